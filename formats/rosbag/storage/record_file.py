"""Files of records one after another, MCAP and ROS 1, also while a recorder still writes them."""

import mmap
import os
import struct
from abc import abstractmethod
from binascii import crc32
from collections import Counter
from collections.abc import Callable, Collection, Iterator, Sequence
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from rosbags.interfaces import Connection

from formats.limits import CHUNK_BYTES, Allowance, TooMuchError, unpacked_limit
from formats.recovery import Span, lost_between
from formats.rosbag.storage.chunks import RUN_BYTES, Chunk, Entries, Layout, Run, locate, runs
from formats.rosbag.storage.raw_messages import CORRUPT, WILD, Index, unpack, widen
from formats.rosbag.storage.stored_file import StoredFile, by_connection

#: By code and number of a record: whether a checksum vouches for it, and what it says.
Told = dict[tuple[int, int], list[tuple[bool, Any]]]
#: A message: connection, log time in ns, where the payload begins in the contents, its size.
Row = tuple[int, int, int, int]
Found = Sequence[tuple[int, ...]]  # Rows, perhaps with more at the end of each

#: Bytes behind damage in a growing file in which a chunk begins. Judged: recorders write chunks of some MB.
_SEARCHED = 16 << 20


class BrokenRecordError(ValueError):
    """A record does not add up."""


class CutOffError(BrokenRecordError):
    """A record ends beyond the file; of one that is still written, the rest will come."""


class RecordFile(StoredFile, Layout):
    """What can be read of a file of records: by its index where it must be whole, else record by record."""

    # Of one that must be whole, all that does not add up is a BrokenRecordError, or another of `DAMAGE`. The
    # layout is that of its own index.

    #: How the file begins, and the code of the records that describe a connection.
    magic: bytes
    describes: int
    is_damaged = is_cut = ""  # What is said behind a place that is damaged, and behind one that is cut off

    def __init__(self, path: Path, *, salvage: bool = False) -> None:
        super().__init__(path)
        self.salvage = salvage  # It need not be whole
        #: What has messages, by the index, or as it was found; and by the index how many each connection has.
        self.chunks: list[Chunk] = []
        self.counts: Counter[int] = Counter()
        self._layout: Layout = self
        #: Where the next record begins, and whether the last one was read.
        self.at = len(self.magic)
        self.ended = False
        self.growing = False  # The file is still being written: what is cut off is waited for
        #: There is more than was asked for; and chunks that were handed over.
        self.full, self._handed = False, 0
        self.told: Told = {}  # What the file says of its connections
        #: First and last log time of what can be read, as it lies in the file; None where something is lost.
        self.walk: list[Span | None] = []
        self.unchecked = False  # No checksum vouches for some of it
        #: Messages in no chunk, places being those in the file.
        self._loose: list[Row] = []

    def indexed(self) -> bool:
        if self.salvage or not self.read_index():
            return False
        if len({chunk.position for chunk in self.chunks}) < len(self.chunks):
            # A few bytes of index could make this unpack one chunk without end.
            raise BrokenRecordError("its index names a chunk twice")
        self.chunks.sort(key=lambda chunk: chunk.position)
        self.connections = [
            one._replace(msgcount=self.counts[number]) for number, one in self.known().items()
        ]
        return True

    def least(self, number: int, begin: int, count: int) -> int:
        """Take in what the index says of one connection in one chunk; return its least log time in ns."""
        times, _ = self._indexed_at(begin, count)
        if len(times) < count:
            raise CutOffError("an index")
        widen(self.spans, number, times)
        self.counts[number] += count
        return int(times.min())

    def named(self, index: dict[int, tuple[int, int]]) -> dict[int, set[tuple[int, int]]]:
        """Return the times and places that an index names, by connection."""
        found = {number: self._indexed_at(*place) for number, place in index.items()}
        return {n: set(zip(times.tolist(), at.tolist(), strict=True)) for n, (times, at) in found.items()}

    def _indexed_at(self, begin: int, count: int) -> tuple[Index, Index]:
        end = begin + count * self.entry.itemsize
        return self.entries(np.frombuffer(self.data[begin:end], self.entry))

    def scan(self) -> tuple[dict[int, Connection], Iterator[tuple[int, Index]]]:
        self._layout = RowLayout()
        self.recovery.bytes_read = at = self.at
        size = len(self.data)
        while at < size and not self.ended:
            try:
                at = self.record(at)
            except TooMuchError:
                raise
            except (ValueError, struct.error) as error:
                what = str(error) if isinstance(error, BrokenRecordError) else f"a record at byte {at:,}"
                following = self.next_chunk(at + 1)
                cut = f"cut off at byte {size:,}, in {what}{self.is_cut}"
                self.lose(f"{what}{self.is_damaged}" if following else cut)
                at = following or size
        self.end_loose()
        end = self.account()
        self.recovery.checked = not self.unchecked
        self.recovery.lost = lost_between(self.walk, end) if self.recovery.damaged else []
        own = (of for one in self.chunks if not callable(one.index) for of in one.index.items())
        return self.known(), ((number, rows["time"]) for number, rows in own if not isinstance(rows, tuple))

    def grow(self, file: BinaryIO, most: int) -> list[Run]:
        """Read on in a file that is being written, some `most` bytes: its messages, as they lie in it."""
        # Damage is passed over, and is in `recovery`; ValueError where nothing follows it.
        self.growing = True
        size = os.fstat(file.fileno()).st_size
        if size < len(self.data):
            raise BrokenRecordError(f"it became shorter, of {size:,} bytes, while it was followed")
        if size > len(self.data):
            self.close()
            self.data = mmap.mmap(file.fileno(), size, access=mmap.ACCESS_READ)
            self._allowance = Allowance(size)
        limit = min(size, self.at + most)
        with suppress(CutOffError):
            while self.at < limit and not self.ended:
                self.at = self._next(size)
        self.full = limit <= self.at < size
        self.end_loose()
        chunks, self.chunks, self.walk = self.chunks, [], []
        if self.told_of().keys() != {connection.id for connection in self.connections}:
            self.connections = list(self.known().values())
        known = {connection.id for connection in self.connections}
        found = []
        for rank, chunk in enumerate(chunks, self._handed):
            # Not read from the file, whose buffer may be older than what was written meanwhile.
            raw = chunk.unpack(self.data[chunk.position : chunk.position + chunk.stored])
            found.append(locate(file, [(rank, chunk, raw)], {}, known, RowLayout()))
        self._handed += len(chunks)
        if isinstance(self.data, mmap.mmap) and hasattr(mmap, "MADV_DONTNEED"):
            # Else a process seems to hold all of the file that it has seen.
            self.data.madvise(mmap.MADV_DONTNEED)
        return found

    def _next(self, size: int) -> int:
        """Read one record of a growing file; return where the next begins, behind damage the next chunk."""
        try:
            return self.record(self.at)
        except (CutOffError, TooMuchError):
            raise
        except (ValueError, struct.error) as error:
            following = self.next_chunk(self.at + 1)
            if following is None and size - self.at > _SEARCHED:
                raise
            if following is None:
                raise CutOffError(f"what follows byte {self.at:,}") from error
            self.lose(f"bytes {self.at:,} to {following:,} are damaged, and passed over")
            return following

    def take_chunk(
        self,
        at: int,
        place: slice,
        packing: str,
        size: int,
        confirm: Callable[[Found], tuple[Index, bool]],
        *,
        checksum: int = 0,
        vouched: bool,
    ) -> None:
        """Take the messages of the chunk that begins at a byte, its packed contents at a `place`."""
        # Checksums vouch for all, or `confirm` returns those to be trusted, and if the index has the same.
        load = partial(contents, packing=packing, size=size, checksum=checksum, most=size)
        self._allowance.take(min(size, unpacked_limit(place.stop - place.start)))
        try:
            raw = bytes(load(self.data[place]))
        except CORRUPT as error:
            reason = " ".join(str(error).split())[:120] or type(error).__name__
            self.lose(f"the chunk at byte {at:,} cannot be read ({reason})")
            return
        told: Told = {}
        found, whole = self.found_in(raw, told, vouched=vouched)
        rows = self._rows_of(found)
        kept, agrees = (rows, True) if vouched else confirm(found)
        self.unchecked = self.unchecked or not vouched
        damage = "" if whole else "contradicts itself"
        packed = packing not in {"", "none"}
        if packed and not vouched and not (whole and agrees):
            # One changed byte of packed data changes others, and no index shows in which values.
            kept, damage = rows[:0], "contradicts its index"
        else:
            join_told(self.told, told)
        self.take(rows, kept, place, load if packed else bytes)
        if damage:
            self.lose(f"the chunk at byte {at:,} {damage}")

    def take(
        self, found: Index, kept: Index, place: slice, load: Callable[[bytes], bytes | memoryview] = bytes
    ) -> None:
        """Take the messages that can be trusted of those that were found together; as for `timeline`."""
        if not self.salvage and len(kept) < len(found):
            raise BrokenRecordError("messages contradict what else the file says of them")
        self.recovery.aside += len(found) - len(kept)
        self.walk += timeline(found, kept)
        if len(kept):
            chunk = Chunk(
                position=place.start,
                stored=place.stop - place.start,
                unpack=load,
                slow=load is not bytes,
                first=int(kept[:, 1].min()),
                index={number: RowLayout.of(rows) for number, rows in by_connection(kept)},
            )
            self.chunks.append(chunk)

    def told_of(self) -> dict[int, list[tuple[bool, Any]]]:
        """Return what the file says of each connection, by its number."""
        return {number: said for (code, number), said in self.told.items() if code == self.describes}

    def take_loose(self, row: Row) -> None:
        """Take a message that is in no chunk, once those behind it are known; nothing vouches for it."""
        self._loose.append(row)
        if row[2] + row[3] - self._loose[0][2] > CHUNK_BYTES >> 5:
            self.end_loose()

    def end_loose(self) -> None:
        """Take the messages that wait for those behind them."""
        if self._loose:
            first, last = self._loose[0][2], self._loose[-1][2] + self._loose[-1][3]
            found = [(number, time, begin - first, size) for number, time, begin, size in self._loose]
            rows = self._rows_of(found)
            self._loose, self.unchecked = [], True
            self.take(rows, tame(rows) if self.salvage else rows, slice(first, last))

    def _rows_of(self, found: Found) -> Index:
        rows = rows_of(found)
        if not self.salvage and len(rows) < len(found):
            raise BrokenRecordError("a log time is beyond the year 2262")
        return rows

    def note(self, damage: str) -> None:
        if not self.salvage:
            raise BrokenRecordError(damage)
        self.recovery.damage.append(damage)

    def lose(self, damage: str) -> None:
        self.end_loose()
        if damage not in self.recovery.damage:
            self.note(damage)
        if not self.walk or self.walk[-1] is not None:
            self.walk.append(None)

    def runs(self, wanted: Collection[int], size: int = RUN_BYTES) -> Iterator[Run]:
        yield from runs(self.file, self.chunks, wanted, self._layout, size)

    @property
    def rest(self) -> int:
        """Bytes at the end of a growing file that are no whole record."""
        return 0 if self.ended else len(self.data) - self.at

    @abstractmethod
    def read_index(self) -> bool:
        """Fill `chunks` and `counts` by the index of a whole file; False where it has none."""

    @abstractmethod
    def record(self, at: int) -> int:
        """Read one record; return where the next begins. CutOffError where it is not all there."""

    @abstractmethod
    def account(self) -> int | None:
        """Fill in what the file says of itself as a whole; return the last log time, if it tells that."""

    @abstractmethod
    def next_chunk(self, start: int) -> int | None:
        """Find the next place where a whole chunk begins."""

    def found_in(self, raw: bytes, told: Told, *, vouched: bool) -> tuple[Found, bool]:
        """Return the messages of a chunk, and whether all of it added up; take in what it tells."""
        found = []
        try:
            for row in self.messages_in(raw, told, vouched=vouched):
                found.append(row)  # noqa: PERF402 - those before the damage are kept
        except (struct.error, ValueError):
            return found, False
        return found, True

    @abstractmethod
    def messages_in(self, raw: bytes, told: Told, *, vouched: bool) -> Iterator[tuple[int, ...]]:
        """Yield the messages of a chunk; an error of `struct` or ValueError where it does not add up."""

    @abstractmethod
    def known(self) -> dict[int, Connection]:
        """Return the connections of which all is known, by their number."""


def agreed(told: Sequence[tuple[bool, Any]]) -> Any | None:
    """Return what a file says of something, if it does not contradict itself; checksums vouch for some."""
    trusted = [what for vouched, what in told if vouched] or [what for _, what in told]
    return trusted[0] if all(what == trusted[0] for what in trusted) else None


def join_told(told: Told, more: Told) -> None:
    """Add what else a file says of its connections to what it said before."""
    for about, said in more.items():
        before = told.setdefault(about, [])
        before += [one for one in said if one not in before[-8:]]


class RowLayout:
    """Of rows of messages, which were looked at when they were found."""

    entry = np.dtype([("time", "<i8"), ("place", "<i8"), ("size", "<i8")])

    @classmethod
    def of(cls, rows: Index) -> Entries:
        """Return what rows of one connection are as entries."""
        return np.ascontiguousarray(rows[:, 1:]).view(cls.entry).ravel()

    def entries(self, of: Entries) -> tuple[Index, Index]:
        return of["time"], of["place"]

    def payloads(self, _buffer: bytes, _: int, entries: Entries, records: Index) -> tuple[Index, Index]:
        return records, entries["size"]


def contents(
    packed: bytes | memoryview, packing: str, size: int, checksum: int, most: int = CHUNK_BYTES
) -> bytes | memoryview:
    """Return what a chunk unpacks to, if that is as it says."""
    raw = unpack(packed, packing, most) if packing else packed
    if len(raw) != size:
        raise ValueError(f"{size:,} bytes were packed, {len(raw):,} came out")
    if checksum and crc32(raw) != checksum:
        raise ValueError("its checksum is wrong")
    return raw


def rows_of(found: Found) -> Index:
    """Return messages as a table, shape (n, 4); times beyond the year 2262 are left out."""
    return np.array([row[:4] for row in found if 0 <= row[1] < 2**63], dtype=np.int64).reshape(-1, 4)


def tame(rows: Index) -> Index:
    """Leave out the messages, rows of a piece, whose time is far from that of the others."""
    if not len(rows):
        return rows
    return np.asarray(rows[np.abs(rows[:, 1] - int(np.median(rows[:, 1]))) <= WILD])


def timeline(found: Index, kept: Index) -> list[Span | None]:
    """Return times (ns) of messages that follow each other, None where some are not `kept`."""
    right = np.isin(found[:, 2], kept[:, 2])
    edges = np.flatnonzero(np.diff(right)) + 1
    spans: list[Span | None] = []
    for part in np.split(np.arange(len(found)), edges):
        if len(part):
            times = found[part, 1]
            spans.append((int(times.min()), int(times.max())) if right[part[0]] else None)
    return spans
