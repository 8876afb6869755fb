"""MCAP files, read through their index in bulk.

`McapReader` takes from its module what is replaced in rosbags 0.11.9 below, for the whole process. For
rosbags to do, and then to go from here:

- bounds on what a chunk unpacks to, `decompress(data, size)` used with the size that the chunk states: a
  few bytes become gigabytes;
- `McapReader.read_index` and `meta_scan` that pass over a schema of an unknown encoding, as over one without
  any: a log with one topic that is not of ROS is refused whole;
- profiles of quality, in YAML, parsed when they are asked for.
"""

from __future__ import annotations

import os
import struct
from binascii import crc32
from functools import lru_cache, partial
from typing import TYPE_CHECKING, Any

import numpy as np
from rosbags.rosbag2 import storage_mcap
from rosbags.rosbag2.storage_mcap import McapReader

from formats.limits import Allowance
from formats.rosbag.storage.chunks import RUN_BYTES, Chunk, opened, runs
from formats.rosbag.storage.raw_messages import DAMAGE, NO_DEFINITION, Messages, parts_at, unpack, widen

if TYPE_CHECKING:
    from collections.abc import Collection, Iterator, Sequence
    from typing import BinaryIO

    from numpy.typing import NDArray
    from rosbags.interfaces import MessageDefinition
    from rosbags.rosbag2.storage_mcap import ChunkInfo, Schema

    from formats.rosbag.storage.chunks import Run
    from formats.rosbag.storage.raw_messages import Index

_ENTRY = np.dtype([("time", "<u8"), ("place", "<u8")])
#: Opcode and length of a record; before the entries of an index its channel and their length in
#: bytes; before a payload channel, sequence, log time and time of publication.
_RECORD, _INDEX, _MESSAGE = 9, 6, 22
_MESSAGE_CODE, _CHUNK_CODE = 0x05, 0x06
#: Of a record; and of a chunk first and last log time, size, checksum, length of its packing's name.
_CODE_AND_LENGTH, _LENGTH, _CHUNK = struct.Struct("<BQ"), struct.Struct("<Q"), struct.Struct("<QQQII")
#: The footer (where the summary begins, and that of its offsets; its checksum), and the magic behind it.
_END = struct.Struct("<BQQQI8s")
#: Bytes of it that no checksum covers.
_BARE = 12
#: Bytes read at a time where records are told apart one by one.
_LEAST_READ = 1 << 16
_HEAD = np.dtype(
    {
        "names": ["code", "length", "channel", "time"],
        "formats": ["u1", "<i8", "<u2", "<i8"],
        "offsets": [0, 1, _RECORD, _RECORD + 6],
        "itemsize": _RECORD + _MESSAGE,
    }
)
#: Of definitions that rosbags reads; the last is that of types without one.
_ENCODINGS = ("ros2msg", "ros2idl", "omgidl", "")
_get_msgdef = storage_mcap.get_msgdef


def _bounded(packing: str, data: bytes, _size: int) -> bytes:
    return unpack(data, packing)


def _known_definition(schema: Schema | None) -> MessageDefinition:
    known = schema is None or schema.encoding in _ENCODINGS
    return _get_msgdef(schema) if known else NO_DEFINITION


storage_mcap.DECOMPRESSORS.update({packing: partial(_bounded, packing) for packing in ("lz4", "zstd")})
storage_mcap.get_msgdef = _known_definition
storage_mcap.get_qos = lru_cache(256)(storage_mcap.get_qos)


class McapFile(McapReader):
    """One file. Its summary is read by rosbags, its messages here."""

    entry = _ENTRY

    def runs(self, wanted: Collection[int], size: int = RUN_BYTES) -> Iterator[Run]:
        if not self.chunks:
            yield from self._walked(wanted, size)
            return
        chunks = [
            Chunk(
                position=chunk.chunk_start_offset,
                stored=chunk.chunk_length,
                unpack=partial(_contents, told=chunk),
                slow=bool(chunk.compression),
                first=chunk.message_start_time,
                index=self._index(chunk),
            )
            for chunk in sorted(self.chunks, key=lambda chunk: chunk.chunk_start_offset)
        ]
        yield from runs(opened(self.bio), chunks, wanted, self, size)

    def open(self) -> None:
        """Read the summary, and see what the indexes span."""
        #: First and last log time of each connection that an index mentions, by its number.
        self.spans: dict[int, tuple[int, int]] = {}
        super().open()
        self._check_summary()
        if len({chunk.chunk_start_offset for chunk in self.chunks}) < len(self.chunks):
            # A few bytes of index could make this unpack one chunk without end.
            raise ValueError("its index names a chunk twice")
        bio = opened(self.bio)
        for chunk in self.chunks:
            for connection, begin, count in self._index(chunk) or ():
                if count > 0:
                    bio.seek(begin)
                    times, _ = self.entries(np.frombuffer(bio.read(count * _ENTRY.itemsize), _ENTRY))
                    widen(self.spans, connection, times)

    def _check_summary(self) -> None:
        """Refuse a summary that its checksum contradicts: names of topics and fields are read from there."""
        bio = opened(self.bio)
        end = bio.seek(-_END.size, os.SEEK_END)
        _, _, summary, _, checksum, _ = _END.unpack(bio.read(_END.size))
        if not checksum:
            return
        summary = summary or end  # a file may have none
        bio.seek(summary)
        # The checksum covers the footer up to itself.
        left, found = end + _END.size - _BARE - summary, 0
        while left > 0 and (piece := bio.read(min(left, RUN_BYTES))):
            found, left = crc32(piece, found), left - len(piece)
        if found != checksum:
            raise ValueError("the checksum of its summary is wrong")

    def _walked(self, wanted: Collection[int], size: int) -> Iterator[Run]:
        """Read a file without an index of its chunks, or without chunks, in the order of the file.

        Records are told apart one by one, and nothing else is done with each.
        """
        done, length = 0, 0
        joined: list[tuple[bytes, list[int]]] = []
        # Topics read by turns would disturb each other in one file, which has one position.
        with self.path.open("rb") as file:
            try:
                for stretch in _stretches(file, self.data_start, self.data_end, size):
                    joined.append(stretch)
                    length += len(stretch[0])
                    if length >= size:
                        yield self._gathered(joined, wanted, done)
                        done += sum(len(places) for _, places in joined)
                        joined, length = [], 0
            except DAMAGE:
                yield self._gathered(joined, wanted, done)
                raise
            yield self._gathered(joined, wanted, done)

    @staticmethod
    def _gathered(joined: Sequence[tuple[bytes, list[int]]], wanted: Collection[int], done: int) -> Run:
        """Return the messages at some places of some bytes, by connection; so many came before."""
        buffer = b"".join(data for data, _ in joined)
        begins = np.cumsum([0, *(len(data) for data, _ in joined)])
        places = [np.array(own, dtype=np.int64) for _, own in joined]
        records = np.concatenate([np.empty(0, dtype=np.int64), *map(np.add, places, begins)])
        heads = parts_at(buffer, records, _HEAD.itemsize).view(_HEAD)
        starts, sizes = records + _HEAD.itemsize, heads["length"] - _MESSAGE
        order = done + np.arange(len(records))
        found: Run = {}
        for connection in np.unique(heads["channel"]):
            own = np.flatnonzero(heads["channel"] == connection)
            if int(connection) in wanted:
                found[int(connection)] = Messages(
                    buffer, starts[own], sizes[own], heads["time"][own], order[own]
                )
        return found

    @staticmethod
    def _index(chunk: ChunkInfo) -> tuple[tuple[int, int, int], ...] | None:
        if not chunk.message_index_offsets:
            return None
        return tuple(
            (connection, offset + _RECORD + _INDEX, chunk.channel_count.get(connection, 0))
            for connection, offset in chunk.message_index_offsets.items()
        )

    def entries(self, of: NDArray[Any]) -> tuple[Index, Index]:
        """Return log times in ns and places in the chunk; see `chunks.Layout`."""
        return of["time"].astype(np.int64), of["place"].astype(np.int64)

    def payloads(self, buffer: bytes, connection: int, times: Index, records: Index) -> tuple[Index, Index]:
        heads = parts_at(buffer, records, _HEAD.itemsize).view(_HEAD)
        right = (heads["code"] == _MESSAGE_CODE) & (heads["channel"] == connection) & (heads["time"] == times)
        if not right.all():
            raise ValueError("an index and the message it points at differ")
        return records + _HEAD.itemsize, heads["length"] - _MESSAGE

    def walk(self, chunk: bytes | memoryview) -> dict[int, NDArray[Any]]:
        """Make the index of a chunk that has none; see `chunks.Layout`."""
        places = np.array(_messages(chunk), dtype=np.int64)
        heads = parts_at(chunk, places, _HEAD.itemsize).view(_HEAD)
        found = {}
        for connection in np.unique(heads["channel"]):
            own = heads["channel"] == connection
            found[int(connection)] = entries = np.empty(np.count_nonzero(own), _ENTRY)
            entries["time"], entries["place"] = heads["time"][own], places[own]
        return found


def _stretches(file: BinaryIO, begin: int, end: int, size: int) -> Iterator[tuple[bytes, list[int]]]:
    """Yield whole records with the places of the messages among them; those of a chunk apart."""
    allowance = Allowance(os.fstat(file.fileno()).st_size)
    file.seek(begin)
    left, data, needed = end - begin, b"", 0
    while left:
        piece = file.read(min(max(size, _LEAST_READ, needed - len(data)), left))
        left -= len(piece)
        data += piece
        first, behind, places = 0, 0, list[int]()
        for code, at, behind in _records(data):
            if code == _MESSAGE_CODE:
                places.append(at - first)
            elif code == _CHUNK_CODE:
                yield data[first:at], places
                contents = bytes(_contents(memoryview(data)[at:behind]))
                allowance.take(len(contents))
                yield contents, _messages(contents)
                first, places = behind, []
        yield data[first:behind], places
        data = data[behind:]
        needed = _RECORD + _LENGTH.unpack_from(data, 1)[0] if len(data) >= _RECORD else _RECORD
        if not piece or (data and needed > len(data) + left):
            raise EOFError("it ends within a record")


def _records(data: bytes | memoryview) -> Iterator[tuple[int, int, int]]:
    """Yield code, begin and end of the whole records in some bytes."""
    at, end = 0, len(data)
    while at + _RECORD <= end:
        code, length = _CODE_AND_LENGTH.unpack_from(data, at)
        behind = at + _RECORD + length
        if behind > end:
            return
        if code == _MESSAGE_CODE and length < _MESSAGE:
            raise ValueError("a message is shorter than its head")
        yield code, at, behind
        at = behind


def _messages(chunk: bytes | memoryview) -> list[int]:
    """Return the places of the messages among the records of a chunk."""
    every = list(_records(chunk))
    if (every[-1][2] if every else 0) < len(chunk):
        raise ValueError("a chunk ends within a record")
    return [at for code, at, _ in every if code == _MESSAGE_CODE]


def _contents(record: bytes | memoryview, told: ChunkInfo | None = None) -> bytes | memoryview:
    """Return the records in the record of a chunk, decompressed and checked, also by what its index told."""
    _, _, size, checksum, letters = _CHUNK.unpack_from(record, _RECORD)
    begin = _RECORD + _CHUNK.size + letters
    (stored,) = _LENGTH.unpack_from(record, begin)
    packed = memoryview(record)[begin + 8 : begin + 8 + stored]
    if told and ((size, stored) != (told.uncompressed_size, told.compressed_size) or len(packed) < stored):
        raise ValueError("a chunk is not as its index says")
    if len(packed) < stored:
        raise ValueError("a chunk is longer than its record")
    packing = told.compression if told else bytes(record[begin - letters : begin]).decode()
    records = unpack(packed, packing) if packing else packed
    if len(records) != size or (checksum and crc32(records) != checksum):
        raise ValueError("a chunk is not what its size and checksum say")
    return records
