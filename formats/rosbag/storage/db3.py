"""The SQLite files of rosbag2, which rosbags refuses where a type has no definition, or by odd paths.

A recorder that goes on writing a file never has to wait. With a write-ahead log a reader locks nothing that
a writer needs. Without one, its lock would make the next commit fail, and recorders do not try again: the
file is then read without any lock, as it is between two commits. That nobody wrote meanwhile is seen from
the lock of the writer, and from the count of its commits.
"""

import os
import re
import sqlite3
import struct
import sys
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack, closing, suppress
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from rosbags.interfaces import Connection, MessageDefinition

from formats.byte_sources import named
from formats.content import SIDE_FILES
from formats.limits import CHUNK_BYTES, TooMuchError
from formats.recovery import Recovery
from formats.rosbag.storage.chunks import RUN_BYTES, Run
from formats.rosbag.storage.db3_rows import Leaves
from formats.rosbag.storage.raw_messages import FORMATS, NO_DEFINITION, astray, collected, ros2_connection
from formats.sqlite_pages import BrokenPageError

#: Name, type and place in the key of the columns that `Leaves` reads.
_PLAIN = [("id", "INTEGER", 1), ("topic_id", "INTEGER", 0), ("timestamp", "INTEGER", 0), ("data", "BLOB", 0)]
#: Log times and keys are compared with their index by one sum, of what is left over these.
_PRIMES = 1_000_003, 1_009
#: Header of the file: its version of reading, 2 with a write-ahead log, and the count of commits.
_HEADER, _VERSION, _COMMITS = 100, 19, slice(24, 28)
#: Bytes that SQLite locks (https://www.sqlite.org/lockingv3.html): to write at all, and to write the file.
_RESERVED, _SHARED = (0x40000001, 1), (0x40000002, 510)
_LOCK = struct.Struct("@hhqqi")  # `struct flock` of Linux: kind, whence, first byte, length, process
_JOURNAL = bytes.fromhex("d9d505f920a163d7")  # How a journal begins that is not yet done with
_DEAD = 5  # Looks in which a journal stands without its writer: one may fall between two commits
_ROWS = 5_000  # Rows in one question
_HASH = "type_description_hash"  # Of a type, in tables of newer recorders


class Db3File:
    """One file, with the interface of rosbags' own readers of files."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.connections: list[Connection] = []
        #: First and last log time of each connection that has messages, by its id.
        self.spans: dict[int, tuple[int, int]] = {}
        self._leaves: Leaves | None = None
        self._opened = ExitStack()
        self.close = self._opened.close  # Closes what is open

    def open(self) -> None:
        # immutable: SQLite must neither wait for locks nor write anything beside the user's file.
        with named(str(self.path)) as path:
            self._database = self._opened.enter_context(closing(_connected(path, "immutable=1")))
            # Without a question it does not open the file.
            with suppress(sqlite3.Error, MemoryError):
                self._database.execute("PRAGMA schema_version")
        try:
            self._read_topics(self._database)
        except MemoryError as error:
            # Damaged pages may have SQLite ask for more than there is.
            raise sqlite3.DatabaseError("its pages are damaged: SQLite ran out of memory") from error

    def _read_topics(self, database: sqlite3.Connection) -> None:
        refuse_what_calculates(database)
        self._leaves = self._plain(database)
        spans = self._leaves.spans() if self._leaves else _spans(database)
        if not all(isinstance(time, int) for _, *ends in spans.values() for time in ends):
            # SQLite takes anything in any column.
            raise ValueError("a log time is no whole number")
        self._check_times(database)
        self.connections = _topics(database, {topic: count for topic, (count, _, _) in spans.items()})
        self.spans = {topic: (start, end) for topic, (_, start, end) in spans.items()}

    def _check_times(self, database: sqlite3.Connection) -> None:
        """Refuse log times that cannot be, as salvage sets them aside: SQLite has no checksums."""
        if self._leaves is not None:
            numbers, times = self._leaves.times()
        else:
            query = "SELECT id, timestamp FROM messages ORDER BY id"
            numbers, times = np.array(database.execute(query).fetchall(), np.int64).reshape(-1, 2).T
        wrong = numbers[astray(times)]
        if len(wrong):
            raise ValueError(f"the log time of message {wrong[0]} is over an hour from those beside it")
        if self._leaves is None:
            return
        # One time that differs changes the sum, and SQLite adds it up without giving rows to Python.
        summed = int((np.fmod(times, _PRIMES[0]) * (np.fmod(numbers, _PRIMES[1]) + 1)).sum())
        for name in _indexes_of_time(database):
            query = "SELECT count(*), sum((timestamp % ?) * (id % ? + 1)) FROM messages INDEXED BY "
            (told,) = database.execute(f'{query}"{name}"', _PRIMES)
            if told != (len(times), summed if len(times) else None):
                raise ValueError("its log times are not those of their index")

    def _plain(self, database: sqlite3.Connection) -> Leaves | None:
        """Return what reads the messages in bulk, if they are as all recorders write them."""
        described = database.execute("PRAGMA table_info(messages)")
        columns = [(name, kind, key) for _, name, kind, _, _, key in described]
        if columns != _PLAIN:
            return None
        ((root,),) = database.execute("SELECT rootpage FROM sqlite_master WHERE lower(name) = 'messages'")
        query = "SELECT data FROM messages WHERE id = ?"
        file = self._opened.enter_context(self.path.open("rb"))
        try:
            return Leaves(file, root, lambda number: database.execute(query, (number,)).fetchone()[0])
        except (BrokenPageError, IndexError):
            return None

    def runs(self, wanted: Collection[int], size: int = RUN_BYTES) -> Iterator[Run]:
        """Read the messages of some connections in the order of their log times, some bytes at a time."""
        if self._leaves is not None:
            yield from self._leaves.runs(wanted, size)
            return
        places = ",".join("?" * len(wanted))
        query = (
            "SELECT topic_id, timestamp, data FROM messages"  # noqa: S608  only question marks are put in
            f" WHERE topic_id IN ({places}) ORDER BY timestamp, id"
        )
        yield from collected(self._database.execute(query, tuple(wanted)), size)


def _connected(path: str, how: str) -> sqlite3.Connection:
    """Open a file to read, without waiting for locks; the garbage collector may close it from any thread."""
    uri = f"{Path(path).absolute().as_uri()}?{how}"
    return sqlite3.connect(uri, uri=True, timeout=0, check_same_thread=False)


def _topics(database: sqlite3.Connection, counts: Mapping[int, int]) -> list[Connection]:
    """Return the topics, in the order of their ids, with their definitions and these counts of messages."""
    topics = _rows(database, "SELECT * FROM topics ORDER BY id")
    defined = database.execute("PRAGMA table_info(message_definitions)").fetchall()
    definitions = _rows(database, "SELECT * FROM message_definitions") if defined else ()
    found = connections_of({topic["id"]: topic for topic in topics}, definitions)
    return [connection._replace(msgcount=counts.get(connection.id, 0)) for connection in found]


def _rows(database: sqlite3.Connection, query: str) -> list[dict[str, Any]]:
    cursor = database.execute(query)
    names = [column[0] for column in cursor.description]
    return [dict(zip(names, row, strict=True)) for row in cursor]


def connections_of(
    topics: Mapping[int, Mapping[str, Any]], definitions: Iterable[Mapping[str, Any]]
) -> list[Connection]:
    """Describe topics by the rows of the tables `topics`, by their ids, and `message_definitions`."""
    known: dict[str, list[tuple[str, MessageDefinition]]] = {}
    for row in definitions:
        if row["encoding"] in FORMATS:
            definition = MessageDefinition(FORMATS[row["encoding"]], row["encoded_message_definition"])
            known.setdefault(row["topic_type"], []).append((row.get(_HASH) or "", definition))
    found = []
    for number, row in topics.items():
        name, digest, encoding = row["type"], row.get(_HASH) or "", row.get("serialization_format") or "cdr"
        definition = _definition(known.get(name, []), digest)
        found.append(ros2_connection(number, row["name"], name, definition, digest, encoding))
    return found


def _indexes_of_time(database: sqlite3.Connection) -> list[str]:
    """Return the names of the indexes that hold the log times of all messages, and nothing else."""
    names = [row[1] for row in database.execute("PRAGMA index_list(messages)") if not row[4]]
    quoted = [name.replace('"', '""') for name in names]
    columns = {name: [row[2] for row in database.execute(f'PRAGMA index_info("{name}")')] for name in quoted}
    return [name for name, held in columns.items() if held == ["timestamp"]]


def _definition(known: Sequence[tuple[str, MessageDefinition]], type_hash: str) -> MessageDefinition:
    """Return the definition that a topic's hash says, or the only one; none where it may be another."""
    of_hash = [definition for own, definition in known if own == type_hash != ""]
    first, *others = of_hash or [definition for _, definition in known] or [NO_DEFINITION]
    return first if all(one == first for one in others) else NO_DEFINITION


def _spans(database: sqlite3.Connection) -> dict[int, tuple[int, int, int]]:
    """Return how many messages each topic has, and its first and last log time in ns."""
    query = "SELECT topic_id, count(*), min(timestamp), max(timestamp) FROM messages GROUP BY topic_id"
    return {topic: (count, start, end) for topic, count, start, end in database.execute(query)}


def refuse_what_calculates(database: sqlite3.Connection) -> None:
    """Refuse a file whose tables are views or make up values: such a query need never end."""
    database.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, CHUNK_BYTES)
    database.execute("PRAGMA trusted_schema = OFF")
    for name, kind, root, statement in database.execute(
        "SELECT name, type, rootpage, sql FROM sqlite_master"
        " WHERE lower(name) IN ('topics', 'messages', 'message_definitions')"
    ):
        if kind != "table" or not root or re.search(r"\bAS\b", str(statement), re.IGNORECASE):
            raise TooMuchError(f"its {name} are no plain table")


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

    def grow(self, file: BinaryIO, most: int) -> list[Run]:
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
        with named(str(self.path)) as path, closing(_connected(path, how)) as database:
            refuse_what_calculates(database)
            self.connections = _topics(database, {})
            # A message of nothing is one that cannot be decoded, and is told as such.
            query = (
                "SELECT rowid, topic_id, timestamp, CAST(coalesce(data, x'') AS BLOB) FROM messages "
                "WHERE rowid > ? ORDER BY 1 LIMIT ?"
            )
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
