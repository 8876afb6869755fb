"""Standard errors of the line under white and correlated residuals."""

from __future__ import annotations

import numpy as np
import pytest
from drives import noise, variation
from scipy import stats

from terrain_cli.estimation.line.correlation import sampling_errors
from terrain_cli.estimation.line.least_squares import fit_line
from terrain_cli.estimation.line.moments import of_windows


def errors_of(x, y, *, correlated=True):
    """Return the line and its sampling errors of windows of shape (windows, samples)."""
    columns = np.ones((6, x.size))
    columns[0], columns[1] = x.ravel(), y.ravel()
    moments = of_windows(columns, np.arange(len(x) + 1) * x.shape[1])
    line = fit_line(moments)
    return line, sampling_errors(moments, line, correlated=correlated)


def test_uncorrelated_errors_are_those_of_the_textbook():
    rng = np.random.default_rng(0)
    x = rng.uniform(9e3, 1.5e4, (1, 12))
    y = 800.0 + 0.5 * x + rng.normal(0.0, 200.0, x.shape)
    _, errors = errors_of(x, y, correlated=False)
    known = stats.linregress(x[0], y[0])
    assert np.sqrt(errors.tan_phi[0]) == pytest.approx(known.stderr)
    assert errors.variance[0] * errors.mean[0] == pytest.approx(
        np.sum((y - known.intercept - known.slope * x) ** 2) / 10 / 12
    )


@pytest.mark.parametrize("kind", ["scatter", "undulation"])
@pytest.mark.parametrize(
    ("rho", "samples", "low", "high"),
    [
        (0.0, 30, 0.93, 0.97),
        (0.0, 100, 0.93, 0.97),
        (0.0, 1000, 0.93, 0.97),
        # Some four samples out of 30 are independent then.
        (0.8, 30, 0.89, 0.985),
        (0.8, 100, 0.915, 0.98),
        (0.8, 1000, 0.93, 0.97),
    ],
)
def test_intervals_hold_their_95_percent(kind, rho, samples, low, high):
    windows = 4000 if samples < 1000 else 2000
    rng = np.random.default_rng(11)
    x = 1.3e4 * (1.0 + 0.1 * variation(kind, windows, samples, rng))
    y = 800.0 + 0.5 * x + 300.0 * noise(rng, x.shape, rho)
    line, errors = errors_of(x, y)
    slope = np.abs(line.tan_phi - 0.5) < 1.96 * np.sqrt(errors.tan_phi)
    miss = y.mean(axis=1) - 800.0 - 0.5 * x.mean(axis=1)
    mean = np.abs(miss) < 1.96 * np.sqrt(errors.variance * errors.mean)
    assert low <= slope.mean() <= high
    assert low <= mean.mean() <= high


def test_slow_misfit_under_sensor_noise_is_seen():
    # The lag-1 correlation of this sum is 0.45; a first-order process of that would have 2.6
    # samples per independent one instead of 10.
    rng = np.random.default_rng(5)
    x = 1.3e4 * (1.0 + 0.1 * variation("undulation", 1000, 1000, rng))
    y = 200.0 * (noise(rng, x.shape, 0.9) + noise(rng, x.shape))
    _, errors = errors_of(x, y)
    assert np.median(errors.mean) * 1000.0 == pytest.approx(10.0, rel=0.1)
    inside = np.abs(y.mean(axis=1)) < 1.96 * np.sqrt(errors.variance * errors.mean)
    assert 0.92 <= inside.mean() <= 0.97


def test_two_samples_have_no_error():
    _, errors = errors_of(np.array([[1.0, 2.0]]), np.array([[1.0, 3.0]]))
    assert np.isnan(errors.variance[0])
