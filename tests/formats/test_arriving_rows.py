"""Rows as they arrive: the columns of the file read whole, whatever is sent and however it is cut."""

from __future__ import annotations

import json
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from profiles import examples

from formats import FormatError, Labels, open_source
from formats.text.arriving_rows import ArrivingRows

HEADER = "time,wheel,torque"
ROWS = [f"{k / 10},{'left' if k % 3 else 'right'},{2.5 + k}" for k in range(200)]
TEXT = "\n".join([HEADER, *ROWS]) + "\n"


def taken(blocks, *, hurry=False):
    """Return the columns of all rows, and the table."""
    rows, batches, begun = ArrivingRows("-"), [], False
    for block in blocks:
        if begun:
            batches.append(rows.take(block))
        else:
            begun = rows.prepare(block, hurry=hurry)
            if begun:
                batches.append(rows.take())
    if not begun:
        assert rows.prepare(b"", hurry=True)
    batches.append(rows.take(last=True))
    batches = [batch for batch in batches if batch]
    return {name: joined([batch[name] for batch in batches]) for name in batches[0]}, rows


def joined(parts):
    if isinstance(parts[0], Labels):
        return [part.names[code] if code >= 0 else None for part in parts for code in part.codes]
    return np.concatenate(parts).tolist()


def cut(data, places):
    ends = sorted({0, len(data), *(place % len(data) for place in places)})
    return [data[a:b] for a, b in pairwise(ends)]


@examples(20)
@given(st.lists(st.integers(0, 10_000), max_size=40))
def test_it_does_not_matter_how_the_bytes_are_cut(places):
    columns, rows = taken(cut(TEXT.encode(), places))
    assert columns["time"] == [k / 10 for k in range(200)]
    assert columns["wheel"] == ["left" if k % 3 else "right" for k in range(200)]
    assert columns["torque"] == [2.5 + k for k in range(200)]
    assert (rows.count, rows.repeated, rows.faults()) == (200, 0, [])


@pytest.mark.parametrize(
    "text",
    [
        TEXT,
        TEXT.replace("\n", "\r\n"),
        "\ufeff" + TEXT,
        TEXT.replace(",", ";").replace(".", ","),
        TEXT.replace(",", "\t"),
        TEXT.replace("left", '"front, left"'),
        TEXT.replace("0.5,", "2026-11-21T08:00:00Z,"),
        TEXT.replace(",12.5", ","),
        TEXT.replace(",12.5", ",1_000", 3),
        TEXT.replace(",12.5", ",١٢", 3),
        TEXT.replace("time", "stamp_ns").replace("0.1,", "1767225600000000001,"),
        "\n".join(["time,wheel,torque", *(f"2026-11-21T08:00:{k:02d}Z,a,{k}" for k in range(60))]) + "\n",
        TEXT.rstrip("\n"),
    ],
)
def test_the_columns_are_those_of_the_file(text, tmp_path):
    path = tmp_path / "run.csv"
    path.write_bytes(text.encode())
    source = open_source(str(path))
    names = [field.name for field in source.streams()[0].fields]
    whole = next(source.read("", names))
    columns, _ = taken([text.encode()])
    assert list(columns) == names
    for name in names:
        np.testing.assert_array_equal(columns[name], joined([whole[name]]))


@pytest.mark.parametrize("ordinary", ["1.5", '"left"'], ids=["number", "text"])
def test_half_a_character_in_json(ordinary):
    rows = ArrivingRows("run.jsonl")
    assert rows.prepare(
        b"".join(b'{"t": %d, "w": %b}\n' % (k, ordinary.encode()) for k in range(70)), hurry=True
    )
    rows.take()
    found = rows.take(b'{"t": 71, "w": "\\ud800"}\n')["w"]
    assert found.names == ("left", "?") if isinstance(found, Labels) else np.isnan(found).all()


def test_objects_of_json_are_rows():
    rows = [{"time": k, "wheel": {"name": "left"}, "torque": 2.5, "ok": True, "list": [1]} for k in range(70)]
    lines = [json.dumps(row) for row in rows]
    lines.insert(10, '{"time": 3, "wheel"')
    lines.insert(20, "[1, 2]")
    lines.append('{"time": 70, "torque": null}')
    columns, table = taken([("\n".join(lines) + "\n").encode()])
    assert columns["time"] == list(range(71))
    assert columns["wheel.name"] == ["left"] * 70 + [None]
    assert columns["ok"][:70] == [1.0] * 70
    assert np.isnan(columns["torque"][-1])
    assert "list" not in columns
    assert table.faults() == ["rows that are no JSON object, passed over: 2"]


def test_what_is_wrong_is_counted_and_the_rest_is_read():
    lines = [HEADER, *ROWS]
    lines[50:50] = ["garbage", "1,2,3,4", '7,"left,1', "", HEADER]
    lines[100] = "9.5,left,abc"
    columns, rows = taken([("\n".join([*lines, "17.5,le"]) + "\n").encode()])
    assert len(columns["time"]) == 200
    assert np.isnan(columns["torque"]).sum() == 1
    assert rows.faults() == [
        "rows of another width than the header, passed over: 4",
        "rows of the header again, passed over: 1",
        "cells of torque with no number in them: 1",
    ]


def test_a_line_that_comes_again_is_counted_once_and_not_kept_for_ever():
    rows = ArrivingRows("-")
    rows.prepare(f"{HEADER}\n{ROWS[0]}\n".encode(), hurry=True)
    for _ in range(3):
        rows.take(f"{ROWS[0]}\n".encode())
    assert (rows.count, rows.repeated) == (1, 3)
    for k in range(20_000):
        rows.take(f"{k + 0.05},left,1\n".encode())
    assert len(rows._known) <= 4096


def test_rows_may_be_looked_at_before_they_are_taken():
    rows = ArrivingRows("-")
    assert rows.prepare(f"{HEADER}\n1,left,1\n2,left,x\n3,left,1\n1\n".encode(), hurry=True)
    before = next(rows.read("", ["torque"]))
    np.testing.assert_array_equal(before["torque"], [1.0, np.nan, 1.0])
    assert rows.faults() == []
    assert len(rows.take()["torque"]) == 3


def test_columns_are_told_in_time():
    rows = ArrivingRows("-")
    assert not rows.prepare(b"time,torque\n", hurry=True)
    assert not rows.prepare(b"1,2\n", hurry=False)
    assert rows.prepare(b"", hurry=True)


@pytest.mark.parametrize(
    ("head", "said"),
    [
        (b"\x89MCAP0\r\n" + bytes(100), "is MCAP, which can be followed in its file, not in a pipe"),
        (b"#ROSBAG V2.0\n" + bytes(100), "is a ROS 1 bag, which"),
        (b"SQLite format 3\0" + bytes(100), "is SQLite, which"),
        (b"PAR1" + bytes(100), "holds Parquet, and only CSV, JSON Lines and bags can be followed"),
        (b"\x1f\x8b" + bytes(100), "is packed (gzip)"),
        (b"x" * 2_000_000, "has a line longer than 1 MiB"),
    ],
)
def test_what_is_no_text_is_refused(head, said):
    with pytest.raises(FormatError, match=said.replace("(", r"\(").replace(")", r"\)")):
        ArrivingRows("-").prepare(head, hurry=False)
