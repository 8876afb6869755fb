"""What is shown is what the independent simulator and the model say of what is felt."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from simulator import wheel as independent
from simulator.soils import Soil

from terrain_cli import effects
from terrain_cli.effects import Effect, Parameter
from terrain_cli.errors import ConfigurationError, InputError
from terrain_cli.mechanics import rates
from terrain_cli.mechanics.past import along
from terrain_cli.mechanics.wheel_model import predict
from terrain_cli.simulation import read, simulate
from terrain_cli.simulation.scenario import SOILS, Chosen
from terrain_cli.telemetry.derived_channels import slip as slip_of

SHORT = {"duration": 20.0}


def truth(**options):
    log = simulate(read(None, {**SHORT, **options}))
    return log, log.truth["wheel"]


def values_of(log):
    return log.scenario.soils[0].values(0.1) | log.scenario.effect_values()


@pytest.mark.parametrize("name", ["dry-sand", "clayey-soil"])
def test_against_the_independent_simulator(name):
    _, shown = truth(soil=[name], drive=["mixed"])
    own = SOILS[name]
    soil = Soil(
        name,
        own.cohesion,
        np.arctan(own.tan_phi),
        own.shear_modulus,
        own.cohesive_modulus,
        own.frictional_modulus,
        own.sinkage_exponent,
        c1=0.5,
        c2=0.0,
    )
    for row in range(0, len(shown["time"]), 67):
        load, slip = float(shown["load"][row]), float(shown["slip"][row])
        wheel = independent.Wheel(radius=0.125, width=0.1)
        sinkage = independent.sinkage_under(soil, wheel, load, slip)
        forces = independent.forces(soil, wheel, sinkage, slip)
        assert shown["sinkage"][row] == pytest.approx(sinkage, rel=1e-6)
        assert shown["torque"][row] == pytest.approx(forces.torque, rel=1e-6)
        assert shown["drawbar_pull"][row] == pytest.approx(forces.pull, abs=1e-6 * load)


@pytest.mark.parametrize("name", effects.NAMES)
def test_what_is_shown_agrees_with_what_is_felt(name):
    """The model that reads the log with the true parameters finds nothing to explain."""
    log, shown = truth(drive=["mixed"], effects={name: {}}, wheels=1)
    wheel = log.scenario.geometry
    time = shown["time"]
    known = {c: v for c, v in shown.items() if not c.startswith("true_")}
    reads = log.scenario.effects[0].effect.reads
    one = np.zeros(len(time), dtype=int)
    of_rates = [name for name in reads if name.endswith("_rate")]
    known |= {n: rates.rate(time, one, shown[n.removesuffix("_rate")]) for n in of_rates}
    # Of a small wheel, so that the lines through the rut are short.
    known["rut_slope"] = rates.rut_slope(time, one, shown["sinkage"], shown["velocity"], radius=0.02)
    known["wheel_angle"] = rates.wheel_angle(time, one, shown["angular_velocity"])
    _, plain = truth(drive=["mixed"], wheels=1)
    known |= along(time, one, shown["velocity"], {c: plain[c] for c in ("torque", "drawbar_pull", "sinkage")})
    said = predict(log.scenario.model, wheel, known, values_of(log))
    # Rates, angles and what is between the samples of a log of 20 Hz are only nearly those of the drive.
    late = log.scenario.model.remembers
    exact = not of_rates and not late and not {"wheel_angle", "rut_slope"} & set(reads)
    close = 1e-6 if exact else 2e-2
    inner = slice(None) if exact else slice(10, -10)
    scale = {"load": 80.0, "torque": 3.0, "drawbar_pull": 20.0}
    assert np.max(np.abs(said.balance[inner])) < close * scale["load"]
    assert np.max(np.abs((said.torque - shown["torque"])[inner])) < close * scale["torque"]
    assert np.max(np.abs((said.drawbar_pull - shown["drawbar_pull"])[inner])) < close * scale["drawbar_pull"]


def test_every_effect_changes_something():
    without = simulate(read(None, {**SHORT, "drive": ["mixed"], "wheels": 4})).truth["rear-left"]
    for name in effects.NAMES:
        options = {**SHORT, "drive": ["mixed"], "wheels": 4, "effects": {name: {}}}
        shown = simulate(read(None, options)).truth["rear-left"]
        change = [
            np.sqrt(np.mean((shown[c] - without[c]) ** 2)) / np.std(without[c])
            for c in ("load", "torque", "sinkage", "drawbar_pull", "angular_velocity")
        ]
        assert max(change) > 0.01, name


def test_slip_follows_from_both_speeds():
    _, shown = truth(drive=["mixed"], effects={"wheel-radius": {"relative_error": 0.05}})
    slip = slip_of(shown["angular_velocity"], shown["velocity"], 0.125)
    np.testing.assert_allclose(slip, shown["slip"], atol=1e-12)
    # The true radius is larger than the one in rover.toml: the wheel turns less than it should.
    np.testing.assert_allclose(1.0 - slip, (1.0 - shown["true_slip"]) * 1.05, rtol=1e-9)


def test_load_cell_shows_what_its_law_turns_into_the_true_load():
    _, shown = truth(drive=["mixed"], effects={"load-bias": {"gain": 0.95, "offset": 4.0}})
    _, plain = truth(drive=["mixed"])
    np.testing.assert_array_equal(shown["true_load"], plain["load"])
    np.testing.assert_array_equal(shown["sinkage"], plain["sinkage"])
    slope, offset = np.polyfit(shown["true_load"], shown["load"], 1)
    assert slope == pytest.approx(0.95)
    assert offset == pytest.approx(4.0)


def test_effects_together():
    given = {"load-transfer": {"ratio": 0.3}, "slope": {}, "wheel-radius": {}, "slip-sinkage": {"n1": 0.4}}
    log, shown = truth(drive=["mixed"], effects=given)
    known = {c: v for c, v in shown.items() if not c.startswith("true_")}
    said = predict(log.scenario.model, log.scenario.geometry, known, values_of(log))
    assert np.max(np.abs(said.balance)) < 1e-5
    np.testing.assert_allclose(said.torque, shown["torque"], rtol=1e-6)


def with_law(quantity, law):
    parameter = Parameter("a", "1", 0.0, 0.1)
    effect = Effect(id="odd", title="Odd", kind="sensor", parameters=(parameter,), laws={quantity: law})
    scenario = read(None, {**SHORT, "drive": ["mixed"]})
    return replace(scenario, effects=(Chosen(effect, {"a": 0.1}),))


@pytest.mark.parametrize(
    ("quantity", "law"),
    [
        ("load", lambda q: q["load"] * (1.0 + q["a"] * np.sin(q["load"] / 30.0))),
        ("load", lambda q: q["load"] + q["a"] * q["measured_torque"] ** 2),
        ("slip", lambda q: q["slip"] + q["a"] * q["slip"] ** 3 + q["a"] * q["load"] / 800.0),
        ("slip", lambda q: q["slip"] + q["a"] * q["angular_velocity"] / 10.0),
        ("sinkage", lambda q: q["sinkage"] * (1.0 + q["a"] * q["slip"])),
    ],
)
def test_any_law_is_turned_round(quantity, law):
    scenario = with_law(quantity, law)
    shown = simulate(scenario).truth["wheel"]
    q = {**shown, "a": 0.1, "measured_torque": shown["torque"]}
    if quantity == "sinkage":
        q |= {"sinkage": shown["true_sinkage"], "slip": shown["true_slip"]}
        np.testing.assert_allclose(law(q), shown["sinkage"], rtol=1e-9)
    else:
        np.testing.assert_allclose(law(q), shown[f"true_{quantity}"], rtol=1e-8)
    assert np.max(np.abs(shown[quantity] - shown[f"true_{quantity}"])) > 1e-4


def test_a_law_that_cannot_be_turned_round():
    with pytest.raises(InputError, match="no measured load gives the load that the soil is to feel"):
        simulate(with_law("load", lambda q: 0.0 * q["load"] + q["a"]))


class TestLinear:
    def test_torque_is_that_of_the_line(self):
        log, shown = truth(drive=["mixed"], model="linear")
        known = {c: shown[c] for c in ("load", "sinkage", "slip")}
        said = predict(log.scenario.model, log.scenario.geometry, known, values_of(log))
        np.testing.assert_allclose(said.torque, shown["torque"], rtol=1e-12)

    def test_sinkage_is_that_of_the_full_model(self):
        _, linear = truth(drive=["mixed"], model="linear")
        _, full = truth(drive=["mixed"])
        np.testing.assert_allclose(linear["sinkage"], full["sinkage"], rtol=1e-12)


class TestBackwards:
    def test_soil_is_the_same_and_forces_turn_round(self):
        calm = {"duration": 10.0, "slip": 0.3, "load": 1.0}
        _, shown = truth(part=[calm, {**calm, "speed": 0.0}, {**calm, "speed": -1.0}], duration=30.0)
        ahead, back = np.searchsorted(shown["time"], (5.0, 25.0))
        for channel in ("torque", "drawbar_pull", "angular_velocity", "velocity"):
            assert shown[channel][back] == pytest.approx(-shown[channel][ahead]), channel
        for channel in ("sinkage", "slip", "load"):
            assert shown[channel][back] == pytest.approx(shown[channel][ahead]), channel

    def test_standing(self):
        calm = {"duration": 10.0, "slip": 0.3, "load": 1.0}
        _, shown = truth(part=[calm, {**calm, "speed": 0.0}], duration=20.0)
        (last,) = np.searchsorted(shown["time"], [15.0])
        for channel in ("torque", "drawbar_pull", "angular_velocity", "velocity"):
            assert shown[channel][last] == 0.0
        assert np.isnan(shown["slip"][last])
        assert shown["sinkage"][last] == pytest.approx(shown["sinkage"][100])


@pytest.mark.parametrize("name", ["sensor-lag", "acceleration-torque", "grouser-ripple"])
def test_turning_round_leaves_no_spike(name):
    _, plain = truth(drive=["reverse"], rate=50.0)
    _, shown = truth(drive=["reverse"], rate=50.0, effects={name: {}})
    assert np.max(np.abs(shown["torque"])) < 1.5 * np.max(np.abs(plain["torque"]))


@pytest.mark.parametrize("filtered", [0.0, 0.5, 1.0])
def test_a_late_channel_is_delayed_then_filtered(filtered):
    parts = [{"slip": {"steps": [0.1, 0.5, 0.2, 0.6]}, "duration": 12.0}]
    lag = {"torque_lag": 0.4, "drawbar_pull_lag": 0.0, "sinkage_lag": 0.0, "filtered": filtered}
    _, plain = truth(part=parts, rate=50.0)
    _, shown = truth(part=parts, rate=50.0, effects={"sensor-lag": lag})
    time = np.arange(len(plain["torque"])) / 50.0
    delayed = np.interp(time - 0.4 * (1.0 - filtered), time, plain["torque"])
    for step, true in enumerate(delayed[1:], 1):
        kept = np.exp(-0.02 / (0.4 * filtered)) if filtered else 0.0
        delayed[step] = kept * delayed[step - 1] + (1.0 - kept) * true
    late = np.max(np.abs(shown["torque"] - plain["torque"]))
    assert np.max(np.abs(shown["torque"] - delayed)) < 0.1 * late
    np.testing.assert_allclose(shown["drawbar_pull"], plain["drawbar_pull"], rtol=1e-6)


def test_a_wheel_that_stands_stays_as_deep_as_it_is():
    parts = [
        {"slip": [0.1, 0.5], "duration": 8.0},
        {"slip": 0.5, "load": [1.0, 1.4], "speed": 0.0, "duration": 5.0},
        {"slip": 0.5, "load": 1.4, "duration": 8.0},
    ]
    _, plain = truth(part=parts, rate=50.0)
    _, shown = truth(part=parts, rate=50.0, effects={"sinkage-relaxation": {"length": 0.05}})
    standing = np.flatnonzero(shown["velocity"] == 0.0)
    assert len(standing) > 200
    assert np.ptp(plain["sinkage"][standing]) > 1e-3
    assert np.ptp(shown["sinkage"][standing]) < 1e-5
    # Before and after, it comes to where the wheel stands without the effect, and is behind until then.
    assert shown["sinkage"][-1] == pytest.approx(plain["sinkage"][-1], rel=1e-3)
    assert np.all(np.diff(shown["sinkage"][standing[-1] + 5 :]) > -1e-9)


def test_skid():
    _, shown = truth(part=[{"slip": -0.2, "load": 1.0, "duration": 10.0}])
    np.testing.assert_allclose(slip_of(shown["angular_velocity"], shown["velocity"], 0.125), -0.2)
    assert np.all(shown["torque"] < 0.0)


def test_soft_soil_gets_a_light_wheel():
    assert read(None, {"soil": ["snow"]}).load < 20.0
    assert read(None, {"soil": ["dry-sand"]}).load == 80.0
    with pytest.raises(InputError, match=r"snow does not carry .* N at slip"):
        truth(soil=["snow"], load=80.0)


def test_needs():
    wheel = {"radius": 0.125, "width": 0.1, "grouser_count": 0, "grouser_height": 0.0}
    with pytest.raises(ConfigurationError, match="effect grousers needs grouser_height"):
        truth(wheel=wheel, effects={"grousers": {}})
