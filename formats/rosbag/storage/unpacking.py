"""Chunks and messages unpacked within limits: a few bytes must not become gigabytes."""

from __future__ import annotations

import sys
from bz2 import BZ2Decompressor
from typing import TYPE_CHECKING, Any

import lz4.frame  # type: ignore[import-untyped]

from formats.limits import CHUNK_BYTES, TooMuchError, unpacked_limit

if sys.version_info >= (3, 14):
    from compression import zstd
else:
    from backports import zstd

if TYPE_CHECKING:
    from collections.abc import Callable

_MAKERS: dict[str, Callable[[], Any]] = {
    "lz4": lz4.frame.LZ4FrameDecompressor,
    "zstd": zstd.ZstdDecompressor,
    "bz2": BZ2Decompressor,
}

#: LZ4 packs 255 times at its best: as much as this cannot become more than 1 GiB.
_LZ4_AT_ONCE = 4 << 20


def unpack(packed: bytes | memoryview, packing: str, most: int = CHUNK_BYTES) -> bytes:
    """Unpack a chunk or a message ("lz4", "zstd", "bz2", "none" or "") to so many bytes at the most.

    TooMuchError beyond that, or beyond `formats.limits.unpacked_limit`; ValueError where it is cut off, or
    packed in an unknown way; of corrupt bytes what the library below raises.
    """
    if packing in {"", "none"}:
        return bytes(packed)
    if packing not in _MAKERS:
        raise ValueError(f"packed with {packing[:40]!r}, which is not known")
    limit = unpacked_limit(len(packed), min(most, CHUNK_BYTES))
    parts, size, rest = [], 0, bytes(packed)
    while rest:
        if packing == "lz4" and len(rest) <= _LZ4_AT_ONCE and _claimed(rest) <= limit - size:
            part, rest = _lz4_frame(rest)
            size += len(part)
        else:
            unpacker = _MAKERS[packing]()
            part = unpacker.decompress(rest, max_length=limit - size + 1)
            size += len(part)
            if size <= limit and not unpacker.eof:
                raise ValueError(f"its {packing} data end too early")
            rest = unpacker.unused_data or b""
        if size > limit:
            ratio = "" if limit == CHUNK_BYTES else f", from {len(packed):,} packed with {packing}"
            raise TooMuchError(f"a chunk unpacks to more than {limit:,} bytes{ratio}")
        parts.append(part)
    return b"".join(parts)


def _lz4_frame(data: bytes) -> tuple[bytes, bytes]:
    """Unpack one frame in half the time of a decompressor; return what follows it too."""
    try:
        part, read = lz4.frame.decompress(data, return_bytes_read=True)
    except RuntimeError as error:
        if "incomplete" in str(error):
            raise ValueError("its lz4 data end too early") from error
        raise
    return part, data[read:]


def _claimed(data: bytes) -> int:
    """Return the size that a frame states, if any: lz4 makes room for it at once, be it true or not."""
    return int.from_bytes(data[6:14], "little") if len(data) > 4 and data[4] & 0x08 else 0


def unpacks(packed: bytes, packing: str) -> bool:
    """Tell whether something can be unpacked."""
    try:
        unpack(packed, packing)
    except Exception:  # noqa: BLE001 - the libraries raise anything
        return False
    return True
