"""Channels that are shown late, in time or along the way: what the laws take for true is what was."""

from __future__ import annotations

import numpy as np
import pytest

from terrain_cli import effects
from terrain_cli.mechanics import rates
from terrain_cli.mechanics.dual import seed, slopes


def test_a_lag_is_taken_out_of_a_slow_signal():
    time, lag = np.linspace(0.0, 10.0, 500), 0.1
    true, late = np.sin(time), np.sin(time - lag)
    law = effects.find("sensor-lag").laws["torque"]
    shown = law({"torque": true, "torque_lag": lag, "torque_rate": np.cos(time - lag)})
    assert np.max(np.abs(shown - late)) < 0.06 * np.max(np.abs(true - late))
    # A channel whose rate is not known is taken as it is.
    assert law({"torque": 2.0, "torque_lag": lag}) == 2.0


def shown_by(time, shown):
    """Return the rate of a channel, and its mean rates over the next moments, as laws read them."""
    one = np.zeros(len(time), dtype=int)
    means = rates.mean_rates(time, one, shown)
    named = {f"torque_rate_{lead:g}": means[:, 1 + k] for k, lead in enumerate(rates.LEADS)}
    return {"torque_rate": rates.rate(time, one, shown), **named}


@pytest.mark.parametrize("lag", [0.03, 0.25, 0.6, -0.1])
def test_a_delay_is_taken_out_however_quick_the_changes(lag):
    time = np.arange(0.0, 20.0, 0.05)
    law, inner = effects.find("sensor-lag").laws["torque"], slice(60, -60)
    true, late = np.sin(2.0 * time), np.sin(2.0 * (time - lag))
    q = {"torque": true, "torque_lag": lag, "filtered": 0.0, **shown_by(time, late)}
    assert np.max(np.abs(law(q) - late)[inner]) < 0.06 * np.max(np.abs(true - late))
    by_rate = {name: q[name] for name in ("torque", "torque_lag", "torque_rate")}
    assert np.max(np.abs(law(by_rate) - late)[inner]) > 0.8 * abs(lag) * np.max(np.abs(true - late))


def test_a_filter_is_taken_out_by_the_rate_alone():
    time, lag = np.arange(0.0, 20.0, 0.02), 0.4
    lagged = np.sin(2.0 * time - np.arctan(2.0 * lag)) / np.hypot(1.0, 2.0 * lag)
    q = {"torque": np.sin(2.0 * time), "torque_lag": lag, "filtered": 1.0, **shown_by(time, lagged)}
    shown = effects.find("sensor-lag").laws["torque"](q)
    assert np.max(np.abs(shown - lagged)[50:-50]) < 0.01


@pytest.mark.parametrize(("lag", "filtered"), [(0.3, 0.0), (0.3, 0.4), (1.9, 0.3), (-0.25, 0.5), (0.15, 1.0)])
def test_a_lag_has_its_derivative(lag, filtered):
    time = np.arange(0.0, 5.0, 0.05)
    law = effects.find("sensor-lag").laws["torque"]
    q = {"torque": np.cos(time), "filtered": filtered, **shown_by(time, np.sin(3.0 * time))}
    step = 1e-6
    above, below = (law(q | {"torque_lag": lag + way * step}) for way in (1.0, -1.0))
    slope = slopes(law(q | {"torque_lag": seed(np.full(len(time), lag), "lag")}))["lag"]
    np.testing.assert_allclose(slope, (above - below) / (2.0 * step), atol=1e-6)


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
    one = np.zeros(len(time), dtype=int)
    one_speed, varied = np.full(len(time), 0.1), 0.1 + 0.05 * np.sin(0.37 * time)
    for velocity in (one_speed, varied, -one_speed):
        shown = relaxed(time, steady, velocity, length)
        slope = rates.rut_slope(time, one, shown, velocity, radius=0.03)
        said = law({"sinkage": steady, "length": length, "rut_slope": slope})
        inner = slice(100, -100)
        assert np.max(np.abs(said - shown)[inner]) < 0.1 * np.max(np.abs(steady - shown)[inner])


def test_a_late_sinkage_is_one_of_a_rut_at_one_speed_alone():
    """A distance over the speed is a time: only where the speed varies do the two laws differ."""
    lag, relaxation = effects.find("sensor-lag"), effects.find("sinkage-relaxation")
    (other,) = lag.others
    q = {"sinkage": 0.02, "rut_slope": np.array([0.01, -0.03, 0.02])}
    for velocity, same in (([0.1, 0.1, 0.1], True), ([0.1, 0.05, 0.2], False)):
        late = other["sinkage"](q | {"sinkage_lag": 0.3, "velocity": np.array(velocity)})
        rolled = relaxation.laws["sinkage"](q | {"length": 0.03})
        assert np.allclose(late, rolled, rtol=1e-12) == same
    # And so are a delay in time and one over a distance.
    columns = shown_by(np.arange(3.0), np.array([0.02, 0.01, 0.03]))
    q |= {name.replace("torque", "sinkage"): column for name, column in columns.items()}
    (place_before,) = relaxation.others
    for velocity, same in (([0.1, 0.1, 0.1], True), ([0.1, 0.05, 0.2], False)):
        late = lag.laws["sinkage"](q | {"sinkage_lag": 0.3, "filtered": 0.0})
        placed = place_before["sinkage"](
            q | {"length": 0.03, "velocity": np.array(velocity), "wheel_radius": 0.1}
        )
        assert np.allclose(late, placed, rtol=1e-12) == same
    # Where no speed is known, it is the law of the model.
    by_time = {"sinkage": 0.02, "sinkage_lag": 0.3, "sinkage_rate": 0.001}
    assert other["sinkage"](by_time) == lag.laws["sinkage"](by_time)
