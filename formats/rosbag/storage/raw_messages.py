"""Raw messages of one connection, many at a time, unpacked within limits: one buffer, and their places."""

from __future__ import annotations

import struct
import sys
from bz2 import BZ2Decompressor
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import islice
from typing import Any

import lz4.frame  # type: ignore[import-untyped]
import numpy as np
from numpy.typing import NDArray
from rosbags.interfaces import Connection, ConnectionExtRosbag2, MessageDefinition, MessageDefinitionFormat

from formats.limits import CHUNK_BYTES, TooMuchError, unpacked_limit

Index = NDArray[np.int64]

#: How ROS 2 names the languages of definitions.
FORMATS = {"ros2msg": MessageDefinitionFormat.MSG, "ros2idl": MessageDefinitionFormat.IDL}
NO_DEFINITION = MessageDefinition(MessageDefinitionFormat.NONE, "")
#: `Messages.order` of the first byte of the n-th chunk or piece is n times this: these are smaller.
ORDER = 1 << 40
WILD = 3600 * 10**9  # A log time this far from those around it, in ns, is no time of this log


if sys.version_info >= (3, 14):
    from compression import zstd
else:
    from backports import zstd


_MAKERS: dict[str, Callable[[], Any]] = {
    "lz4": lz4.frame.LZ4FrameDecompressor,
    "zstd": zstd.ZstdDecompressor,
    "bz2": BZ2Decompressor,
}

#: What unpacking raises of bytes that are cut off or corrupt: bz2 an OSError, lz4 a RuntimeError.
CORRUPT = (ValueError, OSError, RuntimeError, zstd.ZstdError)
DAMAGE = (*CORRUPT, EOFError, struct.error)  # What reading the records of a damaged file raises
_COUNTED = 64  # Messages that are taken before their bytes are counted


def unpack(packed: bytes | memoryview, packing: str, most: int = CHUNK_BYTES) -> bytes:
    """Unpack a chunk or a message to so many bytes at the most; TooMuchError, or one of `CORRUPT`."""
    if packing in {"", "none"}:
        return bytes(packed)
    if packing not in _MAKERS:
        raise ValueError(f"packed with {packing[:40]!r}, which is not known")
    limit = unpacked_limit(len(packed), min(most, CHUNK_BYTES))
    parts, size, rest = [], 0, bytes(packed)
    while rest:
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


@dataclass(frozen=True, slots=True)
class Messages:
    """Messages of one connection, in the order of their log times."""

    buffer: bytes | memoryview  # May hold more than these messages
    #: Of each payload, in bytes; shape (n,).
    starts: Index
    sizes: Index
    times: Index  # Log times, ns; shape (n,)
    order: Index  # Rising with the place in the file: what decides between equal times; shape (n,)

    def __len__(self) -> int:
        return len(self.starts)

    def payload(self, row: int) -> bytes:
        start = int(self.starts[row])
        return bytes(self.buffer[start : start + int(self.sizes[row])])

    def take(self, rows: Index | NDArray[np.bool_] | slice) -> Messages:
        return Messages(self.buffer, self.starts[rows], self.sizes[rows], self.times[rows], self.order[rows])

    def sorted(self) -> Messages:
        """Return them in the order of their log times, equal ones in that of the file."""
        return self.take(np.lexsort((self.order, self.times)))


def of_payloads(
    payloads: Sequence[bytes],
    times: Sequence[int] | Index | None = None,
    order: Sequence[int] | Index | None = None,
) -> Messages:
    """Join single messages; log times are in ns, zero if not given, and `order` rises by one if not given."""
    rows = len(payloads)
    sizes = np.fromiter(map(len, payloads), np.int64, rows)
    clock = np.zeros(rows, np.int64) if times is None else np.array(times, dtype=np.int64)
    places = np.arange(rows) if order is None else np.array(order, dtype=np.int64)
    return Messages(b"".join(payloads), np.cumsum(sizes) - sizes, sizes, clock, places)


def collected(messages: Iterable[tuple[int, int, bytes]], size: int) -> Iterator[dict[int, Messages]]:
    """Collect messages (connection, log time in ns, payload) by connection, to pieces of so many bytes."""
    rows = iter(messages)
    done = 0
    while waiting := list(islice(rows, _COUNTED)):
        held = sum(len(row[2]) for row in waiting)
        while held < size and (more := list(islice(rows, _COUNTED))):
            waiting += more
            held += sum(len(row[2]) for row in more)
        connections, times, payloads = zip(*waiting, strict=True)
        joined = of_payloads(payloads, times, range(done, done + len(waiting)))
        done += len(waiting)
        numbers = np.array(connections)
        yield {int(number): joined.take(numbers == number) for number in np.unique(numbers)}


def astray(times: Index) -> NDArray[np.bool_]:
    """Tell which log times (ns, as recorded) are none: far from neighbours that are near each other."""
    # A clock that was set stays where it was set to: its times are right.
    if len(times) < 3:
        return np.zeros(len(times), dtype=bool)
    # Of what damage makes of a time the difference may be beyond what integers hold.
    seconds = times / 1e9
    padded = np.concatenate([seconds[2:3], seconds, seconds[-3:-2]])
    before, behind, far = padded[:-2], padded[2:], WILD / 1e9
    alone = (np.abs(seconds - before) > far) & (np.abs(seconds - behind) > far)
    return np.asarray(alone & (np.abs(before - behind) <= far))


def ros2_connection(
    number: int, topic: str, kind: str, definition: MessageDefinition, digest: str = "", encoding: str = "cdr"
) -> Connection:
    """Describe a topic as rosbags' own readers of ROS 2 do."""
    return Connection(number, topic, kind, definition, digest, 0, ConnectionExtRosbag2(encoding, []), None)


def widen(spans: dict[int, tuple[int, int]], connection: int, times: Index) -> None:
    """Take some log times into the span of a connection, from its first to its last."""
    first, last = int(times.min()), int(times.max())
    start, end = spans.get(connection, (first, last))
    spans[connection] = min(start, first), max(end, last)


def numbers_at(buffer: bytes | memoryview | NDArray[np.uint8], places: Index, code: str) -> NDArray[Any]:
    """Read a number (of NumPy's code, such as "<u4") at each of some places, wherever they are."""
    count = max(0, len(buffer) - int(code[2:]) + 1)
    return np.asarray(np.ndarray((count,), code, buffer, strides=(1,))[places])


def parts_at(buffer: bytes | memoryview | NDArray[np.uint8], places: Index, size: int) -> NDArray[np.uint8]:
    """Copy equally long parts of some bytes together, which is faster than number by number."""
    count = max(0, len(buffer) - size + 1)
    return np.ndarray((count,), f"V{size}", buffer, strides=(1,))[places].view("u1")
