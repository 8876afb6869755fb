"""Text tables cut in the middle of a row, and Parquet that is not whole."""

from __future__ import annotations

import bz2
import gzip

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from hypothesis import given
from hypothesis import strategies as st
from profiles import examples

from formats import DamagedError, FormatError, open_source
from formats.rosbag.storage.raw_messages import zstd

N = 200
PACKERS = {"": bytes, "gz": gzip.compress, "bz2": bz2.compress, "zst": zstd.compress}


def text():
    """Return a table whose rows all differ in every column, with quotes and letters of two bytes."""
    rows = [f'{i / 8},{i * 1.25e3},"Böschung, {i}",{i % 7}' for i in range(N)]
    return ("time,load,note,pass\n" + "\n".join(rows) + "\n").encode()


def table(path, *, salvage=True):
    source = open_source(str(path), salvage=salvage)
    names = [field.name for field in source.streams()[0].fields]
    parts = list(source.read("", names, 37))
    columns = {}
    for name in names:
        values = []
        for part in parts:
            column = part[name]
            values += (
                [column.names[code] for code in column.codes] if hasattr(column, "codes") else column.tolist()
            )
        columns[name] = values
    return source, columns


WHOLE = text()


def test_a_whole_table_is_read_as_ever(tmp_path):
    path = tmp_path / "log.csv"
    path.write_bytes(WHOLE)
    source, columns = table(path)
    assert columns == table(path, salvage=False)[1]
    assert (source.remarks, source.recovery.damaged, source.recovery.fraction) == ([], False, 1.0)
    assert source.recovery.read == N


@examples(200)
@given(st.integers(0, len(WHOLE) - 1))
def test_cut_at_any_byte(tmp_path_factory, cut):
    """Every row that has its end of line is read, and nothing of the one that has not."""
    path = tmp_path_factory.mktemp("cut") / "log.csv"
    path.write_bytes(WHOLE[:cut])
    rows = WHOLE[:cut].count(b"\n") - 1
    if rows < 1:
        with pytest.raises(FormatError):
            table(path)
        return
    source, columns = table(path)
    expected = [line.split(",") for line in WHOLE.decode().splitlines()[1 : rows + 1]]
    assert columns["time"] == [float(row[0]) for row in expected]
    assert columns["load"] == [float(row[1]) for row in expected]
    assert columns["note"] == [f"Böschung, {i}" for i in range(rows)]
    assert source.recovery.read == rows
    whole = WHOLE[:cut].endswith(b"\n")
    assert source.recovery.damaged == (not whole)
    if not whole:
        left = cut - WHOLE[:cut].rindex(b"\n") - 1
        assert f"damaged: cut off in row {rows + 2}, of which" in "\n".join(source.remarks)
        assert source.recovery.fraction == (cut - left) / cut
        assert source.recovery.lost_s is None


@pytest.mark.parametrize("share", [0.3, 0.6, 0.9])
def test_without_salvage_it_fails_with_the_hint(tmp_path, share):
    path = tmp_path / "log.csv"
    cut = int(len(WHOLE) * share)
    while WHOLE[cut - 1 : cut + 1].strip() != WHOLE[cut - 1 : cut + 1] or b"," in WHOLE[cut - 1 : cut + 1]:
        cut += 1
    path.write_bytes(WHOLE[:cut])
    with pytest.raises(DamagedError, match=r"cut off in row \d+: its last row has \d of 4 fields") as caught:
        table(path, salvage=False)
    assert "--salvage" in caught.value.hint


@pytest.mark.parametrize("packing", [name for name in PACKERS if name])
@pytest.mark.parametrize("share", [0.5, 0.8, 0.99])
def test_packed_and_cut_off(tmp_path, packing, share):
    """Of packed data what can be unpacked is right; it is a prefix of what was packed."""
    rows = 40_000
    noise = np.random.default_rng(5).random(rows)
    whole = "time,load\n" + "".join(f"{i},{value!r}\n" for i, value in enumerate(noise.tolist()))
    packed = PACKERS[packing](whole.encode())
    path = tmp_path / f"log.csv.{packing}"
    path.write_bytes(packed[: int(len(packed) * share)])
    with pytest.raises(DamagedError, match="cut off") as caught:
        table(path, salvage=False)
    assert "--salvage" in caught.value.hint
    if packing == "bz2" and share < 0.9:
        # One block of it has 900 kB.
        with pytest.raises(DamagedError, match="data end too early, before anything can be unpacked"):
            table(path)
        return
    source, columns = table(path)
    found = len(columns["load"])
    assert columns["load"] == noise[:found].tolist()
    assert found > 0.3 * share * rows
    assert "data end too early" in "\n".join(source.remarks)
    assert source.recovery.damaged


@pytest.mark.parametrize("packing", ["gz", "bz2"])
def test_packed_and_corrupt_cannot_be_saved(tmp_path, packing):
    """Its checksum stands at the end and vouches for all or nothing."""
    packed = bytearray(PACKERS[packing](WHOLE * 3))
    packed[len(packed) // 2] ^= 4
    path = tmp_path / f"log.csv.{packing}"
    path.write_bytes(packed)
    for salvage in (False, True):
        with pytest.raises(FormatError):
            table(path, salvage=salvage)


def test_an_odd_inch_mark_is_no_open_quote(tmp_path):
    path = tmp_path / "log.csv"
    path.write_text('time,size 5",load\n0,1,2\n1,2,3\n2,3')
    _, columns = table(path)
    assert columns["time"] == [0.0, 1.0]


def test_an_open_quote_ends_the_table(tmp_path):
    """The cut fell into a text with a line break in it."""
    path = tmp_path / "log.csv"
    path.write_text('time,note,load\n0,"a\nb",2\n1,"c\nd')
    source, columns = table(path)
    assert columns["note"] == ["a\nb"]
    assert columns["load"] == [2.0]
    assert source.recovery.damaged


def test_parquet_without_footer_says_why_nothing_can_be_saved(tmp_path):
    path = tmp_path / "log.parquet"
    pq.write_table(pa.table({"time": np.arange(1000.0)}), path)
    path.write_bytes(path.read_bytes()[:-20])
    for salvage in (False, True):
        with pytest.raises(DamagedError, match="its footer is missing or corrupt") as caught:
            open_source(str(path), salvage=salvage)
        assert "--salvage cannot help" in caught.value.hint


def test_parquet_of_which_one_part_is_not_whole(tmp_path):
    for k in range(3):
        pq.write_table(pa.table({"time": np.arange(10.0) + 10 * k}), tmp_path / f"part-{k}.parquet")
    part = tmp_path / "part-1.parquet"
    part.write_bytes(part.read_bytes()[:-20])
    with pytest.raises(DamagedError, match="part-1"):
        open_source(str(tmp_path))
    source, columns = table(tmp_path)
    assert columns["time"] == [*range(10), *range(20, 30)]
    assert "salvaged: 2 parts of 3 (66.7 %)" in source.remarks
    for name in ("part-0.parquet", "part-2.parquet"):
        (tmp_path / name).write_bytes(b"PAR1")
    with pytest.raises(DamagedError, match="none of its 3 parts is whole"):
        open_source(str(tmp_path), salvage=True)


@pytest.mark.parametrize("version", ["1.0", "2.0"])
@pytest.mark.parametrize("dictionary", [True, False])
@pytest.mark.parametrize("compression", ["none", "zstd"])
def test_parquet_is_checked_where_every_page_has_a_checksum(tmp_path, version, dictionary, compression):
    path = tmp_path / "log.parquet"
    content = pa.table({"time": np.arange(900.0), "none": pa.nulls(900, pa.float64()), "list": [[1]] * 900})
    options = {"data_page_version": version, "use_dictionary": dictionary, "compression": compression}
    for checksums in (False, True):
        pq.write_table(content, path, write_page_checksum=checksums, data_page_size=500, **options)
        recovery = open_source(str(path), salvage=True).recovery
        assert (recovery.damaged, recovery.checked) == (False, checksums)
    # A checksum is verified: what it vouches for is right, or is not read.
    data = path.read_bytes()
    whole = table(path)[1]["time"]
    refused = 0
    for at in range(4, data.index(b"ARROW:schema") - 900, 97):
        path.write_bytes(data[:at] + bytes([data[at] ^ 8]) + data[at + 1 :])
        try:
            assert table(path)[1]["time"] == whole
        except FormatError:
            refused += 1
    assert refused


def test_one_part_without_checksums_leaves_the_folder_unchecked(tmp_path):
    for k in range(2):
        pq.write_table(
            pa.table({"time": np.arange(9.0)}), tmp_path / f"part-{k}.parquet", write_page_checksum=k == 0
        )
    assert not open_source(str(tmp_path), salvage=True).recovery.checked
