"""One file of a bag, and the pieces of it that can be read: a message as it was recorded, or not at all."""

import mmap
from abc import ABC, abstractmethod
from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import BinaryIO

import numpy as np
from numpy.typing import NDArray
from rosbags.interfaces import Connection

from formats.limits import Allowance
from formats.recovery import Recovery
from formats.rosbag.storage.raw_messages import Messages, widen

Index = NDArray[np.int64]
Span = tuple[int, int]
Row = tuple[int, int, int, int]  # A message as a row of a piece
Found = Sequence[tuple[int, ...]]  # Rows of a piece, perhaps with more at the end of each


@dataclass(frozen=True, slots=True)
class Piece:
    """Messages that lie together, each vouched for by all that the file says of it."""

    #: Connection, log time in ns, where the payload begins in the contents, its size: shape (n, 4).
    rows: Index
    begin: int = 0  # Of the bytes in the file that `unpack` makes the contents of
    stored: int = 0
    unpack: Callable[[bytes], bytes | memoryview] = bytes


class StoredFile(ABC):
    """What can be read of one file of a bag: by its index, or in pieces."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.connections: list[Connection] = []
        #: First and last log time in ns of each connection, by its number, as far as they are known.
        self.spans: dict[int, tuple[int, int]] = {}
        self.recovery = Recovery()
        self.pieces: list[Piece] = []
        self.file: BinaryIO | None = None
        self.data: mmap.mmap | bytes = b""

    def open(self) -> None:
        """Read the index, or else find the readable pieces."""
        self.file = self.path.open("rb")
        try:
            self.data = mmap.mmap(self.file.fileno(), 0, access=mmap.ACCESS_READ)
            self.recovery.bytes_expected = len(self.data)
            self._allowance = Allowance(len(self.data))
            if self.indexed():
                # Whoever makes the file shorter while it is read would end a process that looks at it so.
                self._unmap()
            else:
                self._settle(self.scan())
        except BaseException:
            self.close()
            raise

    def close(self) -> None:
        self._unmap()
        if self.file is not None:
            self.file.close()

    def _unmap(self) -> None:
        if isinstance(self.data, mmap.mmap):
            self.data.close()
        self.data = b""

    def indexed(self) -> bool:
        """Tell whether the file has an index that is to be trusted, and read that."""
        return False

    @abstractmethod
    def scan(self) -> dict[int, Connection]:
        """Fill `pieces` and `recovery`; return the connections that are known, by their number."""

    @abstractmethod
    def runs(self, wanted: Collection[int], size: int) -> Iterator[dict[int, Messages]]:
        """Read the messages of some connections, none earlier than one of its connection before."""

    def _settle(self, known: dict[int, Connection]) -> None:
        """Keep the messages of known connections, and count them."""
        numbers = np.array(sorted(known), dtype=np.int64)
        kept = []
        for piece in self.pieces:
            right = np.isin(piece.rows[:, 0], numbers)
            self.recovery.aside += int(np.count_nonzero(~right))
            if right.any():
                kept.append(replace(piece, rows=piece.rows[right]))
        self.pieces = kept
        counts: dict[int, int] = {}
        for piece in kept:
            for number, rows in by_connection(piece.rows):
                widen(self.spans, number, rows[:, 1])
                counts[number] = counts.get(number, 0) + len(rows)
        self.connections = [one._replace(msgcount=counts.get(number, 0)) for number, one in known.items()]
        self.recovery.read = sum(counts.values())
        self.recovery.first = min((start for start, _ in self.spans.values()), default=None)
        if self.recovery.expected is not None:
            self.recovery.expected = max(self.recovery.expected, self.recovery.read)


def by_connection(rows: Index) -> Iterator[tuple[int, Index]]:
    """Yield the rows of each connection, in one pass however many there are."""
    if not len(rows):
        return
    rows = rows[np.argsort(rows[:, 0], kind="stable")]
    for part in np.split(rows, np.flatnonzero(np.diff(rows[:, 0])) + 1):
        yield int(part[0, 0]), part
