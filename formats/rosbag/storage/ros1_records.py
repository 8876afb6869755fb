"""The records of ROS 1 bags: a header of named fields, then data, each with its length."""

import struct
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from formats.rosbag.storage.raw_messages import Index, numbers_at, parts_at
from formats.rosbag.storage.record_file import BrokenRecordError, CutOffError

MESSAGE, HEADER, INDEX, CHUNK, CHUNK_INFO, CONNECTION = 2, 3, 4, 5, 6, 7
SECOND = 1_000_000_000
_LONGEST_HEADER = 1 << 20
#: Names and sizes of what the header of a message holds, in any order.
_FIELDS = {b"op": 1, b"conn": 4, b"time": 8}


@dataclass(frozen=True, slots=True)
class BagRecord:
    """One record; its data need not all be there."""

    fields: dict[bytes, bytes]
    #: Where its data begin, and end.
    begin: int
    end: int

    @property
    def code(self) -> int:
        """What it is; 0 where it does not tell."""
        return self.fields.get(b"op", b"\0")[0] if len(self.fields.get(b"op", b"")) == 1 else 0

    def number(self, name: bytes, code: str = "<I") -> int:
        value: int = struct.unpack(code, self.fields.get(name, b""))[0]
        return value

    def time(self, name: bytes = b"time") -> int:
        """Return a field that is a time, ns."""
        seconds, rest = struct.unpack("<II", self.fields.get(name, b""))
        if rest >= SECOND:
            raise BrokenRecordError("a time")
        return int(seconds) * SECOND + int(rest)


def read_record(data: Any, at: int) -> BagRecord:
    """Read the header of a record; its data may end beyond those that are there."""
    if at + 4 > len(data):
        raise CutOffError(f"a record at byte {at:,}")
    (length,) = struct.unpack_from("<I", data, at)
    begin, end = at + 4, at + 4 + length
    if length > _LONGEST_HEADER:
        raise BrokenRecordError(f"a record that begins at byte {at:,}")
    if end + 4 > len(data):
        raise CutOffError(f"a record that begins at byte {at:,}")
    (stored,) = struct.unpack_from("<I", data, end)
    return BagRecord(fields_of(data[begin:end]), end + 4, end + 4 + stored)


def fields_of(header: bytes) -> dict[bytes, bytes]:
    fields, at = {}, 0
    while at < len(header):
        (size,) = struct.unpack_from("<I", header, at)
        name, sign, value = header[at + 4 : at + 4 + size].partition(b"=")
        at += 4 + size
        if not sign or at > len(header):
            raise BrokenRecordError("the header of a record")
        fields[name] = value
    return fields


def data_of(buffer: bytes, number: int, times: Index, records: Index) -> Index:
    """Return where the data of messages begin, of one connection; ValueError where one is another's."""
    lengths = numbers_at(buffer, records, "<u4").astype(np.int64)
    known = np.zeros(len(records), dtype=bool)
    ordered = np.sort(lengths)
    # np.unique would import numpy.ma, which takes longer than a short bag.
    for length in ordered[np.diff(ordered, prepend=-1) > 0]:
        # Writers put the fields in one order, so that the first header of a length tells of all.
        rows = np.flatnonzero(lengths == length)
        first = int(records[rows[0]]) + 4
        places = _places(buffer[first : first + int(length)])
        if places is not None:
            heads = _heads(buffer, records[rows], int(length), places)
            at = heads["sec"].astype(np.int64) * SECOND + heads["nsec"]
            right = (heads["op"] == MESSAGE) & (heads["conn"] == number)
            known[rows] = right & (at == times[rows])
    data = records + 4 + lengths
    for row in np.flatnonzero(~known):
        record = read_record(buffer, int(records[row]))
        while record.code == CONNECTION:
            # Some writers let the index point at the connection that stands before its first message.
            record = read_record(buffer, record.end)
        if (record.code, record.number(b"conn"), record.time()) != (MESSAGE, number, times[row]):
            raise ValueError("an index and the message it points at differ")
        data[row] = record.begin - 4
    return data


def _places(header: bytes) -> dict[bytes, int] | None:
    """Return where the values of the header of a message begin; None if they are not all there."""
    places, at = {}, 0
    while at + 4 <= len(header):
        size = int.from_bytes(header[at : at + 4], "little")
        name, sign, value = header[at + 4 : at + 4 + size].partition(b"=")
        if not sign:
            return None
        if len(value) == _FIELDS.get(name):
            places[name] = at + 4 + len(name) + 1
        at += 4 + size
    return places if len(places) == len(_FIELDS) and at == len(header) else None


def _heads(buffer: bytes, records: Index, length: int, places: Mapping[bytes, int]) -> NDArray[Any]:
    """Return the headers of messages of which all have this length and these places of fields."""
    begins = [4 + places[name] for name in (b"op", b"conn", b"time")]
    begins.append(begins[-1] + 4)
    kinds: Any = {"names": ["op", "conn", "sec", "nsec"], "formats": ["u1", "<u4", "<u4", "<u4"]}
    layout = np.dtype(kinds | {"offsets": begins, "itemsize": 4 + length})
    return parts_at(buffer, records, layout.itemsize).view(layout)
