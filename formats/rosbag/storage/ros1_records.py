"""What a ROS 1 bag is made of: records, and checksums of its message definitions.

A record is a header of named fields, then data, each with its length: http://wiki.ros.org/Bags/Format/2.0.
The checksum is noted by each connection beside its definition. As ``genmsg`` computes it: MD5 of the
constants, then of the fields in their order, without comments and spaces, each message type in place of
which its own checksum stands.
"""

from __future__ import annotations

import re
import struct
from dataclasses import dataclass
from hashlib import md5
from typing import TYPE_CHECKING, Any

from formats.rosbag.storage.record_file import BrokenRecordError, CutOffError

if TYPE_CHECKING:
    from collections.abc import Iterator

SECOND = 1_000_000_000
_LONGEST_HEADER = 1 << 20
_BUILT_IN = frozenset(
    {"bool", "byte", "char", "string", "time", "duration", "float32", "float64"}
    | {f"{sign}int{bits}" for sign in ("", "u") for bits in (8, 16, 32, 64)}
)
_DEEPEST = 50


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


class _UnknownError(Exception):
    """Not all that the checksum covers can be told."""


def checksum(text: str, type_name: str) -> str | None:
    """Return the checksum of a definition, behind which are those of its parts, as bags hold it.

    None where it cannot be told: a type is missing, or a constant is a number with a fraction or a text,
    which tools write in more than one way.
    """
    main, *others = re.split(r"^=+\n", text, flags=re.MULTILINE)
    sections = {_short(type_name): main}
    for section in others:
        first, _, rest = section.partition("\n")
        sections[first.removeprefix("MSG:").strip()] = rest
    try:
        return _of(_short(type_name), sections, {}, 0)
    except _UnknownError:
        return None


def _short(name: str) -> str:
    return name.replace("/msg/", "/")


def _of(name: str, sections: dict[str, str], known: dict[str, str], depth: int) -> str:
    if name in known:
        return known[name]
    if name not in sections or depth > _DEEPEST:
        raise _UnknownError
    constants, fields = [], []
    for line in sections[name].split("\n"):
        kind, _, rest = line.partition("#")[0].strip().partition(" ")
        rest = rest.strip()
        if not kind:
            continue
        if "=" in rest:
            if kind in {"string", "float32", "float64"}:
                raise _UnknownError
            constant, _, value = rest.partition("=")
            constants.append(f"{kind} {constant.strip()}={value.strip()}")
            continue
        base = kind.partition("[")[0]
        if base in _BUILT_IN:
            fields.append(f"{kind} {rest}")
            continue
        package = name.partition("/")[0]
        full = "std_msgs/Header" if base == "Header" else base if "/" in base else f"{package}/{base}"
        fields.append(f"{_of(full, sections, known, depth + 1)} {rest}")
    known[name] = md5("\n".join([*constants, *fields]).encode(), usedforsecurity=False).hexdigest()
    return known[name]
