"""The records that a ROS 1 bag is made of: a header of named fields, then data, each with its length.

http://wiki.ros.org/Bags/Format/2.0
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Iterator

SECOND = 1_000_000_000
_LONGEST_HEADER = 1 << 20


class BrokenRecordError(ValueError):
    """A record does not add up."""


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
        """Return a field that is a number."""
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
    (length,) = struct.unpack_from("<I", data, at)
    begin, end = at + 4, at + 4 + length
    if length > _LONGEST_HEADER or end + 4 > len(data):
        raise BrokenRecordError(f"a record that begins at byte {at:,}")
    (stored,) = struct.unpack_from("<I", data, end)
    return BagRecord(fields_of(data[begin:end]), end + 4, end + 4 + stored)


def fields_of(header: bytes) -> dict[bytes, bytes]:
    """Return the fields of a header by their names."""
    fields, at = {}, 0
    while at < len(header):
        (size,) = struct.unpack_from("<I", header, at)
        name, sign, value = header[at + 4 : at + 4 + size].partition(b"=")
        at += 4 + size
        if not sign or at > len(header):
            raise BrokenRecordError("the header of a record")
        fields[name] = value
    return fields


def records(raw: bytes) -> Iterator[tuple[int, BagRecord | None]]:
    """Yield place and record of all in a chunk; None at the first that does not fit."""
    at = 0
    while at < len(raw):
        try:
            record = read_record(raw, at)
        except (BrokenRecordError, struct.error):
            yield at, None
            return
        if record.end > len(raw):
            yield at, None
            return
        yield at, record
        at = record.end
