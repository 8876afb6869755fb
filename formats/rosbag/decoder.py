"""Payloads of one connection to columns: the fast way where it holds, else message by message."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from functools import reduce
from typing import Any

import numpy as np
from rosbags.typesys.base import normalize_fieldname

from formats.recovery import Recovery
from formats.rosbag.bulk_extraction import Elements, UnevenError, called, elements, gather
from formats.rosbag.definitions import DURATION, Definition, FieldRequest, Leaf, Path, Values
from formats.rosbag.storage.chunks import Run
from formats.rosbag.storage.raw_messages import Messages
from formats.table import STAMP, Kind, Labels


class UndecodableError(Exception):
    """A message does not follow its definition; `row` is its place among the payloads."""

    def __init__(self, row: int, reason: str) -> None:
        super().__init__(reason)
        self.row = row


def columns(
    definition: Definition, messages: Messages, requests: Sequence[FieldRequest]
) -> list[tuple[Values, bool]]:
    """Take one value per request from each message, and tell whether any message has it."""
    leaves = [_leaf(definition, request) for request in requests]
    wanted = [(leaf, request) for leaf, request in zip(leaves, requests, strict=True) if leaf is not None]
    try:
        found = iter(gather(definition, messages, wanted))
    except UnevenError:
        plain = [decoded(definition, messages.payload(row), row) for row in range(len(messages))]
        found = iter([extract(plain, leaf, request) for leaf, request in wanted])
    return [
        (request.blank(len(messages)), False) if leaf is None else next(found)
        for leaf, request in zip(leaves, requests, strict=True)
    ]


def first_elements(definition: Definition, message: Messages, lists: Sequence[Leaf]) -> list[Elements]:
    try:
        return elements(definition, message, lists)
    except UnevenError:
        plain = decoded(definition, message.payload(0))
        return [elements_of(plain, leaf) for leaf in lists]


def decoded(definition: Definition, payload: bytes, row: int = 0) -> object:
    try:
        store = definition.store
        decode = store.deserialize_ros1 if definition.ros1 else store.deserialize_cdr
        return decode(payload, definition.type)
    except Exception as error:  # rosbags answers damaged bytes and texts with any exception there is
        raise UndecodableError(row, " ".join(str(error).split())[:160] or type(error).__name__) from error


def _leaf(definition: Definition, request: FieldRequest) -> Leaf | None:
    """Find the field in this definition, which need not be the one it was listed by."""
    if request.asked == STAMP and not definition.stamped:
        return None
    leaf = definition.leaves.get(request.field)
    plural = "" if request.key is None else "s"
    return leaf if leaf is not None and leaf.kind == request.kind + plural else None


class Decodable:
    """Sets aside messages of a damaged bag that cannot be decoded, and keeps recovery and remarks right."""

    def __init__(self, recovery: Recovery, remarks: list[str]) -> None:
        self._recovery = recovery
        self._remarks = remarks
        self._told = recovery.sentences()
        self._known: set[tuple[int, int]] = set()
        remarks[:0] = self._told

    def only(self, runs: Iterable[Run], definitions: Mapping[int, Definition]) -> Iterator[Run]:
        for run in runs:
            kept = {place: self._kept(place, messages, definitions[place]) for place, messages in run.items()}
            yield {place: messages for place, messages in kept.items() if len(messages)}

    def _kept(self, place: int, messages: Messages, definition: Definition) -> Messages:
        if not len(messages):
            return messages
        try:
            gather(definition, messages, _texts(definition, messages))
        except (UnevenError, UndecodableError):
            right = np.array([_decodes(definition, messages, row) for row in range(len(messages))])
            self._note(place, messages.order[~right].tolist())
            return messages.take(right)
        return messages

    def _note(self, place: int, orders: list[int]) -> None:
        new = {(place, order) for order in orders} - self._known
        if not new:
            return
        self._known |= new
        self._recovery.aside += len(new)
        self._recovery.read -= len(new)
        for sentence in self._told:
            self._remarks.remove(sentence)
        self._told = self._recovery.sentences()
        self._remarks[:0] = self._told


def _texts(definition: Definition, messages: Messages) -> list[tuple[Leaf, FieldRequest]]:
    """Ask for every text of the messages: numbers are right in any bytes, texts are not."""
    leaves = definition.leaves.values()
    wanted = [(leaf, FieldRequest(leaf.name, leaf.name, "text")) for leaf in leaves if leaf.kind == "text"]
    if lists := [leaf for leaf in leaves if leaf.kind == "texts"]:
        first = decoded(definition, messages.payload(0))
        for leaf in lists:
            places = range(len(elements_of(first, leaf)[0]))
            asked = {place: f"{leaf.name}[{place}]" for place in places}
            wanted += [(leaf, FieldRequest(name, leaf.name, "text", place)) for place, name in asked.items()]
    return wanted


def _decodes(definition: Definition, messages: Messages, row: int) -> bool:
    try:
        decoded(definition, messages.payload(row))
    except UndecodableError:
        return False
    return True


def extract(messages: Sequence[object], leaf: Leaf, request: FieldRequest) -> tuple[Values, bool]:
    """Take one value from each message; tell whether some message has the element asked for, be it NaN."""
    column, present = request.blank(len(messages)), False
    for i, message in enumerate(messages):
        value = _walk(message, leaf.path)
        if request.key is not None:
            value = _element(message, value, leaf, request.key)
        if value is not None:
            column[i], present = _plain(value, leaf.base, request.kind), True
    return column, present


def elements_of(message: object, leaf: Leaf) -> Elements:
    """Tell how the elements of a list are called: by the names beside it if these fit (and True)."""
    values = _walk(message, leaf.path)
    return called(_names(message, values, leaf), len(values))


def labels(texts: Iterable[str | None]) -> Labels:
    """Turn texts into codes; None has the code −1."""
    places: dict[str, int] = {}
    codes = [-1 if text is None else places.setdefault(text, len(places)) for text in texts]
    return Labels(np.array(codes, dtype=np.int32), tuple(places))


def _walk(message: object, path: Path) -> Any:
    return reduce(getattr, map(normalize_fieldname, path), message)


def _names(message: object, values: Sequence[Any], leaf: Leaf) -> list[str]:
    if leaf.names is None:
        return []
    if leaf.inner:
        return [_walk(element, leaf.names) for element in values]
    return list(_walk(message, leaf.names))


def _element(message: object, values: Sequence[Any], leaf: Leaf, key: int | str) -> Any:
    if isinstance(key, str):
        names = _names(message, values, leaf)
        key = names.index(key) if key in names else len(values)
    return _walk(values[key], leaf.inner) if key < len(values) else None


def _plain(value: Any, base: str, kind: Kind) -> Any:
    if kind == "time":
        return np.datetime64(value.sec * 1_000_000_000 + value.nanosec, "ns")
    if base == DURATION:
        return value.sec + value.nanosec / 1e9
    return value
