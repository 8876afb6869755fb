"""MCAP files, read through their index in bulk; without it or some of their bytes every whole chunk.

Records, each with its length, follow each other (https://mcap.dev/spec); where one does not add up, the next
chunk is looked for. A message is taken where the checksum of its chunk is right, or its index names it too.
"""

import re
import struct
from binascii import crc32
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from rosbags.interfaces import Connection, MessageDefinition, MessageDefinitionFormat

from formats.limits import CHUNK_BYTES
from formats.rosbag.storage import record_file
from formats.rosbag.storage.chunks import Chunk, Entries
from formats.rosbag.storage.raw_messages import FORMATS, Index, parts_at, ros2_connection
from formats.rosbag.storage.record_file import BrokenRecordError, CutOffError, Found, RecordFile, Row, Told

#: Bytes of the opcode and length of a record, and those before the entries of an index, and a payload.
_RECORD, _BEFORE_ENTRIES, _BEFORE_PAYLOAD = 9, 6, 22
_SCHEMA, _CHANNEL, _MESSAGE, _CHUNK, _INDEX = 0x03, 0x04, 0x05, 0x06, 0x07
_CHUNK_INDEX, _STATISTICS, _DATA_END, _FOOTER = 0x08, 0x0B, 0x0F, 0x02
#: The footer, where the summary begins in it, and the magic behind it.
_END = struct.Struct("<BQQQI8s")
#: Opcode, length, first and last time, size, checksum; then the name of the compression.
_CHUNK_BEGINS = re.compile(rb"\x06.{36}(?:\x00{4}|\x03\x00{3}lz4|\x04\x00{3}zstd)", re.DOTALL)
_HEAD = np.dtype(
    {
        "names": ["code", "length", "channel", "time"],
        "formats": ["u1", "<i8", "<u2", "<i8"],
        "offsets": [0, 1, _RECORD, _RECORD + 6],
        "itemsize": _RECORD + _BEFORE_PAYLOAD,
    }
)
_FORMATS = FORMATS | {"omgidl": MessageDefinitionFormat.IDL}


class McapFile(RecordFile):
    magic = b"\x89MCAP0\r\n"
    describes = _CHANNEL
    entry = np.dtype([("time", "<u8"), ("place", "<u8")])
    is_cut = ": its index is missing"

    def __init__(self, path: Path, *, salvage: bool = False) -> None:
        super().__init__(path, salvage=salvage)
        #: The index of chunks is being read; and there is one, which tells the times of connections.
        self._listing = self._timed = False
        #: Number of messages by channel, and the last log time.
        self._counts: dict[int, int] | None = None
        self._end: int | None = None

    def open(self) -> None:
        super().open()
        if self.salvage:
            return
        if not self._timed:
            self.spans = {}
        if (counts := self._counts) is not None:
            self.connections = [one._replace(msgcount=counts.get(one.id, 0)) for one in self.connections]

    def read_index(self) -> bool:
        code, length, at, *_ = _END.unpack(self.data[-_END.size :])
        if (code, length) != (_FOOTER, 20):
            raise BrokenRecordError("its footer")
        self._listing = True
        while at and not self.ended:
            if set(self.data[at : at + 1]) <= {_MESSAGE, _CHUNK}:
                raise BrokenRecordError(f"the record at byte {at:,} of its summary")
            at = self.record(at)
        self._listing = self.ended = False
        self._timed = bool(self.chunks)
        if not self.told_of():
            # They are described in the chunks alone.
            self.chunks.clear()
        for chunk in self.chunks:
            for number, place in () if callable(chunk.index) else chunk.index.items():
                if isinstance(place, tuple) and place[1] > 0:
                    self.least(number, *place)
        return bool(self.chunks)

    def entries(self, of: Entries) -> tuple[Index, Index]:
        return of["time"].astype(np.int64), of["place"].astype(np.int64)

    def payloads(self, buffer: bytes, number: int, entries: Entries, records: Index) -> tuple[Index, Index]:
        times, _ = self.entries(entries)
        heads = parts_at(buffer, records, _HEAD.itemsize).view(_HEAD)
        right = (heads["code"] == _MESSAGE) & (heads["channel"] == number) & (heads["time"] == times)
        if not right.all():
            raise ValueError("an index and the message it points at differ")
        return records + _HEAD.itemsize, heads["length"] - _BEFORE_PAYLOAD

    def account(self) -> int | None:
        if not self.ended and not self.recovery.damage:
            missing = "the end of the file and with it the index are missing"
            self.lose(f"cut off at byte {len(self.data):,}: {missing}")
        self.recovery.whole_known = self.ended
        if self._counts is not None:
            self.recovery.expected = sum(self._counts.values())
        return self._end

    def record(self, at: int) -> int:
        if at + _RECORD > len(self.data):
            raise CutOffError(f"a record at byte {at:,}")
        code, length = struct.unpack_from("<BQ", self.data, at)
        begin, end = at + _RECORD, at + _RECORD + length
        if code == 0 and self.growing:
            # The file is longer already than what was written into it.
            raise CutOffError(f"a record at byte {at:,}")
        if code == 0 or 0x0F < code < 0x80:
            raise BrokenRecordError(f"there is no record at byte {at:,}")
        if self.growing and length > CHUNK_BYTES:
            raise BrokenRecordError(f"a record at byte {at:,} that claims {length:,} bytes")
        if end > len(self.data):
            if code == _CHUNK:
                self._note_cut_chunk(begin)
            raise CutOffError(f"a {'chunk' if code == _CHUNK else 'record'} that begins at byte {at:,}")
        try:
            end = self._content(code, begin, end)
        except (struct.error, UnicodeDecodeError, IndexError) as error:
            raise BrokenRecordError(f"the record at byte {at:,} contradicts itself") from error
        self.recovery.bytes_read += end - at
        self.ended = code == _FOOTER
        return end

    def _content(self, code: int, begin: int, end: int) -> int:
        """Take in what a record says; return where the next begins."""
        if code == _CHUNK:
            return self._chunk(begin, end)
        if code in {_SCHEMA, _CHANNEL}:
            _note(self.told, code, self.data[begin:end], vouched=False)
        elif code == _MESSAGE:
            # No checksum and no index vouches for it.
            self.take_loose(_message(self.data, begin, end))
        elif code == _CHUNK_INDEX and self._listing:
            self.chunks.append(_listed(self.data[begin:end]))
        elif code == _STATISTICS:
            self._statistics(self.data[begin:end])
        elif code == _DATA_END:
            self._data_end(begin - _RECORD, *struct.unpack("<I", self.data[begin:end]))
        elif code == _FOOTER:
            if self.growing and len(self.data) < end + len(self.magic):
                raise CutOffError("the end of the file")
            self._footer(begin, *struct.unpack("<QQI", self.data[begin:end]))
            if self.data[end:] != self.magic:
                raise BrokenRecordError(f"the end of the file, behind byte {end:,},")
        return end

    def next_chunk(self, start: int) -> int | None:
        for match in _CHUNK_BEGINS.finditer(self.data, start):
            at = match.start()
            try:
                _, _, end = _head(self.data, at + _RECORD)
            except (struct.error, BrokenRecordError):
                continue
            if end <= len(self.data) and end - at - _RECORD == struct.unpack_from("<Q", self.data, at + 1)[0]:
                return at
        return None

    def _note_cut_chunk(self, begin: int) -> None:
        """Take from the head of a chunk that is cut off when the log went on to at least."""
        if begin + 16 <= len(self.data):
            start, end = struct.unpack_from("<QQ", self.data, begin)
            before = max((span[1] for span in self.walk if span), default=start)
            # Far from what is before it, the head is no chunk's.
            if start <= end < 2**63 and abs(start - before) < 600 * 10**9 and end - start < 600 * 10**9:
                self.recovery.goes_on = max(end, before)

    def _chunk(self, begin: int, end: int) -> int:
        """Read a chunk and the index behind it; return where that ends."""
        self.end_loose()
        head, contents, chunk_end = _head(self.data, begin)
        if chunk_end != end:
            raise BrokenRecordError(f"the chunk at byte {begin - _RECORD:,} contradicts itself")
        index, end = self._index(end)
        start, last, size, checksum, packing = head
        place, vouched = slice(contents, chunk_end), bool(checksum)

        def confirm(found: Found) -> tuple[Index, bool]:
            return _confirmed(found, self.named(index), start, last)

        self.take_chunk(begin - _RECORD, place, packing, size, confirm, checksum=checksum, vouched=vouched)
        return end

    def _index(self, at: int) -> tuple[dict[int, tuple[int, int]], int]:
        """Read the records of the index behind a chunk: where entries begin and how many, by channel."""
        index = {}
        while at + _RECORD + 6 <= len(self.data):
            code, length, channel, size = struct.unpack_from("<BQHI", self.data, at)
            if code != _INDEX or length != 6 + size or size % self.entry.itemsize:
                break
            end = at + _RECORD + length
            if end > len(self.data):
                break
            index[channel] = at + _RECORD + _BEFORE_ENTRIES, size // self.entry.itemsize
            at = end
        return index, at

    def _statistics(self, content: bytes) -> None:
        end, size = struct.unpack_from("<QI", content, 34)
        if size % 10 or size != len(content) - 46:
            raise BrokenRecordError("the statistics")
        counts = dict(struct.iter_unpack("<HQ", content[46:]))
        if sum(counts.values()) != struct.unpack_from("<Q", content)[0]:
            raise BrokenRecordError("the statistics")
        self._counts = counts
        self._end = end if 0 < end < 2**63 and counts else None

    def _data_end(self, at: int, checksum: int) -> None:
        self.end_loose()
        if not checksum or not self.salvage:
            # Of a whole file each chunk has its own.
            return
        found = 0
        for begin in range(0, at, 1 << 24):
            found = crc32(self.data[begin : min(begin + (1 << 24), at)], found)
        if found != checksum:
            self.note("the checksum of the data is wrong")
        else:
            self.unchecked = False

    def _footer(self, begin: int, summary: int, _: int, checksum: int) -> None:
        # The checksum covers the summary, if there is one, and the footer up to itself.
        first = summary or begin - _RECORD
        if checksum and (first > begin or crc32(self.data[first : begin + 16]) != checksum):
            self.note("the checksum of the summary is wrong")
            self._counts = self._end = None

    def messages_in(self, raw: bytes, told: Told, *, vouched: bool) -> Iterator[Row]:
        for code, begin, end in records(raw):
            if code == _MESSAGE:
                yield _message(raw, begin, end)
            elif code in {_SCHEMA, _CHANNEL}:
                _note(told, code, raw[begin:end], vouched=vouched)

    def known(self) -> dict[int, Connection]:
        known = {}
        for number, told in self.told_of().items():
            channel = record_file.agreed(told)
            if channel is None:
                self.note(f"channel {number} is described twice, each time differently")
                continue
            schema_number, topic, encoding = channel
            if encoding != "cdr" and self.salvage:
                self.note(f"{topic} is encoded as {encoding[:20]!r}; only 'cdr' can be read")
                continue
            schemas = self.told.get((_SCHEMA, schema_number), [])
            schema = record_file.agreed(schemas or [(False, None)])
            if schemas and schema is None and not self.salvage:
                self.note(f"schema {schema_number} is described twice, each time differently")
            name, schema_encoding, text = schema or ("__schemaless__", "", "")
            definition = MessageDefinition(_FORMATS.get(schema_encoding, MessageDefinitionFormat.NONE), text)
            known[number] = ros2_connection(number, topic, name, definition, encoding=encoding)
        return known


def _listed(content: bytes) -> Chunk:
    """Read what the summary says of a chunk."""
    first, _, position, stored, size = struct.unpack_from("<QQQQI", content)
    begins = sorted((begin, number) for number, begin in struct.iter_unpack("<HQ", content[36 : 36 + size]))
    length, letters = struct.unpack_from("<QI", content, 36 + size)
    at = 48 + size + letters
    packing, sizes = content[at - letters : at].decode(), struct.unpack_from("<QQ", content, at)
    # Each index ends where the next begins.
    ends = [*(begin for begin, _ in begins[1:]), position + stored + length]
    before = _RECORD + _BEFORE_ENTRIES
    index = {n: (at + before, (end - at - before) // 16) for (at, n), end in zip(begins, ends, strict=False)}
    return Chunk(
        position=position,
        stored=stored,
        unpack=partial(_contents, told=(packing, *sizes)),
        slow=bool(packing),
        first=first,
        index=index or _walk,
    )


def _contents(record: bytes | memoryview, told: tuple[str, int, int]) -> bytes | memoryview:
    """Return the records in the record of a chunk, decompressed and checked, also by what its index told."""
    (_, _, size, checksum, packing), begin, end = _head(record, _RECORD)
    if (packing, end - begin, size) != told or end > len(record):
        raise ValueError("a chunk is not as its index says")
    return record_file.contents(memoryview(record)[begin:end], packing, size, checksum)


def _walk(chunk: bytes | memoryview) -> dict[int, Entries]:
    """Return what an index would have."""
    begins = [begin - _RECORD for code, begin, _ in records(chunk) if code == _MESSAGE]
    places = np.array(begins, dtype=np.int64)
    heads = parts_at(chunk, places, _HEAD.itemsize).view(_HEAD)
    found = {}
    for channel in np.unique(heads["channel"]):
        own = heads["channel"] == channel
        found[int(channel)] = entries = np.empty(np.count_nonzero(own), McapFile.entry)
        entries["time"], entries["place"] = heads["time"][own], places[own]
    return found


def _message(data: Any, begin: int, end: int) -> Row:
    channel, _, time, _ = struct.unpack_from("<HIQQ", data, begin)
    if end - begin < 22:
        raise BrokenRecordError(f"a message at byte {begin - _RECORD:,}")
    return channel, time, begin + 22, end - begin - 22


def _head(data: Any, begin: int) -> tuple[tuple[int, int, int, int, str], int, int]:
    """Return first and last time, size, checksum and packing of a chunk, where its contents begin and end."""
    start, last, size, checksum, letters = struct.unpack_from("<QQQII", data, begin)
    packing = bytes(data[begin + 32 : begin + 32 + min(letters, 8)])
    if (start > last and size) or packing not in {b"", b"lz4", b"zstd"}:
        raise BrokenRecordError(f"the chunk at byte {begin - _RECORD:,} contradicts itself")
    (stored,) = struct.unpack_from("<Q", data, begin + 32 + letters)
    contents = begin + 40 + letters
    return (start, last, size, checksum, packing.decode()), contents, contents + stored


def records(raw: bytes | memoryview) -> Iterator[tuple[int, int, int]]:
    """Yield code, begin and end of the records in a chunk; an error at the first that does not fit."""
    at = 0
    while at < len(raw):
        code, length = struct.unpack_from("<BQ", raw, at)
        at += _RECORD
        if at + length > len(raw) or code == 0:
            raise BrokenRecordError("a record")
        yield code, at, at + length
        at += length


def _confirmed(
    found: Found, named: dict[int, set[tuple[int, int]]], start: int, last: int
) -> tuple[Index, bool]:
    """Keep the messages that the index names at the same place and time; tell if it and they are the same."""
    # Those of channels without an index, which may be left out or cut off, must lie within the chunk's times.
    rows = record_file.rows_of(found)
    # A record begins with 9 bytes, a message with 22.
    keep = [
        (time, begin - 31) in named[channel] if channel in named else start <= time <= last
        for channel, time, begin, _ in rows.tolist()
    ]
    kept = rows[np.array(keep, dtype=bool)]
    counted = all(np.count_nonzero(rows[:, 0] == number) == len(own) for number, own in named.items())
    return kept, len(kept) == len(found) and counted


def _note(told: Told, code: int, content: bytes, *, vouched: bool) -> None:
    """Take in what a record says of a schema or a channel."""
    (number,) = struct.unpack_from("<H", content)
    kept: Any
    if code == _SCHEMA:
        at, name = _text(content, 2)
        at, encoding = _text(content, at)
        at, text = _text(content, at)
        kept = name, encoding, text
    else:
        (schema,) = struct.unpack_from("<H", content, 2)
        at, topic = _text(content, 4)
        at, encoding = _text(content, at)
        (size,) = struct.unpack_from("<I", content, at)
        at, kept = at + 4 + size, (schema, topic, encoding)
    if at != len(content):
        raise BrokenRecordError(f"the description of {number}")
    record_file.join_told(told, {(code, number): [(vouched, kept)]})


def _text(content: bytes, at: int) -> tuple[int, str]:
    (size,) = struct.unpack_from("<I", content, at)
    end = at + 4 + size
    if end > len(content):
        raise BrokenRecordError("a text")
    return end, content[at + 4 : end].decode()
