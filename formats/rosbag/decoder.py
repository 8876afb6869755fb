"""Payloads of one connection to columns: all at once, or as few at once as are laid out alike."""

from collections.abc import Iterable, Iterator, Mapping, Sequence

import numpy as np

from formats.recovery import Recovery
from formats.rosbag.bulk_extraction import Elements, Found, UnevenError, Wanted, elements, gather
from formats.rosbag.definitions import Definition, FieldRequest, Leaf
from formats.rosbag.storage.chunks import Run
from formats.rosbag.storage.raw_messages import Messages
from formats.table import STAMP, Labels


class UndecodableError(Exception):
    """A message does not follow its definition; `row` is its place among the payloads."""

    def __init__(self, row: int, reason: str) -> None:
        super().__init__(reason)
        self.row = row


def columns(definition: Definition, messages: Messages, requests: Sequence[FieldRequest]) -> list[Found]:
    """Take one value per request from each message, and tell whether any message has it."""
    leaves = [_leaf(definition, request) for request in requests]
    wanted = [(leaf, request) for leaf, request in zip(leaves, requests, strict=True) if leaf is not None]
    found = iter(_gathered(definition, messages, wanted))
    return [
        (request.blank(len(messages)), False) if leaf is None else next(found)
        for leaf, request in zip(leaves, requests, strict=True)
    ]


def _gathered(definition: Definition, messages: Messages, wanted: Sequence[Wanted]) -> list[Found]:
    """Gather from all messages at once; where they are uneven by their sizes, then from each by itself."""
    try:
        return gather(definition, messages, wanted)
    except UnevenError as error:
        if len(messages) == 1:
            raise UndecodableError(0, str(error)) from error
    order = np.argsort(messages.sizes, kind="stable")
    changes = np.flatnonzero(np.diff(messages.sizes[order])) + 1
    found = [request.blank(len(messages)) for _, request in wanted]
    present = [False] * len(wanted)
    wrong = []
    for rows in np.split(order, changes if len(changes) else len(order)):
        try:
            parts = _gathered(definition, messages.take(rows), wanted)
        except UndecodableError as error:
            wrong.append((int(rows[error.row]), str(error)))
            continue
        for i, (values, there) in enumerate(parts):
            found[i][rows] = values
            present[i] = present[i] or there
    if wrong:
        raise UndecodableError(*min(wrong))
    return list(zip(found, present, strict=True))


def first_elements(definition: Definition, message: Messages, lists: Sequence[Leaf]) -> list[Elements]:
    try:
        return elements(definition, message, lists)
    except UnevenError as error:
        raise UndecodableError(0, str(error)) from error


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
        if len(messages) and not _decodes(definition, messages):
            right = np.array(
                [_decodes(definition, messages.take(slice(row, row + 1))) for row in range(len(messages))]
            )
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


def _decodes(definition: Definition, messages: Messages) -> bool:
    """Ask for every text of the messages: numbers are right in any bytes, texts are not."""
    leaves = definition.leaves.values()
    wanted = [(leaf, FieldRequest(leaf.name, leaf.name, "text")) for leaf in leaves if leaf.kind == "text"]
    lists = [leaf for leaf in leaves if leaf.kind == "texts"]
    try:
        for leaf, (names, _) in zip(lists, elements(definition, messages.take(slice(1)), lists), strict=True):
            wanted += [(leaf, FieldRequest(leaf.name, leaf.name, "text", i)) for i in range(len(names))]
        gather(definition, messages, wanted)
    except UnevenError:
        return False
    return True


def labels(texts: Iterable[str | None]) -> Labels:
    """Turn texts into codes; None has the code −1."""
    places: dict[str, int] = {}
    codes = [-1 if text is None else places.setdefault(text, len(places)) for text in texts]
    return Labels(np.array(codes, dtype=np.int32), tuple(places))
