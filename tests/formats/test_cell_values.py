"""Tables of text read as numbers at once give what reading their texts gives, however odd they are."""

from __future__ import annotations

import gzip

import numpy as np
import pytest
from hypothesis import HealthCheck, example, given
from hypothesis import strategies as st
from profiles import examples

from formats.errors import FormatError
from formats.table import Labels
from formats.text import cell_values
from formats.text.cell_values import MISSING_SPELLINGS
from formats.text.delimited import DelimitedSource

numbers = st.one_of(
    st.floats(allow_nan=False).map(repr),
    st.integers(-(2**62), 2**62).map(str),
    st.integers(-99, 99).map(str),
    st.sampled_from(["1e400", "-0", "+5", " 7", "7 ", "inf", "-Infinity", ".5", "5.", "1E5", "0x10"]),
)
cells = st.one_of(
    numbers, numbers, numbers, st.sampled_from(["", "NaN", "nan", "NULL", "-nan", "x", '"3"', '"', "1,5"])
)
row = st.lists(numbers, min_size=3, max_size=3)
odd = st.lists(cells, min_size=1, max_size=5)
ends = st.sampled_from(["\n", "\n", "\n", "\r\n", "\n\n"])
wrappings = st.sampled_from(["utf-8", "utf-8", "utf-8-sig", "utf-16", "gzip"])


def refuse(*_):
    """Find everything odd."""
    raise cell_values.OddError
    yield


def read(path, *, at_once, batch_rows=7):
    """Return columns, remarks and rows set aside, or the error."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(cell_values, "_PIECE_BYTES", 64)
        if not at_once:
            patch.setattr(cell_values, "columns", refuse)
        try:
            source = DelimitedSource("t.csv", str(path))
            batches = list(source.read("", [f.name for f in source.streams()[0].fields], batch_rows))
        except FormatError as error:
            return str(error)
    columns = {}
    for name in batches[0]:
        parts = [batch[name] for batch in batches]
        if isinstance(parts[0], Labels):
            parts = [np.array([*part.names, ""], dtype=object)[part.codes] for part in parts]
        columns[name] = np.concatenate(parts)
    return columns, source.remarks, source.skipped


def assert_same(path):
    fast, slow = read(path, at_once=True), read(path, at_once=False)
    if isinstance(slow, str) or isinstance(fast, str):
        assert fast == slow
        return
    # Blocks end elsewhere, so that columns may be complained of in another order.
    assert (sorted(fast[1]), fast[2]) == (sorted(slow[1]), slow[2])
    assert list(fast[0]) == list(slow[0])
    for name, column in slow[0].items():
        if column.dtype == object:
            assert fast[0][name].tolist() == column.tolist()
            continue
        np.testing.assert_array_equal(fast[0][name], column, err_msg=name)
        np.testing.assert_array_equal(np.signbit(fast[0][name]), np.signbit(column))


@examples(250, suppress_health_check=list(HealthCheck))
@example([["1", "2", "3"]] * 40, [], 0, "\n", True, "utf-8")
@example([["1", "2", "3"]] * 40, [["4", "5"]], 30, "\n", True, "utf-8-sig")
@example([["1", "2", "3"]] * 40, [["9007199254740993", "1", "1"]], 35, "\n", True, "utf-8")
@example([["1", "2", "3"]] * 9, [["4", "5"]], 9, "\n", False, "utf-8")
@example(
    [["0.0", "0", "0"]] * 18 + [["9007199254740992", "0", "0"], ["-0", "0", "0"]], [], 0, "\n", False, "utf-8"
)
@example([["0", "0", "0"]] * 7, [[" 7"], ["-nan"]], 6, "\n", False, "utf-8")
@given(
    st.lists(row, min_size=1, max_size=30),
    st.lists(odd, max_size=2),
    st.integers(0, 30),
    ends,
    st.booleans(),
    wrappings,
)
def test_the_same_as_from_texts(tmp_path_factory, rows, others, where, end, closed, wrapping):
    rows[where:where] = others
    path = tmp_path_factory.mktemp("table") / "t.csv"
    text = end.join(["a,b,c", *(",".join(row) for row in rows)]) + (end if closed else "")
    path.write_bytes(gzip.compress(text.encode()) if wrapping == "gzip" else text.encode(wrapping))
    assert_same(path)


@pytest.mark.parametrize("row", [2_000, 90_000, 99_999], ids=["head", "middle", "end"])
@pytest.mark.parametrize(
    "cell",
    [b"\0\0", b"\xe9", b"\xe2\x82", "gr\N{LATIN SMALL LETTER U WITH DIAERESIS}n".encode(), b'"'],
    ids=ascii,
)
def test_odd_bytes_are_told_of_as_from_texts(tmp_path, row, cell):
    """In a column that is not asked for, too."""
    path = tmp_path / "t.csv"
    lines = [b"%d,%d,sand" % (i, 2 * i) for i in range(100_000)]
    lines[row] = lines[row].replace(b"sand", cell)
    path.write_bytes(b"a,b,terrain\n" + b"\n".join(lines) + b"\n")
    told = []
    for at_once in (True, False):
        with pytest.MonkeyPatch.context() as patch:
            if not at_once:
                patch.setattr(cell_values, "columns", refuse)
            try:
                source = DelimitedSource("t.csv", str(path))
                batches = list(source.read("", ["b"]))
            except FormatError as error:
                told.append(str(error))
            else:
                values = np.concatenate([batch["b"] for batch in batches])
                told.append((values.tolist(), sorted(source.remarks), source.skipped))
    assert told[0] == told[1]


def test_lines_longer_than_a_piece(tmp_path, monkeypatch):
    path = tmp_path / "t.csv"
    names = [f"c{j}" for j in range(40)]
    lines = [",".join(f"{i * j / 8}" for j in range(40)) for i in range(3_000)]
    path.write_text("\n".join([",".join(names), *lines]))
    monkeypatch.setattr(cell_values, "_PIECE_BYTES", 50)
    source = DelimitedSource("t.csv", str(path))
    texts = DelimitedSource._texts
    monkeypatch.setattr(DelimitedSource, "_texts", None)
    values = np.concatenate([batch["c39"] for batch in source.read("", ["c39"])])
    assert values.tolist() == [i * 39 / 8 for i in range(3_000)]
    monkeypatch.setattr(DelimitedSource, "_texts", texts)
    monkeypatch.setattr(cell_values, "_LONGEST_LINE", 100)
    np.testing.assert_array_equal(
        np.concatenate([batch["c39"] for batch in source.read("", ["c39"])]), values
    )


def test_what_is_even_is_read_at_once(tmp_path, monkeypatch):
    path = tmp_path / "t.csv"
    path.write_text(
        "time,torque,terrain\n"
        + "".join(f"{i},{i / 8},{'sand' if i % 2 else 'clay'}\n" for i in range(5_000))
    )
    source = DelimitedSource("t.csv", str(path))
    monkeypatch.setattr(DelimitedSource, "_texts", None)
    batches = list(source.read("", ["torque", "terrain"], 1_000))
    assert np.concatenate([batch["torque"] for batch in batches]).tolist() == [i / 8 for i in range(5_000)]
    assert batches[-1]["terrain"].names == ("clay", "sand")


def test_every_spelling_of_a_missing_value_is_read_at_once(tmp_path, monkeypatch):
    path = tmp_path / "t.csv"
    lines = [f"{i},{i / 8}" for i in range(2_000)]
    lines[1_500:] = [f"{i},{spelling}" for i, spelling in enumerate(MISSING_SPELLINGS, 1_500)]
    path.write_text("a,b\n" + "\n".join(lines) + "\n")
    monkeypatch.setattr(cell_values, "_PIECE_BYTES", 1_000)
    source = DelimitedSource("t.csv", str(path))
    monkeypatch.setattr(DelimitedSource, "_texts", None)
    values = np.concatenate([batch["b"] for batch in source.read("", ["b"])])
    assert values[:1_500].tolist() == [i / 8 for i in range(1_500)]
    assert len(values) == 1_500 + len(MISSING_SPELLINGS)
    assert np.isnan(values[1_500:]).all()


def test_what_was_passed_on_is_not_read_twice(tmp_path, monkeypatch):
    """An odd row near the end: the rows before it came as numbers, the rest as texts."""
    monkeypatch.setattr(cell_values, "_PIECE_BYTES", 1_000)
    path = tmp_path / "t.csv"
    lines = [f"{i},{2 * i}" for i in range(2_000)]
    lines[1_900] += ",7"
    path.write_text("a,b\n" + "\n".join(lines) + "\n")
    source = DelimitedSource("t.csv", str(path))
    batches = list(source.read("", ["a", "b"], 100))
    kept = [i for i in range(2_000) if i != 1_900]
    assert np.concatenate([batch["a"] for batch in batches]).tolist() == kept
    assert source.skipped == 1
    assert any("row 1902 has 3 fields" in remark for remark in source.remarks)


def test_decimal_commas_are_read_at_once_too(tmp_path, monkeypatch):
    path = tmp_path / "t.csv"
    path.write_text("a;b\n" + "\n".join(f"{i},5;{-i}e-1" for i in range(3_000)) + "\n")
    monkeypatch.setattr(cell_values, "_PIECE_BYTES", 500)
    source = DelimitedSource("t.csv", str(path))
    monkeypatch.setattr(DelimitedSource, "_texts", None)
    values = np.concatenate([batch["a"] for batch in source.read("", ["a", "b"])])
    assert values.tolist() == [i + 0.5 for i in range(3_000)]


@pytest.mark.parametrize("cell", ["1.234,5", "1.5", "1,5,5", "x", "", "NULL", "9007199254740993"])
def test_odd_cells_among_decimal_commas_are_as_from_texts(tmp_path, cell):
    path = tmp_path / "t.csv"
    lines = [f"{i},5;{i}" for i in range(40)]
    lines[35] = f"{cell};35"
    path.write_text("a;b\n" + "\n".join(lines) + "\n")
    assert_same(path)
