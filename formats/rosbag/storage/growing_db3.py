"""The rows of an SQLite file of rosbag2 that a recorder goes on writing, who never has to wait.

With a write-ahead log a reader locks nothing that a writer needs. Without one, its lock would make the next
commit fail, and recorders do not try again: the file is then read without any lock, as it is between two
commits. That nobody wrote meanwhile is seen from the lock of the writer, and from the count of its commits.
"""

from __future__ import annotations

import os
import sqlite3
import struct
import sys
from contextlib import closing
from pathlib import Path
from typing import TYPE_CHECKING, BinaryIO

from formats.content import SIDE_FILES
from formats.copies import named
from formats.recovery import Recovery
from formats.rosbag.storage.db3 import refuse_what_calculates, topics_of
from formats.rosbag.storage.raw_messages import collected

if TYPE_CHECKING:
    from rosbags.interfaces import Connection

    from formats.rosbag.storage.raw_messages import Messages

#: Header of the file: its version of reading, 2 with a write-ahead log, and the count of commits.
_HEADER, _VERSION, _COMMITS = 100, 19, slice(24, 28)
#: Bytes that SQLite locks (https://www.sqlite.org/lockingv3.html): to write at all, and to write the file.
_RESERVED, _SHARED = (0x40000001, 1), (0x40000002, 510)
#: `struct flock` of Linux: kind, whence, first byte, length, process.
_LOCK = struct.Struct("@hhqqi")
#: How a journal begins that is not yet done with.
_JOURNAL = bytes.fromhex("d9d505f920a163d7")
#: Looks in which a journal stands without its writer: one may fall between two commits.
_DEAD = 5
#: Rows in one question.
_ROWS = 5_000


class GrowingDb3:
    """One file, with what `RecordFile` has for a file that grows."""

    #: Nothing in it says that no more will come, and rows are whole or not there.
    ended, rest = False, 0

    def __init__(self, path: Path) -> None:
        self.path = path
        self.connections: list[Connection] = []
        self.recovery = Recovery()
        self.full = False
        self._last = 0
        self._seen: object = None
        self._dead = 0

    def grow(self, file: BinaryIO, most: int) -> list[dict[int, Messages]]:
        """Read on behind the last row, some `most` bytes at the most; nothing while the recorder commits."""
        header = os.pread(file.fileno(), _HEADER, 0)
        seen = [header[_COMMITS], os.fstat(file.fileno()).st_mtime_ns, *map(_changed, self._beside)]
        if seen == self._seen or len(header) < _HEADER:
            return []
        logged = header[_VERSION] == 2 and any(_changed(beside) for beside in self._beside)
        if not logged and self._is_written(file):
            return []
        try:
            rows = self._rows(most, "mode=ro" if logged else "immutable=1")
        except sqlite3.OperationalError:
            # It has no tables yet, or is locked for a moment.
            return []
        except sqlite3.DatabaseError:
            if logged or not self._was_written(file, header):
                raise
            return []
        if not logged and self._was_written(file, header):
            return []
        self.full = bool(rows)
        if rows:
            self._last = rows[-1][0]
        else:
            self._seen = seen
        return list(collected((row[1:] for row in rows), most))

    @property
    def _beside(self) -> list[Path]:
        return [Path(f"{self.path}{ending}") for ending in SIDE_FILES]

    def _is_written(self, file: BinaryIO) -> bool:
        """Tell whether somebody writes the file, or died while writing it."""
        journal = self._beside[1]
        if _undoes(journal) and not _locked(file, *_RESERVED) and _undoes(journal):
            self._dead += 1
            if self._dead == _DEAD:
                self.recovery.damage.append(f"its recorder died while it wrote: {journal.name} undoes that")
            return True
        self._dead = 0
        return _locked(file, *_SHARED)

    def _was_written(self, file: BinaryIO, header: bytes) -> bool:
        commits = os.pread(file.fileno(), _HEADER, 0)[_COMMITS]
        return commits != header[_COMMITS] or _locked(file, *_SHARED)

    def _rows(self, most: int, how: str) -> list[tuple[int, int, int, bytes]]:
        """Return number, topic, time and content of the rows behind the last."""
        rows, size = [], 0
        with (
            named(str(self.path)) as path,
            closing(
                sqlite3.connect(f"{Path(path).absolute().as_uri()}?{how}", timeout=0, uri=True)
            ) as database,
        ):
            refuse_what_calculates(database)
            self.connections = topics_of(database, {})
            query = "SELECT rowid, topic_id, timestamp, data FROM messages WHERE rowid > ? ORDER BY 1 LIMIT ?"
            for row in database.execute(query, (self._last, _ROWS)):
                rows.append(row)
                size += len(row[3])
                if size > most:
                    break
        return rows


def _changed(path: Path) -> int:
    """Return when a file that is not empty was changed last, in ns; 0 where there is none."""
    try:
        found = path.stat()
    except FileNotFoundError:
        return 0
    return found.st_mtime_ns if found.st_size else 0


def _undoes(path: Path) -> bool:
    """Tell whether a journal has what a commit would undo."""
    try:
        with path.open("rb") as file:
            return file.read(len(_JOURNAL)) == _JOURNAL
    except FileNotFoundError:
        return False


def _locked(file: BinaryIO, first: int, length: int) -> bool:
    """Tell whether another process has locked some bytes for itself."""
    if sys.platform != "linux":
        return False
    import fcntl

    asked = _LOCK.pack(fcntl.F_RDLCK, os.SEEK_SET, first, length, 0)
    return bool(_LOCK.unpack(fcntl.fcntl(file.fileno(), fcntl.F_GETLK, asked))[0] != fcntl.F_UNLCK)
