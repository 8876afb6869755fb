"""CSV and its kin: what is read, and what is said of what is wrong."""

from __future__ import annotations

import bz2
import gzip
import math

import numpy as np
import pyarrow as pa
import pytest
from hypothesis import given
from hypothesis import strategies as st
from profiles import examples

from formats import DamagedError, FormatError, Labels, open_source, write_table
from formats.text.delimited import DelimitedSource


@pytest.fixture
def make(tmp_path):
    def write(text, name="log.csv", encoding="utf-8"):
        path = tmp_path / name
        path.write_bytes(text if isinstance(text, bytes) else text.encode(encoding))
        return str(path)

    return write


def table(path, fields=None, batch_rows=65_536):
    """Read everything and join the batches."""
    source = open_source(path)
    names = fields or [field.name for field in source.streams()[0].fields]
    batches = list(source.read("", names, batch_rows))
    return source, {name: join([batch[name] for batch in batches]) for name in names}


def join(parts):
    if isinstance(parts[0], Labels):
        return [part.names[code] if code >= 0 else None for part in parts for code in part.codes]
    return np.concatenate(parts)


def kinds(source):
    return {field.name: field.kind for field in source.streams()[0].fields}


def same(actual, expected):
    np.testing.assert_array_equal(actual, np.asarray(expected))


def test_numbers_and_labels(make):
    source, columns = table(make("time,torque,terrain\n0,1.5,sand\n0.1,-2e-3,rock\n0.2,.5, sand \n"))
    assert source.kind == "csv"
    assert kinds(source) == {"time": "number", "torque": "number", "terrain": "text"}
    same(columns["time"], [0.0, 0.1, 0.2])
    same(columns["torque"], [1.5, -0.002, 0.5])
    assert columns["terrain"] == ["sand", "rock", "sand"]
    assert source.remarks == []
    assert source.skipped == 0


@pytest.mark.parametrize(
    ("text", "remarks"),
    [
        ("a;b\n0,5;-1,25e1\n1;2\n", ["columns separated by semicolons", "decimal comma"]),
        ("a\tb\n0,5\t-12,5\n1\t2\n", ["columns separated by tabs", "decimal comma"]),
        ("a;b\n0.5;-12.5\n1;2\n", ["columns separated by semicolons"]),
        ("a\tb\r\n0.5\t-12.5\r\n1\t2\r\n", ["columns separated by tabs"]),
        (' "a" , "b"\n 0.5 , -12.5\n+1,2 ', []),
        ("# a log\n#\n\na,b\n\n0.5,-12.5\n\n1,2\n\n", []),
        ("a,b\r\r\n0.5,-12.5\r\r\n1,2\r\r\n", []),
        ("a,b\r0.5,-12.5\r1,2\r", []),
        ("a,b\n0.5,-12.5,\n1,2,\n", []),
        ("a,b,\n0.5,-12.5\n1,2\n", []),
        ('a,b\n"0.5","-12.5"\n"1","2"\n', []),
        ("# a,b\n0.5,-12.5\n1,2\n", ["the names of the columns are in the comment on line 1"]),
    ],
)
def test_ways_of_writing_one_table(make, text, remarks):
    source, columns = table(make(text))
    assert list(columns) == ["a", "b"]
    same(columns["a"], [0.5, 1.0])
    same(columns["b"], [-12.5, 2.0])
    assert source.remarks == remarks
    assert source.skipped == 0


@pytest.mark.parametrize("encoding", ["utf-8-sig", "utf-16", "utf-32"])
def test_byte_order_mark(make, encoding):
    source, columns = table(make("time,terrain\n1,Böschung\n2,砂\n", encoding=encoding))
    same(columns["time"], [1.0, 2.0])
    assert columns["terrain"] == ["Böschung", "砂"]
    assert source.remarks == ([] if encoding == "utf-8-sig" else [f"{encoding.upper()}-LE"])


@pytest.mark.parametrize("packing", ["gzip", "bz2", "zstd"])
def test_compressed(tmp_path, packing):
    path = tmp_path / "log.csv.packed"
    with pa.CompressedOutputStream(str(path), packing) as stream:
        stream.write(b"a,b\n" + b"1,2\n" * 100_000)
    source, columns = table(str(path))
    assert columns["a"].sum() == 100_000
    assert source.remarks == [f"packed with {packing}"]
    path.write_bytes(path.read_bytes()[:-9])
    with pytest.raises(DamagedError, match="is cut off"):
        table(str(path))


def test_gzip_of_several_members(make):
    _, columns = table(
        make(gzip.compress(b"a,b\n1,2\n", mtime=0) + gzip.compress(b"3,4\n", mtime=0), "log.csv.gz")
    )
    same(columns["b"], [2.0, 4.0])


def test_corrupt_compressed_data(make):
    packed = bytearray(bz2.compress(b"a,b\n" + b"1,2\n" * 1000))
    packed[20] ^= 0xFF
    with pytest.raises(DamagedError, match="bz2 data are corrupt"):
        table(make(bytes(packed)))


def test_text_in_numbers_is_nan_and_said(make):
    rows = "".join(f"{j},{'abc' if j in (15, 20, 21) else j}\n" for j in range(30))
    source, columns = table(make("time,torque\n" + rows))
    assert np.flatnonzero(np.isnan(columns["torque"])).tolist() == [15, 20, 21]
    assert source.remarks == ["row 17: torque is 'abc', not a number (3 such cells)"]


def test_what_stands_for_no_value_and_infinity(make):
    cells = ["1", "", "NaN", "nan", " NA ", "null", "N/A", "None", "inf", "-Infinity", "+INF"]
    source, columns = table(make("n,x\n" + "".join(f"{j},{cell}\n" for j, cell in enumerate(cells))))
    same(columns["x"], [1, *[np.nan] * 7, np.inf, -np.inf, np.inf])
    assert source.remarks == []


def test_points_are_not_decimal_in_a_file_with_decimal_comma(make):
    # 1.234 may be one thousand two hundred and thirty-four.
    source, columns = table(make("a;b\n0,5;1,5\n1,0;2,5\n1.234;2,5\n1.234,5;3,5\n"))
    same(columns["a"], [0.5, 1.0, np.nan, np.nan])
    assert "row 4: a is '1.234', not a number (2 such cells)" in source.remarks


def test_rows_of_unequal_length(make):
    source, columns = table(make("a,b,c\n1,2,3\n4,5\n6,7,8,9\n\n10,11,12,\n13\n14,15,16\n"))
    same(columns["a"], [1, 4, 10, 13, 14])
    same(columns["b"], [2, 5, 11, np.nan, 15])
    same(columns["c"], [3, np.nan, 12, np.nan, 16])
    assert source.skipped == 1
    assert source.remarks == [
        "row 3 has 2 of 3 fields: the others are empty (2 such rows)",
        "row 4 has 4 fields where the header names 3: set aside",
    ]


def test_last_row_cut_off_is_an_error_with_its_remedy(make):
    with pytest.raises(DamagedError, match="cut off in row 4: its last row has 1 of 2 fields") as caught:
        table(make("a,b\n1,2.5\n3,4.5\n5"))
    assert "--salvage" in caught.value.hint


def test_nul_bytes_after_a_power_cut(make):
    source, columns = table(make(b"time,torque\n" + b"1.0,2.0\n" * 50 + b"\0" * 4096))
    assert len(columns["time"]) == 50
    assert source.remarks == ["4096 NUL bytes passed over, as a power cut leaves them"]


@given(st.lists(st.integers(0, 4), min_size=1, max_size=60), st.integers(1, 9), st.booleans())
@examples(60)
def test_uneven_rows_keep_their_places(tmp_path_factory, widths, batch_rows, newline):
    """Each row carries its number, so that a shifted or lost row shows."""
    widths = [3, *widths, 3]
    lines = [",".join(str(100 * j + k) for k in range(width)) for j, width in enumerate(widths)]
    path = tmp_path_factory.mktemp("uneven") / "log.csv"
    path.write_text("a,b,c\n" + "\n".join(lines) + "\n" * newline)
    source, columns = table(str(path), ["c", "a"], batch_rows)
    kept = [j for j, width in enumerate(widths) if 1 <= width <= 3]
    same(columns["a"], [100.0 * j for j in kept])
    same(columns["c"], [100.0 * j + 2 if widths[j] == 3 else np.nan for j in kept])
    assert source.skipped == sum(width == 4 for width in widths)


def test_uneven_rows_across_blocks(make, monkeypatch):
    monkeypatch.setattr("formats.text.delimited._BLOCK_BYTES", 64)
    lines = [f"{j},{j}" if j % 7 == 3 else f"{j},{j},{j}" for j in range(500)]
    source, columns = table(make("a,b,c\n" + "\n".join(lines) + "\n"))
    same(columns["a"], np.arange(500.0))
    same(np.flatnonzero(np.isnan(columns["c"])), np.arange(3, 500, 7))
    assert source.remarks == ["row 5 has 2 of 3 fields: the others are empty (71 such rows)"]


def test_column_that_turns_into_text_late(make):
    source, columns = table(make("a,b\n" + "1,2\n" * 5000 + "3,late\n"))
    assert math.isnan(columns["b"][-1])
    assert columns["a"][-1] == 3
    assert source.remarks == ["row 5002: b is 'late', not a number"]


def test_column_whose_first_value_comes_late(make):
    text = "a,terrain,empty,temperature\n" + "1,,,\n" * 80_000 + "2,sand,,21.5\n"
    source, columns = table(make(text))
    assert kinds(source) == {"a": "number", "terrain": "text", "empty": "number", "temperature": "number"}
    assert columns["terrain"][-2:] == [None, "sand"]
    assert columns["temperature"][-1] == 21.5
    assert np.isnan(columns["empty"]).all()


def test_codes_of_labels_hold_across_batches(make):
    path = make("a,terrain\n" + "".join(f"{j},soil {j // 3}\n" for j in range(12)))
    labels = [batch["terrain"] for batch in open_source(path).read("", ["terrain"], 5)]
    assert [len(part) for part in labels] == [5, 5, 2]
    assert np.concatenate([part.codes for part in labels]).tolist() == [j // 3 for j in range(12)]
    assert labels[-1].names == ("soil 0", "soil 1", "soil 2", "soil 3")


@pytest.mark.parametrize(
    ("cells", "expected"),
    [
        (["2024-05-01T12:00:00Z", "2024-05-01T12:00:00.000000001Z"], ["12:00:00", "12:00:00.000000001"]),
        (["2024-05-01 12:00:00.5", "2024-05-01 12:01"], ["12:00:00.5", "12:01:00"]),
        (["2024-05-01T14:30:00+02:30", "2024-05-01T10:00:00-0200"], ["12:00:00", "12:00:00"]),
        (["2024-05-01T12:00:00", "2024-05-01T12:00:00Z", "2024-05-01"], ["12:00:00", "12:00:00", "00:00:00"]),
        (["2024-05-01T12:00:00,25 +01", "2024-05-01T12:00"], ["11:00:00.25", "12:00:00"]),
    ],
)
def test_iso_8601_times(make, cells, expected):
    source, columns = table(make("time;x\n" + "".join(f"{cell};1\n" for cell in cells)))
    assert kinds(source)["time"] == "time"
    assert columns["time"].dtype == np.dtype("datetime64[ns]")
    same(columns["time"], np.array([f"2024-05-01T{clock}" for clock in expected], "datetime64[ns]"))


def test_what_is_no_time_is_nat_and_said(make):
    cells = ["2024-05-01T12:00:00Z", "", "noon", "2024-02-30", "0001-01-01", "2024-05-01T12:00:01Z"]
    source, columns = table(make("time,x\n" + "".join(f"{cell},1\n" for cell in cells)))
    assert np.isnat(columns["time"]).tolist() == [False, True, True, True, True, False]
    assert source.remarks == ["row 4: time is 'noon', not a time (3 such cells)"]


def test_nanoseconds_keep_their_digits(make):
    _, columns = table(make("time_ns,x\n1714564800123456789,1\n1714564800123456790,2\n"))
    assert columns["time_ns"].dtype == np.int64
    assert columns["time_ns"].tolist() == [1714564800123456789, 1714564800123456790]
    assert columns["x"].dtype == np.float64


def test_only_what_is_asked_for_and_as_often_as_asked(make):
    path = make("a,b,c\n1,x,3\n4,y,oops\n")
    source = open_source(path)
    for _ in range(2):
        (batch,) = source.read("", ["c", "a"])
        assert list(batch) == ["c", "a"]
        same(batch["c"], [3, np.nan])
    assert source.remarks == ["row 3: c is 'oops', not a number"]
    assert list(source.read("", [])) == []
    with pytest.raises(FormatError, match="no column 'd'"):
        list(source.read("", ["d"]))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "is empty"),
        ("\n\n", "has no table in it"),
        ("# nothing but comments\n", "has no table in it"),
        ("time,torque\n", "has a header but no rows"),
        ("time,torque", "has a header but no rows"),
        ("time,torque\n\n  \n", "has a header but no rows"),
        ("0.5,1,2\n1,2,3\n", "line 1 holds values where the names of the columns should be"),
        ("2024-01-01T00:00:00,1\n2024-01-01T00:00:01,2\n", "line 1 holds values"),
        ("a,b,a\n1,2,3\n", "two columns are named 'a'"),
        (
            "time,torque,slip\ns,N m,-\n0,1,0.2\n1,2,0.3\n",
            "line 2 holds no numbers .'s' under 'time'.: units",
        ),
        ("time,torque,slip\ns,N m,1\n0,1,0.2\n1,2,0.3\n", "line 2 holds no numbers"),
        ("time,torque\n1,2,3\n4,5,6\n", "the header names 2 columns, but the rows have 3 fields"),
        ("time torque slip\n1 2 3\n4 5 6\n", "has spaces between its columns"),
        ("a,b\n1,2\n3,caf\u00e9\n".encode("latin-1"), "line 3: byte 0xe9 is not UTF-8 text"),
        ("a,b\n1,2\n".encode("utf-16-le"), "is binary"),
        (bytes(range(256)), "is binary"),
        (b"PK\x03\x04rest", "Excel"),
        (b"\x89HDF\r\n\x1a\n", "HDF5"),
        (b"#ROSBAG V1.2\n", "ROS bag of format 1"),
        (gzip.compress(b"", mtime=0), "is empty"),
        (gzip.compress(b"PAR1 and more", mtime=0), "is a parquet file packed with gzip"),
        ('a,b\n1,2\n3,"never closed\n' + "4,5\n" * 300_000, "a quote that is not closed"),
        ("a,b\n" + "1,2\n" * 99_999 + '3,"never closed\n' + "4,5\n" * 600_000, "a quote that is not closed"),
    ],
)
def test_what_cannot_be_read_says_why(make, text, message):
    with pytest.raises(FormatError, match=message) as caught:
        table(make(text))
    assert caught.value.exit_code == 65
    assert "log.csv: " in str(caught.value)
    assert "\n" not in str(caught.value)


def test_wrong_encoding_far_inside(make):
    text = ("a,b\n" + "1,fine\n" * 300_000).encode() + b"2,\xb0C\n"
    with pytest.raises(FormatError, match="line 300002: byte 0xb0"):
        table(make(text))


def test_quote_that_is_not_closed_is_said(make):
    source, columns = table(make('a,b\n1,x\n2,"y\n3,z\n'))
    assert columns["b"] == ["x", "y\n3,z"]
    assert source.remarks == [
        "an odd number of quote marks: where one is not closed, rows are read as one text"
    ]


def test_single_column(make):
    source, columns = table(make("torque [N m]\n1\n\n2\nx y\n"))
    same(columns["torque [N m]"], [1, 2, np.nan])
    assert source.remarks == ["row 4: torque [N m] is 'x y', not a number"]


floats = st.floats(allow_infinity=True, allow_nan=True, width=64)


@given(
    values=st.lists(floats, min_size=1, max_size=40),
    texts=st.lists(
        st.text(st.characters(codec="utf-8", exclude_categories=["Cc", "Zs", "Zl", "Zp"]), max_size=8)
    ),
    start=st.integers(-(2**63), 2**63 - 41),
)
@examples(80)
def test_what_is_written_is_read_back_to_the_last_digit(tmp_path_factory, values, texts, start):
    path = str(tmp_path_factory.mktemp("round") / "table.csv")
    labels = [(["x", *texts])[j % (len(texts) + 1)] for j in range(len(values))]
    integers = np.arange(start, start + len(values))
    write_table({"key": ["k"] * len(values), "f": np.array(values), "i": integers, "t": labels}, path)
    source = DelimitedSource(path, path)
    (batch,) = source.read("", ["f", "i"])
    np.testing.assert_array_equal(batch["f"], values)
    same(np.signbit(batch["f"][~np.isnan(batch["f"])]), np.signbit([v for v in values if not math.isnan(v)]))
    same(batch["i"], integers)
    assert source.remarks == []


def test_rows_are_counted_by_a_reading_that_ends(make):
    source = open_source(make("a,b\n" + "1,2\n" * 30 + "1,2,3\n" + "4,5\n"))
    assert source.streams()[0].count is None
    reading = source.read("", ["a"], 10)
    next(reading)
    reading.close()
    assert source.streams()[0].count is None
    list(source.read("", ["b"], 10))
    assert (source.streams()[0].count, source.skipped) == (31, 1)
