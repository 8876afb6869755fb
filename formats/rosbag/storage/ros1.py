"""ROS 1 bags, read through their index in bulk; without it or some of their bytes every whole chunk.

Records follow each other (http://wiki.ros.org/Bags/Format/2.0). Where one does not add up, the next chunk is
looked for. The format has no checksums (bz2 has its own): a message is taken where the index behind its chunk
names it too, or there is no such index, as in the last chunk before a cut.
"""

import re
import struct
from collections.abc import Iterator
from functools import lru_cache, partial
from pathlib import Path
from typing import BinaryIO

import numpy as np
from rosbags.interfaces import Connection, ConnectionExtRosbag1, MessageDefinition, MessageDefinitionFormat
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosbags.typesys.msg import normalize_msgtype

from formats.limits import CHUNK_BYTES
from formats.rosbag.definitions import msg_text
from formats.rosbag.storage import record_file
from formats.rosbag.storage import ros1_records as records
from formats.rosbag.storage.chunks import Chunk, Entries, Run
from formats.rosbag.storage.raw_messages import Index, numbers_at, unpack
from formats.rosbag.storage.record_file import BrokenRecordError, CutOffError, Found, RecordFile, Told

_CHUNK_FIELD = re.compile(rb"compression=(?:none|bz2|lz4)")
_LONGEST_CHUNK_HEADER = 80  # The header of a chunk has three short fields

_FLOATING = frozenset({"bool", "string", "float32", "float64"})


class Ros1File(RecordFile):
    magic = b"#ROSBAG V2.0\n"
    describes = records.CONNECTION
    entry = np.dtype([("sec", "<u4"), ("nsec", "<u4"), ("place", "<u4")])
    is_damaged = " is damaged"

    def __init__(self, path: Path, *, salvage: bool = False) -> None:
        super().__init__(path, salvage=salvage)
        self._index_at: int | None = None  # Where the index at the end of the file begins, by its header
        #: Chunks of the log, and connections and chunks together that the header promises in that index.
        self._chunks = self._promised = 0
        self._indexed = self._counted = 0  # Records that stand there, and those of chunks among them
        self._messages = self._end = 0  # Messages and the last log time, by the index
        #: Of each chunk, by the index, where it begins and how many connections it has messages of.
        self._listed: list[tuple[int, int]] = []

    def read_index(self) -> bool:
        if records.read_record(self.data, len(self.magic)).fields.get(b"encryptor"):
            raise BrokenRecordError("it is encrypted")
        at = self.record(len(self.magic))
        if self._chunks:
            at = self._index_at or at
            while self._indexed < self._promised:
                if records.read_record(self.data, at).code not in {records.CONNECTION, records.CHUNK_INFO}:
                    raise BrokenRecordError(f"the record at byte {at:,} of its index")
                at = self.record(at)
        for position, connections in self._listed:
            record = records.read_record(self.data, position)
            packing, index = record.fields.get(b"compression", b"").decode(), self._index(record.end)[0]
            if record.code != records.CHUNK or len(index) != connections:
                raise BrokenRecordError(f"the chunk at byte {position:,} or its index")
            firsts = [self.least(number, begin, count) for number, (begin, count) in index.items() if count]
            if firsts:
                chunk = Chunk(
                    position=record.begin,
                    stored=record.end - record.begin,
                    unpack=partial(unpack, packing=packing),
                    slow=packing != "none",
                    first=min(firsts),
                    index=index,
                )
                self.chunks.append(chunk)
        return True

    def entries(self, of: Entries) -> tuple[Index, Index]:
        return of["sec"].astype(np.int64) * records.SECOND + of["nsec"], of["place"].astype(np.int64)

    def payloads(self, buffer: bytes, number: int, entries: Entries, places: Index) -> tuple[Index, Index]:
        data = records.data_of(buffer, number, self.entries(entries)[0], places)
        return data + 4, numbers_at(buffer, data, "<u4").astype(np.int64)

    def account(self) -> int | None:
        recovery, size, index = self.recovery, len(self.data), self._index_at
        if index is None and not recovery.damage:
            self.lose(f"cut off at byte {size:,}: its header is missing")
        elif index == 0:
            self.lose("its index is missing: the recording was not closed properly")
        elif index is not None and index >= size:
            # Says more than where the last record is cut.
            recovery.damage = [text for text in recovery.damage if not text.startswith("cut off")]
            self.lose(f"cut off at byte {size:,} of at least {index:,}: its index is missing")
            recovery.bytes_expected = index
        elif self._indexed < self._promised and not recovery.damage:
            of = f"{self._indexed:,} of {self._promised:,} records"
            self.lose(f"cut off at byte {size:,}, in its index: {of} are there")
        recovery.whole_known = bool(index)
        if self._counted and self._counted == self._chunks:
            recovery.expected = self._messages
        return self._end or None

    def grow(self, file: BinaryIO, most: int) -> list[Run]:
        found = super().grow(file, most)
        if self.at > len(self.magic):
            # The header is written again once the index is there.
            index = records.read_record(self.data, len(self.magic)).number(b"index_pos", "<Q")
            self.ended = 0 < index <= self.at
        return found

    def record(self, at: int) -> int:
        record = records.read_record(self.data, at)
        end = record.end
        if end > len(self.data):
            if record.code == records.CHUNK and not self.growing:
                self._cut_chunk(record)
            what = "chunk" if record.code == records.CHUNK else "record"
            raise CutOffError(f"a {what} that begins at byte {at:,}")
        match record.code:
            case records.CHUNK:
                end = self._chunk(at, record)
            case records.MESSAGE:
                # Of a chunk that was never closed.
                size = record.end - record.begin
                self.take_loose((record.number(b"conn"), record.time(), record.begin, size))
            case records.HEADER:
                self._index_at = record.number(b"index_pos", "<Q")
                self._chunks = record.number(b"chunk_count")
                self._promised = self._chunks + record.number(b"conn_count")
            case records.CONNECTION:
                self._indexed += at >= (self._index_at or 0)
                _note(self.told, record, self.data[record.begin : record.end], vouched=False)
            case records.CHUNK_INFO:
                self._chunk_info(record)
            case records.INDEX:
                pass
            case 0 if self.growing and not record.fields:
                # The file is longer already than what was written into it.
                raise CutOffError(f"a record at byte {at:,}")
            case _:
                raise BrokenRecordError(f"a record at byte {at:,}")
        self.recovery.bytes_read += end - at
        return end

    def next_chunk(self, start: int) -> int | None:
        for match in _CHUNK_FIELD.finditer(self.data, start):
            for at in range(match.start() - 8, max(start, match.start() - _LONGEST_CHUNK_HEADER) - 1, -1):
                (length,) = struct.unpack_from("<I", self.data, at)
                if not match.end() - at - 4 <= length <= _LONGEST_CHUNK_HEADER:
                    continue
                try:
                    record = records.read_record(self.data, at)
                except (BrokenRecordError, struct.error):
                    continue
                if record.code == records.CHUNK and record.end <= len(self.data):
                    return at
        return None

    def _chunk(self, at: int, record: records.BagRecord) -> int:
        """Read a chunk and the index behind it; return where that ends."""
        self.end_loose()
        if record.begin == record.end:
            # Not closed: its messages follow as records of the file.
            if self.growing and record.fields.get(b"compression") != b"none":
                raise CutOffError(f"a chunk that begins at byte {at:,}")
            return record.end
        packing, size = record.fields.get(b"compression", b"").decode(), record.number(b"size")
        index, end = self._index(record.end)
        place, vouched = slice(record.begin, record.end), packing == "bz2"

        def confirm(found: Found) -> tuple[Index, bool]:
            return _settled(found, self.named(index))

        self.take_chunk(at, place, packing, size, confirm, vouched=vouched)
        return end

    def _cut_chunk(self, record: records.BagRecord) -> None:
        """Take the whole messages of a chunk that is cut off, if it is not packed."""
        if record.fields.get(b"compression") != b"none" or len(self.data) - record.begin > CHUNK_BYTES:
            return
        place = slice(record.begin, len(self.data))
        found, _ = self.found_in(self.data[place], self.told, vouched=False)
        rows = record_file.rows_of(found)
        self.unchecked = True
        self.take(rows, record_file.tame(rows), place)

    def _index(self, at: int) -> tuple[dict[int, tuple[int, int]], int]:
        """Read the records of the index behind a chunk: where entries begin and how many, by connection."""
        index = {}
        while at < len(self.data):
            try:
                record = records.read_record(self.data, at)
                if record.code != records.INDEX or record.end > len(self.data):
                    break
                connection, count = record.number(b"conn"), record.number(b"count")
                if count * self.entry.itemsize != record.end - record.begin or record.number(b"ver") != 1:
                    break
            except (BrokenRecordError, struct.error):
                break
            index[connection] = record.begin, count
            at = record.end
        return index, at

    def _chunk_info(self, record: records.BagRecord) -> None:
        content = self.data[record.begin : record.end]
        if len(content) != 8 * record.number(b"count"):
            raise BrokenRecordError("the index")
        if not self.salvage:
            self._listed.append((record.number(b"chunk_pos", "<Q"), record.number(b"count")))
        self._counted += 1
        self._indexed += 1
        self._messages += sum(count for _, count in struct.iter_unpack("<II", content))
        self._end = max(self._end, record.time(b"end_time"))

    def messages_in(self, raw: bytes, told: Told, *, vouched: bool) -> Iterator[tuple[int, ...]]:
        """Yield messages as rows of a piece, where their record begins, and a connection just before it."""
        # At the latter some writers let the index point.
        at, earlier = 0, None
        while at < len(raw):
            record = records.read_record(raw, at)
            if record.end > len(raw):
                raise BrokenRecordError("a record")
            if record.code == records.CONNECTION:
                _note(told, record, raw[record.begin : record.end], vouched=vouched)
                earlier = at if earlier is None else earlier
            elif record.code == records.MESSAGE:
                number, time, size = record.number(b"conn"), record.time(), record.end - record.begin
                yield number, time, record.begin, size, at, at if earlier is None else earlier
                earlier = None
            else:
                raise BrokenRecordError("a record")
            at = record.end

    def known(self) -> dict[int, Connection]:
        known = {}
        for number, told in self.told_of().items():
            said = record_file.agreed(told)
            if said is None and self.salvage:
                fits = {what: _fits(what) for _, what in told}
                # Else one of which that cannot be told.
                fitting = [what for what in fits if fits[what]] or [
                    what for what in fits if fits[what] is None
                ]
                said = fitting[0] if len(fitting) == 1 else None
            if said is None:
                self.note(f"connection {number} is described twice, each time differently")
                continue
            topic, kind, digest, text, caller = said
            if self.salvage and _fits(said) is False:
                # Perhaps it is a standard type, which its checksum tells.
                self.note(f"the definition of {topic} is not the one its checksum is of")
                text = ""
            definition = MessageDefinition(MessageDefinitionFormat.MSG, text)
            more = ConnectionExtRosbag1(caller, None)
            known[number] = Connection(number, topic, kind, definition, digest, 0, more, self)
        return known


def _settled(found: Found, index: dict[int, set[tuple[int, int]]]) -> tuple[Index, bool]:
    """Keep the messages that the index, if any, names at the same place and time; tell if all agree."""
    named, unnamed = [], []
    for row in found:
        connection, time, _, _, at, earlier = row
        if connection not in index:
            unnamed.append(row)
        elif (time, at) in index[connection] or (time, earlier) in index[connection]:
            named.append(row)
    rows = record_file.rows_of(named + unnamed)
    # Those without an index are compared with the others of their chunk.
    agrees = len(named) == sum(map(len, index.values())) == len(found) - len(unnamed)
    return record_file.tame(rows) if unnamed else rows, agrees


def _fits(said: tuple[str, str, str, str, str | None]) -> bool | None:
    """Tell whether a definition has the checksum noted beside it; None where that cannot be told."""
    _, kind, digest, text, _ = said
    found = checksum(text, kind) if re.fullmatch("[0-9a-f]{32}", digest) and text.strip() else None
    return None if found is None else found == digest


def _note(told: Told, record: records.BagRecord, content: bytes, *, vouched: bool) -> None:
    """Take in what a record says of a connection."""
    number, topic = record.number(b"conn"), record.fields.get(b"topic", b"").decode()
    about = records.fields_of(content)
    if not topic or b"type" not in about:
        raise BrokenRecordError(f"the description of connection {number}")
    keys = (b"type", b"md5sum", b"message_definition", b"callerid")
    kind, digest, definition, caller = (about.get(key, b"").decode() for key in keys)
    # As rosbags has it: no part of a topic is empty.
    topic = "/" * topic.startswith("/") + "/".join(filter(None, topic.split("/")))
    kept = topic, normalize_msgtype(kind), digest, definition, caller or None
    record_file.join_told(told, {(records.CONNECTION, number): [(vouched, kept)]})


@lru_cache(256)
def checksum(text: str, type_name: str) -> str | None:
    """Return the checksum of a definition, behind which are those of its parts, as rosbags computes it.

    None where it cannot be told: a type is missing, or a constant is no whole number, which tools write in
    more than one way.
    """
    try:
        types = get_types_from_msg(msg_text(text), type_name)
        store = get_typestore(Stores.EMPTY)
        if any(kind in _FLOATING for constants, _ in types.values() for _, kind, _ in constants):
            return None
        store.register({name: types[name] for name in types if name not in store.fielddefs})
        return store.generate_msgdef(normalize_msgtype(type_name))[1]
    except Exception:  # noqa: BLE001 - a damaged text makes rosbags' parser fail in any way
        return None
