"""Bands and shares of many points."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from terrain_cli.views import shown_samples


def values(n):
    return arrays(float, n, elements=st.floats(-1e6, 1e6, allow_subnormal=False))


@pytest.mark.parametrize(("n", "most"), [(10, 20), (20, 20), (21, 20), (10_000, 17)])
def test_some_are_different_and_in_order(n, most):
    chosen = shown_samples.some(n, most)
    assert len(chosen) == min(n, most)
    assert np.all(np.diff(chosen) > 0)
    assert chosen[0] >= 0
    assert chosen[-1] < n


def test_some_do_not_beat_with_a_period():
    phase = np.arange(100_000) % 20
    assert np.ptp(np.bincount(phase[shown_samples.some(100_000, 5_000)])) < 120


def test_band_holds_ninety_per_cent():
    rng = np.random.default_rng(0)
    driver = rng.uniform(0.0, 1.0, 50_000)
    band = shown_samples.band(driver, 3.0 * driver + rng.normal(size=50_000))
    np.testing.assert_allclose(band.median, 3.0 * band.centre, atol=0.12)
    np.testing.assert_allclose(band.high - band.median, 1.645, atol=0.15)
    np.testing.assert_allclose(band.median - band.low, 1.645, atol=0.15)


def test_band_does_not_bridge_a_hole():
    driver = np.concatenate([np.linspace(0.0, 1.0, 200), np.linspace(5.0, 6.0, 200)])
    band = shown_samples.band(driver, driver)
    inside = (band.centre > 1.0) & (band.centre < 5.0)
    assert inside.sum() == 1
    assert np.isnan(band.median[inside]).all()


def test_band_keeps_the_samples_of_one_value_together():
    driver = np.repeat([0.0, 1.0, 2.0], [500, 40, 300])
    band = shown_samples.band(driver, driver * 10.0)
    np.testing.assert_array_equal(band.centre, [0.0, 1.0, 2.0])
    np.testing.assert_array_equal(band.median, [0.0, 10.0, 20.0])


@pytest.mark.parametrize("n", [0, 1, 24])
def test_band_of_few_samples_is_empty(n):
    assert all(len(column) == 0 for column in shown_samples.band(np.arange(float(n)), np.zeros(n)))


def test_band_passes_over_what_is_not_known():
    driver, residual = np.arange(100.0), np.ones(100)
    driver[::3], residual[1::3] = np.nan, np.nan
    np.testing.assert_array_equal(shown_samples.band(driver, residual).median, 1.0)


@given(x=values(200))
def test_band_is_in_order(x):
    band = shown_samples.band(x, x[::-1])
    known = np.isfinite(band.median)
    assert np.all(np.diff(band.centre) > 0.0)
    assert np.all(band.low[known] <= band.median[known])
    assert np.all(band.median[known] <= band.high[known])


def test_limits_are_a_little_wider():
    low, high = shown_samples.limits(np.array([1.0, np.nan, 3.0]))
    assert (low, high) == pytest.approx((0.94, 3.06))
    assert shown_samples.limits(np.array([np.nan])) == (0.0, 1.0)
    low, high = shown_samples.limits(np.zeros(3))
    assert low < 0.0 < high
