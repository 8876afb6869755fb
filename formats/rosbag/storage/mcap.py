"""MCAP files, read through their index in bulk.

`McapReader` takes from its module what is replaced in rosbags 0.11.9 below, for the whole process. For
rosbags to do, and then to go from here:

- bounds on what a chunk unpacks to, `decompress(data, size)` used with the size that the chunk states: a
  few bytes become gigabytes;
- `McapReader.read_index` and `meta_scan` that pass over a schema of an unknown encoding, as over one without
  any: a log with one topic that is not of ROS is refused whole;
- profiles of quality, in YAML, parsed when they are asked for.
"""

import os
import struct
from binascii import crc32
from collections.abc import Collection, Iterator
from functools import cached_property, lru_cache, partial
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rosbags.interfaces import MessageDefinition
from rosbags.rosbag2 import storage_mcap
from rosbags.rosbag2.storage_mcap import ChunkInfo, McapReader, Schema

from formats.rosbag.storage.chunks import RUN_BYTES, Chunk, Entries, Run, opened, runs
from formats.rosbag.storage.raw_messages import NO_DEFINITION, Index, parts_at, unpack, widen
from formats.rosbag.storage.salvaged_mcap import ENTRY, RECORD, records

#: Before entries of an index channel and length; before a payload channel, sequence, log time and another.
_INDEX, _MESSAGE = 6, 22
_MESSAGE_CODE, _CHUNK_CODE = 0x05, 0x06
#: Of a record; and of a chunk first and last log time, size, checksum, length of its packing's name.
_CODE_AND_LENGTH, _LENGTH, _CHUNK = struct.Struct("<BQ"), struct.Struct("<Q"), struct.Struct("<QQQII")
_TIME = struct.Struct("<q")  # Of a message, as NumPy reads it below
#: The footer (where the summary begins, and that of its offsets; its checksum), and the magic behind it.
_END = struct.Struct("<BQQQI8s")
#: Bytes of it that no checksum covers.
_BARE = 12
_HEAD = np.dtype(
    {
        "names": ["code", "length", "channel", "time"],
        "formats": ["u1", "<i8", "<u2", "<i8"],
        "offsets": [0, 1, RECORD, RECORD + 6],
        "itemsize": RECORD + _MESSAGE,
    }
)
#: Of definitions that rosbags reads; the last is that of types without one.
_ENCODINGS = ("ros2msg", "ros2idl", "omgidl", "")
_get_msgdef = storage_mcap.get_msgdef


def _known_definition(schema: Schema | None) -> MessageDefinition:
    known = schema is None or schema.encoding in _ENCODINGS
    return _get_msgdef(schema) if known else NO_DEFINITION


storage_mcap.DECOMPRESSORS |= {
    "lz4": lambda data, _size: unpack(data, "lz4"),
    "zstd": lambda data, _size: unpack(data, "zstd"),
}
storage_mcap.get_msgdef = _known_definition
storage_mcap.get_qos = lru_cache(256)(storage_mcap.get_qos)


class McapFile(McapReader):
    """One file. Its summary is read by rosbags, its messages here."""

    entry = ENTRY

    def runs(self, wanted: Collection[int], size: int = RUN_BYTES) -> Iterator[Run]:
        chunks = [
            Chunk(
                position=chunk.chunk_start_offset,
                stored=chunk.chunk_length,
                unpack=partial(_contents, told=chunk),
                slow=bool(chunk.compression),
                first=chunk.message_start_time,
                index=self._index(chunk) or _walk,
            )
            for chunk in sorted(self.chunks, key=lambda chunk: chunk.chunk_start_offset)
        ]
        yield from runs(opened(self.bio), chunks or self._unlisted, wanted, self, size)

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
                    times, _ = self.entries(np.frombuffer(bio.read(count * ENTRY.itemsize), ENTRY))
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

    @cached_property
    def _unlisted(self) -> list[Chunk]:
        """The chunks of a file that has no index of them; messages in no chunk are put together in some."""
        bio = opened(self.bio)
        found: list[Chunk] = []
        begin = at = self.data_start
        first: int | None = None
        while at < self.data_end:
            bio.seek(at)
            head = bio.read(_HEAD.itemsize)
            code, length = _CODE_AND_LENGTH.unpack_from(head)
            behind = at + RECORD + length
            if behind > self.data_end:
                raise EOFError("it ends within a record")
            if code == _CHUNK_CODE or behind - begin > RUN_BYTES:
                found += _loose(begin, at, first)
                begin, first = at, None
            if code == _CHUNK_CODE:
                (start,) = _LENGTH.unpack_from(head, RECORD)
                size = RECORD + length
                chunk = Chunk(position=at, stored=size, unpack=_contents, slow=True, first=start, index=_walk)
                found.append(chunk)
                begin = behind
            elif code == _MESSAGE_CODE:
                (time,) = _TIME.unpack_from(head, RECORD + 6)
                first = time if first is None else min(first, time)
            at = behind
        return found + _loose(begin, at, first)

    @staticmethod
    def _index(chunk: ChunkInfo) -> tuple[tuple[int, int, int], ...] | None:
        if not chunk.message_index_offsets:
            return None
        begins, counts = chunk.message_index_offsets.items(), chunk.channel_count
        return tuple((number, at + RECORD + _INDEX, counts.get(number, 0)) for number, at in begins)

    def entries(self, of: Entries) -> tuple[Index, Index]:
        return of["time"].astype(np.int64), of["place"].astype(np.int64)

    def payloads(self, buffer: bytes, number: int, entries: Entries, records: Index) -> tuple[Index, Index]:
        times, _ = self.entries(entries)
        heads = parts_at(buffer, records, _HEAD.itemsize).view(_HEAD)
        right = (heads["code"] == _MESSAGE_CODE) & (heads["channel"] == number) & (heads["time"] == times)
        if not right.all():
            raise ValueError("an index and the message it points at differ")
        return records + _HEAD.itemsize, heads["length"] - _MESSAGE


def _walk(chunk: bytes | memoryview) -> dict[int, NDArray[Any]]:
    """Return what an index would have."""
    begins = [begin - RECORD for code, begin, _ in records(chunk) if code == _MESSAGE_CODE]
    places = np.array(begins, dtype=np.int64)
    heads = parts_at(chunk, places, _HEAD.itemsize).view(_HEAD)
    found = {}
    for connection in np.unique(heads["channel"]):
        own = heads["channel"] == connection
        found[int(connection)] = entries = np.empty(np.count_nonzero(own), ENTRY)
        entries["time"], entries["place"] = heads["time"][own], places[own]
    return found


def _loose(begin: int, end: int, first: int | None) -> list[Chunk]:
    """Take records in no chunk, the first message among them of this time, as one; nothing without any."""
    if first is None:
        return []
    return [Chunk(position=begin, stored=end - begin, unpack=bytes, slow=False, first=first, index=_walk)]


def _contents(record: bytes | memoryview, told: ChunkInfo | None = None) -> bytes | memoryview:
    """Return the records in the record of a chunk, decompressed and checked, also by what its index told."""
    _, _, size, checksum, letters = _CHUNK.unpack_from(record, RECORD)
    begin = RECORD + _CHUNK.size + letters
    (stored,) = _LENGTH.unpack_from(record, begin)
    packed = memoryview(record)[begin + 8 : begin + 8 + stored]
    if told and ((size, stored) != (told.uncompressed_size, told.compressed_size) or len(packed) < stored):
        raise ValueError("a chunk is not as its index says")
    if len(packed) < stored:
        raise ValueError("a chunk is longer than its record")
    packing = told.compression if told else bytes(record[begin - letters : begin]).decode()
    contents = unpack(packed, packing) if packing else packed
    if len(contents) != size or (checksum and crc32(contents) != checksum):
        raise ValueError("a chunk is not what its size and checksum say")
    return contents
