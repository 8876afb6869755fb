"""MCAP files, read through their index in bulk."""

from __future__ import annotations

import struct
from contextlib import closing
from functools import lru_cache, partial
from typing import TYPE_CHECKING, Any, cast

import numpy as np
from rosbags.interfaces import MessageDefinition, MessageDefinitionFormat
from rosbags.rosbag2 import storage_mcap
from rosbags.rosbag2.storage_mcap import McapReader

from formats.rosbag.chunks import RUN_BYTES, Chunk, opened, runs
from formats.rosbag.messages import collected, parts_at
from formats.rosbag.unpacking import unpack

if TYPE_CHECKING:
    from collections.abc import Collection, Iterator

    from numpy.typing import NDArray
    from rosbags.rosbag2.storage_mcap import ChunkInfo, Schema

    from formats.rosbag.chunks import Run
    from formats.rosbag.messages import Index

#: Of definitions that rosbags reads; the last is that of types without one.
_ENCODINGS = ("ros2msg", "ros2idl", "omgidl", "")
_ENTRY = np.dtype([("time", "<u8"), ("place", "<u8")])
#: Opcode and length of a record; before the entries of an index its channel and their length in
#: bytes; before a payload channel, sequence, log time and time of publication.
_RECORD, _INDEX, _MESSAGE = 9, 6, 22
_MESSAGE_CODE = 0x05
_HEAD = np.dtype(
    {
        "names": ["code", "length", "channel", "time"],
        "formats": ["u1", "<i8", "<u2", "<i8"],
        "offsets": [0, 1, _RECORD, _RECORD + 6],
        "itemsize": _RECORD + _MESSAGE,
    }
)

# rosbags itself unpacks without bounds: a few bytes would become gigabytes.
storage_mcap.DECOMPRESSORS.update(
    {packing: lambda data, _, packing=packing: unpack(data, packing) for packing in ("lz4", "zstd")}  # type: ignore[misc]
)
# YAML, 0.4 ms for each of many topics whose profiles are alike; nobody here asks for them.
storage_mcap.get_qos = lru_cache(256)(storage_mcap.get_qos)
_get_msgdef = storage_mcap.get_msgdef


def _definition(schema: Schema | None) -> MessageDefinition:
    """Return the definition of a type; none of one that is not of ROS, which rosbags takes for damage."""
    known = schema is None or schema.encoding in _ENCODINGS
    return _get_msgdef(schema) if known else MessageDefinition(MessageDefinitionFormat.NONE, "")


storage_mcap.get_msgdef = _definition


class McapFile(McapReader):
    """One file. Its summary is read by rosbags, its messages here.

    Parameters
    ----------
    path : Path
    """

    entry = _ENTRY

    def runs(self, wanted: Collection[int], size: int = RUN_BYTES) -> Iterator[Run]:
        """Read the messages of some connections; see `chunks.runs`."""
        if not self.chunks:
            yield from self._walked(wanted, size)
            return
        chunks = [
            Chunk(
                chunk.chunk_start_offset,
                chunk.chunk_length,
                partial(_unpack, chunk),
                bool(chunk.compression),
                chunk.message_start_time,
                self._index(chunk),
            )
            for chunk in sorted(self.chunks, key=lambda chunk: chunk.chunk_start_offset)
        ]
        yield from runs(opened(self.bio), chunks, wanted, self, size)

    def open(self) -> None:
        """Read the summary, and see what the indexes span."""
        #: First and last log time of each connection that an index mentions, by its number.
        self.spans: dict[int, tuple[int, int]] = {}
        super().open()
        if len({chunk.chunk_start_offset for chunk in self.chunks}) < len(self.chunks):
            # A few bytes of index could make this unpack one chunk without end.
            raise ValueError("its index names a chunk twice")
        bio = opened(self.bio)
        for chunk in self.chunks:
            for connection, begin, count in self._index(chunk) or ():
                if count > 0:
                    bio.seek(begin)
                    times, _ = self.entries(np.frombuffer(bio.read(count * _ENTRY.itemsize), _ENTRY))
                    first, last = int(times.min()), int(times.max())
                    start, end = self.spans.get(connection, (first, last))
                    self.spans[connection] = min(start, first), max(end, last)

    def _walked(self, wanted: Collection[int], size: int) -> Iterator[Run]:
        """Read a file without chunks, message by message, in the order of the file."""
        # Topics read by turns would disturb each other, for rosbags walks a file with the one
        # position it has; and its messages() wants the log times in order.
        walker = McapReader(self.path)
        walker.open()
        with closing(walker):
            found = walker.messages_scan([c for c in self.connections if c.id in wanted])
            yield from collected(((connection.id, time, data) for connection, time, data in found), size)

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
        """Return starts and sizes of payloads; see `chunks.Layout`."""
        heads = parts_at(buffer, records, _HEAD.itemsize).view(_HEAD)
        right = (heads["code"] == _MESSAGE_CODE) & (heads["channel"] == connection) & (heads["time"] == times)
        if not right.all():
            raise ValueError("an index and the message it points at differ")
        return records + _HEAD.itemsize, heads["length"] - _MESSAGE

    def walk(self, chunk: bytes | memoryview) -> dict[int, NDArray[Any]]:
        """Make the index of a chunk that has none; see `chunks.Layout`."""
        found: dict[int, list[tuple[int, int]]] = {}
        at = 0
        while at < len(chunk):
            code, length = struct.unpack_from("<BQ", chunk, at)
            if code == _MESSAGE_CODE:
                connection, _, time = struct.unpack_from("<HIQ", chunk, at + _RECORD)
                found.setdefault(connection, []).append((time, at))
            at += _RECORD + length
        return {connection: np.array(entries, _ENTRY) for connection, entries in found.items()}


def _unpack(chunk: ChunkInfo, record: bytes) -> bytes | memoryview:
    """Return the messages in the record of a chunk, decompressed and checked."""
    # First and last log time, size, checksum, name of the compression, stored size.
    _, _, size, checksum, letters = struct.unpack_from("<QQQII", record, _RECORD)
    (stored,) = struct.unpack_from("<Q", record, begin := _RECORD + 32 + letters)
    contents = memoryview(record)[begin + 8 :]
    if (size, stored) != (chunk.uncompressed_size, chunk.compressed_size) or stored > len(contents):
        raise ValueError("a chunk is not as its index says")
    # Whatever it is packed in, rosbags takes any bytes.
    return storage_mcap.decompress(cast("bytes", contents[:stored]), chunk.compression, size, checksum)
