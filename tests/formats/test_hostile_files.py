"""Files made to do harm: bombs, endless queries, links that go in circles."""

from __future__ import annotations

import bz2
import contextlib
import gzip
import sqlite3
import struct
from pathlib import Path

import lz4.frame
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from bags import typestore, write_ros2
from salvage_cases import START, samples, write

import formats
from formats import limits, page_claims
from formats.errors import DamagedError, FormatError, NotFoundError
from formats.page_claims import check_pages
from formats.rosbag import bag_files, containers
from formats.rosbag.bag_source import BagSource
from formats.rosbag.storage.raw_messages import unpack, zstd

NOTHING = bytes(64 << 20)
PACKERS = {"zstd": zstd.compress, "lz4": lz4.frame.compress, "bz2": bz2.compress}
salvage = pytest.mark.parametrize("salvage", [False, True])
pytestmark = pytest.mark.usefixtures("soon")


@pytest.mark.parametrize("packing", PACKERS)
def test_a_bomb_is_not_unpacked(packing):
    bomb = PACKERS[packing](NOTHING)
    if packing == "lz4":
        # At its best it packs 255 times: harmless by itself.
        assert len(unpack(bomb, packing)) == len(NOTHING)
        return
    with pytest.raises(limits.TooMuchError, match="unpacks to more than"):
        unpack(bomb, packing)


@pytest.mark.parametrize("packing", PACKERS)
def test_what_is_packed_is_unpacked(packing):
    """Random bytes of several frames, and nothing at all."""
    contents = np.random.default_rng(3).bytes(3 << 20)
    packed = PACKERS[packing](contents)
    assert unpack(packed + packed, packing) == contents * 2
    assert unpack(PACKERS[packing](b""), packing) == b""
    with pytest.raises(ValueError, match="end too early"):
        unpack(packed[:-8], packing)
    with pytest.raises(ValueError, match="not known"):
        unpack(packed, "rar")


@salvage
@pytest.mark.parametrize("kind", ["ros1", "mcap"])
def test_a_bag_with_a_bomb(tmp_path, kind, salvage, monkeypatch):
    """The limit holds for the readers of whole files and for salvage."""
    path = write(tmp_path, kind, "lz4")
    monkeypatch.setattr(limits, "UNPACKED_BYTES", 1_000)
    monkeypatch.setattr(limits, "UNPACKED_RATIO", 2)
    with pytest.raises(DamagedError, match=r"unpacks to more than|nothing can be read") as caught:
        samples(BagSource(str(path), kind, salvage=salvage))
    assert "\n" not in str(caught.value)


@salvage
def test_a_packed_recording_with_a_bomb(tmp_path, salvage):
    path = write(tmp_path, "mcap", "file")
    path.write_bytes(zstd.compress(NOTHING))
    with pytest.raises(DamagedError, match="unpacks to more than"):
        BagSource(str(path.parent), "mcap", salvage=salvage)


@salvage
def test_a_packed_message_with_a_bomb(tmp_path, salvage):
    path = write(tmp_path, "db3", "message")
    with sqlite3.connect(path) as base:
        base.execute("UPDATE messages SET data = ? WHERE id = 7", (zstd.compress(NOTHING),))
    base.close()
    if salvage:
        assert len(samples(BagSource(str(path.parent), "db3", salvage=True))) == 239
    else:
        with pytest.raises(DamagedError, match="unpacks to more than"):
            samples(BagSource(str(path.parent), "db3"))


@salvage
def test_a_table_with_a_bomb(tmp_path, monkeypatch, salvage):
    path = tmp_path / "log.csv.gz"
    path.write_bytes(gzip.compress(b"time,load\n" + b"0,0\n" * 1_000_000))
    assert len(next(iter(formats.open_source(str(path)).read("", ["time"])))["time"])
    monkeypatch.setattr(limits, "FILE_BYTES", 1 << 20)
    with pytest.raises(DamagedError, match=r"unpacks to more than .* times its size") as caught:
        list(formats.open_source(str(path), salvage=salvage).read("", ["time"]))
    assert "unpack it first" in caught.value.hint


def test_a_parquet_file_that_claims_too_many_rows(tmp_path, monkeypatch):
    path = tmp_path / "a.parquet"
    pq.write_table(pa.table({"time": pa.array(np.zeros(2_000_000))}), path)
    assert formats.open_source(str(path)).streams()[0].count == 2_000_000
    monkeypatch.setattr(limits, "PARQUET_ROWS", 1000)
    monkeypatch.setattr(limits, "PARQUET_ROWS_PER_BYTE", 1)
    with pytest.raises(DamagedError, match="claims 2,000,000 rows"):
        formats.open_source(str(path))


def test_pages_of_parquet_are_checked(tmp_path):
    """Where the writer left checksums."""
    path = tmp_path / "a.parquet"
    values = np.random.default_rng(1).random(2_000)
    pq.write_table(
        pa.table({"time": values}), path, write_page_checksum=True, use_dictionary=False, compression="none"
    )
    data = bytearray(path.read_bytes())
    data[data.index(values[1000].tobytes()) + 2] ^= 1
    path.write_bytes(data)
    with pytest.raises(DamagedError, match="is corrupt"):
        list(formats.open_source(str(path)).read("", ["time"]))


def test_a_table_of_too_many_columns(tmp_path):
    path = tmp_path / "a.csv"
    path.write_text(",".join(f"c{i}" for i in range(20_000)) + "\n" + "0," * 19_999 + "0\n")
    with pytest.raises(FormatError, match="has 20,000 columns; 10,000 at most"):
        formats.open_source(str(path))


@pytest.mark.parametrize(
    "cell", ["1" * 120_000 + "x", "1." * 60_000, "+" + "9" * 100_000 + "e" * 9, "." * 100_000]
)
def test_a_cell_that_is_almost_a_number(tmp_path, cell):
    """A pattern that parts digits in two ways would need hours."""
    path = tmp_path / "a.csv"
    path.write_text(f"a,b\n{cell},1\n{cell},2\n")
    source = formats.open_source(str(path))
    assert [field.kind for field in source.streams()[0].fields] == ["text", "number"]


@salvage
@pytest.mark.parametrize(
    "view",
    [
        """CREATE VIEW messages AS WITH RECURSIVE n(i) AS (SELECT 0 UNION ALL SELECT i + 1 FROM n)
        SELECT i AS id, 1 AS topic_id, i AS timestamp, x'00' AS data FROM n""",
        """CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER, timestamp INTEGER,
        data BLOB GENERATED ALWAYS AS (zeroblob(900000000)))""",
    ],
    ids=["view", "generated"],
)
def test_a_database_that_calculates_for_ever(tmp_path, view, salvage):
    path = write_ros2(
        tmp_path / "run", [("/s", "std_msgs/msg/Float64", START, {"data": 1.0})], typestore(ros1=False), "db3"
    )
    with sqlite3.connect(path) as base:
        base.execute("DROP TABLE messages")
        base.execute(view)
        if "VIEW" not in view:
            base.execute("INSERT INTO messages(id, topic_id, timestamp) VALUES (1, 1, 1)")
    base.close()
    with pytest.raises(DamagedError, match=r"no plain table|nothing can be read"):
        samples(BagSource(str(path), "db3", salvage=salvage))


@salvage
@pytest.mark.parametrize("value", ["NULL", "'soon'", "1.5", "-3", "x'00'"])
@pytest.mark.parametrize("column", ["timestamp", "topic_id", "data"])
def test_columns_of_other_kinds(tmp_path, column, value, salvage):
    """SQLite takes anything in any column; fuzzing found a time that is NULL."""
    path = write_ros2(
        tmp_path / "run", [("/s", "std_msgs/msg/Float64", START, {"data": 1.0})], typestore(ros1=False), "db3"
    )
    with sqlite3.connect(path) as base:
        base.execute("ALTER TABLE messages RENAME TO old")
        base.execute("CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id, timestamp, data)")
        base.execute("INSERT INTO messages SELECT * FROM old")
        base.execute(f"UPDATE messages SET {column} = {value}")  # noqa: S608 - written above
    base.close()
    with contextlib.suppress(FormatError):
        assert len(samples(BagSource(str(path), "db3", salvage=salvage))) <= 1


def test_folders_linked_in_circles(tmp_path):
    folder = tmp_path / "parts"
    folder.mkdir()
    pq.write_table(pa.table({"time": [0.0, 1.0]}), folder / "a.parquet")
    for name in "bcdefgh":
        (folder / name).symlink_to(folder)
    with pytest.raises(FormatError, match="neither a rosbag2 log nor one of Parquet files alone"):
        formats.open_source(str(folder))
    assert formats.expand([str(folder)]) == [str(folder / "a.parquet")]


@salvage
def test_metadata_that_never_end(tmp_path, monkeypatch, salvage):
    path = write(tmp_path, "mcap")
    (path.parent / "metadata.yaml").write_text("a: &a [" + "x," * 3_000_000 + "]")
    if salvage:
        assert len(samples(formats.open_source(str(path.parent), salvage=True))) == 240
    else:
        with pytest.raises(DamagedError, match="longer than"):
            formats.open_source(str(path.parent))
    assert bag_files.METADATA_BYTES < 6_000_000


@pytest.mark.parametrize("name", ["../../secret.mcap", "/etc/passwd", "..", ".", ""])
def test_metadata_name_no_file_outside(tmp_path, name):
    path = write(tmp_path, "mcap")
    (tmp_path / "secret.mcap").write_bytes(path.read_bytes())
    metadata = path.parent / "metadata.yaml"
    metadata.write_text(metadata.read_text().replace("- run.mcap", f"- '{name}'"))
    with pytest.raises(NotFoundError, match="names files that are not there"):
        formats.open_source(str(path.parent))


def test_an_index_that_names_a_chunk_twice(tmp_path):
    """A few bytes of index must not make one chunk be unpacked again and again."""
    path = write(tmp_path, "mcap")
    data = path.read_bytes()
    (summary,) = struct.unpack_from("<Q", data, len(data) - 28)
    at = data.index(b"\x08", summary)
    while struct.unpack_from("<Q", data, at + 1)[0] > 300:
        at = data.index(b"\x08", at + 1)
    record = data[at : at + 9 + struct.unpack_from("<Q", data, at + 1)[0]]
    path.write_bytes(data[:at] + record * 3 + data[at:])
    with pytest.raises(DamagedError, match="names a chunk twice"):
        BagSource(str(path), "mcap")

    path = write(tmp_path, "ros1")
    data = bytearray(path.read_bytes())
    at = data.rindex(b"chunk_pos=") + 10
    before = data.rindex(b"chunk_pos=", 0, at - 20) + 10
    data[at : at + 8] = data[before : before + 8]
    path.write_bytes(data)
    with pytest.raises(DamagedError, match="names a chunk twice"):
        BagSource(str(path), "ros1")


@pytest.mark.parametrize("kind", ["ros1", "mcap"])
def test_an_index_that_is_in_the_middle_of_the_data(tmp_path, kind):
    """Its chunks must not be read twice, once for each way in which they are found."""
    path = write(tmp_path, kind)
    data = bytearray(path.read_bytes())
    at = data.index(b"index_pos=") + 10 if kind == "ros1" else len(data) - 28
    begin = 13 + 4096 if kind == "ros1" else 17 + data[9]
    data[at : at + 8] = begin.to_bytes(8, "little")
    path.write_bytes(data)
    with pytest.raises(DamagedError, match=r"the record at byte [\d,]+ of its (index|summary)"):
        BagSource(str(path), kind)


@pytest.mark.parametrize("kind", ["ros1", "mcap", "db3"])
def test_more_definitions_than_any_log_has(tmp_path, kind, monkeypatch):
    path = write(tmp_path, kind)
    monkeypatch.setattr(containers, "DEFINITIONS_CHARACTERS", 100)
    with pytest.raises(DamagedError, match="definitions have more than 100 characters"):
        BagSource(str(path), kind)
    monkeypatch.setattr(containers, "CONNECTIONS", 1)
    with pytest.raises(DamagedError, match="more than 1 connections"):
        BagSource(str(path), kind)


FINDINGS = sorted((Path(__file__).parent / "findings").iterdir())


@pytest.mark.parametrize("path", FINDINGS, ids=lambda path: path.name)
def test_what_fuzzing_found(path):
    """Each made the program crash or wait once."""

    def read():
        source = formats.open_source(str(path))
        for stream in source.streams():
            for field in stream.fields:
                list(source.read(stream.topic, [field.name]))

    with pytest.raises(FormatError) as caught:
        read()
    assert "\n" not in str(caught.value)
    assert len(FINDINGS) > 1


def test_pages_claim_no_more_than_can_be(tmp_path, monkeypatch):
    path = tmp_path / "a.parquet"
    columns = {"time": np.arange(50_000.0), "zero": np.zeros(50_000), "text": ["a"] * 50_000}
    for options in ({}, {"use_dictionary": False, "compression": "zstd"}, {"data_page_version": "2.0"}):
        pq.write_table(pa.table(columns), path, row_group_size=20_000, **options)
        assert formats.open_source(str(path)).streams()[0].count == 50_000
    monkeypatch.setattr(page_claims, "_USUAL_HEAD", 3)
    monkeypatch.setattr(limits, "UNPACKED_BYTES", 100)
    monkeypatch.setattr(limits, "UNPACKED_RATIO", 1)
    source = formats.open_source(str(path))
    monkeypatch.setattr(pq.ParquetFile, "iter_batches", lambda *_, **__: pytest.fail("it was unpacked"))
    with pytest.raises(DamagedError, match="a page claims to unpack to"):
        next(source.read("", ["zero", "time"]))


@pytest.mark.parametrize(
    "footer", [b"\x19" * 5_000, b"\x19\xfc\xff\xff\xff\xff\x0f" * 99, b"\x1c" * 5_000, b"\xff" * 99]
)
def test_footers_that_nest_without_end(tmp_path, footer):
    path = tmp_path / "a.parquet"
    path.write_bytes(b"PAR1" + footer + struct.pack("<I", len(footer)) + b"PAR1")
    check_pages(str(path))
    with pytest.raises(DamagedError, match="footer is missing or corrupt"):
        formats.open_source(str(path))
