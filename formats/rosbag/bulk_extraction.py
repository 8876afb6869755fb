"""Fields of many messages at once, gathered with NumPy from their joined payloads.

A cursor walks the definition once for all messages of a batch. Its place in a message is one number as long
as it is the same in all of them, and an array once a text or a list has differed in length. Where the layout
itself differs, or anything does not add up, it is an `UnevenError`; of a single message that says what is
wrong with it.

ROS 1 packs its members without gaps. CDR aligns each number to its size, counted from the end of the 4-byte
header; an empty list adds no gap for its elements.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray
from rosbags.interfaces import Nodetype
from rosbags.interfaces.typing import FieldDesc

from formats.limits import WALKED
from formats.rosbag.definitions import (
    CODES,
    DURATION,
    FILLER,
    TIME,
    Definition,
    FieldRequest,
    Leaf,
    Values,
    members,
)
from formats.rosbag.storage.raw_messages import Messages, numbers_at, parts_at

Elements: TypeAlias = tuple[tuple[str, ...], bool]  # Names or places, and whether they are names
Found: TypeAlias = tuple[Values, bool]  # A column, and whether any message has a value for it
Wanted: TypeAlias = tuple[Leaf, FieldRequest]
Places: TypeAlias = int | NDArray[np.int64]  # One number for all messages, or one for each

_SIZES = {base: int(code[1]) for base, code in CODES.items()}  # Bytes of each number
#: The byte order by the first two bytes of a payload in CDR, read as a little-endian number.
ORDERS = {0x0100: "<", 0x0000: ">"}


class UnevenError(Exception):
    """These messages cannot be read all at once."""


class _Spot(NamedTuple):
    """Where something begins, and how many numbers or bytes of text it has."""

    begin: Places
    size: Places = 1
    constant: bytes | None = None  # The bytes of a text that is the same in all messages


def gather(definition: Definition, messages: Messages, wanted: Sequence[Wanted]) -> list[Found]:
    """Take values from all messages, one at least; UnevenError if they cannot be read all at once."""
    needed = {leaf.name for leaf, _ in wanted}
    needed |= {_names_of(leaf) for leaf, request in wanted if isinstance(request.key, str)}
    cursor = _Cursor(definition, messages, needed)
    return [cursor.values(leaf, request) for leaf, request in wanted]


def elements(definition: Definition, message: Messages, lists: Sequence[Leaf]) -> list[Elements]:
    """Tell how the elements of lists are called: by the names beside them if these fit (and True)."""
    wanted = {name for leaf in lists for name in (leaf.name, _names_of(leaf)) if name}
    cursor = _Cursor(definition, message, wanted)
    return [cursor.elements(leaf) for leaf in lists]


def _names_of(leaf: Leaf) -> str:
    """Return the name of the texts that name the elements of a list; empty if none do."""
    if leaf.names is None:
        return ""
    return ".".join(leaf.path + leaf.names if leaf.inner else leaf.names)


class _Cursor:
    def __init__(self, definition: Definition, messages: Messages, wanted: set[str]) -> None:
        self._definition = definition
        self._aligned = not definition.ros1
        self._order, head = "<", 0
        self._rows = len(messages)
        self._buffer: bytes | memoryview | NDArray[np.uint8] = messages.buffer
        starts, sizes = messages.starts, messages.sizes
        self._stride = int(sizes[0]) if (sizes == sizes[0]).all() else 0
        if self._stride:
            # Put together they are read by strides, which is faster than from here and there.
            self._buffer = parts_at(messages.buffer, starts, self._stride)
            starts = np.arange(self._rows) * self._stride
        if self._aligned:
            head = 4
            if int(sizes.min()) < head:
                raise UnevenError("it is shorter than the header of CDR")
            headers = numbers_at(self._buffer, starts, "<u2")
            if (headers != headers[0]).any() or int(headers[0]) not in ORDERS:
                raise UnevenError("its encapsulation is not that of plain CDR")
            self._order = ORDERS[int(headers[0])]
        self._starts = starts + head
        self._sizes = sizes - head
        self._least = int(self._sizes.min())
        #: One spot for a scalar or a list of numbers, one per element for texts and messages.
        self._spots: dict[str, list[_Spot]] = {name: [] for name in wanted}
        self._indices: dict[tuple[str, str], Places] = {}
        self._at: Places = 0
        self._walked = 0
        self._message(definition.type, "")
        rest = self._sizes - self._at
        # CDR may be padded to a multiple of 4.
        if (rest < 0).any() or (rest > (3 if self._aligned else 0)).any():
            raise UnevenError("it is longer than its members")

    def _message(self, type_name: str, prefix: str) -> None:
        for name, desc in members(self._definition.types, type_name):
            if name != FILLER or self._aligned:
                self._member(desc, prefix + name)

    def _member(self, desc: FieldDesc, name: str) -> None:
        if desc[0] == Nodetype.BASE:
            if desc[1][0] == "string":
                self._text(name)
            else:
                self._numbers(desc[1][0], 1, name)
        elif desc[0] == Nodetype.NAME:
            if desc[1] in {TIME, DURATION}:
                self._numbers("int32", 2, name)
            else:
                self._message(desc[1], name + ".")
        else:
            element, length = desc[1]
            count = length if desc[0] == Nodetype.ARRAY else self._uint32()
            if element[0] == Nodetype.BASE and element[1][0] != "string":
                self._numbers(element[1][0], count, name)
                return
            if not isinstance(count, int):
                raise UnevenError
            self._walked += count
            if self._walked > WALKED:
                raise UnevenError(f"its lists have more than {WALKED:,} texts or messages")
            for _ in range(count):
                self._member(element, name)

    def _numbers(self, base: str, count: Places, name: str) -> None:
        size = _SIZES[base]
        if self._aligned and size > 1:
            aligned = (self._at + size - 1) & -size
            if isinstance(count, int):
                self._at = aligned if count else self._at
            else:
                self._at = np.where(count > 0, aligned, self._at)
        if name in self._spots:
            self._spots[name].append(_Spot(self._at, count))
        self._advance(count * size)

    def _text(self, name: str) -> None:
        length = self._uint32()
        begin = self._at
        self._advance(length)
        if self._aligned:
            length -= 1
            if np.any(length < 0) or self._take(begin + length, "u1").any():
                raise UnevenError("a text of it does not end with NUL")
        if name in self._spots:
            self._spots[name].append(_Spot(begin, length, self._constant(begin, length)))

    def _constant(self, begin: Places, length: Places) -> bytes | None:
        if not (self._stride and isinstance(begin, int) and isinstance(length, int)):
            return None
        first = int(self._starts[0]) + begin
        texts = np.ndarray((self._rows, length), "u1", self._buffer, first, (self._stride, 1))
        return texts[0].tobytes() if (texts == texts[0]).all() else None

    def _uint32(self) -> Places:
        if self._aligned:
            self._at = (self._at + 3) & -4
        begin = self._at
        self._advance(4)
        return _one(self._take(begin, "u4").astype(np.int64))

    def _advance(self, count: Places) -> None:
        end = self._at + count
        if end > self._least if isinstance(end, int) else (end > self._sizes).any():
            raise UnevenError("it ends too early")
        self._at = _one(end)

    def _take(self, begin: Places, code: str, rows: NDArray[np.int64] | None = None) -> NDArray[Any]:
        """Read one number at a place of every message, or of some."""
        size = int(code[1])
        windows = np.ndarray((len(self._buffer) - size + 1,), self._order + code, self._buffer, strides=(1,))
        if rows is None and self._stride and isinstance(begin, int):
            first = int(self._starts[0]) + begin
            return windows[first :: self._stride][: self._rows]
        places = self._starts + begin
        return np.asarray(windows[places if rows is None else places[rows]])

    def elements(self, leaf: Leaf) -> Elements:
        """Return the names of the elements of a list if they fit it, else their places."""
        spots = self._spots[leaf.name]
        one_spot = leaf.kind == "numbers" and not leaf.inner and leaf.base != DURATION
        count = int(spots[0].size if one_spot else len(spots))
        texts = [self._strings(spot, None)[0] for spot in self._spots.get(_names_of(leaf), [])]
        if texts and len(texts) == count == len(set(texts)) and all(texts):
            return tuple(texts), True
        return tuple(map(str, range(count))), False

    def values(self, leaf: Leaf, request: FieldRequest) -> Found:
        """Return the column of a request, and whether any message has a value for it."""
        spots = self._spots[leaf.name]
        if request.key is None:
            return self._values(leaf, spots[0]), True
        index = self._index(leaf, request.key)
        if leaf.kind == "numbers" and not leaf.inner and leaf.base != DURATION:
            return self._of_numbers(leaf, request, spots[0], index)
        return self._of_spots(leaf, request, spots, index)

    def _of_numbers(self, leaf: Leaf, request: FieldRequest, spot: _Spot, index: Places) -> Found:
        element = _Spot(spot.begin + index * _SIZES[leaf.base])
        there = (np.asarray(index) >= 0) & (np.asarray(index) < spot.size)
        if there.all():
            return self._values(leaf, element), True
        column = request.blank(self._rows)
        rows = np.flatnonzero(np.broadcast_to(there, self._rows))
        column[rows] = self._values(leaf, element, rows)
        return column, len(rows) > 0

    def _of_spots(self, leaf: Leaf, request: FieldRequest, spots: list[_Spot], index: Places) -> Found:
        """Take one element from a list whose elements have their own spots."""
        if isinstance(index, int):
            if 0 <= index < len(spots):
                return self._values(leaf, spots[index]), True
            return request.blank(self._rows), False
        column, present = request.blank(self._rows), False
        for place in np.unique(index):
            if 0 <= place < len(spots):
                rows = np.flatnonzero(index == place)
                column[rows], present = self._values(leaf, spots[place], rows), True
        return column, present

    def _index(self, leaf: Leaf, key: int | str) -> Places:
        """Return the place of an element in its list; −1 where no element has that name."""
        if isinstance(key, int):
            return key
        names = _names_of(leaf)
        if (names, key) not in self._indices:
            index: Places = -1
            text = key.encode()
            # Backwards, so that of two elements of one name the first remains.
            for place, spot in reversed(list(enumerate(self._spots[names]))):
                same = self._equals(spot, text)
                index = (
                    np.where(same, place, index) if isinstance(same, np.ndarray) else place if same else index
                )
            self._indices[names, key] = _one(index)
        return self._indices[names, key]

    def _equals(self, spot: _Spot, text: bytes) -> bool | NDArray[np.bool_]:
        if spot.constant is not None:
            return spot.constant == text
        same = np.broadcast_to(np.asarray(spot.size) == len(text), self._rows).copy()
        rows = np.flatnonzero(same)
        begins = (self._starts + spot.begin)[rows]
        letters = np.frombuffer(self._buffer, "u1")[begins[:, None] + np.arange(len(text))]
        same[rows] = (letters == np.frombuffer(text, "u1")).all(axis=1)
        return same

    def _values(self, leaf: Leaf, spot: _Spot, rows: NDArray[np.int64] | None = None) -> Values:
        """Read what is at a spot, in all messages or in some."""
        if leaf.base == "string":
            return self._strings(spot, rows)
        if leaf.base in {TIME, DURATION}:
            seconds, rest = self._take(spot.begin, "i4", rows), self._take(spot.begin + 4, "u4", rows)
            if leaf.base == DURATION:
                return np.asarray(seconds + rest / 1e9)
            return np.asarray(seconds.astype(np.int64) * 1_000_000_000 + rest, dtype="datetime64[ns]")
        numbers = self._take(spot.begin, CODES[leaf.base], rows)
        return np.asarray(numbers != 0 if leaf.base == "bool" else numbers, dtype=np.float64)

    def _strings(self, spot: _Spot, rows: NDArray[np.int64] | None) -> Values:
        count = self._rows if rows is None else len(rows)
        try:
            if spot.constant is not None:
                return np.full(count, spot.constant.decode(), dtype=object)
            begins = self._starts + spot.begin
            ends = begins + spot.size
            if rows is not None:
                begins, ends = begins[rows], ends[rows]
            letters = bytes(self._buffer)
            texts = [letters[a:b] for a, b in zip(begins.tolist(), ends.tolist(), strict=True)]
            decoded = {text: text.decode() for text in set(texts)}
        except UnicodeDecodeError as error:
            raise UnevenError("a text of it is not UTF-8") from error
        column = np.empty(count, dtype=object)
        column[:] = [decoded[text] for text in texts]
        return column


def _one(places: Places) -> Places:
    """Return one number if all are the same."""
    if isinstance(places, int) or (places != places[0]).any():
        return places
    return int(places[0])
