"""Rates of channels, and the angle of the wheel: also in a log whose stretches begin at any phase."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from terrain_cli.mechanics import rates
from terrain_cli.mechanics.rates import rate, rut_slope, wheel_angle

TIME = np.arange(400) * 0.05
ONE = np.zeros(400, dtype=int)
GROUSERS = 12


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


RADIUS = 0.1


@pytest.mark.parametrize("velocity", [0.1 + 0.0 * TIME, 0.1 + 0.08 * np.sin(TIME), -0.1 + 0.0 * TIME])
def test_rut_has_its_slope_at_whatever_speed(velocity):
    way = np.concatenate([[0.0], np.cumsum(0.5 * np.abs(velocity[1:] + velocity[:-1]) * 0.05)])
    assert rut_slope(TIME, ONE, 0.01 + 0.03 * way, velocity, radius=RADIUS) == pytest.approx(0.03, abs=1e-9)


def test_at_one_speed_a_rut_is_a_rate():
    sinkage = 0.01 + 0.003 * np.sin(0.8 * TIME)
    found = rut_slope(TIME, ONE, sinkage, np.full(400, 0.2), radius=RADIUS)
    assert found[10:-10] == pytest.approx(0.003 * 0.8 * np.cos(0.8 * TIME)[10:-10] / 0.2, abs=2e-4)


@pytest.mark.parametrize("stop", [20, 200])
def test_a_wheel_that_stands_has_the_slope_of_its_rut_however_long(stop):
    """Neither a jump nor a decay, whatever its noise is worth there."""
    velocity = np.full(400, 0.1)
    velocity[150 : 150 + stop] = 0.0
    way = np.concatenate([[0.0], np.cumsum(0.5 * (velocity[1:] + velocity[:-1]) * 0.05)])
    sinkage = 0.01 + 0.03 * way
    standing = slice(152, 148 + stop)
    sinkage[standing] += 1e-4 * (-1.0) ** np.arange(stop - 4)
    found = rut_slope(TIME, ONE, sinkage, velocity, radius=RADIUS)
    assert found == pytest.approx(0.03, abs=1e-4)
    assert np.ptp(found[standing]) == 0.0


def test_rut_begins_anew_with_each_stretch():
    stretch = np.repeat([0, 1], 200)
    sinkage = np.where(stretch == 0, 0.002 * TIME, 0.5 - 0.002 * TIME)
    found = rut_slope(TIME, stretch, sinkage, np.full(400, 0.1), radius=RADIUS)
    assert found == pytest.approx(np.where(stretch == 0, 0.02, -0.02), abs=1e-9)


def test_a_rut_that_nobody_drove_has_no_slope():
    sinkage = 0.01 + 0.001 * TIME
    assert np.isnan(rut_slope(TIME, ONE, sinkage, np.zeros(400), radius=RADIUS)).all()
    assert np.isnan(rut_slope(TIME, ONE, np.full(400, np.nan), np.ones(400), radius=RADIUS)).all()
    assert len(rut_slope([], [], [], [], radius=RADIUS)) == 0
    sinkage[::7] = np.nan
    found = rut_slope(TIME, ONE, sinkage, np.full(400, 0.1), radius=RADIUS)
    assert np.isnan(found[::7]).all()
    assert np.delete(found, np.s_[::7]) == pytest.approx(0.01, abs=1e-9)


def test_wheel_angle_begins_anew_with_each_stretch():
    stretch = np.repeat([0, 1], 200)
    angle = wheel_angle(TIME, stretch, np.full(400, 2.0))
    assert angle[:200] == pytest.approx(2.0 * TIME[:200])
    assert angle[200:] == pytest.approx(2.0 * TIME[:200], abs=1e-9)
    assert len(wheel_angle([], [], [])) == 0


def log(seed, stretches, samples, amplitude):
    """Return stretch, angle and time, with two channels of noise that ripple a quarter of a turn apart."""
    rng = np.random.default_rng(seed)
    stretch = np.repeat(np.arange(stretches), samples)
    time = 0.1 * np.arange(len(stretch))
    angle = rates.wheel_angle(time, stretch, 0.6 + 0.05 * np.sin(time / 7.0))
    psi = GROUSERS * angle + rng.uniform(0.0, 2.0 * np.pi, stretches)[stretch]
    wave = amplitude * np.stack([np.cos(psi), np.sin(psi)])
    return stretch, angle, time, wave + 0.2 * time + rng.normal(size=wave.shape)


def waves(angle, time, channel):
    """Fit cosine and sine of the whole log, and return them."""
    psi = GROUSERS * angle
    design = np.column_stack([np.cos(psi), np.sin(psi), np.ones(len(time)), time])
    return np.linalg.lstsq(design, channel, rcond=None)[0][:2]


def test_one_amplitude_serves_stretches_that_begin_anywhere():
    stretch, angle, time, shown = log(1, 8, 150, 3.0)
    assert np.hypot(*waves(angle, time, shown[0])) < 1.5
    found = rates.aligned(angle, stretch, GROUSERS, shown, [time])
    np.testing.assert_allclose(waves(found, time, shown[0]), [3.0, 0.0], atol=0.25)
    # What one channel is told by serves the others, with their phase to it.
    np.testing.assert_allclose(waves(found, time, shown[1]), [0.0, 3.0], atol=0.25)


@pytest.mark.parametrize(
    ("stretches", "samples", "amplitude", "grousers"),
    [(1, 900, 3.0, GROUSERS), (6, 150, 0.0, GROUSERS), (20, 20, 3.0, GROUSERS), (6, 150, 3.0, 0)],
    ids=["one stretch", "noise", "too short", "smooth"],
)
def test_the_angle_stays_where_nothing_tells_or_needs_a_phase(stretches, samples, amplitude, grousers):
    stretch, angle, time, shown = log(2, stretches, samples, amplitude)
    np.testing.assert_array_equal(rates.aligned(angle, stretch, grousers, shown, [time]), angle)


def test_a_channel_that_is_hardly_there_or_never_changes_tells_nothing():
    stretch, angle, time, shown = log(3, 6, 150, 3.0)
    gone = np.where(np.arange(len(time)) < 100, shown[1], np.nan)
    found = rates.aligned(angle, stretch, GROUSERS, [gone, np.ones(len(time)), shown[0]], [time])
    alone = rates.aligned(angle, stretch, GROUSERS, shown[:1], [time])
    np.testing.assert_allclose(found, alone, rtol=0.0, atol=1e-12)


def test_noise_does_not_align_itself(monkeypatch):
    """In units of its own error a wave that is not there is normal, though phases are told by the data."""
    monkeypatch.setattr(rates, "_STANDS_OUT", 0.0)
    found = []
    for seed in range(150):
        stretch, angle, time, shown = log(seed, 10, 90, 0.0)
        aligned = rates.aligned(angle, stretch, GROUSERS, shown, [time])
        found.append([waves(aligned, time, channel) / np.sqrt(2.0 / len(time)) for channel in shown])
    found = np.array(found).reshape(150, 4)
    np.testing.assert_allclose(found.mean(axis=0), 0.0, atol=0.3)
    np.testing.assert_allclose(found.std(axis=0), 1.0, atol=0.2)
