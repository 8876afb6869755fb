"""Standard errors that hold: of correlated residuals, and of noise in the channels."""

from __future__ import annotations

import numpy as np
import pytest
from drives import GEOMETRY, drive, noise, variation
from scipy import stats

from terrain_cli.estimation.line.moments import X, Y, fit_line, of_windows
from terrain_cli.estimation.line.uncertainty import (
    distance_to_bounds,
    phi_bounds,
    sampling_errors,
    uncertainty,
)
from terrain_cli.mechanics.linear import line_coordinates

AS_LEAST_SQUARES = np.eye(2)[:, :, None]


def bounds_of(run, *, correlated=True):
    channels = run.channels
    x, y = line_coordinates(**channels, **GEOMETRY)
    columns = np.array([x, y, *channels.values()])
    low, high = phi_bounds(of_windows(columns, run.bounds), correlated=correlated)
    return np.degrees(low), np.degrees(high)


def test_without_noise_the_bounds_meet():
    low, high = bounds_of(drive(5, 40, 1, kind="scatter", share=0.15))
    # What is left is κ3, which the line leaves out.
    np.testing.assert_allclose(low, 30.0, atol=0.1)
    np.testing.assert_allclose(high - low, 0.0, atol=0.01)


@pytest.mark.parametrize(
    ("noises", "low_is_exact", "high_is_exact"),
    [
        # The sinkage follows the load: without noise of its own it is as good an instrument.
        ((0.03, 0.0, 0.0, 0.0), True, True),
        ((0.03, 0.0, 0.03, 0.0), False, True),
        ((0.0, 0.03, 0.0, 0.0), True, False),
        ((0.0, 0.0, 0.03, 0.03), True, True),
    ],
)
def test_noise_loosens_the_bound_of_its_own_sensor(noises, low_is_exact, high_is_exact):
    low, high = bounds_of(drive(1, 20_000, 2, kind="scatter", share=0.15, noises=noises))
    assert (abs(low[0] - 30.0) < 0.5) == low_is_exact
    assert (abs(high[0] - 30.0) < 0.5) == high_is_exact
    assert low[0] < 30.5
    assert high[0] > 29.5


@pytest.mark.parametrize("slip_share", [0.0, 0.5])
def test_truth_is_between_the_bounds(slip_share):
    low, high = bounds_of(
        drive(20, 5000, 3, kind="undulation", share=0.15, slip_share=slip_share, noises=0.03)
    )
    assert np.all((low < 30.5) & (high > 29.5))
    assert np.all(high - low < 8.0)


def test_a_slip_sweep_under_an_exact_load_has_bounds():
    low, high = bounds_of(drive(20, 2000, 4, slip_share=0.5, noises=(0.0, 0.02, 0.02, 0.02)))
    assert np.all((low < 30.5) & (high > 29.5))
    assert np.all(high - low < 5.0)


def test_noise_alone_bounds_nothing():
    low, high = bounds_of(drive(50, 2000, 5, noises=0.03))
    assert np.all(low < 10.0)
    assert np.all(high > 45.0)


def test_constant_channels_bound_nothing():
    low, high = bounds_of(drive(1, 20, 6))
    assert (low[0], high[0]) == (0.0, pytest.approx(60.0))


def test_distance_to_a_truth_between_bounds():
    # Mean of (φ − u)² over u from 1 to 4 at φ = 0: (4³ − 1³)/(3 · 3) = 7.
    assert distance_to_bounds(0.0, 1.0, 4.0) == pytest.approx(np.sqrt(7.0))
    assert distance_to_bounds(2.0, 2.0, 2.0) == 0.0


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


@pytest.fixture
def window():
    run = drive(1, 80, 1, kind="undulation", share=0.2, noises=0.02)
    x, y = line_coordinates(**run.channels, **GEOMETRY)
    moments = of_windows(np.array([x, y, *run.channels.values()]), run.bounds)
    return moments, fit_line(moments)


def test_least_squares_turns_about_its_mean_point(window):
    moments, line = window
    errors, _ = uncertainty(moments, line, line.cohesion, line.tan_phi, AS_LEAST_SQUARES, correlated=True)
    assert errors.sigma_star[0] == pytest.approx(moments.mean[X, 0])
    assert errors.strength[0] == pytest.approx(moments.mean[Y, 0])
    tan_se = errors.phi_se * (1.0 + line.tan_phi**2)
    np.testing.assert_allclose(errors.c_se, np.hypot(errors.strength_se, moments.mean[X] * tan_se))


def test_a_pull_off_the_mean_is_shown_and_counted(window):
    moments, line = window
    fair, pulled = (
        uncertainty(moments, line, line.cohesion + by, line.tan_phi, AS_LEAST_SQUARES, correlated=True)[0]
        for by in (0.0, 300.0)
    )
    np.testing.assert_allclose(pulled.strength, fair.strength + 300.0)
    np.testing.assert_allclose(pulled.strength_se, np.hypot(fair.strength_se, 300.0))
    np.testing.assert_allclose(pulled.phi_se, fair.phi_se)


def test_a_slope_off_the_bounds_is_counted(window):
    moments, line = window
    (fair, open_), (turned, still_open) = (
        uncertainty(moments, line, line.cohesion, slope, AS_LEAST_SQUARES, correlated=True)
        for slope in (line.tan_phi, line.tan_phi - 0.3)
    )
    np.testing.assert_allclose(still_open, open_)
    middle = 0.5 * np.sum(phi_bounds(moments, correlated=True), axis=0)
    assert turned.phi_se[0] > (middle - np.arctan(line.tan_phi - 0.3))[0] > 3.0 * fair.phi_bias[0]
