import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from terrain_cli.windows.change_points import whole_windows
from terrain_cli.windows.cut_windows import fixed_windows, label_windows


@st.composite
def lengths_and_breaks(draw):
    n = draw(st.integers(0, 60))
    return n, draw(st.lists(st.integers(0, n), max_size=4))


@given(lengths_and_breaks())
def test_whole_windows_are_the_stretches_between_breaks(case):
    n, breaks = case
    bounds = whole_windows(n, breaks=breaks)
    assert bounds.dtype == np.intp
    assert bounds.tolist() == sorted({0, n, *breaks})


def test_labels_cut_where_they_change_and_at_breaks():
    codes = [-1, -1, 2, 2, 2, 0, 2]
    assert label_windows(codes).tolist() == [0, 2, 5, 6, 7]
    assert label_windows(codes, breaks=[4, 5]).tolist() == [0, 2, 4, 5, 6, 7]
    assert label_windows([]).tolist() == [0]


@given(lengths_and_breaks(), st.integers(1, 20))
def test_fixed_windows_count_anew_from_each_break(case, samples):
    n, breaks = case
    bounds = fixed_windows(n, samples=samples, breaks=breaks)
    assert set(breaks) <= set(bounds.tolist())
    sizes = np.diff(bounds)
    assert (sizes <= samples).all()
    # Only the last window of a stretch may be shorter.
    stretches = whole_windows(n, breaks=breaks)
    assert np.isin(bounds[1:][sizes < samples], stretches).all()


def test_fixed_windows_in_metres():
    distance = 0.05 * np.arange(10)
    assert fixed_windows(10, metres=0.1, distance=distance).tolist() == [0, 2, 4, 6, 8, 10]
    assert fixed_windows(10, metres=0.12, distance=distance).tolist() == [0, 3, 5, 8, 10]
    assert fixed_windows(10, metres=0.1, distance=distance, breaks=[5]).tolist() == [0, 2, 4, 5, 7, 9, 10]


def test_windows_in_metres_hold_a_wheel_that_stands():
    distance = np.array([0.0, 0.06, 0.06, 0.06, 0.12, 0.18, 0.5])
    assert fixed_windows(7, metres=0.1, distance=distance).tolist() == [0, 4, 6, 7]


def test_a_tenth_of_a_metre_is_a_tenth_whatever_the_rounding():
    distance = np.cumsum(np.full(1000, 0.01)) + 1e4
    assert (np.diff(fixed_windows(1000, metres=0.1, distance=distance)) == 10).all()


@pytest.mark.parametrize(
    ("asked", "says"),
    [
        ({"samples": 0}, "holds no sample"),
        ({"metres": 0.0, "distance": [0, 1, 2, 3]}, "holds no sample"),
        ({"metres": float("nan"), "distance": [0, 1, 2, 3]}, "holds no sample"),
    ],
)
def test_fixed_windows_that_make_no_sense_are_refused(asked, says):
    with pytest.raises(ValueError, match=says):
        fixed_windows(4, **asked)
