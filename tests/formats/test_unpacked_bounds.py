"""What many small parts of a file may cost together."""

from __future__ import annotations

import bz2
import gzip

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from salvage_cases import opened, samples, write

from formats import DamagedError, FormatError, content, limits, open_source
from formats.rosbag.storage.raw_messages import unpack, zstd

salvage = pytest.mark.parametrize("salvage", [True, False])


@salvage
@pytest.mark.parametrize(("kind", "packing"), [("ros1", "bz2"), ("mcap", "zstd"), ("mcap", "message")])
def test_all_chunks_of_a_bag_together(tmp_path, kind, packing, salvage, monkeypatch):
    """Each is within its own bound."""
    path = write(tmp_path, kind, packing)
    path = path.parent if packing == "message" else path
    assert samples(opened(path, kind, salvage=salvage))
    monkeypatch.setattr(limits, "FILE_BYTES", 8_000)
    monkeypatch.setattr(limits, "UNPACKED_RATIO", 0)
    with pytest.raises(DamagedError, match="its parts unpack to more than 8,000 bytes together"):
        samples(opened(path, kind, salvage=salvage))


@pytest.mark.parametrize("packing", ["bz2", "zstd", "lz4"])
def test_a_chunk_becomes_no_more_than_it_says(packing):
    import lz4.frame

    pack = {"bz2": bz2.compress, "zstd": zstd.compress, "lz4": lz4.frame.compress}[packing]
    packed = pack(bytes(5_000))
    assert unpack(packed, packing, 5_000) == bytes(5_000)
    with pytest.raises(limits.TooMuchError, match="more than 4,999 bytes"):
        unpack(packed, packing, 4_999)


@salvage
@pytest.mark.parametrize("pack", [bytes, gzip.compress], ids=["plain", "gzip"])
def test_nul_bytes_without_end(tmp_path, pack, salvage, monkeypatch):
    monkeypatch.setattr(content, "NUL_BYTES", 1 << 20)
    path = tmp_path / "log.csv"
    head = b"time,load\n" + b"0.5,81.25\n" * 30_000
    for count in (1000, 3 << 20):
        path.write_bytes(pack(head + bytes(count)))
        if count == 1000:
            source = open_source(str(path), salvage=salvage)
            assert sum(len(batch["time"]) for batch in source.read("", ["time"])) == 30_000
            continue
        with pytest.raises(DamagedError, match=r"up to line 30002 .* than 1,048,576 NUL") as caught:
            list(open_source(str(path), salvage=salvage).read("", ["time"]))
        assert "tr -d" in caught.value.hint


@salvage
def test_a_line_without_end(tmp_path, salvage):
    path = tmp_path / "log.csv"
    path.write_bytes(b"time,load\n" + b"0.5,81.25\n" * 30_000 + b"7" * (40 << 20))
    with pytest.raises(FormatError) as caught:
        list(open_source(str(path), salvage=salvage).read("", ["time"]))
    assert "\n" not in str(caught.value)


def test_equal_rows_of_parquet(tmp_path):
    """Within the bound of rows, but far beyond that of what they become."""
    path = tmp_path / "log.parquet"
    rows = 10_000_000
    same = pa.DictionaryArray.from_arrays(np.zeros(rows, np.int8), pa.array([81.25]))
    pq.write_table(pa.table({f"c{k}": same for k in range(15)}), path)
    source = open_source(str(path))
    assert len(next(iter(source.read("", ["c0"])))["c0"])
    with pytest.raises(DamagedError, match=r"15 columns of it become 1,200,000,000 bytes") as caught:
        next(iter(source.read("", [f"c{k}" for k in range(15)])))
    assert "CSV" in caught.value.hint


def test_columns_of_parquet(tmp_path, monkeypatch):
    path = tmp_path / "log.parquet"
    monkeypatch.setattr("formats.limits.COLUMNS", 4)
    pq.write_table(pa.table({f"c{k}": [1.0] for k in range(5)}), path)
    with pytest.raises(FormatError, match="has 5 columns; 4 at most are read"):
        open_source(str(path))


def test_aliases_in_metadata(tmp_path):
    """Nine lines of them stand for a thousand million texts."""
    path = write(tmp_path, "mcap")
    lines = ["a0: &a0 [x, x, x, x, x, x, x, x, x, x]"]
    lines += [f"a{k}: &a{k} [{', '.join([f'*a{k - 1}'] * 10)}]" for k in range(1, 9)]
    told = path.with_name("metadata.yaml")
    told.write_text("\n".join(lines) + "\n" + told.read_text() + "  compression_mode: *a8\n")
    with pytest.raises(DamagedError, match="aliases"):
        opened(path.parent, "mcap", salvage=False)
    assert "metadata.yaml is damaged" in "\n".join(opened(path.parent, "mcap").remarks)
