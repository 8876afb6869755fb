"""Rates of channels, and the angle through which the wheel has turned."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from terrain_cli.mechanics.rates import rate, wheel_angle

TIME = np.arange(400) * 0.05
ONE = np.zeros(400, dtype=int)


@given(st.floats(-5.0, 5.0), st.floats(-5.0, 5.0))
def test_line_has_its_slope(slope, offset):
    assert rate(TIME, ONE, offset + slope * TIME) == pytest.approx(np.full(400, slope), abs=1e-9)


def test_uneven_times_and_missing_values():
    rng = np.random.default_rng(1)
    time = np.sort(rng.uniform(0.0, 20.0, 400))
    values = 3.0 * time
    values[::7] = np.nan
    found = rate(time, ONE, values)
    assert np.isnan(found[::7]).all()
    assert np.delete(found, np.s_[::7]) == pytest.approx(3.0, abs=1e-9)


def test_smooth_channel_is_followed_closely():
    found = rate(TIME, ONE, np.sin(TIME))
    assert found[5:-5] == pytest.approx(np.cos(TIME)[5:-5], abs=5e-3)


def test_noisy_channel_is_smoothed():
    rng = np.random.default_rng(2)
    truth = np.cos(TIME)
    noisy = np.sin(TIME) + 0.1 * rng.normal(size=400)
    chosen, narrow = (
        np.sqrt(np.mean((rate(TIME, ONE, noisy, **reach) - truth)[10:-10] ** 2))
        for reach in ({}, {"reach": 2})
    )
    assert chosen < narrow / 2.0


def test_stretches_are_no_neighbours():
    stretch = np.repeat([0, 1], 200)
    found = rate(TIME, stretch, np.where(stretch == 0, TIME, 50.0 - TIME))
    assert found == pytest.approx(np.where(stretch == 0, 1.0, -1.0), abs=1e-9)
    assert np.isnan(rate([0.0, 1.0], [0, 1], [0.0, 1.0])).all()


def test_wheel_angle_begins_anew_with_each_stretch():
    stretch = np.repeat([0, 1], 200)
    angle = wheel_angle(TIME, stretch, np.full(400, 2.0))
    assert angle[:200] == pytest.approx(2.0 * TIME[:200])
    assert angle[200:] == pytest.approx(2.0 * TIME[:200], abs=1e-9)
    assert len(wheel_angle([], [], [])) == 0
