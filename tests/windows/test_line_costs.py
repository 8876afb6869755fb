"""Costs of windows against the same sums done sample by sample."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from profiles import examples

from terrain_cli.windows import line_costs
from terrain_cli.windows.running_moments import RunningMoments

PLACES = st.integers(0, 300)


def cloud(seed, n=300, slope=0.6, spread=1000.0, noise=((300.0, 0.0), (0.0, 200.0))):
    """Return samples about y = 1000 + slope x, x about 10 kPa."""
    rng = np.random.default_rng(seed)
    true = 1e4 + spread * rng.standard_normal(n)
    errors = rng.standard_normal((n, 2)) @ np.array(noise)
    return true + errors[:, 0], 1000.0 + slope * true + errors[:, 1]


def index(*values):
    return np.array(values, dtype=np.intp)


def weighted(moments, first, last):
    """Return weights, x, y and covariances of the noise of the samples of a window."""
    block = np.arange(first, last) // moments.step
    noise = moments.noise[:, block]
    return (
        1.0 / line_costs.across(*noise, line_costs.MIDDLE_SLOPE),
        *moments.samples.at(np.arange(first, last)),
        noise,
    )


@given(PLACES, PLACES, st.integers(1, 32))
def test_moments_of_any_window_are_the_sums_over_its_samples(a, b, step):
    first, last = min(a, b), max(a, b)
    moments = RunningMoments(*cloud(1), step)
    w, x, y, noise = weighted(moments, first, last)
    expected = [
        *(np.sum(w * v) for v in (1, x, y, x * x, x * y, y * y)),
        *(w * noise).sum(axis=1),
        last - first,
    ]
    np.testing.assert_allclose(
        moments.between(index(first), index(last))[:, 0], expected, rtol=1e-9, atol=1e-6
    )


@examples(40)
@given(st.integers(0, 1000), st.floats(0.2, 1.1), st.sampled_from([0.0, 300.0, 3000.0]))
def test_the_best_line_is_the_best_of_all_slopes(seed, slope, spread):
    moments = RunningMoments(*cloud(seed, slope=slope, spread=spread), 4)
    window = moments.between(index(20), index(280))
    w, x, y, noise = weighted(moments, 20, 280)
    low, high = (float(limit[0]) for limit in line_costs.possible_slopes(window))
    slopes = np.linspace(low, high, 2001)
    across = np.array([np.sum(w * (y - t * x - np.average(y - t * x, weights=w)) ** 2) for t in slopes])
    misfits = 260.0 * across / np.array([np.sum(w * line_costs.across(*noise, t)) for t in slopes])
    found, misfit = line_costs.best_line(window)
    assert misfit[0] == pytest.approx(misfits.min(), rel=1e-5)
    assert abs(found[0] - slopes[misfits.argmin()]) <= 0.01


def test_the_gain_of_a_split_is_that_of_two_regressions_across_the_line():
    x, y = cloud(3, noise=((300.0, 90.0), (0.0, 200.0)))
    y[150:] += 300.0
    moments = RunningMoments(x, y, 5)
    left, right = moments.between(index(0, 150), index(150, 300)).T
    gain, _ = line_costs.split_gain(left[:, None], right[:, None])
    both = (left + right)[:, None]
    slope = line_costs.best_line(both)[0][0]
    w, x, y, noise = weighted(moments, 0, 300)
    noise_xx, noise_xy, noise_yy = (w * noise).sum(axis=1) / 300.0
    variance = noise_yy - 2.0 * slope * noise_xy + slope**2 * noise_xx
    g = y - slope * x
    along = x + g * (slope * noise_xx - noise_xy) / variance

    def squares(rows):
        design = np.column_stack([np.ones(300), along])[rows] * np.sqrt(w[rows, None])
        wanted = g[rows] * np.sqrt(w[rows])
        return np.sum((wanted - design @ np.linalg.lstsq(design, wanted)[0]) ** 2)

    expected = squares(slice(None)) - squares(slice(0, 150)) - squares(slice(150, 300))
    assert gain[0] == pytest.approx(expected / variance, rel=1e-6)
    assert gain[0] > 50.0


def test_a_load_step_gains_nothing_but_chance():
    """Two clouds of constant load on one line: least squares of y on x would gain by the hundred."""
    gains, naive = [], []
    for seed in range(200):
        x, y = cloud(seed, n=600, spread=0.0)
        x[300:] += 2500.0
        y[300:] += 0.6 * 2500.0
        moments = RunningMoments(x, y, 3)
        gain, _ = line_costs.split_gain(*moments.between(index(0, 300), index(300, 600)).T[:, :, None])
        gains.append(gain[0])

        def squares(rows, x=x, y=y):
            return np.var(y[rows] - np.polyval(np.polyfit(x[rows], y[rows], 1), x[rows])) * len(x[rows])

        parts = squares(slice(0, 300)) + squares(slice(300, 600))
        naive.append((squares(slice(None)) - parts) / (parts / 600.0))
    # χ² with 2 degrees of freedom: mean 2, 10.6 exceeded once in 200.
    assert 1.6 < np.mean(gains) < 2.6
    assert max(gains) < 20.0
    assert np.median(naive) > 50.0


def test_lines_apart_gain_their_distance():
    x, y = cloud(5, n=20_000)
    y[10_000:] += 100.0
    moments = RunningMoments(x, y, 10)
    gain, worth = line_costs.split_gain(
        *moments.between(index(0, 10_000), index(10_000, 20_000)).T[:, :, None]
    )
    assert np.sqrt(gain[0] / worth[0]) == pytest.approx(100.0, rel=0.1)


def test_late_windows_of_a_long_drifting_series_are_exact():
    n = 1_000_000
    rng = np.random.default_rng(0)
    x = np.linspace(4e3, 4e4, n) + 30.0 * rng.standard_normal(n)
    y = 1000.0 + 0.6 * x + 20.0 * rng.standard_normal(n)
    moments = RunningMoments(x, y, 18)
    first, last = n - 1003, n - 500
    w, x, y, _ = weighted(moments, first, last)
    residuals = y - 0.6 * x
    expected = np.sum(w * (residuals - np.average(residuals, weights=w)) ** 2)
    found = line_costs.across(*line_costs.scatter(moments.between(index(first), index(last))), 0.6)
    assert found[0] == pytest.approx(expected, rel=1e-5)


def test_no_soil_has_a_negative_or_a_vertical_line():
    x = np.concatenate([np.full(50, 1e4), np.full(50, 2e4)])
    down = RunningMoments(x, np.where(x < 1.5e4, 8e3, 6e3), 2)
    up = RunningMoments(x, np.where(x < 1.5e4, 2e3, 3e4), 2)
    for moments in (down, up):
        slope, misfit = line_costs.best_line(moments.between(index(0), index(100)))
        assert line_costs.SMALLEST_SLOPE <= slope[0] <= line_costs.LARGEST_SLOPE
        assert misfit[0] > 100.0
