"""Columns out of decoded messages: the plain way, and the measure of the fast one."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
from rosbags.typesys.base import normalize_fieldname

from formats.rosbag.decoding.definitions import DURATION
from formats.table import Labels

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from numpy.typing import NDArray

    from formats.rosbag.decoding.definitions import Leaf, Path
    from formats.table import Kind

NAT = np.datetime64("NaT", "ns")

#: float64, datetime64[ns], or object (str, or None where there is none).
Values: TypeAlias = "NDArray[Any]"


@dataclass(frozen=True, slots=True)
class FieldRequest:
    """What is asked of each message."""

    asked: str  # As the caller wrote it
    field: str  # Name of the leaf
    kind: Kind  # What comes out, one per message
    #: Which element of a list: its place or its name; None where the field is no list.
    key: int | str | None = None

    def blank(self, rows: int) -> Values:
        if self.kind == "text":
            return np.full(rows, None, dtype=object)
        return np.full(rows, np.nan) if self.kind == "number" else np.full(rows, NAT)


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


def elements_of(message: object, leaf: Leaf) -> tuple[tuple[str, ...], bool]:
    """Tell how the elements of a list are called: by the names beside it if these fit (and True)."""
    values = _walk(message, leaf.path)
    names = _names(message, values, leaf)
    if names and len(names) == len(values) == len(set(names)) and all(names):
        return tuple(names), True
    return tuple(str(place) for place in range(len(values))), False


def labels(texts: Iterable[str | None]) -> Labels:
    """Turn texts into codes; None has the code −1."""
    places: dict[str, int] = {}
    codes = [-1 if text is None else places.setdefault(text, len(places)) for text in texts]
    return Labels(np.array(codes, dtype=np.int32), tuple(places))


def _walk(message: object, path: Path) -> Any:
    for member in path:
        message = getattr(message, normalize_fieldname(member))
    return message


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
