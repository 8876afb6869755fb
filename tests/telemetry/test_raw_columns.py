from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from formats import LOG_TIME, STAMP, Labels, open_source
from terrain_cli.errors import InputError
from terrain_cli.telemetry import raw_columns

texts = st.lists(st.sampled_from(["sand", "loam", "3", None]), min_size=1, max_size=12)


def labels(cells):
    names = tuple(dict.fromkeys(cell for cell in cells if cell is not None))
    codes = [-1 if cell is None else names.index(cell) for cell in cells]
    return Labels(np.array(codes, dtype=np.int32), names)


def cells(column):
    return [None if code < 0 else column.names[code] for code in column.codes]


@given(st.lists(texts, min_size=1, max_size=4))
def test_joined_labels_are_the_labels_one_after_another(pieces):
    joined = raw_columns.join([labels(piece) for piece in pieces])
    assert cells(joined) == [cell for piece in pieces for cell in piece]
    assert len(set(joined.names)) == len(joined.names)


def test_numbers_beside_texts_become_texts():
    joined = raw_columns.join([np.array([1.0, np.nan, 2.5]), labels(["x", None])])
    assert cells(joined) == ["1", None, "2.5", "x", None]


def test_numbers_stay_numbers():
    np.testing.assert_array_equal(raw_columns.join([np.array([1.0]), np.array([2.0, 3.0])]), [1.0, 2.0, 3.0])


@pytest.mark.parametrize(
    ("values", "expected"),
    [
        (np.array([3.0, 1.0, np.nan, 3.0, 0.5]), ["3", "1", None, "3", "0.5"]),
        (np.array([2**60 + 1, 2**60]), [str(2**60 + 1), str(2**60)]),
        (np.array([np.inf, 1.0]), ["inf", "1"]),
        (np.array(["2026-11-21", "NaT"], "datetime64[ns]"), ["2026-11-21", None]),
        (np.array(["2026-11-21T08:00"], "datetime64[ns]"), ["2026-11-21T08:00:00"]),
    ],
)
def test_numbers_and_times_as_labels(values, expected):
    found = raw_columns.as_labels(values)
    assert cells(found) == expected
    assert list(found.names) == list(dict.fromkeys(filter(None, expected)))


def test_texts_as_numbers():
    found = raw_columns.as_numbers(labels(["1.5", "overload", None, "-inf", "1e-3"]))
    np.testing.assert_array_equal(found, [1.5, np.nan, np.nan, -np.inf, 1e-3])


def test_times_are_no_numbers():
    assert np.isnan(raw_columns.as_numbers(np.array(["2026-11-21"], "datetime64[ns]"))).all()


@given(texts, st.data())
def test_rows_of_a_column(cell_list, data):
    rows = data.draw(st.lists(st.integers(0, len(cell_list) - 1), max_size=8))
    taken = raw_columns.take(labels(cell_list), np.array(rows, dtype=np.intp))
    assert cells(taken) == [cell_list[row] for row in rows]


LOGGED = np.array(["2026-11-21T08:00:00", "2026-11-21T08:00:01"], "datetime64[ns]")


@pytest.mark.parametrize(
    ("stamp", "stamped"),
    [(LOGGED - np.timedelta64(5, "ms"), True), (np.array([LOGGED[0], "NaT"], "datetime64[ns]"), False)],
)
def test_headers_count_only_if_every_message_has_one(stamp, stamped):
    times = raw_columns.stamps({STAMP: stamp, LOG_TIME: LOGGED})
    np.testing.assert_array_equal(times, stamp if stamped else LOGGED)


@pytest.mark.parametrize(
    ("stamps", "believed"),
    [
        (["NaT", "NaT", 50_000_000, 100_000_000], [0, 0, 50_000_000, 100_000_000]),
        (["NaT", 1_754_000_000_000_000_000], None),
        ([50_000_000, "NaT"], None),
        (["NaT", "NaT"], None),
        ([5, 6], [5, 6]),
    ],
)
def test_a_clock_may_begin_at_zero_but_a_stamp_of_zero_is_none(stamps, believed):
    table = {STAMP: np.array([np.datetime64(stamp, "ns") for stamp in stamps])}
    found = raw_columns.header_stamps(table)
    assert (None if found is None else found.astype(np.int64).tolist()) == believed


def test_no_more_is_held_than_there_is_memory_for(tmp_path, monkeypatch):
    path = tmp_path / "log.csv"
    path.write_text("time,load\n" + "0.5,81\n" * 1_000)
    assert len(raw_columns.read_topics(open_source(str(path)), {"": ["time"]})[""]["time"]) == 1_000
    monkeypatch.setattr(raw_columns, "most_held", lambda: 8_191)
    assert len(raw_columns.read_topics(open_source(str(path)), {"": ["time"]})[""]["time"]) == 1_000
    with pytest.raises(InputError, match=r"too long to be read whole: .* 8,191 bytes") as caught:
        raw_columns.read_topics(open_source(str(path)), {"": ["time", "load"]})
    assert "Long logs" in caught.value.hint
