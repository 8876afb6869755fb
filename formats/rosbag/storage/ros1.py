"""The files of ROS 1, read through their index in bulk."""

import io
from collections.abc import Collection, Iterator, Mapping
from functools import partial
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray
from rosbags.rosbag1 import Reader
from rosbags.rosbag1.reader import Header, RecordType, decompressors, read_uint32

from formats.rosbag.storage.chunks import RUN_BYTES, Chunk, Entries, Run, opened, runs
from formats.rosbag.storage.raw_messages import Index, numbers_at, parts_at, unpack, widen

#: What rosbags makes of an index, entry by entry; here it stays empty.
Unused: TypeAlias = dict[int, list[Any]]

_ENTRY = np.dtype([("sec", "<u4"), ("nsec", "<u4"), ("place", "<u4")])
_SECOND = 1_000_000_000
#: Names and sizes of what the header of a message holds, in any order.
_FIELDS = {b"op": 1, b"conn": 4, b"time": 8}

# Those of rosbags unpack without bounds: a few bytes would become gigabytes.
decompressors.update({name: partial(unpack, packing=name) for name in decompressors if name != "none"})


class Ros1File(Reader):
    """One file. Its connections are read by rosbags, its messages here, and its index without objects."""

    entry = _ENTRY

    def open(self) -> None:
        """Read connections and chunks, and see what the indexes span."""
        #: First and last log time of each connection that has messages, by its number.
        self.spans: dict[int, tuple[int, int]] = {}
        self._found: dict[int, list[tuple[int, int, int]]] = {}
        self._listed: set[tuple[int, int]] = set()
        self._firsts: dict[int, int] = {}
        self._counts: dict[int, int] = {}
        super().open()
        self.connections = [c._replace(msgcount=self._counts.get(c.id, 0)) for c in self.connections]

    def read_index_data(self, pos: int, indexes: Unused) -> None:  # noqa: ARG002 - as rosbags calls it
        """Note where the index of one connection in one chunk stands."""
        bio = opened(self.bio)
        header = Header.read(bio, RecordType.IDXDATA)
        version, connection, count = map(header.get_uint32, ("ver", "conn", "count"))
        if version != 1:
            raise ValueError("an index is of an unknown version")
        if (pos, connection) in self._listed:
            # A few bytes of index could make this read one chunk without end.
            raise ValueError("its index names a chunk twice")
        self._listed.add((pos, connection))
        if read_uint32(bio) != count * _ENTRY.itemsize:
            raise ValueError("an index is not as long as it says")
        begin = bio.tell()
        times, _ = self.entries(np.frombuffer(bio.read(count * _ENTRY.itemsize), _ENTRY))
        if len(times) != count:
            raise EOFError("an index is cut off")
        self._found.setdefault(pos, []).append((connection, begin, count))
        if not count:
            return
        first = int(times.min())
        self._firsts[pos] = min(first, self._firsts.get(pos, first))
        self._counts[connection] = self._counts.get(connection, 0) + count
        widen(self.spans, connection, times)

    def runs(self, wanted: Collection[int], size: int = RUN_BYTES) -> Iterator[Run]:
        chunks = [
            Chunk(
                position=chunk.datapos,
                stored=chunk.datasize,
                unpack=chunk.decompressor,
                slow=chunk.decompressor is not decompressors["none"],
                first=self._firsts[position],
                index=tuple(self._found[position]),
            )
            for position, chunk in sorted(self.chunks.items())
            if position in self._firsts
        ]
        yield from runs(opened(self.bio), chunks, wanted, self, size)

    def entries(self, of: Entries) -> tuple[Index, Index]:
        times = of["sec"].astype(np.int64) * _SECOND + of["nsec"]
        return times, of["place"].astype(np.int64)

    def payloads(self, buffer: bytes, number: int, entries: Entries, records: Index) -> tuple[Index, Index]:
        times, _ = self.entries(entries)
        lengths = numbers_at(buffer, records, "<u4").astype(np.int64)
        known = np.zeros(len(records), dtype=bool)
        ordered = np.sort(lengths)
        # np.unique would import numpy.ma, which takes longer than a short bag.
        for length in ordered[np.diff(ordered, prepend=-1) > 0]:
            # Writers put the fields in one order, so that the first header of a length tells of all.
            rows = np.flatnonzero(lengths == length)
            first = int(records[rows[0]]) + 4
            places = _fields(buffer[first : first + int(length)])
            if places is not None:
                heads = _heads(buffer, records[rows], int(length), places)
                at = heads["sec"].astype(np.int64) * _SECOND + heads["nsec"]
                right = (heads["op"] == RecordType.MSGDATA) & (heads["conn"] == number)
                known[rows] = right & (at == times[rows])
        data = records + 4 + lengths
        for row in np.flatnonzero(~known):
            data[row] = _data_of(buffer, int(records[row]), number, int(times[row]))
        return data + 4, numbers_at(buffer, data, "<u4").astype(np.int64)


def _fields(header: bytes) -> dict[bytes, int] | None:
    """Return where the values of the header of a message begin; None if they are not all there."""
    places, at = {}, 0
    while at + 4 <= len(header):
        size = int.from_bytes(header[at : at + 4], "little")
        name, sign, value = header[at + 4 : at + 4 + size].partition(b"=")
        if not sign:
            return None
        if len(value) == _FIELDS.get(name):
            places[name] = at + 4 + len(name) + 1
        at += 4 + size
    return places if len(places) == len(_FIELDS) and at == len(header) else None


def _heads(buffer: bytes, records: Index, length: int, places: Mapping[bytes, int]) -> NDArray[Any]:
    """Return the headers of messages of which all have this length and these places of fields."""
    begins = [4 + places[name] for name in (b"op", b"conn", b"time")]
    begins.append(begins[-1] + 4)
    kinds: Any = {"names": ["op", "conn", "sec", "nsec"], "formats": ["u1", "<u4", "<u4", "<u4"]}
    layout = np.dtype(kinds | {"offsets": begins, "itemsize": 4 + length})
    return parts_at(buffer, records, layout.itemsize).view(layout)


def _data_of(buffer: bytes, record: int, connection: int, time: int) -> int:
    """Return where the data of one message begin, by rosbags' own way of reading its header."""
    stream = io.BytesIO(buffer)
    stream.seek(record)
    header = Header.read(stream)
    while header.get_uint8("op") == RecordType.CONNECTION:
        # Some writers let the index point at the connection that stands before its first message.
        size = read_uint32(stream)
        stream.seek(size, io.SEEK_CUR)
        header = Header.read(stream)
    found = header.get_uint8("op"), header.get_uint32("conn"), header.get_time("time")
    if found != (RecordType.MSGDATA, connection, time):
        raise ValueError("an index and the message it points at differ")
    return stream.tell()
