"""Files cut where one record ends and the next would begin: nothing there looks damaged."""

from __future__ import annotations

import struct

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from salvage_cases import CASES, opened, samples, write

from formats import FormatError, open_source

MAGIC = {"ros1": b"#ROSBAG V2.0\n", "mcap": b"\x89MCAP0\r\n", "db3": b"SQLite format 3\0"}
FEW = 3


def ends(kind, data):
    """Return where the magic line and each record or page end, by other means than those under test."""
    at = len(MAGIC[kind])
    found = [at]
    while at < len(data) and kind != "db3":
        if kind == "ros1":
            for _ in range(2):
                at += 4 + struct.unpack_from("<I", data, at)[0]
        else:
            at += 9 + struct.unpack_from("<BQ", data, at)[1] if len(data) - at > 8 else 8
        found.append(at)
    if kind == "db3":
        found += range(4096, len(data) + 1, 4096)
    assert found[-1] == len(data)
    return found


@pytest.mark.parametrize(("kind", "compression"), CASES)
def test_a_cut_between_two_records_is_told(tmp_path, kind, compression):
    path = write(tmp_path, kind, compression, FEW)
    data, whole = path.read_bytes(), samples(opened(path, kind))
    assert data.startswith(MAGIC[kind])
    assert len(whole) == 2 * FEW
    counts = []
    for cut in ends(kind, data)[:-1]:
        path.write_bytes(data[:cut])
        with pytest.raises(FormatError):
            samples(opened(path, kind, salvage=False))
        try:
            source = opened(path, kind)
        except FormatError as error:
            assert "cut off" in str(error) or "are not there" in str(error)  # noqa: PT017 - either is right
            continue
        found = samples(source)
        counts.append(len(found))
        assert found.items() <= whole.items()
        assert f"damaged: cut off at byte {cut:,}" in "\n".join(source.remarks)
        assert f"salvaged: {len(found):,} messages" in "\n".join(source.remarks)
    assert counts == sorted(counts)
    assert counts[-1] == 2 * FEW


def test_a_bag_that_ends_behind_its_magic_line(tmp_path):
    path = tmp_path / "a.bag"
    path.write_bytes(MAGIC["ros1"])
    with pytest.raises(FormatError, match="cut off at byte 13: its header is missing"):
        open_source(str(path), salvage=True)
    with pytest.raises(FormatError, match="cut off after 13 bytes, in its header"):
        open_source(str(path))


def test_parquet_cut_at_any_byte(tmp_path):
    path = tmp_path / "a.parquet"
    pq.write_table(pa.table({"time": np.arange(9.0)}), path)
    data = path.read_bytes()
    for cut in (*range(4, 8), *range(8, len(data) - 1, 41), len(data) - 8, len(data) - 4, len(data) - 1):
        path.write_bytes(data[:cut])
        for salvage in (False, True):
            with pytest.raises(FormatError, match="its footer is missing or corrupt"):
                open_source(str(path), salvage=salvage)
