"""Messages out of the chunks of a ROS 1 bag or an MCAP file, many chunks at a time.

Both formats have chunks and an index: for each connection the log time of every message and its place in the
chunk. Chunks are joined until they have `RUN_BYTES`, and what the index says of their messages is gathered
and checked with NumPy: no message is touched in Python.
"""

import os
from collections import deque
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any, BinaryIO, Protocol, TypeAlias

import numpy as np
from numpy.typing import NDArray

from formats.limits import Allowance
from formats.rosbag.storage.raw_messages import DAMAGE, ORDER, Index, Messages

Entries: TypeAlias = NDArray[Any]  # Of an index, as `Layout.entry` has them
RUN_BYTES = 8 << 20  # Chunks are joined until they have this many bytes: enough to make NumPy's calls cheap
#: Decompressing in more threads than this would be faster than what is done with the messages.
_MOST_THREADS = 4


@dataclass(frozen=True, slots=True, kw_only=True)
class Chunk:
    """Where a chunk and its index stand in the file."""

    #: Of the bytes that `unpack` takes.
    position: int
    stored: int
    unpack: Callable[[bytes], bytes | memoryview]  # Makes the contents of them
    slow: bool  # It is worth a thread
    first: int  # The least log time in it, ns
    #: By connection the entries, or where they begin in the file and how many they are; or what makes entries
    #: of the contents.
    index: Mapping[int, Entries | tuple[int, int]] | Callable[[bytes | memoryview], dict[int, Entries]]


class Layout(Protocol):
    """How one format writes indexes and messages."""

    entry: np.dtype[Any]

    # Log times in ns and places in the chunk, of entries of an index
    def entries(self, of: Entries) -> tuple[Index, Index]: ...
    def payloads(self, buffer: bytes, number: int, entries: Entries, records: Index) -> tuple[Index, Index]:
        """Return starts and sizes of payloads by the places of their records; any error where one differs."""


#: Messages by the number of their connection, all in one buffer.
Run: TypeAlias = dict[int, Messages]
_Unpacked: TypeAlias = tuple[int, Chunk, bytes | memoryview]


def runs(
    file: BinaryIO, chunks: Sequence[Chunk], wanted: Collection[int], layout: Layout, size: int = RUN_BYTES
) -> Iterator[Run]:
    """Read the messages of some connections by log time, `size` bytes of chunks joined (1: few as can be)."""
    # A damaged file raises one of `DAMAGE`, after what comes before the damage was yielded.
    chosen = sorted(
        (chunk.first, rank, chunk)
        for rank, chunk in enumerate(chunks)
        if callable(chunk.index) or not chunk.index.keys().isdisjoint(wanted)
    )
    if not chosen:
        return
    horizons = [first for first, _, _ in chosen[1:]]
    kept: Run = {}
    joined: list[_Unpacked] = []
    length = 0
    unpacked = _unpacked(file, [chunk for _, _, chunk in chosen], ahead=size > 1)
    allowance = Allowance(os.fstat(file.fileno()).st_size)
    for (first, rank, chunk), horizon in zip(chosen, [*horizons, None], strict=True):
        try:
            joined.append((rank, chunk, next(unpacked)))
            allowance.take(len(joined[-1][2]))
        except DAMAGE:
            yield _split(locate(file, joined, kept, wanted, layout), first)[0]
            raise
        length += len(joined[-1][2])
        if horizon is not None and length >= size:
            # Chunks may overlap in time: what is later than the first message of the next one waits.
            run, kept = _split(locate(file, joined, kept, wanted, layout), horizon)
            joined, length = [], 0
            yield run
    yield locate(file, joined, kept, wanted, layout)


def _unpacked(file: BinaryIO, chunks: Sequence[Chunk], *, ahead: bool) -> Iterator[bytes | memoryview]:
    """Yield the contents of chunks; some are decompressed ahead, where that is what takes the time."""
    if not (ahead and any(chunk.slow for chunk in chunks)):
        for chunk in chunks:
            yield chunk.unpack(_read(file, chunk.position, chunk.stored))
        return
    threads = min(_MOST_THREADS, os.cpu_count() or 1)
    with ThreadPoolExecutor(threads) as pool:
        waiting: deque[Any] = deque()
        for chunk in chunks:
            # Reading stays in this thread, for the file has one position.
            waiting.append(pool.submit(chunk.unpack, _read(file, chunk.position, chunk.stored)))
            if len(waiting) > threads:
                yield waiting.popleft().result()
        while waiting:
            yield waiting.popleft().result()


def _read(file: BinaryIO, position: int, size: int) -> bytes:
    file.seek(position)
    data = file.read(size)
    if len(data) != size:
        raise EOFError(f"{size} bytes were to be at {position}, {len(data)} are")
    return data


def locate(
    file: BinaryIO, joined: Sequence[_Unpacked], kept: Run, wanted: Collection[int], layout: Layout
) -> Run:
    """Find the messages of some chunks; those that were kept come first in the new buffer."""
    pieces: list[bytes | memoryview] = []
    run: dict[int, list[Messages]] = {}
    begin = 0
    for connection, messages in kept.items():
        pieces += [messages.payload(row) for row in range(len(messages))]
        starts = begin + np.cumsum(messages.sizes) - messages.sizes
        run[connection] = [Messages(b"", starts, messages.sizes, messages.times, messages.order)]
        begin += int(messages.sizes.sum())
    found: dict[int, list[tuple[Entries, int, int, int, int]]] = {}
    for rank, chunk, data in joined:
        end = begin + len(data)
        for connection, entries in _entries(file, chunk, data, wanted, layout):
            found.setdefault(connection, []).append((entries, begin, end, rank, chunk.first))
        pieces.append(data)
        begin = end
    buffer = b"".join(pieces)
    for connection, parts in found.items():
        of_chunks, *rest = zip(*parts, strict=True)
        # Joined as bytes: NumPy would compare the names of all fields first.
        every = np.frombuffer(b"".join(of_chunks), layout.entry)
        times, places = layout.entries(every)
        lengths = [len(entries) for entries in of_chunks]
        bases, ends, ranks, firsts = (np.repeat(np.array(of_chunk), lengths) for of_chunk in rest)
        records = bases + places
        if ((places < 0) | (records > ends)).any():
            raise ValueError("an index points beyond its chunk")
        starts, sizes = layout.payloads(buffer, connection, every, records)
        if ((sizes < 0) | (starts + sizes > ends)).any():
            raise ValueError("a message is longer than its chunk")
        if (times < firsts).any():
            raise ValueError("a message is earlier than its chunk")
        run.setdefault(connection, []).append(Messages(b"", starts, sizes, times, ranks * ORDER + places))
    names = ("starts", "sizes", "times", "order")
    joint = {c: [[getattr(part, name) for part in parts] for name in names] for c, parts in run.items()}
    return {c: Messages(buffer, *map(np.concatenate, columns)).sorted() for c, columns in joint.items()}


def _entries(
    file: BinaryIO, chunk: Chunk, data: bytes | memoryview, wanted: Collection[int], layout: Layout
) -> Iterator[tuple[int, Entries]]:
    index = chunk.index(data) if callable(chunk.index) else chunk.index
    for connection, own in index.items():
        if connection not in wanted:
            continue
        if not isinstance(own, tuple):
            yield connection, own
        elif own[1]:
            raw = _read(file, own[0], own[1] * layout.entry.itemsize)
            yield connection, np.frombuffer(raw, layout.entry)


def _split(run: Run, horizon: int) -> tuple[Run, Run]:
    """Part messages into those before a time and the others; leave out connections without any."""
    before: Run = {}
    others: Run = {}
    for connection, messages in run.items():
        count = int(np.searchsorted(messages.times, horizon))
        if count:
            before[connection] = messages.take(slice(None, count))
        if count < len(messages):
            others[connection] = messages.take(slice(count, None))
    return before, others
