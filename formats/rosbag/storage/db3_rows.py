"""The messages of an SQLite file of rosbag2, straight from its pages, thousands of rows at a time.

SQLite gives row after row to Python; here the leaves of the one table are decoded with NumPy. SQLite reads
the payloads that go on in further pages, and whole files in which anything is not plain.
"""

from collections.abc import Callable, Collection, Iterator
from io import BufferedReader
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from formats.rosbag.storage.chunks import RUN_BYTES, Run
from formats.rosbag.storage.raw_messages import Index, Messages, numbers_at
from formats.sqlite_pages import HEADER, TABLE_LEAF, TABLE_NODE, BrokenPageError, Pages, layout

Bytes = NDArray[np.uint8]
#: Of messages the key, that of the topic, the log time in ns, where the payload begins in the file (−1 if
#: it goes on in other pages), and its bytes; shape (5, n).
Rows = NDArray[np.int64]

_LEAF_HEAD = 8
#: No row of a message takes less of its page: its place (2 bytes), its size, its key, its head, four types.
_LEAST = 9
_DEEPEST = 20  # SQLite's own limit of the pages from a root to a leaf
_WIDTHS = np.full(128, -1)  # Bytes of an integer by its serial type; −1 where a type is none
for _serial in (1, 2, 3, 4, 5, 6, 8, 9):
    ((_, _begin, _end),) = layout(bytes((2, _serial)))
    _WIDTHS[_serial] = _end - _begin


class Leaves:
    """The plain table of messages from its `root` page on; BrokenPageError or IndexError of another."""

    # `fetch` returns the payload of a key, however long.

    def __init__(self, file: BufferedReader, root: int, fetch: Callable[[int], bytes]) -> None:
        self._file = file
        self._fetch = fetch
        self._pages = Pages(file.read(HEADER))
        leaves = self._leaves(root)
        step = max(1, RUN_BYTES // self._pages.size)
        some = [leaves[k : k + step] for k in range(0, len(leaves), step)]
        parts = [_decoded(self._read(pages), pages, self._pages) for pages in some]
        rows = np.concatenate(parts, axis=1)
        number, _, time, _, _ = rows
        if (number[1:] <= number[:-1]).any():
            raise BrokenPageError("rows out of order")
        self._rows = rows if (time[1:] >= time[:-1]).all() else rows[:, np.lexsort((number, time))]

    def _leaves(self, root: int) -> Index:
        """Return the pages with the rows, in the order of the keys: all are equally far from the root."""
        header = self._read(np.array([1])).tobytes()
        count = self._file.seek(0, 2) // self._pages.size
        level = np.array([root], dtype=np.int64)
        for _ in range(_DEEPEST):
            if len(level) > count:
                raise BrokenPageError("pages that are in two places")
            if self._read(level[:1])[0] != TABLE_NODE:
                return level
            # Of such a file the nodes are pages 2, 3 and so on.
            nodes = Pages(header + self._read(level).tobytes())
            places = range(2, nodes.count + 1)
            if any(nodes.code(place) != TABLE_NODE for place in places):
                raise BrokenPageError("pages of another kind")
            level = np.concatenate([np.array(nodes.children(place)) for place in places])
        raise BrokenPageError("pages that go round in circles")

    def _read(self, pages: Index) -> Bytes:
        """Return the bytes of some pages, one after the other."""
        size = self._pages.size
        block = np.empty(len(pages) * size, np.uint8)
        if (pages < 1).any():
            raise BrokenPageError("a page that is not there")
        begins = np.flatnonzero(np.diff(pages, prepend=-1) != 1)
        for begin, end in pairwise([*begins.tolist(), len(pages)]):
            self._file.seek((int(pages[begin]) - 1) * size)
            if self._file.readinto(block[begin * size : end * size].data) != (end - begin) * size:
                raise BrokenPageError("a page that is not there")
        return block

    def times(self) -> tuple[Index, Index]:
        """Return the keys and log times in ns of all messages, in the order of the keys."""
        number, _, time, _, _ = self._rows
        order = np.argsort(number)
        return number[order], time[order]

    def spans(self) -> dict[int, tuple[int, int, int]]:
        """Return how many messages each topic has, and its first and last log time in ns."""
        spans = {}
        _, topics, time, _, _ = self._rows
        for topic in np.unique(topics):
            times = time[topics == topic]
            spans[int(topic)] = len(times), int(times[0]), int(times[-1])
        return spans

    def runs(self, wanted: Collection[int], size: int) -> Iterator[Run]:
        """Read the messages of some topics; see `db3.Db3File.runs`."""
        rows = self._rows[:, np.isin(self._rows[1], np.array(sorted(wanted), dtype=np.int64))]
        _, _, _, starts, sizes = rows
        if not len(sizes):
            return
        inside = starts >= 0
        # Of the byte before the payload: an empty one may stand at the end of its page.
        page = (starts - 1) // self._pages.size + 1
        # A page is read whole, however little of it is wanted.
        read = np.where(inside, self._pages.size, sizes)
        read[1:][inside[1:] & (page[1:] == page[:-1])] = 0
        bounds = np.flatnonzero(np.diff(np.cumsum(read) // size, prepend=-1))
        for begin, end in zip(bounds, [*bounds[1:], len(page)], strict=True):
            some = slice(int(begin), int(end))
            yield self._run(rows[:, some], page[some], int(begin))

    def _run(self, rows: Rows, page: Index, first: int) -> Run:
        numbers, topics, times, begins, sizes = rows
        inside = begins >= 0
        starts = np.empty(len(page), np.int64)
        needed, rank = np.unique(page[inside], return_inverse=True)
        parts: list[Any] = [self._read(needed)]
        starts[inside] = begins[inside] + (rank - page[inside] + 1) * self._pages.size
        end = len(parts[0])
        for row in np.flatnonzero(~inside):
            payload = self._fetch(int(numbers[row]))
            if len(payload) != sizes[row]:
                raise BrokenPageError("a payload is not as long as it says")
            starts[row], end = end, end + len(payload)
            parts.append(np.frombuffer(payload, np.uint8))
        buffer = (np.concatenate(parts) if len(parts) > 1 else parts[0]).data
        every = Messages(buffer, starts, sizes, times, np.arange(first, first + len(page)))
        return {int(topic): every.take(topics == topic) for topic in np.unique(topics)}


def _decoded(block: Bytes, page: Index, pages: Pages) -> Rows:
    """Decode the rows of some leaves: their bytes, one after the other, and their numbers."""
    size, usable = pages.size, pages.usable
    first = np.arange(len(page)) * size
    if (block[first] != TABLE_LEAF).any():
        raise BrokenPageError("pages of another kind")
    count = numbers_at(block, first + 3, ">u2").astype(np.int64)
    if (_LEAF_HEAD + _LEAST * count > usable).any():
        raise BrokenPageError("more rows than its page holds")
    nth = np.arange(count.sum()) - np.repeat(np.cumsum(count) - count, count)
    of = np.repeat(np.arange(len(page)), count)
    base = first[of]
    offset = numbers_at(block, base + _LEAF_HEAD + 2 * nth, ">u2").astype(np.int64)
    length, at = _varints(block, base + offset)
    number, record = _varints(block, at)
    head = block[record].astype(np.int64)
    key, topic, time = (block[record + k].astype(np.int64) for k in (1, 2, 3))
    data, at = _varints(block, record + 4)
    topic_width, time_width = _WIDTHS[topic & 0x7F], _WIDTHS[time & 0x7F]
    time_at = record + head + topic_width
    begin = time_at + time_width
    payload = (data - 12) // 2
    plain = (key == 0) & (topic < 0x80) & (time < 0x80) & (topic_width >= 0) & (time_width >= 0)
    plain &= (data >= 12) & (data % 2 == 0) & (at == record + head) & (begin + payload == record + length)
    # SQLite's limit, beyond which a row goes on in other pages.
    inside = length <= usable - 35
    plain &= ~inside | (record + length <= base + usable)
    if not (plain & (offset >= _LEAF_HEAD + 2 * count[of])).all():
        raise BrokenPageError("a row is not plain")
    topic = _integers(block, record + head, topic, topic_width)
    time = _integers(block, time_at, time, time_width)
    begin = np.where(inside, begin - base + (page[of] - 1) * size, -1)
    return np.array([number, topic, time, begin, payload])


def _varints(block: Bytes, at: Index) -> tuple[Index, Index]:
    """Return the numbers of one to eight bytes at some places, and where they end."""
    last = block[at].astype(np.int64)
    value, at = last & 0x7F, at + 1
    further = np.flatnonzero(last >= 0x80)
    for _ in range(7):
        if not len(further):
            return value, at
        last = block[at[further]].astype(np.int64)
        value[further] = value[further] << 7 | last & 0x7F
        at[further] += 1
        further = further[last >= 0x80]
    raise BrokenPageError("a number")


def _integers(block: Bytes, at: Index, serial: Index, width: Index) -> Index:
    """Return integers of any width; a page begins with eight bytes that are none of them."""
    spare = np.minimum(64 - 8 * width, 63)
    value = numbers_at(block, at + width - 8, ">i8").astype(np.int64) << spare >> spare
    return np.where(width > 0, value, serial - 8)
