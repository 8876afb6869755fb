"""Channels without their own noise: from neighbours, from conditions, and by what answers to them."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from terrain_cli.comparison import residual_noise, smoothed_channels
from terrain_cli.comparison.smoothed_channels import from_conditions, from_neighbours

N = 1500
SLIP = 0.3 + 0.25 * np.sin(np.arange(N) / 40.0)
LOAD = 80.0 + 15.0 * np.sin(np.arange(N) / 170.0)
PITCH = 0.1 * np.sin(np.arange(N) / 90.0)
WINDOW = np.repeat([0, 1], [900, 600])
STRENGTH = np.where(WINDOW == 0, 0.5, 0.4)
PULL = LOAD * (STRENGTH * (1.0 - np.exp(-SLIP / 0.15)) - 0.1) - LOAD * np.sin(PITCH)
CHANNELS = {"slip": SLIP, "load": LOAD, "pitch": PITCH}


@pytest.mark.parametrize("torque", [0.1, 0.3, 1.0, 7.7])
@pytest.mark.parametrize("slip", [0.0, 0.1, 0.3])
def test_a_constant_channel_answers_to_no_load(torque, slip):
    load = np.linspace(50.0, 150.0, 40)
    columns = {"load": load, "torque": np.full(40, torque), "slip": np.full(40, slip)}
    record = smoothed_channels.RecordedWheel(columns, np.zeros(40, dtype=np.intp), None)
    answered = smoothed_channels._answered(record, "torque", 1.0)
    assert answered == pytest.approx(0.0, abs=1e-9)


@given(st.integers(0, 8), st.integers(1, 5), st.integers(0, 59))
def test_a_sample_has_no_part_in_its_own_value_nor_in_that_of_near_ones(gap, reach, place):
    values, group = np.zeros(60), np.zeros(60, dtype=int)
    values[place] = 1.0
    moved = from_neighbours(values, group, gap=gap, reach=reach) - from_neighbours(
        np.zeros(60), group, gap=gap, reach=reach
    )
    near = np.abs(np.arange(60) - place) <= gap
    assert moved[near] == pytest.approx(0.0, abs=1e-12)


def test_a_cubic_is_kept_but_for_the_width_of_the_means():
    t = np.linspace(-1.0, 1.0, 101)
    values = 1.0 + 2.0 * t - t**2 + t**3
    smooth = from_neighbours(values, np.zeros(101, dtype=int), gap=2, reach=1)
    assert smooth[12:-12] == pytest.approx(values[12:-12], abs=1e-12)


def test_noise_is_another_one():
    noise = np.random.default_rng(1).normal(size=20_000)
    smooth = from_neighbours(noise, np.zeros(20_000, dtype=int), gap=0, reach=3)
    assert abs(np.corrcoef(noise, smooth)[0, 1]) < 0.03


def test_groups_are_no_neighbours():
    values, group = np.repeat([0.0, 5.0], 20), np.repeat([0, 1], 20)
    assert from_neighbours(values, group, gap=1, reach=3) == pytest.approx(values)


def test_a_sample_alone_has_none():
    assert np.isnan(from_neighbours(np.array([1.0, 2.0]), np.array([0, 1]), gap=0, reach=3)).all()
    assert len(from_neighbours(np.zeros(0), np.zeros(0, dtype=int), gap=0, reach=3)) == 0


def test_unknown_samples_are_passed_over():
    values = np.ones(50)
    values[::3] = np.nan
    assert from_neighbours(values, np.zeros(50, dtype=int), gap=0, reach=3) == pytest.approx(1.0)


def lasting(deviation, memory):
    noise = np.random.default_rng(4).normal(size=N) * np.sqrt(1.0 - memory**2)
    for i in range(1, N):
        noise[i] += memory * noise[i - 1]
    return deviation * noise


def test_what_the_conditions_cause_is_kept():
    assert np.std(from_conditions(PULL, CHANNELS, WINDOW) - PULL) < 0.05 * np.std(PULL)


def test_a_load_that_goes_with_slip_is_kept():
    rng, time = np.random.default_rng(79_935_901), np.arange(2_000.0)
    slip = 0.35 + 0.3 * np.sin(time / 60.0) + 0.1 * np.sin(time / 23.0)
    # On a hill the front wheels slip more, and carry less.
    load = 600.0 - 400.0 * slip + 20.0 * np.sin(time / 31.0)
    columns = {
        "load": load + 10.0 * rng.standard_normal(2_000),
        "slip": slip,
        "sinkage": 0.01 * (load / 600.0) ** 0.75 * (1.0 + slip),
        "torque": 0.1 * load * (1.0 - np.exp(-slip / 0.1)),
    }
    record = smoothed_channels.RecordedWheel(columns, np.zeros(2_000, int), np.zeros(2_000, int))
    found, _ = smoothed_channels.without_noise(record, columns, load_tells_sinkage=True)
    assert np.sqrt(np.mean((found["load"] - load) ** 2)) < 10.0


@pytest.mark.parametrize(("memory", "through"), [(0.0, 0.05), (0.8, 0.3)])
def test_noise_is_not(memory, through):
    """Some twenty numbers are fitted to a window; of lasting noise nine times as much gets by them."""
    noise = lasting(2.0, memory)
    plain = from_conditions(PULL, CHANNELS, WINDOW)
    left = from_conditions(PULL + noise, CHANNELS, WINDOW) - plain
    assert 0.0 < float(left @ noise) < through * float(noise @ noise)


@given(st.integers(0, N - 1), st.floats(-50.0, 50.0))
def test_a_sample_does_not_foretell_itself(place, jump):
    changed = PULL.copy()
    changed[place] += jump
    moved = from_conditions(changed, CHANNELS, WINDOW)[place] - from_conditions(PULL, CHANNELS, WINDOW)[place]
    assert abs(moved) <= 0.2 * abs(jump) + 1e-9


def test_what_is_not_known_is_not_made_up():
    pull, slip = PULL.copy(), SLIP.copy()
    pull[:50], slip[100:120] = np.nan, np.nan
    pull[WINDOW == 1] = np.nan
    found = from_conditions(pull, {**CHANNELS, "slip": slip}, WINDOW)
    assert np.isfinite(found[:50]).all()
    assert np.isnan(found[100:120]).all()
    assert np.isnan(found[WINDOW == 1]).all()
    assert np.isnan(from_conditions(PULL, {"load": LOAD}, WINDOW)).all()


def test_a_handful_of_test_points_will_do():
    few = slice(0, 9)
    found = from_conditions(PULL[few], {"slip": SLIP[few]}, WINDOW[few])
    assert np.abs(found - PULL[few]).max() < 0.05 * np.ptp(PULL)


def test_points_at_another_slip_angle_are_no_repeats():
    """What a wheel misses that slides sideways would pass for noise."""
    rng = np.random.default_rng(78_957_001)
    mixed = rng.permutation(60)
    slip, angle = np.tile(np.linspace(0.1, 0.6, 6), 10)[mixed], np.repeat([0.0, 0.4], 30)[mixed]
    columns = {"slip": slip, "load": np.full(60, 20.0), "slip_angle": angle}
    window = np.zeros(60, dtype=np.intp)
    drivers = smoothed_channels.RecordedWheel(columns, window, None).conditions(("slip", "load"))
    left = 0.1 * rng.normal(size=60) + np.where(angle > 0.0, 3.0, 0.0)
    assert residual_noise.of_points(left, window, drivers) == pytest.approx(0.1, rel=0.3)
    assert residual_noise.of_points(left, window, drivers[:, :2]) > 1.0


def test_a_condition_that_is_nowhere_known_is_none():
    columns = {"slip": np.linspace(0.1, 0.6, 6), "slip_angle": np.full(6, np.nan)}
    record = smoothed_channels.RecordedWheel(columns, np.zeros(6, dtype=np.intp), None)
    assert record.conditions(("slip", "load")).shape == (6, 1)
