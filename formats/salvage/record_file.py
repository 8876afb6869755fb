"""Files of records one after another, MCAP and ROS 1, also while a recorder still writes them."""

from __future__ import annotations

import mmap
import os
import struct
from abc import abstractmethod
from contextlib import suppress
from typing import TYPE_CHECKING, BinaryIO

import numpy as np

from formats.limits import Allowance, TooMuchError
from formats.salvage.salvaged_file import SalvagedFile, messages_of

if TYPE_CHECKING:
    from collections.abc import Collection
    from pathlib import Path

    from rosbags.interfaces import Connection

    from formats.rosbag.storage.raw_messages import Messages

#: Bytes behind damage in a growing file in which a chunk begins. Judged: recorders write chunks of some MB.
_SEARCHED = 16 << 20


class BrokenRecordError(ValueError):
    """A record does not add up."""


class CutOffError(BrokenRecordError):
    """A record ends beyond the file; of one that is still written, the rest will come."""


class RecordFile(SalvagedFile):
    """What can be read of a file of records."""

    def __init__(self, path: Path) -> None:
        super().__init__(path)
        #: Where the next record begins, and whether the last one was read.
        self.at = 0
        self.ended = False
        #: The file is still being written: what is cut off is waited for.
        self.growing = False
        #: There is more than was asked for; and pieces that were handed over.
        self.full, self._handed = False, 0

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
        found = [messages_of(piece, rank, numbers) for rank, piece in enumerate(pieces, self._handed)]
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

    @abstractmethod
    def record(self, at: int) -> int:
        """Read one record; return where the next begins. CutOffError where it is not all there."""

    @abstractmethod
    def next_chunk(self, start: int) -> int | None:
        """Find the next place where a whole chunk begins."""

    @abstractmethod
    def numbers(self) -> Collection[int]:
        """Return the numbers of the connections that were told of so far."""

    @abstractmethod
    def known(self) -> dict[int, Connection]:
        """Return the connections of which all is known, by their number."""
