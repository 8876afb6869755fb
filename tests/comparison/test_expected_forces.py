"""What effects may read of the pull that is to be explained: its causes, and none of its noise."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from terrain_cli.comparison.expected_forces import from_conditions

N = 1500
SLIP = 0.3 + 0.25 * np.sin(np.arange(N) / 40.0)
LOAD = 80.0 + 15.0 * np.sin(np.arange(N) / 170.0)
PITCH = 0.1 * np.sin(np.arange(N) / 90.0)
WINDOW = np.repeat([0, 1], [900, 600])
STRENGTH = np.where(WINDOW == 0, 0.5, 0.4)
PULL = LOAD * (STRENGTH * (1.0 - np.exp(-SLIP / 0.15)) - 0.1) - LOAD * np.sin(PITCH)
CHANNELS = {"slip": SLIP, "load": LOAD, "pitch": PITCH}


def lasting(deviation, memory):
    noise = np.random.default_rng(4).normal(size=N) * np.sqrt(1.0 - memory**2)
    for i in range(1, N):
        noise[i] += memory * noise[i - 1]
    return deviation * noise


def test_what_the_conditions_cause_is_kept():
    assert np.std(from_conditions(PULL, CHANNELS, WINDOW) - PULL) < 0.05 * np.std(PULL)


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
