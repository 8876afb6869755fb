"""Channels that are shown late, in time or along the way."""

from __future__ import annotations

import numpy as np
import pytest

from terrain_cli import effects
from terrain_cli.mechanics.dual import seed, slopes
from terrain_cli.mechanics.past import along


def predicted(channel, time, true, velocity=None):
    """Return a channel with its past, as laws read them."""
    return {channel: true, **along(time, np.zeros(len(time), dtype=int), velocity, {channel: true})}


@pytest.mark.parametrize("lag", [0.03, 0.25, 0.6, -0.1])
def test_a_delay_is_shown_however_quick_the_changes(lag):
    time = np.arange(0.0, 20.0, 0.05)
    law, inner = effects.find("sensor-lag").laws["torque"], slice(60, -60)
    true, late = np.sin(2.0 * time), np.sin(2.0 * (time - lag))
    shown = law(predicted("torque", time, true) | {"torque_lag": lag, "filtered": 0.0})
    assert np.max(np.abs(shown - late)[inner]) < 0.02 * np.max(np.abs(true - late))
    # Of steady test points there is no past.
    assert law({"torque": 2.0, "torque_lag": lag}) == 2.0


def test_a_filter_is_that_of_first_order():
    time, lag = np.arange(0.0, 20.0, 0.02), 0.4
    late = np.sin(2.0 * time - np.arctan(2.0 * lag)) / np.hypot(1.0, 2.0 * lag)
    effect = effects.find("sensor-lag")
    q = predicted("torque", time, np.sin(2.0 * time)) | {"torque_lag": lag, "filtered": 1.0}
    assert np.max(np.abs(effect.laws["torque"](q) - late)[200:]) < 1e-3
    (other,) = effect.others
    np.testing.assert_array_equal(other["torque"](q | {"filtered": 0.0}), effect.laws["torque"](q))


@pytest.mark.parametrize(
    ("lag", "filtered"), [(0.31, 0.0), (0.31, 0.4), (1.9, 0.3), (-0.25, 0.51), (0.15, 1.0)]
)
def test_a_lag_has_its_derivative(lag, filtered):
    time = np.arange(0.0, 5.0, 0.05)
    law = effects.find("sensor-lag").laws["torque"]
    q = predicted("torque", time, np.cos(3.0 * time)) | {"filtered": filtered}
    step = 1e-6
    above, below = (law(q | {"torque_lag": lag + way * step}) for way in (1.0, -1.0))
    slope = slopes(law(q | {"torque_lag": seed(np.full(len(time), lag), "lag")}))["lag"]
    np.testing.assert_allclose(slope, (above - below) / (2.0 * step), atol=1e-4)


def relaxed(time, steady, velocity, length):
    """Roll on in steps so short that their order does not matter: length · dz/ds = steady − z."""
    z, found = steady[0], []
    for j in range(len(time)):
        moved = abs(velocity[j]) * (time[j] - time[j - 1]) if j else 0.0
        z += moved / length * (steady[j] - z)
        found.append(z)
    return np.array(found)


def test_sinkage_follows_over_a_distance_at_whatever_speed():
    time, length = np.arange(0.0, 60.0, 0.01), 0.03
    steady = 0.015 + 0.005 * np.sin(time)
    law = effects.find("sinkage-relaxation").laws["sinkage"]
    one_speed, varied = np.full(len(time), 0.1), 0.1 + 0.05 * np.sin(0.37 * time)
    for velocity in (one_speed, varied, -one_speed):
        shown = relaxed(time, steady, velocity, length)
        said = law(predicted("sinkage", time, steady, velocity) | {"length": length})
        assert np.max(np.abs(said - shown)) < 0.05 * np.max(np.abs(steady - shown))


def test_a_late_sinkage_is_one_of_a_rut_at_one_speed_alone():
    """A distance over the speed is a time: only where the speed varies do the two laws differ."""
    lag, relaxation = effects.find("sensor-lag"), effects.find("sinkage-relaxation")
    time = np.arange(0.0, 10.0, 0.05)
    pairs = (lag.others[0], relaxation.laws), (lag.laws, relaxation.others[0])
    for speed, same in ((np.full(200, 0.1), True), (0.1 + 0.05 * np.sin(time), False)):
        q = predicted("sinkage", time, 0.02 + 0.01 * np.sin(3.0 * time), speed)
        for in_time, on_the_way in pairs:
            late = in_time["sinkage"](q | {"sinkage_lag": 0.3, "filtered": 0.0})
            rolled = on_the_way["sinkage"](q | {"length": 0.03})
            assert np.allclose(late, rolled, rtol=1e-9) == same
    # Where no speed is known, nothing is late on the way.
    unknown = predicted("sinkage", time, np.sin(time)) | {"length": 0.03}
    np.testing.assert_array_equal(relaxation.laws["sinkage"](unknown), np.sin(time))
