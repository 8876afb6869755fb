"""Chunks and rows that contradict their index, where no checksum tells."""

from __future__ import annotations

import sqlite3
import struct

import pytest
from rosbags.rosbag1 import Reader as Ros1Reader
from rosbags.rosbag2.storage_mcap import McapReader
from salvage_cases import START, N, opened, samples, write

from formats import DamagedError, FormatError

DAY = 86_400 * 10**9


def last_chunk(path, kind):
    """Return where the packed bytes of the last chunk begin and end, and its first and last log time."""
    if kind == "mcap":
        reader = McapReader(path)
        reader.open()
        chunk = reader.chunks[-1]
        reader.close()
        end = chunk.chunk_start_offset + chunk.chunk_length
        return end - chunk.compressed_size, end, (chunk.message_start_time, chunk.message_end_time)
    with Ros1Reader(path) as reader:
        info = max(reader.chunk_infos, key=lambda info: info.pos)
        begin = reader.chunks[info.pos].datapos
        return begin, begin + reader.chunks[info.pos].datasize, (info.start_time, info.end_time - 1)


@pytest.mark.parametrize(("kind", "packing"), [("ros1", "lz4"), ("mcap", "lz4"), ("mcap", "zstd")])
def test_a_packed_chunk_is_kept_whole_or_not_at_all(tmp_path, kind, packing):
    """One changed byte of it changes others: what still agrees with the index may be wrong too."""
    path = write(tmp_path, kind, packing)
    data, whole = path.read_bytes(), samples(opened(path, kind))
    begin, end, (start, last) = last_chunk(path, kind)
    inside = {key for key in whole if start <= key[1] <= last}
    outside = whole.keys() - inside
    contradicted = 0
    for at in range(begin, end, 61):
        path.write_bytes(data[:at] + bytes([data[at] ^ 16]) + data[at + 1 :])
        source = opened(path, kind)
        kept = source.recovery.read
        found = samples(source)
        contradicts = "contradicts its index" in "\n".join(source.remarks)
        assert kept in ({len(outside)} if contradicts else {len(outside), len(whole)})
        assert found.keys() <= (outside if contradicts else whole.keys())
        contradicted += contradicts
    assert contradicted


def changed(path, statement):
    with sqlite3.connect(path) as database:
        database.execute(statement)
    database.close()


@pytest.mark.parametrize("number", [1, 117, 2 * N])
@pytest.mark.parametrize("shift", [DAY, -DAY, 2**62])
def test_an_impossible_log_time_of_a_database(tmp_path, number, shift):
    """Its index agrees; but no clock runs a day ahead and back for one message."""
    path = write(tmp_path, "db3")
    whole = samples(opened(path, "db3", salvage=False))
    changed(path, f"UPDATE messages SET timestamp = timestamp + {shift} WHERE id = {number}")  # noqa: S608
    with pytest.raises(DamagedError, match=f"log time of message {number} is over an hour") as caught:
        opened(path, "db3", salvage=False)
    assert "--salvage" in caught.value.hint
    source = opened(path, "db3")
    found = samples(source)
    assert found.items() <= whole.items()
    assert (len(found), source.recovery.aside, source.recovery.expected) == (2 * N - 1, 1, 2 * N)
    assert "1 message set aside, which contradicts itself" in "\n".join(source.remarks)
    assert "not there" not in "\n".join(source.remarks)


def test_a_clock_that_was_set_is_believed(tmp_path):
    path = write(tmp_path, "db3")
    changed(path, f"UPDATE messages SET timestamp = timestamp + {DAY} WHERE id > 100")  # noqa: S608
    plain = samples(opened(path, "db3", salvage=False))
    assert len(plain) == 2 * N
    assert samples(opened(path, "db3")) == plain


@pytest.mark.parametrize("bit", range(0, 64, 7))
def test_a_log_time_that_its_index_does_not_name(tmp_path, bit):
    """A changed bit in a row, or in the index: without salvage too, the two are compared."""
    path = write(tmp_path, "db3")
    data = path.read_bytes()
    code = struct.pack(">Q", START + 7 * 10**8)
    for at in (data.index(code), data.rindex(code)):
        broken = bytearray(data)
        broken[at + 7 - bit // 8] ^= 1 << bit % 8
        path.write_bytes(broken)
        with pytest.raises(FormatError):
            opened(path, "db3", salvage=False)
        assert len(samples(opened(path, "db3"))) >= 2 * N - 1
