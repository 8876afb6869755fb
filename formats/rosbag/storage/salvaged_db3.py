"""SQLite files of rosbag2 that are cut off or damaged: every row of every page that is there.

SQLite has no checksums: a row is taken where it is one of messages in every respect, and the index of the
log times, as far as it is there, does not contradict it.
"""

import contextlib
import re
import sqlite3
import struct
from collections.abc import Collection, Iterator, Sequence
from functools import partial
from pathlib import Path

import numpy as np
from rosbags.interfaces import Connection

from formats.byte_sources import kept, named
from formats.content import SIDE_FILES
from formats.limits import CHUNK_BYTES, TooMuchError
from formats.rosbag.storage.chunks import RUN_BYTES
from formats.rosbag.storage.db3 import connections_of
from formats.rosbag.storage.raw_messages import WILD, Index, Messages, astray, collected
from formats.rosbag.storage.stored_file import StoredFile, by_connection
from formats.sqlite_pages import (
    INDEX_LEAF,
    INDEX_NODE,
    TABLE_LEAF,
    BrokenPageError,
    PageCell,
    Pages,
    Value,
    layout,
)

_Table = tuple[int, list[str]]  # Root page, and names of the columns

_MOST_TABLES = 100
_BLOCK = 1 << 20
_COLUMNS = ("topic_id", "timestamp", "data")


class SalvagedDb3(StoredFile):
    def open(self) -> None:
        """Find the readable pages; what a log beside the file holds is put into a copy first."""
        files = [Path(f"{self.path}{ending}") for ending in SIDE_FILES]
        beside = [file for file in files if file.is_file() and file.stat().st_size]
        damage = [f"the recording was not closed: messages were left in {file.name}" for file in beside]
        with contextlib.ExitStack() as stack:
            if beside:
                self.path = self._joined(beside, stack)
            super().open()
        self.recovery.damage = damage + self.recovery.damage

    def _joined(self, beside: Sequence[Path], stack: contextlib.ExitStack) -> Path:
        """Copy the file, and have SQLite put into the copy what a log beside it holds."""
        copies = {}
        for file in (self.path, *beside):
            with file.open("rb") as source:
                copy, path = kept(str(file), iter(partial(source.read, _BLOCK), b""))
            stack.callback(copy.close)
            copies[file] = path
        with contextlib.ExitStack() as names:
            name = names.enter_context(named(copies[self.path]))
            for file in beside:
                names.enter_context(named(copies[file], name + file.name.removeprefix(self.path.name)))
            with contextlib.suppress(sqlite3.Error), contextlib.closing(sqlite3.connect(name)) as database:
                database.execute("PRAGMA trusted_schema = OFF")
                database.execute("SELECT count(*) FROM sqlite_master").fetchone()
                database.execute("PRAGMA journal_mode = DELETE")
            Path(f"{name}-shm").unlink(missing_ok=True)
        return Path(copies[self.path])

    def scan(self) -> tuple[dict[int, Connection], list[tuple[int, Index]]]:
        recovery = self.recovery
        self._pages = pages = Pages(self.data)
        size, whole = len(self.data), pages.stated * pages.size
        if whole:
            recovery.bytes_expected, recovery.whole_known = whole, True
        if size < whole:
            recovery.damage.append(f"cut off at byte {size:,} of {whole:,}")
        elif size % pages.size:
            recovery.damage.append(f"cut off at byte {size:,}, inside a page")
        recovery.bytes_read = min(pages.count * pages.size, whole or size)
        self._lost: set[int] = set()
        tables = self._tables()
        if "messages" not in tables or "topics" not in tables:
            raise BrokenPageError("the pages that name its tables are not there")
        known = self._topics(tables)
        rows = self._rows = self._messages(tables, set(known))
        pages.budget = None
        if any(page <= pages.count for page in self._lost):
            told = ", ".join(str(page) for page in sorted(self._lost) if page <= pages.count)
            recovery.damage.append(f"pages that are not what they should be: {told[:80]}")
        self._lost_times(cut=size < whole)
        return known, [(topic, own[:, 1]) for topic, own in by_connection(rows)]

    def _tables(self) -> dict[str, _Table]:
        """Return root page and columns of each table, and of the index of times."""
        tables: dict[str, _Table] = {}
        for _, row in self._table(1):
            if len(tables) > _MOST_TABLES:
                raise TooMuchError("it has more tables than any recording")
            if len(row) < 5 or not (isinstance(row[1], str) and isinstance(row[3], int)):
                continue
            kind, name, of, root, sql = row[0], row[1], row[2], row[3], str(row[4] or "")
            if kind == "table":
                tables[name] = root, _column_names(sql)
            elif kind == "index" and of == "messages" and re.search(r"\(\s*timestamp\b[^,]*\)", sql):
                tables["@times"] = root, []
        return tables

    def _table(self, root: int) -> Iterator[tuple[int, list[Value]]]:
        """Yield the rows of a table that can be read."""
        leaves, lost = self._pages.tree(root)
        self._lost.update(lost)
        for page in leaves:
            try:
                for cell in self._pages.cells(page):
                    if cell.size <= CHUNK_BYTES:
                        with contextlib.suppress(BrokenPageError, struct.error):
                            yield cell.row, self._pages.values(self._pages.record(cell))
            except (BrokenPageError, struct.error):
                self._lost.add(page)

    def _topics(self, tables: dict[str, _Table]) -> dict[int, Connection]:
        topics = self._named_rows(tables["topics"], ("name", "type"))
        columns = ("topic_type", "encoding", "encoded_message_definition")
        definitions = self._named_rows(tables.get("message_definitions"), columns)
        return {one.id: one for one in connections_of(topics, definitions.values())}

    def _named_rows(self, table: _Table | None, texts: Sequence[str]) -> dict[int, dict[str, Value]]:
        """Return the rows of a table in which some columns are texts."""
        if table is None:
            return {}
        root, names = table
        rows = {row: dict(zip(names, values, strict=False)) for row, values in self._table(root)}
        return {n: row for n, row in rows.items() if all(isinstance(row.get(text), str) for text in texts)}

    def _messages(self, tables: dict[str, _Table], topics: set[int]) -> Index:
        """Return the rows of messages: topic, time, place of the record in the file, its size, number."""
        names = tables["messages"][1]
        if not set(_COLUMNS) <= set(names):
            raise BrokenPageError("its table of messages has other columns")
        self._places = [names.index(name) for name in _COLUMNS]
        self._width = len(names)
        own, orphans = self._leaves(tables)
        self._times = self._index(tables)
        found: dict[int, tuple[int, int, int, int]] = {}
        claimed: dict[int, int] = {}
        twice: set[int] = set()
        for page in [*own, *orphans]:
            rows, whole = self._leaf(page, topics)
            if not whole:
                self._lost.add(page)
                if page not in own:
                    # Perhaps of another table.
                    continue
            for row, (topic, time, cell, further) in rows.items():
                if row in found:
                    twice.add(row)
                    continue
                for other in further:
                    if claimed.setdefault(other, row) != row or other in own:
                        twice.update((row, claimed[other]))
                found[row] = topic, time, cell.begin, cell.size
        wrong = twice | {row for row, (_, time, _, _) in found.items() if self._times.get(row, time) != time}
        kept = [(*values, row) for row, values in sorted(found.items()) if row not in wrong]
        table = np.array(kept, dtype=np.int64).reshape(-1, 5)
        alone = astray(table[:, 1])
        self._aside = wrong.union(table[alone, 4].tolist())
        self.recovery.aside += len(self._aside)
        return table[~alone]

    def _leaves(self, tables: dict[str, _Table]) -> tuple[dict[int, None], list[int]]:
        """Return the pages of messages, and those that may be: the node above them is lost."""
        pages = self._pages
        own, lost = pages.tree(tables["messages"][0])
        self._lost.update(lost)
        taken = pages.free_pages().union(own, pages.tree(1)[0])
        for name, (root, _) in tables.items():
            if name != "messages":
                taken.update(pages.tree(root)[0])
        leaves = (page for page in range(2, pages.count + 1) if pages.code(page) == TABLE_LEAF)
        return dict.fromkeys(own), [page for page in leaves if page not in taken]

    def _leaf(
        self, page: int, topics: set[int]
    ) -> tuple[dict[int, tuple[int, int, PageCell, list[int]]], bool]:
        """Return the rows of a page that are messages, and whether all of it added up."""
        rows: dict[int, tuple[int, int, PageCell, list[int]]] = {}
        whole = True
        before = None
        try:
            for cell in self._pages.cells(page):
                if before is not None and cell.row <= before:
                    return {}, False
                before = cell.row
                try:
                    message = self._message(cell, topics)
                except (BrokenPageError, struct.error):
                    whole = False
                    continue
                # The rest of a long message may be lost; the others of its page are not.
                with contextlib.suppress(BrokenPageError, struct.error):
                    rows[cell.row] = (*message, cell, self._pages.overflow(cell))
        except (BrokenPageError, struct.error):
            whole = False
        # A time that no index confirms is compared with the others of its page.
        if unnamed := [row for row in rows if row not in self._times]:
            middle = int(np.median([time for _, time, _, _ in rows.values()]))
            for row in unnamed:
                if abs(rows[row][1] - middle) > WILD:
                    del rows[row]
                    whole = False
        return rows, whole

    def _message(self, cell: PageCell, topics: set[int]) -> tuple[int, int]:
        """Return topic and time of a row, if it is one of messages in every respect."""
        # Of a long record the first part holds all but the end of the payload.
        begins = self._pages.data[cell.begin : cell.end]
        spans = layout(begins)
        topic_at, time_at, data_at = self._places
        if len(spans) != self._width or spans[-1][2] != cell.size or cell.size > CHUNK_BYTES:
            raise BrokenPageError("a row")
        serial = spans[data_at][0]
        topic, time = (self._pages.value(begins, spans[at]) for at in (topic_at, time_at))
        if serial < 12 or serial % 2 or not isinstance(topic, int) or not isinstance(time, int):
            raise BrokenPageError("a row")
        if topic not in topics or time < 0:
            raise BrokenPageError("a row")
        return topic, time

    def _index(self, tables: dict[str, _Table]) -> dict[int, int]:
        """Return the log time of each row that the index of times names."""
        if "@times" not in tables:
            return {}
        times: dict[int, int] = {}
        pages, lost = self._pages.tree(tables["@times"][0])
        self._lost.update(lost)
        for page in pages:
            if self._pages.code(page) not in {INDEX_LEAF, INDEX_NODE}:
                continue
            try:
                for cell in self._pages.cells(page):
                    values = self._pages.values(self._pages.record(cell))
                    if len(values) == 2 and isinstance(values[0], int) and isinstance(values[1], int):
                        times[values[1]] = values[0]
            except (BrokenPageError, struct.error):
                self._lost.add(page)
        return times

    def _lost_times(self, *, cut: bool) -> None:
        """Tell the stretches of time that hold lost rows, by the rows around them and by the index."""
        recovery, rows = self.recovery, self._rows
        numbers, times = rows[:, 4], rows[:, 1]
        gone = sorted(set(self._times) - set(numbers.tolist()) - self._aside)
        if not cut and not self._lost:
            recovery.expected = len(rows) + recovery.aside
            if not gone and not recovery.aside:
                return
        if gone and not cut:
            recovery.expected = len(rows) + recovery.aside + len(gone)
            recovery.damage.append(f"{len(gone):,} messages that its index names are not there")
        for place in np.flatnonzero(np.diff(numbers) > 1).tolist():
            recovery.lost.append((int(times[place]), max(int(times[place]), int(times[place + 1]))))
        if cut:
            last = int(times.max()) if len(rows) else None
            recovery.lost.append((last, None))
            after = [self._times[row] for row in gone]
            if after and last is not None and 0 <= max(after) - last < WILD:
                recovery.goes_on = max(after)

    def runs(self, wanted: Collection[int], size: int = RUN_BYTES) -> Iterator[dict[int, Messages]]:
        rows = self._rows[np.isin(self._rows[:, 0], np.array(sorted(wanted), dtype=np.int64))]
        rows = rows[np.lexsort((rows[:, 4], rows[:, 1]))]
        found = ((topic, time, self._payload(at, size)) for topic, time, at, size, _ in rows.tolist())
        yield from collected(found, size)

    def _payload(self, begin: int, size: int) -> bytes:
        record = self._pages.record(self._pages.cell_at(begin, size))
        _, start, end = layout(record)[self._places[2]]
        return record[start:end]


def _column_names(sql: str) -> list[str]:
    """Return the names of the columns in a statement that makes a table."""
    inner = sql.partition("(")[2].rpartition(")")[0]
    parts = re.sub(r"\([^()]*\)", "", inner).split(",")
    names = [part.split()[0].strip("\"'`[]") for part in parts if part.split()]
    constraints = {"FOREIGN", "UNIQUE", "CHECK", "CONSTRAINT", "PRIMARY"}
    return [name for name in names if name.upper() not in constraints]
