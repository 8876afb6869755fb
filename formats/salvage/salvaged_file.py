"""The readable pieces of a damaged bag, and their messages in the order of the log times."""

from __future__ import annotations

import mmap
import os
import struct
from abc import ABC, abstractmethod
from binascii import crc32
from contextlib import suppress
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, BinaryIO

import numpy as np

from formats.limits import CHUNK_BYTES, CONNECTIONS, Allowance, TooMuchError, unpacked_limit
from formats.recovery import Recovery
from formats.rosbag.storage.raw_messages import CORRUPT, WILD, Messages, of_payloads, unpack

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Iterator, Sequence
    from pathlib import Path

    from numpy.typing import NDArray
    from rosbags.interfaces import Connection

    Index = NDArray[np.int64]
    Span = tuple[int, int]

#: `Messages.order` of the first byte of the n-th piece is n times this: pieces are smaller.
_ORDER = 1 << 40
#: Bytes of messages that may wait for others which are earlier.
_WAITING = 1 << 30
_WAITING_PARTS = 50_000
#: Bytes behind damage in a growing file in which a chunk begins. Judged: recorders write chunks of some MB.
_SEARCHED = 16 << 20


class BrokenRecordError(ValueError):
    """A record does not add up."""


class CutOffError(BrokenRecordError):
    """A record ends beyond the file; of one that is still written, the rest will come."""


@dataclass(frozen=True, slots=True)
class Piece:
    """Messages that lie together, each vouched for by all that the file says of it."""

    #: Connection, log time in ns, where the payload begins in the contents, its size: shape (n, 4).
    rows: Index
    load: Callable[[], bytes]

    @property
    def first(self) -> int:
        return int(self.rows[:, 1].min())

    @property
    def last(self) -> int:
        return int(self.rows[:, 1].max())


class SalvagedFile(ABC):
    """What can be read of one file of a bag, as the readers of whole files give it."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.connections: list[Connection] = []
        #: First and last log time in ns of each connection, by its number.
        self.spans: dict[int, tuple[int, int]] = {}
        self.recovery = Recovery()
        self.pieces: list[Piece] = []
        #: First and last log time of what can be read, as it lies in the file; None where something is lost.
        self.walk: list[Span | None] = []
        self.data: mmap.mmap | bytes = b""
        #: No checksum vouches for some of it.
        self.unchecked = False
        #: Messages in no chunk, as rows of a piece, places being those in the file.
        self._loose: list[tuple[int, int, int, int]] = []
        #: Where the next record begins, and whether the last one was read.
        self.at = 0
        self.ended = False
        #: The file is still being written: what is cut off is waited for.
        self.growing = False
        #: There is more than was asked for; and pieces that were handed over.
        self.full, self._handed = False, 0

    def open(self) -> None:
        """Find the readable pieces."""
        with self.path.open("rb") as file:
            self.data = mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ)
        try:
            self.recovery.bytes_expected = len(self.data)
            self._allowance = Allowance(len(self.data))
            known = self.scan()
            self._settle(known)
        except BaseException:
            self.close()
            raise

    def grow(self, file: BinaryIO, most: int) -> list[dict[int, Messages]]:
        """Read on in a file that is being written, some `most` bytes: its messages, as they lie in it.

        No record before `at` is looked at again. Damage is passed over, and is in `recovery`; ValueError
        where nothing follows it.
        """
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
        pieces, self.pieces, self.walk = self.pieces, [], []
        if set(self.numbers()) != {connection.id for connection in self.connections}:
            self.connections = list(self.known().values())
        numbers = np.array([connection.id for connection in self.connections], dtype=np.int64)
        found = [_messages(piece, rank, numbers) for rank, piece in enumerate(pieces, self._handed)]
        self._handed += len(pieces)
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

    @property
    def rest(self) -> int:
        """Bytes at the end of a growing file that are no whole record."""
        return 0 if self.ended else len(self.data) - self.at

    def take(self, found: Index, kept: Index, load: Callable[[], bytes], damage: str = "") -> None:
        """Take the messages that can be trusted of those that were found together.

        `found` and `kept` are as for `timeline`; `damage` says what is wrong where `found` is not all there
        was.
        """
        self.recovery.aside += len(found) - len(kept)
        self.walk += timeline(found, kept)
        if len(kept):
            self.pieces.append(Piece(kept, load))
        if damage:
            self.lose(damage)

    def take_loose(self, row: tuple[int, int, int, int]) -> None:
        """Take a message that is in no chunk, once those behind it are known; nothing vouches for it."""
        self._loose.append(row)
        if row[2] + row[3] - self._loose[0][2] > CHUNK_BYTES >> 5:
            self.end_loose()

    def end_loose(self) -> None:
        """Take the messages that wait for those behind them."""
        if self._loose:
            first, last = self._loose[0][2], self._loose[-1][2] + self._loose[-1][3]
            rows = rows_of([(number, time, begin - first, size) for number, time, begin, size in self._loose])
            self._loose, self.unchecked = [], True
            self.take(rows, tame(rows), lambda: self.data[first:last])

    def contents(self, begin: int, end: int, packing: str, size: int, checksum: int = 0) -> bytes:
        """Return what a chunk there unpacks to, if that is as it says."""
        raw = unpack(self.data[begin:end], packing, size)
        if len(raw) != size:
            raise ValueError(f"{size:,} bytes were packed, {len(raw):,} came out")
        if checksum and crc32(raw) != checksum:
            raise ValueError("its checksum is wrong")
        return raw

    def unpacked(self, load: Callable[[], bytes], stored: int, size: int) -> bytes | str:
        """Unpack a chunk, or say why that cannot be.

        `load` returns no more than `size` bytes, which the file says that those `stored` become. TooMuchError
        where all chunks together become more than a file may.
        """
        self._allowance.take(min(size, unpacked_limit(stored)))
        try:
            return load()
        except CORRUPT as error:
            return " ".join(str(error).split())[:120] or type(error).__name__

    def lose(self, damage: str) -> None:
        """Note that something is lost here."""
        self.end_loose()
        if damage not in self.recovery.damage:
            self.recovery.damage.append(damage)
        if not self.walk or self.walk[-1] is not None:
            self.walk.append(None)

    def close(self) -> None:
        if isinstance(self.data, mmap.mmap):
            self.data.close()
        self.data = b""

    @abstractmethod
    def scan(self) -> dict[int, Connection]:
        """Fill `salvaged_file` and `recovery`; return the connections that are known, by their number."""

    def record(self, at: int) -> int:
        """Read one record; return where the next begins. CutOffError where it is not all there."""
        raise NotImplementedError(at)

    def next_chunk(self, start: int) -> int | None:
        """Find the next place where a whole chunk begins."""
        raise NotImplementedError(start)

    def numbers(self) -> Collection[int]:
        """Return the numbers of the connections that were told of so far."""
        raise NotImplementedError

    def known(self) -> dict[int, Connection]:
        """Return the connections of which all is known, by their number."""
        raise NotImplementedError

    def _settle(self, known: dict[int, Connection]) -> None:
        """Keep the messages of known connections, and count them."""
        if len(known) > CONNECTIONS:
            raise TooMuchError(f"it has more than {CONNECTIONS:,} connections")
        numbers = np.array(sorted(known), dtype=np.int64)
        kept = []
        for piece in self.pieces:
            right = np.isin(piece.rows[:, 0], numbers)
            self.recovery.aside += int(np.count_nonzero(~right))
            if right.any():
                kept.append(piece if right.all() else Piece(piece.rows[right], piece.load))
        self.pieces = kept
        counts: dict[int, int] = {}
        for piece in kept:
            for number, rows in _by_connection(piece.rows):
                times = rows[:, 1]
                start, end = self.spans.get(number, (int(times.min()), int(times.max())))
                self.spans[number] = min(start, int(times.min())), max(end, int(times.max()))
                counts[number] = counts.get(number, 0) + len(times)
        self.connections = [
            connection._replace(msgcount=counts.get(number, 0)) for number, connection in known.items()
        ]
        self.recovery.read = sum(counts.values())
        self.recovery.first = min((start for start, _ in self.spans.values()), default=None)
        if self.recovery.expected is not None:
            self.recovery.expected = max(self.recovery.expected, self.recovery.read)

    def runs(self, wanted: Collection[int], size: int = 0) -> Iterator[dict[int, Messages]]:  # noqa: ARG002 - as `rosbag.containers.Reader` has it
        """Read the messages of some connections, none earlier than one of its connection before."""
        numbers = np.array(sorted(wanted), dtype=np.int64)
        chosen = sorted(
            (piece.first, rank, piece)
            for rank, piece in enumerate(self.pieces)
            if np.isin(piece.rows[:, 0], numbers).any()
        )
        waiting: dict[int, list[Messages]] = {}
        for k, (_, rank, piece) in enumerate(chosen):
            for number, messages in _messages(piece, rank, numbers).items():
                waiting.setdefault(number, []).append(messages)
            horizon = chosen[k + 1][0] if k + 1 < len(chosen) else None
            before, waiting = _parted(waiting, horizon)
            held = [len(part.buffer) for parts in waiting.values() for part in parts]
            if sum(held) > _WAITING or len(held) > _WAITING_PARTS:
                raise TooMuchError("its chunks overlap in time: too much would have to be held in memory")
            if before:
                yield before


def _messages(piece: Piece, rank: int, wanted: Index) -> dict[int, Messages]:
    contents = piece.load()
    found = {}
    for number, rows in _by_connection(piece.rows[np.isin(piece.rows[:, 0], wanted)]):
        order = rank * _ORDER + rows[:, 2]
        found[number] = Messages(contents, rows[:, 2], rows[:, 3], rows[:, 1], order).sorted()
    return found


def _by_connection(rows: Index) -> Iterator[tuple[int, Index]]:
    """Yield the rows of each connection, in one pass however many there are."""
    if not len(rows):
        return
    rows = rows[np.argsort(rows[:, 0], kind="stable")]
    for part in np.split(rows, np.flatnonzero(np.diff(rows[:, 0])) + 1):
        yield int(part[0, 0]), part


def _parted(
    waiting: dict[int, list[Messages]], horizon: int | None
) -> tuple[dict[int, Messages], dict[int, list[Messages]]]:
    """Part messages into those before a time, and the others; the latter in buffers of their own."""
    before: dict[int, Messages] = {}
    others: dict[int, list[Messages]] = {}
    for number, parts in waiting.items():
        ready = []
        for part in parts:
            count = len(part) if horizon is None else int(np.searchsorted(part.times, horizon))
            if count:
                ready.append(part.take(slice(None, count)))
            if count < len(part):
                rest = part.take(slice(count, None))
                # In a buffer of its own, so that the contents of its chunk need not be kept.
                own = rest if len(rest.buffer) == rest.sizes.sum() else joined([rest])
                others.setdefault(number, []).append(own)
        if ready:
            before[number] = ready[0] if len(ready) == 1 else joined(ready).sorted()
    return before, others


def joined(parts: Sequence[Messages]) -> Messages:
    """Join messages, in the order given, in one buffer that holds nothing else."""
    payloads = [part.payload(row) for part in parts for row in range(len(part))]
    times, order = (np.concatenate([getattr(part, name) for part in parts]) for name in ("times", "order"))
    return of_payloads(payloads, times, order)


def rows_of(found: Sequence[tuple[int, int, int, int]]) -> Index:
    """Return the table of a piece as `Piece.rows` has it; times beyond the year 2262 are left out."""
    return np.array([row for row in found if 0 <= row[1] < 2**63], dtype=np.int64).reshape(-1, 4)


def tame(rows: Index) -> Index:
    """Leave out the messages, rows of a piece, whose time is far from that of the others."""
    if not len(rows):
        return rows
    return np.asarray(rows[np.abs(rows[:, 1] - int(np.median(rows[:, 1]))) <= WILD])


def agreed(told: Sequence[tuple[bool, Any]]) -> Any | None:
    """Return what a file says of something, if it does not contradict itself; checksums vouch for some."""
    trusted = [what for vouched, what in told if vouched] or [what for _, what in told]
    return trusted[0] if all(what == trusted[0] for what in trusted) else None


def join_told(told: dict[int, list[tuple[bool, Any]]], more: dict[int, list[tuple[bool, Any]]]) -> None:
    """Add what else a file says of its connections, by their numbers, to what it said before."""
    for number, said in more.items():
        before = told.setdefault(number, [])
        before += [one for one in said if one not in before[-8:]]


def timeline(found: Index, kept: Index) -> list[Span | None]:
    """Return the times (ns) of messages that follow each other, None between where some are left out.

    `found` are rows of a piece in the order of the file, `kept` those of them that are kept.
    """
    right = np.isin(found[:, 2], kept[:, 2])
    edges = np.flatnonzero(np.diff(right)) + 1
    spans: list[Span | None] = []
    for part in np.split(np.arange(len(found)), edges):
        if len(part):
            times = found[part, 1]
            spans.append((int(times.min()), int(times.max())) if right[part[0]] else None)
    return spans


def lost_between(spans: Sequence[Span | None], end: int | None) -> list[tuple[int | None, int | None]]:
    """Return the stretches of log time (ns) in which something was lost.

    Spans are as from `timeline`, in the order of the file; `end` is when the log ended, where that is known.
    """
    lost: list[tuple[int | None, int | None]] = []
    before: int | None = None
    waiting = False
    for span in spans:
        if span is None:
            waiting = True
            continue
        first, last = span
        if waiting:
            after = first if before is None else max(first, before)
            if lost and lost[-1][1] == before is not None:
                lost[-1] = lost[-1][0], after
            else:
                lost.append((before, after))
            waiting = False
        before = last if before is None else max(before, last)
    if waiting:
        lost.append((before, max(end, before) if end is not None and before is not None else end))
    return lost
