from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from terrain_cli.errors import InputError
from terrain_cli.telemetry import alignment

NAN = float("nan")
milliseconds = st.lists(st.integers(0, 20_000), min_size=1, max_size=40, unique=True)
readings = st.floats(-1e6, 1e6) | st.just(NAN)


@st.composite
def series(draw):
    """Draw a channel: increasing times in s, and what was read then."""
    time = np.sort(draw(milliseconds)) * 1e-3
    return time, np.array(draw(st.lists(readings, min_size=len(time), max_size=len(time))))


@given(series(), st.sampled_from([None, 0.05, 10.0]))
def test_at_its_own_times_a_channel_is_what_it_was(own, max_gap):
    time, values = own
    np.testing.assert_array_equal(alignment.resample(time, time, values, max_gap), values)


@given(series(), milliseconds, st.floats(0.01, 5.0))
def test_no_value_bridges_a_gap_or_leaves_what_was_measured(own, wanted, max_gap):
    time, values = own
    clock = np.sort(wanted) * 1e-3
    result = alignment.resample(clock, time, values, max_gap)
    known = ~np.isnan(values)
    for moment, value in zip(clock, result, strict=True):
        if moment in time:
            continue
        before, after = time[known & (time < moment)], time[known & (time > moment)]
        bridged = len(before) and len(after) and after[0] - before[-1] <= max_gap + 1e-6
        assert np.isnan(value) != bool(bridged)
        if bridged:
            ends = values[known & np.isin(time, [before[-1], after[0]])]
            assert ends.min() - 1e-9 <= value <= ends.max() + 1e-9


@given(series(), milliseconds)
def test_the_order_of_the_samples_does_not_matter(own, wanted):
    time, values = own
    clock = np.array(wanted) * 1e-3
    order = np.random.default_rng(len(time)).permutation(len(time))
    expected = alignment.resample(clock, time, values)
    np.testing.assert_array_equal(alignment.resample(clock, time[order], values[order]), expected)
    back = np.argsort(clock)[::-1]
    np.testing.assert_array_equal(alignment.resample(clock[back], time, values), expected[back])


def test_a_straight_line_is_kept():
    time = np.arange(0.0, 10.0, 0.1)
    clock = np.array([0.0, 0.033, 5.55, 9.9, 9.91, -0.01])
    expected = [0.0, 0.099, 16.65, 29.7, NAN, NAN]
    np.testing.assert_allclose(alignment.resample(clock, time, 3.0 * time), expected, rtol=0, atol=1e-12)


def test_a_reading_that_failed_is_no_reading():
    # Asked at 1 s the sensor had no answer; between 0 and 2 s the others tell.
    time, values = np.array([0.0, 1.0, 2.0]), np.array([0.0, NAN, 4.0])
    result = alignment.resample(np.array([0.5, 1.0, 1.5]), time, values, 2.0)
    np.testing.assert_array_equal(result, [1.0, NAN, 3.0])


@pytest.mark.parametrize("time", [[], [NAN, NAN], [1.0]])
def test_nothing_comes_of_nothing(time):
    time = np.array(time)
    assert np.isnan(alignment.resample(np.array([0.0, 2.0]), time, np.full(len(time), NAN))).all()


def test_two_lost_samples_are_bridged_and_a_pause_is_not():
    # 5 Hz: three intervals are 0.6 s, give or take what a double makes of it.
    time = 1e5 + np.array([0.0, 0.2, 0.4, 1.0, 1.2, 1.4, 2.2, 2.4])
    result = alignment.resample(np.array([0.7, 1.7]) + 1e5, time, np.ones(8))
    np.testing.assert_array_equal(result, [1.0, NAN])
    assert alignment.default_gap(np.array([0.0])) == 0.5
    assert alignment.default_gap(np.arange(5) * 0.02) == 0.5
    assert alignment.default_gap(np.arange(5) * 2.0) == 7.0


def test_a_gap_is_longer_than_an_interval():
    time = np.array([0.0, 0.2, NAN, 0.2, 0.4, 0.6, 5.0])
    assert alignment.stretch_gap(time) == pytest.approx(0.7)
    assert alignment.stretch_gap(time, 0.05) == pytest.approx(0.3)
    assert alignment.stretch_gap(time, 2.0) == 2.0
    assert alignment.stretch_gap(time[:1], 2.0) == 2.0


def test_absolute_times_keep_their_microseconds():
    stamps = np.array(["2026-11-21T08:00:00.000001234", "NaT", "2026-11-21T08:00:01.5"], "datetime64[ns]")
    origin = float(stamps[0].astype("datetime64[s]").astype(int))
    np.testing.assert_array_equal(alignment.seconds(stamps, origin), [1e-6, NAN, 1.5])


@pytest.mark.parametrize(
    ("times", "origin"),
    [([0.5, 1.0], 0.0), ([NAN, 1_754_000_000.25], 1_754_000_000.0), ([], 0.0), ([-3.0], 0.0)],
)
def test_only_a_clock_since_1970_has_an_origin(times, origin):
    assert alignment.origin_of(np.array(times)) == origin


def check(time, *, speed=0.1, stated=False):
    speeds = None if speed is None else np.full(len(time), speed)
    alignment.check_unit_of_time("a.csv", "time", time, speed=speeds, radius=0.125, stated=stated)


@pytest.mark.parametrize(
    ("times", "unit"),
    [
        (1.754e9 * 1e3 + np.arange(5) * 20.0, "ms"),
        (1.754e9 * 1e6 + np.arange(5) * 2e4, "us"),
        (1.754e9 * 1e9 + np.arange(5) * 2e7, "ns"),
        (np.arange(50.0) * 20.0, "ms"),
        (np.arange(50.0) * 20_000.0, "us"),
        (np.arange(50.0) * 2e7, "ns"),
    ],
)
def test_a_clock_that_is_not_in_seconds_is_refused_with_the_lines_to_add(times, unit):
    with pytest.raises(InputError, match="seconds") as error:
        check(times)
    assert f"(time_{unit})" in error.value.hint
    assert f'[channels]\ntime = {{ column = "time", unit = "{unit}" }}' in error.value.hint


@pytest.mark.parametrize(
    "times",
    [
        np.arange(50.0),  # 1 Hz
        np.arange(50.0) * 0.02,
        1.754e9 + np.arange(50) * 1.0,
        np.arange(50.0) * 3.0,  # a slow log: 0.3 m between two samples
        np.array([0.0, 1e9]),  # too short to tell
        np.full(5, NAN),
    ],
)
def test_seconds_are_seconds(times):
    check(times)


def test_what_the_header_says_is_believed_where_it_can_be():
    slow = np.arange(50.0) * 60.0
    check(slow, stated=True)
    check(slow, speed=None)
    with pytest.raises(InputError, match="hardly be seconds"):
        check(slow)
    with pytest.raises(InputError, match="no time in seconds"):
        check(slow + 1.754e12, stated=True)


clean = st.integers(20, 60)


@given(clean, st.data())
def test_exactly_the_samples_out_of_order_are_found(n, data):
    time = np.arange(n) * 0.1
    late = data.draw(st.sets(st.integers(1, n - 2), max_size=4))
    for j in late:
        # Within the least number of samples: no restart.
        time[j] -= 0.25
    out = np.array([time[j] <= np.max(time[:j], initial=-1.0) for j in range(n)])
    restarts, backwards, repeated = alignment.split_clock(time)
    assert len(restarts) == 0
    np.testing.assert_array_equal(backwards | repeated, out)


@given(clean, clean, st.floats(0.0, 5.0))
def test_a_clock_that_begins_anew_is_another_stretch(n, m, start):
    time = np.concatenate([10.0 + np.arange(n) * 0.1, start + np.arange(m) * 0.1])
    restarts, backwards, repeated = alignment.split_clock(time)
    assert restarts.tolist() == [n]
    assert not backwards.any()
    assert not repeated.any()


@given(clean, st.integers(0, 19), st.integers(1, 3))
def test_a_leap_ahead_is_passed_over(n, at, length):
    time = np.arange(n + 20) * 0.1
    time[at : at + length] += 1e6
    restarts, backwards, _ = alignment.split_clock(time)
    if at == 0:
        # Nothing before it tells that it is wrong: another clock.
        assert restarts.tolist() == [length]
    else:
        assert len(restarts) == 0
        assert np.flatnonzero(backwards).tolist() == list(range(at, at + length))


@given(st.lists(st.integers(0, 50).map(lambda t: t * 0.1) | st.just(NAN), max_size=60))
def test_what_is_kept_of_any_clock_never_falls_but_at_restarts(times):
    time = np.array(times)
    restarts, backwards, repeated = alignment.split_clock(time)
    kept = np.isfinite(time) & ~backwards & ~repeated
    for piece in np.split(np.arange(len(time)), restarts):
        assert np.all(np.diff(time[piece][kept[piece]]) > 0)


def test_a_log_written_backwards_is_out_of_order():
    time = np.arange(100.0)[::-1]
    restarts, backwards, _ = alignment.split_clock(time)
    assert len(restarts) == 0
    assert np.flatnonzero(~backwards).tolist() == [0]


def test_repeated_times():
    time = np.array([0.0, 0.1, 0.1, NAN, 0.1, 0.2])
    restarts, backwards, repeated = alignment.split_clock(time)
    assert len(restarts) == 0
    assert not backwards.any()
    assert np.flatnonzero(repeated).tolist() == [2, 4]


def test_an_infinite_reading_is_kept_and_goes_no_further_than_its_neighbours():
    time, values = np.arange(5.0), np.array([1.0, 2.0, np.inf, 4.0, 5.0])
    result = alignment.resample(np.array([0.5, 1.5, 2.0, 2.5, 3.5]), time, values, 2.0)
    np.testing.assert_array_equal(result[[0, 2, 4]], [1.5, np.inf, 4.5])
    assert not np.isfinite(result[[1, 3]]).any()
