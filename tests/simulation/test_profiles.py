"""Ramps, steps and swings."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from terrain_cli.errors import ConfigurationError
from terrain_cli.simulation.course import FLANK, STEP, smooth
from terrain_cli.simulation.scenario import Profile, profile_rule
from terrain_cli.simulation.sensors import generator

RULE = profile_rule("a share, from 0 to 2", 0.0, 2.0)
TIME = np.linspace(0.0, 12.0, 121)


def over(value, seed=0):
    return RULE(value, "f: load").over(TIME, 12.0, generator(seed, "load"))


def test_number_ramps_and_steps():
    assert set(over(0.5)) == {0.5}
    np.testing.assert_allclose(over([0.0, 1.2, 0.0]), 0.2 * np.minimum(TIME, 12.0 - TIME), atol=1e-12)
    steps = over({"steps": [1.0, 0.5, 2.0]})
    assert steps[[0, 39, 40, 79, 80, 120]].tolist() == [1.0, 1.0, 0.5, 0.5, 2.0, 2.0]


@given(st.floats(0.5, 1.5), st.floats(0.0, 0.5), st.floats(1.0, 100.0), st.integers(0, 2**31))
def test_swing_stays_about_its_mean(mean, swing, period, seed):
    values = Profile("swing", (mean, swing, period)).over(TIME, 12.0, generator(seed, "x"))
    assert np.all(np.abs(values - mean) <= swing * (1.0 + 1e-12))


def test_swing_has_phases_by_the_seed():
    value = {"mean": 1.0, "swing": 0.3, "period": 5.0}
    np.testing.assert_array_equal(over(value), over(value))
    assert not np.allclose(over(value), over(value, seed=1))


@pytest.mark.parametrize(
    ("value", "message"),
    [
        ("fast", "must be a number, a list of numbers"),
        ([], "must be a number, a list of numbers"),
        (True, "must be a number, a list of numbers"),
        (2.5, "must be a share, from 0 to 2, not 2.5"),
        ([1.0, "x"], r"f: load\[1\]: must be a share"),
        ({"steps": []}, "steps is missing"),
        ({"mean": 1.0, "swing": 0.1}, "period is missing"),
        ({"mean": 1.0, "swng": 0.1, "period": 1.0}, "did you mean swing"),
        ({"mean": 1.8, "swing": 0.5, "period": 1.0}, "swings beyond"),
    ],
)
def test_wrong(value, message):
    with pytest.raises(ConfigurationError, match=message):
        RULE(value, "f: load")


def test_smooth_keeps_constants_and_rounds_steps():
    assert set(smooth(np.full(500, 0.3))) == {0.3}
    step = np.repeat([0.0, 1.0], 500)
    done = smooth(step)
    flank = round(FLANK / STEP)
    assert np.all(np.diff(done) >= 0.0)
    assert np.max(np.abs(np.diff(done))) < 3.0 / flank
    np.testing.assert_allclose(done[: 500 - flank], 0.0, atol=1e-12)
    np.testing.assert_allclose(done[500 + flank :], 1.0, atol=1e-12)


def test_generators_do_not_depend_on_each_other():
    first = generator(3, "left torque").normal(size=5)
    generator(3, "left load").normal(size=9)
    np.testing.assert_array_equal(first, generator(3, "left torque").normal(size=5))
    assert not np.allclose(first, generator(3, "left load").normal(size=5))
