"""The unpacked sizes that a Parquet file states: pyarrow allocates them, whether they are true or not.

Read without pyarrow, which ends the whole process where the index of a column contradicts itself: footer
and heads of pages are structs of Thrift's compact protocol.
"""

import os
import re
from collections.abc import Collection, Iterator
from pathlib import Path
from typing import Any

from formats.limits import TooMuchError, unpacked_limit

#: Bytes that the head of a page nearly always has, and those that it may have.
_USUAL_HEAD, _HEAD = 1 << 8, 1 << 16
_DEEPEST = 12
#: Numbers of the kinds: true and false, integers, bytes, list and set, struct.
_FLAGS, _INTEGERS, _BYTES, _LISTS, _STRUCT = (1, 2), (4, 5, 6), 8, (9, 10), 12
_FIXED = {1: 0, 2: 0, 3: 1, 7: 8}  # Bytes of those of one size: true, false, byte, double
#: Numbers of the fields, by parquet.thrift.
_ROW_GROUPS, _COLUMNS, _COLUMN = 4, 1, 3
_PACKED_SIZE, _DATA, _DICTIONARY = 7, 9, 11
_PAGE_SIZE, _PAGE_PACKED = 2, 3
#: A head with a checksum: it follows kind, size and packed size, an integer of 32 bits as they are.
_CHECKSUM = re.compile(rb"(?:\x15[\x80-\xff]{0,8}[\x00-\x7f]){4}")


def check_pages(file: str, leaves: Collection[int] | None = None) -> bool:
    """Refuse a file with a page that claims far more than can be in it; tell if each has a checksum."""
    # What is damaged otherwise is passed over: pyarrow tells.
    with Path(file).open("rb", buffering=0) as stream:
        number = stream.fileno()
        whole = os.fstat(number).st_size
        size = int.from_bytes(os.pread(number, 4, max(0, whole - 8)), "little")
        try:
            footer, _ = _struct(os.pread(number, min(size, whole), max(0, whole - 8 - size)), 0, 0)
        except (IndexError, ValueError):
            return False
        checksums = []
        for first, end in _columns(footer, leaves):
            at = first
            while 0 <= at < min(end, whole):
                try:
                    unpacked, packed, length, checksum = _head(number, at)
                except (IndexError, ValueError):
                    checksums.append(False)
                    break
                checksums.append(checksum)
                if unpacked > unpacked_limit(max(packed, 0)):
                    raise TooMuchError(f"a page claims to unpack to {unpacked:,} bytes, from {packed:,}")
                at += length + max(packed, 0)
                if at > whole:
                    raise TooMuchError(f"a page claims {packed:,} bytes, more than the file has")
    return bool(checksums) and all(checksums)


def _head(number: int, at: int) -> tuple[int, int, int, bool]:
    """Return what the page there unpacks to, its bytes, those of its head, and if it has a checksum."""
    begin = os.pread(number, _USUAL_HEAD, at)
    try:
        head, length = _struct(begin, 0, 0)
    except IndexError:
        head, length = _struct(os.pread(number, _HEAD, at), 0, 0)
    checksum = _CHECKSUM.match(begin) is not None
    return _number(head, _PAGE_SIZE), _number(head, _PAGE_PACKED), length, checksum


def _columns(footer: dict[int, Any], leaves: Collection[int] | None) -> Iterator[tuple[int, int]]:
    """Yield where the pages of each of these columns begin and end."""
    for group in _list(footer, _ROW_GROUPS):
        for leaf, chunk in enumerate(_list(group, _COLUMNS)):
            if leaves is not None and leaf not in leaves:
                continue
            column = chunk.get(_COLUMN) if isinstance(chunk, dict) else None
            if isinstance(column, dict):
                at, first = _number(column, _DATA), _number(column, _DICTIONARY)
                at = first if 0 < first < at else at
                yield at, at + _number(column, _PACKED_SIZE)


def _list(struct: Any, field: int) -> list[Any]:
    value = struct.get(field) if isinstance(struct, dict) else None
    return value if isinstance(value, list) else []


def _number(struct: dict[int, Any], field: int) -> int:
    value = struct.get(field)
    return value if isinstance(value, int) else 0


def _struct(data: bytes, at: int, depth: int) -> tuple[dict[int, Any], int]:
    """Return the values of a struct by the number of their field, and where it ends."""
    found: dict[int, Any] = {}
    field = 0
    while data[at]:
        step, kind = data[at] >> 4, data[at] & 0x0F
        at += 1
        if step:
            field += step
        else:
            field, at = _integer(data, at)
        found[field], at = _value(data, at, kind, depth)
    return found, at + 1


def _value(data: bytes, at: int, kind: int, depth: int) -> tuple[Any, int]:
    """Return an integer, a list or a struct, else None; and where it ends."""
    if depth > _DEEPEST:
        raise ValueError("nested too deep")
    if kind in _FIXED:
        return None, at + _FIXED[kind]
    if kind in _INTEGERS:
        return _integer(data, at)
    if kind == _BYTES:
        size, at = _varint(data, at)
        return None, at + size
    if kind == _STRUCT:
        return _struct(data, at, depth + 1)
    if kind not in _LISTS:
        raise ValueError("no kind of Thrift")
    size, inner = data[at] >> 4, data[at] & 0x0F
    at += 1
    if size == 15:
        size, at = _varint(data, at)
    values = []
    for _ in range(size):
        if at >= len(data):
            raise IndexError
        value, at = _value(data, at, inner, depth + 1)
        values.append(value)
        at += inner in _FLAGS
    return values, at


def _integer(data: bytes, at: int) -> tuple[int, int]:
    value, at = _varint(data, at)
    return (value >> 1) ^ -(value & 1), at


def _varint(data: bytes, at: int) -> tuple[int, int]:
    value = shift = 0
    while data[at] & 0x80:
        value |= (data[at] & 0x7F) << shift
        at, shift = at + 1, shift + 7
        if shift > 63:
            raise ValueError("no number")
    return value | data[at] << shift, at + 1
