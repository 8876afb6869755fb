"""Bounds of φ from noisy channels, and what they call separable."""

from __future__ import annotations

import numpy as np
import pytest
from drives import GEOMETRY, drive

from terrain_cli.estimation.line.moments import of_windows
from terrain_cli.estimation.line.separability import distance_to_bounds, phi_bounds
from terrain_cli.mechanics.linear import line_coordinates


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
