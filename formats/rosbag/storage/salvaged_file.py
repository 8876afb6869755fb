"""The readable pieces of a damaged bag: a message is given as it was recorded, or not at all."""

from __future__ import annotations

import mmap
from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from formats.limits import CONNECTIONS, Allowance, TooMuchError
from formats.recovery import Recovery
from formats.rosbag.storage.raw_messages import WILD, Messages, of_payloads, widen

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Iterator, Sequence
    from pathlib import Path

    from numpy.typing import NDArray
    from rosbags.interfaces import Connection

    Index = NDArray[np.int64]
    Span = tuple[int, int]
    #: A message as a row of a piece.
    Row = tuple[int, int, int, int]
    #: Rows of a piece, perhaps with more at the end of each.
    Found = Sequence[tuple[int, ...]]

#: `Messages.order` of the first byte of the n-th piece is n times this: pieces are smaller.
_ORDER = 1 << 40


@dataclass(frozen=True, slots=True)
class Piece:
    """Messages that lie together, each vouched for by all that the file says of it."""

    #: Connection, log time in ns, where the payload begins in the contents, its size: shape (n, 4).
    rows: Index
    load: Callable[[], bytes]

    @property
    def first(self) -> int:
        return int(self.rows[:, 1].min())


class SalvagedFile(ABC):
    """What can be read of one file of a bag, as the readers of whole files give it."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.connections: list[Connection] = []
        #: First and last log time in ns of each connection, by its number.
        self.spans: dict[int, tuple[int, int]] = {}
        self.recovery = Recovery()
        self.pieces: list[Piece] = []
        self.data: mmap.mmap | bytes = b""

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

    def close(self) -> None:
        if isinstance(self.data, mmap.mmap):
            self.data.close()
        self.data = b""

    @abstractmethod
    def scan(self) -> dict[int, Connection]:
        """Fill `pieces` and `recovery`; return the connections that are known, by their number."""

    @abstractmethod
    def runs(self, wanted: Collection[int], size: int) -> Iterator[dict[int, Messages]]:
        """Read the messages of some connections, none earlier than one of its connection before."""

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
                widen(self.spans, number, rows[:, 1])
                counts[number] = counts.get(number, 0) + len(rows)
        self.connections = [
            connection._replace(msgcount=counts.get(number, 0)) for number, connection in known.items()
        ]
        self.recovery.read = sum(counts.values())
        self.recovery.first = min((start for start, _ in self.spans.values()), default=None)
        if self.recovery.expected is not None:
            self.recovery.expected = max(self.recovery.expected, self.recovery.read)


def messages_of(piece: Piece, rank: int, wanted: Index) -> dict[int, Messages]:
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


def parted(
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


def rows_of(found: Found) -> Index:
    """Return the table of a piece as `Piece.rows` has it; times beyond the year 2262 are left out."""
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


def lost_between(spans: Sequence[Span | None], end: int | None) -> list[tuple[int | None, int | None]]:
    """Return the log times (ns) between which something of `timeline` was lost, up to the `end` if known."""
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
