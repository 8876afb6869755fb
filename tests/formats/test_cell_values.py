"""Cells of a table of text become the numbers that Python makes of them, wherever they stand."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import HealthCheck, given
from hypothesis import strategies as st
from profiles import examples

from formats.text import delimited
from formats.text.cell_values import MISSING_SPELLINGS
from formats.text.delimited import DelimitedSource

numbers = st.one_of(
    st.floats(allow_nan=False).map(repr),
    st.integers(-(2**53), 2**53).map(str),
    st.sampled_from(["1e400", "-0", "+5", " 7", "7 ", "inf", "-Infinity", ".5", "5.", "1E5"]),
)
#: No numbers: a missing value, a text, hexadecimal digits, a decimal comma in quotes.
others = st.sampled_from([*MISSING_SPELLINGS, "-nan", "x", "0x10", '"1,5"'])


def column(path, name, **options):
    source = DelimitedSource("t.csv", str(path))
    return np.concatenate([batch[name] for batch in source.read("", [name], **options)]), source


@examples(100, suppress_health_check=list(HealthCheck))
@given(
    st.lists(numbers, min_size=4, max_size=30),
    st.lists(st.tuples(st.integers(0, 40), others), max_size=3),
    st.sampled_from(["\n", "\r\n", "\n\n"]),
    st.booleans(),
)
def test_what_python_makes_of_them(tmp_path_factory, cells, odd, end, closed):
    expected = [float(cell) for cell in cells]
    for place, cell in odd:
        cells.insert(place, cell)
        expected.insert(place, np.nan)
    path = tmp_path_factory.mktemp("table") / "t.csv"
    rows = end.join(["n,x", *(f"{i},{cell}" for i, cell in enumerate(cells))])
    path.write_bytes((rows + (end if closed else "")).encode())
    values, _ = column(path, "x", batch_rows=7)
    np.testing.assert_array_equal(values, expected)
    known = ~np.isnan(values)  # A NaN has a sign too, which means nothing
    np.testing.assert_array_equal(np.signbit(values[known]), np.signbit(np.array(expected)[known]))


def test_every_spelling_of_a_missing_value(tmp_path, monkeypatch):
    monkeypatch.setattr(delimited, "_BLOCK_BYTES", 1_000)
    path = tmp_path / "t.csv"
    lines = [f"{i},{i / 8}" for i in range(2_000)]
    lines[1_500:] = [f"{i},{spelling}" for i, spelling in enumerate(MISSING_SPELLINGS, 1_500)]
    path.write_text("a,b\n" + "\n".join(lines) + "\n")
    values, source = column(path, "b")
    assert values[:1_500].tolist() == [i / 8 for i in range(1_500)]
    assert len(values) == 1_500 + len(MISSING_SPELLINGS)
    assert np.isnan(values[1_500:]).all()
    assert source.remarks == []


@pytest.mark.parametrize(
    ("cell", "value"),
    [
        *((cell, np.nan) for cell in ("1.234,5", "1.5", "1,5,5", "x", "", "NULL")),
        ("2,5e1", 25.0),
        ("9007199254740992", 2.0**53),
    ],
)
def test_odd_cells_among_decimal_commas(tmp_path, cell, value):
    path = tmp_path / "t.csv"
    lines = [f"{i},5;{i}" for i in range(40)]
    lines[35] = f"{cell};35"
    path.write_text("a;b\n" + "\n".join(lines) + "\n")
    values, _ = column(path, "a")
    np.testing.assert_array_equal(values, [value if i == 35 else i + 0.5 for i in range(40)])


@pytest.mark.parametrize("row", [2_000, 99_999], ids=["head", "end"])
def test_odd_bytes_far_inside_are_told_of(tmp_path, row):
    """In a column that is not asked for, too."""
    path = tmp_path / "t.csv"
    lines = [b"%d,%d,sand" % (i, 2 * i) for i in range(100_000)]
    lines[row] = lines[row].replace(b"sand", b"\0\0")
    path.write_bytes(b"a,b,terrain\n" + b"\n".join(lines) + b"\n")
    values, source = column(path, "b")
    np.testing.assert_array_equal(values, 2.0 * np.arange(100_000))
    assert source.remarks == ["2 NUL bytes passed over, as a power cut leaves them"]
