"""The pages of an SQLite file, read without SQLite (https://www.sqlite.org/fileformat2.html).

A table is a tree of pages; its leaves hold the rows. A file that is cut off may have lost pages that point
at those before them: so every page that is a leaf can be read by itself.
"""

import struct
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, TypeAlias

from formats.limits import TooMuchError

MAGIC = b"SQLite format 3\0"
HEADER = 100
TABLE_LEAF, TABLE_NODE, INDEX_LEAF, INDEX_NODE = 0x0D, 0x05, 0x0A, 0x02
_TEXT = {1: "utf-8", 2: "utf-16-le", 3: "utf-16-be"}
#: Bytes of the integers of serial types 1 to 6.
_WIDTHS = {1: 1, 2: 2, 3: 3, 4: 4, 5: 6, 6: 8}
_MOST_COLUMNS = 100

Value: TypeAlias = "int | float | str | bytes | None"


class BrokenPageError(ValueError):
    """A page does not add up."""


@dataclass(frozen=True, slots=True)
class PageCell:
    """One row of a table, or one entry of an index."""

    row: int  # Its number; 0 in an index
    size: int  # Bytes of its record
    #: Those of them that are in the page itself, as places in the file.
    begin: int
    end: int
    overflow: int  # The page with the others; 0 if there are none


class Pages:
    """The pages of a file; BrokenPageError wherever something of them does not add up."""

    def __init__(self, data: Any) -> None:
        if len(data) < HEADER or data[: len(MAGIC)] != MAGIC:
            raise BrokenPageError("its header is cut off")
        self.data = data
        (size,) = struct.unpack_from(">H", data, 16)
        self.size = 65_536 if size == 1 else size
        self.usable = self.size - data[20]
        if self.size < 512 or self.size & (self.size - 1) or self.usable < 480:
            raise BrokenPageError("its header contradicts itself")
        changes, self.stated, self.free, _ = struct.unpack_from(">IIII", data, 24)
        if changes != struct.unpack_from(">I", data, 92)[0]:
            self.stated = 0
        self.encoding = _TEXT.get(struct.unpack_from(">I", data, 56)[0], "utf-8")
        self.count = len(data) // self.size  # Whole pages that are there
        #: How many further pages of cells may be walked; none is part of two cells. None for any number.
        self.budget: int | None = 4 * self.count + 1_000

    def start(self, page: int) -> int:
        """Return where the header of a page begins in the file."""
        return (page - 1) * self.size + (HEADER if page == 1 else 0)

    def code(self, page: int) -> int:
        """Return what a page is by its first byte."""
        return int(self.data[self.start(page)])

    def cells(self, page: int) -> Iterator[PageCell]:
        """Yield the cells of a leaf of a table, or of a leaf or node of an index."""
        code, start, first = self.code(page), self.start(page), (page - 1) * self.size
        node = code == INDEX_NODE
        head = 12 if node else 8
        (count,) = struct.unpack_from(">H", self.data, start + 3)
        if start + head + 2 * count > first + self.usable:
            raise BrokenPageError(f"page {page}")
        for (offset,) in struct.iter_unpack(">H", self.data[start + head : start + head + 2 * count]):
            if offset < head + 2 * count or offset >= self.usable:
                raise BrokenPageError(f"page {page}")
            at = first + offset + (4 if node else 0)
            size, at = varint(self.data, at)
            row = 0
            if code == TABLE_LEAF:
                row, at = varint(self.data, at)
            yield self._cell(row, size, at, first + self.usable, leaf=code == TABLE_LEAF)

    def _cell(self, row: int, size: int, at: int, limit: int, *, leaf: bool) -> PageCell:
        most = self.usable - 35 if leaf else (self.usable - 12) * 64 // 255 - 23
        if size <= most:
            if at + size > limit:
                raise BrokenPageError("a row")
            return PageCell(row, size, at, at + size, 0)
        least = (self.usable - 12) * 32 // 255 - 23
        local = least + (size - least) % (self.usable - 4)
        local = local if local <= most else least
        if at + local + 4 > limit:
            raise BrokenPageError("a row")
        (overflow,) = struct.unpack_from(">I", self.data, at + local)
        return PageCell(row, size, at, at + local, overflow)

    def cell_at(self, begin: int, size: int) -> PageCell:
        """Return the cell of a table whose record begins at a place in the file and has this size."""
        page = begin // self.size
        return self._cell(0, size, begin, page * self.size + self.usable, leaf=True)

    def children(self, page: int) -> list[int]:
        """Return the pages below a node, the last one last."""
        start, first = self.start(page), (page - 1) * self.size
        count, right = struct.unpack_from(">H3xI", self.data, start + 3)
        if start + 12 + 2 * count > first + self.usable:
            raise BrokenPageError(f"page {page}")
        below = []
        for (offset,) in struct.iter_unpack(">H", self.data[start + 12 : start + 12 + 2 * count]):
            if offset + 4 > self.usable:
                raise BrokenPageError(f"page {page}")
            below.append(struct.unpack_from(">I", self.data, first + offset)[0])
        return [*below, right]

    def overflow(self, cell: PageCell) -> list[int]:
        pages = []
        needed = -(-(cell.size - (cell.end - cell.begin)) // (self.usable - 4))
        following = cell.overflow
        if self.budget is not None:
            self.budget -= needed
            if self.budget < 0:
                raise TooMuchError("its rows share their pages")
        for _ in range(min(needed, self.count + 1)):
            if not 1 < following <= self.count:
                raise BrokenPageError("the rest of a row")
            pages.append(following)
            (following,) = struct.unpack_from(">I", self.data, (following - 1) * self.size)
        if following or len(pages) != needed:
            raise BrokenPageError("the rest of a row")
        return pages

    def record(self, cell: PageCell) -> bytes:
        parts = [self.data[cell.begin : cell.end]]
        left = cell.size - (cell.end - cell.begin)
        for page in self.overflow(cell):
            begin = (page - 1) * self.size + 4
            parts.append(self.data[begin : begin + min(left, self.usable - 4)])
            left -= len(parts[-1])
        return b"".join(parts)

    def free_pages(self) -> set[int]:
        """Return the pages that are not in use, as far as they are known."""
        free: set[int] = set()
        trunk = self.free
        while 1 < trunk <= self.count and trunk not in free:
            free.add(trunk)
            start = (trunk - 1) * self.size
            trunk, count = struct.unpack_from(">II", self.data, start)
            count = min(count, self.usable // 4 - 2)
            free.update(struct.unpack_from(f">{count}I", self.data, start + 8))
        return free

    def tree(self, root: int) -> tuple[list[int], list[int]]:
        """Walk down a table or index: its leaves in order (of an index its nodes too), and lost pages."""
        leaves, lost = [], []
        seen: set[int] = set()
        waiting = [root]
        while waiting:
            page = waiting.pop()
            if not 1 <= page <= self.count or page in seen:
                lost.append(page)
                continue
            seen.add(page)
            code = self.code(page)
            if code in {TABLE_LEAF, INDEX_LEAF, INDEX_NODE}:
                leaves.append(page)
            if code in {TABLE_NODE, INDEX_NODE}:
                try:
                    waiting += reversed(self.children(page))
                except (BrokenPageError, struct.error):
                    lost.append(page)
            elif code not in {TABLE_LEAF, INDEX_LEAF}:
                lost.append(page)
        return leaves, lost

    def values(self, record: bytes) -> list[Value]:
        return [self.value(record, span) for span in layout(record)]

    def value(self, record: bytes, span: tuple[int, int, int]) -> Value:
        """Return one column of a record; `span` is from `layout`."""
        serial, begin, end = span
        content = record[begin:end]
        if end > len(record):
            raise BrokenPageError("a row")
        if serial == 0:
            return None
        if serial in _WIDTHS:
            return int.from_bytes(content, "big", signed=True)
        if serial == 7:
            return float(struct.unpack(">d", content)[0])
        if serial in {8, 9}:
            return serial - 8
        return bytes(content) if serial % 2 == 0 else bytes(content).decode(self.encoding, "replace")


def layout(record: bytes) -> list[tuple[int, int, int]]:
    """Return the serial type of each column of a record, and where it begins and ends."""
    head, at = varint(record, 0)
    spans: list[tuple[int, int, int]] = []
    begin = head
    while at < head:
        serial, at = varint(record, at)
        if serial in {10, 11} or serial < 0 or len(spans) > _MOST_COLUMNS:
            raise BrokenPageError("a row")
        size = _WIDTHS.get(serial, 8 if serial == 7 else 0) if serial < 12 else (serial - 12) // 2
        spans.append((serial, begin, begin + size))
        begin += size
    if at != head or head > len(record):
        raise BrokenPageError("a row")
    return spans


def varint(data: Any, at: int) -> tuple[int, int]:
    """Return a number of one to nine bytes, and where it ends."""
    if at < len(data) and data[at] < 0x80:
        return data[at], at + 1
    value = 0
    for k in range(9):
        if at + k >= len(data):
            raise BrokenPageError("a number")
        byte = data[at + k]
        if k == 8:
            value = value << 8 | byte
            return (value - (1 << 64) if value >> 63 else value), at + 9
        value = value << 7 | byte & 0x7F
        if byte < 0x80:
            return value, at + k + 1
    raise BrokenPageError("a number")
