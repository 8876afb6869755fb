"""One file of a bag, and what of it can be read: a message as it was recorded, or not at all."""

import mmap
from abc import ABC, abstractmethod
from collections import Counter
from collections.abc import Collection, Iterable, Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import BinaryIO

import numpy as np
from rosbags.interfaces import Connection

from formats.limits import Allowance
from formats.recovery import Recovery
from formats.rosbag.storage.raw_messages import Index, Messages, widen


class StoredFile(ABC):
    """What can be read of one file of a bag: by its index, or what is found in it."""

    file: BinaryIO

    def __init__(self, path: Path) -> None:
        self.path = path
        self.connections: list[Connection] = []
        #: First and last log time in ns of each connection, by its number, as far as they are known.
        self.spans: dict[int, tuple[int, int]] = {}
        self.recovery = Recovery()
        self._held = ExitStack()
        self.data: mmap.mmap | bytes = b""

    def open(self) -> None:
        """Read the index, or else find what can be read."""
        self.file = self._held.enter_context(self.path.open("rb"))
        try:
            self.data = mmap.mmap(self.file.fileno(), 0, access=mmap.ACCESS_READ)
            self.recovery.bytes_expected = len(self.data)
            self._allowance = Allowance(len(self.data))
            if self.indexed():
                # Whoever makes the file shorter while it is read would end a process that looks at it so.
                self._unmap()
            else:
                self._settle(*self.scan())
        except BaseException:
            self.close()
            raise

    def close(self) -> None:
        self._unmap()
        self._held.close()

    def _unmap(self) -> None:
        if isinstance(self.data, mmap.mmap):
            self.data.close()
        self.data = b""

    def indexed(self) -> bool:
        """Tell whether the file has an index that is to be trusted, and read that."""
        return False

    @abstractmethod
    def scan(self) -> tuple[dict[int, Connection], Iterable[tuple[int, Index]]]:
        """Find messages, and fill `recovery`; return known connections by number, and as for `_settle`."""

    @abstractmethod
    def runs(self, wanted: Collection[int], size: int) -> Iterator[dict[int, Messages]]:
        """Read the messages of some connections, none earlier than one of its connection before."""

    def _settle(self, known: dict[int, Connection], found: Iterable[tuple[int, Index]]) -> None:
        """Count the messages of known connections: of each, several times, its number and log times in ns."""
        counts: Counter[int] = Counter()
        for number, times in found:
            if number in known:
                widen(self.spans, number, times)
                counts[number] += len(times)
            else:
                self.recovery.aside += len(times)
        self.connections = [one._replace(msgcount=counts[number]) for number, one in known.items()]
        self.recovery.read = counts.total()
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
