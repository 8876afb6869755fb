"""The simulator's physical effects: right by themselves, and the same by name as those of the program."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from known_effects import KNOWN_EFFECTS
from simulator import (
    CHANNELS,
    DRY_SAND,
    EFFECTS,
    FURTHER,
    SANDY_LOAM,
    Drive,
    Track,
    Wheel,
    base_contact,
    constant,
    sensing,
    simulate,
    steps,
    sweep,
    undulation,
    wave,
)
from simulator import wheel as exact
from simulator.effects import OnGround, forces_with, freeze
from simulator.wheel import Moment

from terrain_cli.effects import catalogue
from terrain_cli.mechanics.past import along
from terrain_cli.mechanics.rates import rate, rut_slope, wheel_angle
from terrain_cli.mechanics.wheel_model import Model, WheelGeometry, predict

WHEEL = Wheel(grouser_height=0.008, grouser_count=16)
SOIL = base_contact(DRY_SAND)
FAST = {"sinkage-relaxation", "sensor-lag", "acceleration-torque", "grouser-ripple"}


def drive(effects, *, seconds=12.0, rate=4.0, **options):
    track = Track(
        "wheel",
        [(SOIL, seconds)],
        load=undulation(70.0, 0.3, 9.0),
        slip=wave(0.35, 0.7, 11.0),
        pass_number=steps([(0.0, seconds / 3), (1.0, seconds / 3), (2.0, seconds / 3)]),
        motor_temperature=sweep(20.0, 60.0, seconds),
    )
    return Drive(
        [track],
        wheel=WHEEL,
        speed=wave(0.1, 0.3, 13.0),
        pitch=wave(0.1, 1.0, 17.0, 0.1),
        slip_angle=wave(0.1, 1.5, 15.0),
        yaw_rate=wave(0.01, 2.0, 12.0),
        effects=effects,
        rate=rate,
        channels=(*CHANNELS, *FURTHER),
        **options,
    )


def log_of(effects, **options):
    return simulate(drive(effects, **options)).wheels["wheel"]


def test_the_program_and_the_simulator_know_the_same_effects():
    known = {name: effect for name, effect in catalogue().items() if effect.origin == "catalogue"}
    assert set(known) == set(EFFECTS) == set(KNOWN_EFFECTS)
    for name, effect in known.items():
        nulls = {p.name: p.null for p in effect.parameters if not p.shape}
        own = {p.name for p in effect.parameters}
        assert set(EFFECTS[name].parameters) == own
        assert {p: EFFECTS[name].parameters[p] for p in nulls} == nulls


@pytest.mark.parametrize("name", KNOWN_EFFECTS)
def test_an_effect_of_no_size_does_nothing(name):
    plain, without = log_of({}), log_of({name: {}})
    for channel, series in plain.measured.items():
        np.testing.assert_allclose(
            without.measured[channel].values, series.values, rtol=1e-6, atol=1e-6, err_msg=channel
        )


@pytest.mark.parametrize("name", KNOWN_EFFECTS)
def test_program_and_simulator_mean_the_same(name):
    typical = KNOWN_EFFECTS[name].values
    log = log_of({name: typical}, rate=50.0 if KNOWN_EFFECTS[name].fast else 4.0)
    columns = log.aligned()
    one = np.zeros(len(columns["time"]))
    for channel in ("torque", "drawbar_pull", "sinkage", "angular_velocity"):
        columns[f"{channel}_rate"] = rate(columns["time"], one, columns[channel])
    plain = log_of({}, rate=50.0 if KNOWN_EFFECTS[name].fast else 4.0).aligned()
    shown = {channel: plain[channel] for channel in ("torque", "drawbar_pull", "sinkage")}
    columns |= along(columns["time"], one, columns["velocity"], shown)
    # Of a small wheel, so that the lines through the rut are short.
    way = columns["sinkage"], columns["velocity"]
    columns["rut_slope"] = rut_slope(columns["time"], one, *way, radius=0.02)
    columns["wheel_angle"] = wheel_angle(columns["time"], one, columns["angular_velocity"])
    values = {
        "cohesion": SOIL.cohesion,
        "tan_phi": SOIL.tan_phi,
        "shear_modulus": SOIL.shear_modulus,
        "stiffness": SOIL.stiffness(WHEEL.width),
        "sinkage_exponent": SOIL.exponent,
    } | {f"{name}.{parameter}": value for parameter, value in typical.items()}
    geometry = WheelGeometry(WHEEL.radius, WHEEL.width, WHEEL.grouser_height, WHEEL.grouser_count)
    model = Model(effects=(catalogue()[name],))
    allowed = KNOWN_EFFECTS[name].same_within
    # The ends of a log have rates on one side only.
    inside = slice(3, -3)
    by_load = predict(
        model, geometry, {n: c for n, c in columns.items() if n != "sinkage"}, values, given="load"
    )
    np.testing.assert_allclose(by_load.sinkage[inside], columns["sinkage"][inside], rtol=allowed)
    by_sinkage = predict(model, geometry, columns, values)
    np.testing.assert_allclose(by_sinkage.balance[inside] / 70.0, 0.0, atol=allowed)
    for found in (by_load, by_sinkage):
        scale = columns["torque"].mean()
        np.testing.assert_allclose(
            found.torque[inside] / scale, columns["torque"][inside] / scale, atol=allowed
        )
        np.testing.assert_allclose(
            found.drawbar_pull[inside] / 70.0, columns["drawbar_pull"][inside] / 70.0, atol=allowed
        )


def test_the_linear_base_takes_effects_on_contact_and_soil():
    effects = {
        name: KNOWN_EFFECTS[name].values
        for name in ("max-stress-angle", "rear-contact", "grousers", "shear-modulus", "multi-pass")
    }
    columns = log_of(effects, model="linear").aligned()
    known = catalogue()
    linear = {name: known[name] for name in effects if "stiffness" not in known[name].laws}
    values = {"cohesion": SOIL.cohesion, "tan_phi": SOIL.tan_phi, "shear_modulus": SOIL.shear_modulus} | {
        f"{name}.{parameter}": value for name in linear for parameter, value in effects[name].items()
    }
    geometry = WheelGeometry(WHEEL.radius, WHEEL.width, WHEEL.grouser_height, WHEEL.grouser_count)
    fresh = columns["pass_number"] == 0.0
    found = predict(
        Model("linear", tuple(linear.values())),
        geometry,
        {name: column[fresh] for name, column in columns.items()},
        values,
    )
    np.testing.assert_allclose(found.torque, columns["torque"][fresh], rtol=1e-6)
    np.testing.assert_allclose(found.drawbar_pull / 70.0, columns["drawbar_pull"][fresh] / 70.0, atol=1e-6)


OTHERS = [name for name in KNOWN_EFFECTS if "other" in EFFECTS[name].forms and name != "load-transfer"]


@pytest.mark.parametrize("name", OTHERS)
def test_the_other_form_is_another_law_of_the_same_thing(name):
    options = {"rate": 20.0, "seconds": 6.0} if KNOWN_EFFECTS[name].fast else {}
    plain = log_of({}, **options)
    one = log_of({name: KNOWN_EFFECTS[name].values}, **options)
    other = log_of({name: {**KNOWN_EFFECTS[name].values, "form": "other"}}, **options)

    def apart(a, b):
        channels = ("torque", "drawbar_pull", "sinkage")
        return max(
            np.sqrt(np.mean((a.measured[c].values - b.measured[c].values) ** 2))
            / np.std(plain.measured[c].values)
            for c in channels
        )

    assert 1e-4 < apart(one, other) < 0.9 * apart(one, plain)


def test_effects_that_cannot_be_are_errors():
    with pytest.raises(ValueError, match="no effect 'slip'"):
        freeze({"slip": {}})
    with pytest.raises(ValueError, match="slip-sinkage has no n3"):
        freeze({"slip-sinkage": {"n3": 1.0}})
    with pytest.raises(ValueError, match="load-bias has no form other"):
        freeze({"load-bias": {"form": "other"}})
    with pytest.raises(ValueError, match="never early"):
        log_of({"sensor-lag": {"torque_lag": -0.1, "filtered": 1.0}})


@pytest.mark.parametrize(
    ("effects", "moment"),
    [
        ({"slip-sinkage": {"n1": 0.5}, "max-stress-angle": {"c1": 0.2, "c2": 0.3}}, {}),
        ({"grousers": {"lambda_s": 1.0}, "rear-contact": {"c3": 0.4}}, {}),
        ({"flexible-wheel": {"deflection": 0.1}, "post-peak-softening": {"loss": 0.5}}, {}),
        ({"multi-pass": {"stiffness_gain": 0.5}, "strength-curvature": {"B": 0.2}}, {"pass_number": 1.0}),
        ({"shear-modulus": {"k1": 2.0}, "side-slip": {"lateral": 5.0}}, {"slip_angle": 0.2}),
    ],
)
def test_tables_with_effects_are_exact_to_a_millionth(effects, moment):
    rng = np.random.default_rng(1)
    load, slip = rng.uniform(50.0, 100.0, 80), rng.uniform(0.02, 0.7, 80)
    moments = {name: np.full(80, moment.get(name, 0.1)) for name in Moment.__slots__}
    frozen = freeze(effects)
    found = forces_with(frozen, SANDY_LOAM, WHEEL, load, slip, moments)
    laws = OnGround(frozen, Moment(**{name: moments[name][0] for name in Moment.__slots__}))
    for j in range(0, 80, 8):
        depth = exact.sinkage_under(SANDY_LOAM, WHEEL, load[j], slip[j], laws=laws)
        truth = exact.forces(SANDY_LOAM, WHEEL, depth, slip[j], laws=laws)
        assert found[0][j] == pytest.approx(depth, rel=1e-6)
        assert found[1][j] == pytest.approx(truth.torque, rel=1e-6)
        assert found[2][j] == pytest.approx(truth.pull, abs=1e-6 * load[j])


@pytest.mark.parametrize(
    ("effects", "reads", "low", "high"),
    [
        ({"rate-dependence": {"beta": 0.15}}, "velocity", 0.02, 0.2),
        ({"side-slip": {"k_growth": 1.2, "lateral": 8.0}}, "slip_angle", -0.25, 0.25),
        ({"hardpan": {"modulus": 1e7, "top": 0.012}}, "velocity", 0.1, 0.1),
    ],
)
def test_long_drives_are_interpolated_to_a_thousandth_of_what_the_effect_does(effects, reads, low, high):
    rng = np.random.default_rng(2)
    n = 500
    load, slip = rng.uniform(56.0, 69.0, n), rng.uniform(0.21, 0.39, n)
    moments = {name: np.full(n, 0.1) for name in Moment.__slots__} | {reads: rng.uniform(low, high, n)}
    found = np.array(forces_with(freeze(effects), SOIL, WHEEL, load, slip, moments))
    without = np.array(forces_with((), SOIL, WHEEL, load, slip, moments))
    some = slice(0, n, 20)
    few = {name: column[some] for name, column in moments.items()}
    truth = np.array(forces_with(freeze(effects), SOIL, WHEEL, load[some], slip[some], few))
    assert np.all(np.abs(found[:, some] - truth).max(axis=1) < 1e-3 * np.abs(found - without).max(axis=1))


def test_further_columns_are_measured_and_drive_laws_of_their_own():
    def law(shown):
        shown["torque"] = shown["torque"] + 0.1 * shown["voltage"] * np.sin(shown["wheel_angle"])

    options = {"further": {"voltage": sweep(24.0, 28.0, 12.0)}}
    plain, bent = log_of({}, **options), log_of({}, **options, laws=(law,))
    voltage = plain.measured["voltage"].values
    assert (voltage[0], voltage[-1]) == (24.0, pytest.approx(28.0, abs=0.1))
    omega = bent.measured["angular_velocity"].values
    angle = np.concatenate([[0.0], np.cumsum(0.5 * (omega[1:] + omega[:-1])) / 4.0])
    added = bent.measured["torque"].values - plain.measured["torque"].values
    np.testing.assert_allclose(added, 0.1 * voltage * np.sin(angle), atol=0.02)
    np.testing.assert_array_equal(bent.truth["torque"], plain.truth["torque"])


def test_sensors_do_not_change_the_truth():
    plain, biased = (
        log_of(effects)
        for effects in (
            {},
            {
                "gear-efficiency": {"eta": 0.5},
                "sinkage-bias": {"offset": 0.01},
                "load-bias": {"offset": 9.0},
            },
        )
    )
    for channel in ("torque", "sinkage", "load", "drawbar_pull"):
        np.testing.assert_array_equal(plain.truth[channel], biased.truth[channel])
    np.testing.assert_allclose(biased.measured["torque"].values, 2.0 * biased.truth["torque"])
    np.testing.assert_allclose(biased.measured["sinkage"].values, biased.truth["sinkage"] + 0.01)
    np.testing.assert_allclose(biased.measured["load"].values, biased.truth["load"] + 9.0)


def test_effects_on_sensors_act_in_their_order():
    friction, gear = {"drivetrain-friction": {"Tc": 1.0}}, {"gear-efficiency": {"eta": 0.5}}
    behind, before = log_of({**gear, **friction}), log_of({**friction, **gear})
    np.testing.assert_allclose(behind.measured["torque"].values, 2.0 * behind.truth["torque"] + 1.0)
    np.testing.assert_allclose(before.measured["torque"].values, 2.0 * (before.truth["torque"] + 1.0))


def test_slip_and_wheel_speed_tell_one_story():
    log = log_of({"wheel-radius": {"relative_error": 0.05}})
    measured = {channel: series.values for channel, series in log.measured.items()}
    stated = 1.0 - measured["velocity"] / (WHEEL.radius * measured["angular_velocity"])
    np.testing.assert_allclose(measured["slip"], stated, atol=1e-12)
    np.testing.assert_allclose(1.0 - stated, 1.05 * (1.0 - log.truth["slip"]))


def test_a_filter_follows_a_ramp_at_its_lag():
    time = np.arange(0.0, 5.0, 0.1)
    ramp = sensing.late(lambda t: {"torque": 3.0 * t}, "torque", time, 0.2, filtered=1.0)
    np.testing.assert_allclose(ramp, 3.0 * (time - 0.2 * (1.0 - np.exp(-time / 0.2))), atol=1e-3)
    shifted = sensing.late(lambda t: {"torque": 3.0 * t}, "torque", time, 0.2, filtered=0.0)
    np.testing.assert_allclose(shifted, 3.0 * np.maximum(time - 0.2, 0.0))


def test_the_second_wheel_drives_in_the_rut_of_the_first():
    front = Track("front", [(SOIL, 2.0)], load=constant(80.0), slip=constant(0.3))
    rear = replace(front, name="rear", pass_number=constant(1.0))
    run = simulate(Drive([front, rear], rate=10.0, effects={"multi-pass": {"stiffness_gain": 0.5}}))
    shallow, deep = (run.wheels[name].truth["sinkage"] for name in ("rear", "front"))
    stiff = replace(
        SOIL, cohesive_modulus=1.5 * SOIL.cohesive_modulus, frictional_modulus=1.5 * SOIL.frictional_modulus
    )
    assert deep[0] == pytest.approx(exact.sinkage_under(SOIL, Wheel(), 80.0, 0.3), rel=1e-6)
    assert shallow[0] == pytest.approx(exact.sinkage_under(stiff, Wheel(), 80.0, 0.3), rel=1e-6)


def test_a_skidding_wheel_is_braked():
    track = Track("wheel", [(SOIL, 2.0)], load=constant(80.0), slip=constant(-0.3))
    log = simulate(
        Drive([track], rate=10.0, channels=(*CHANNELS, "slip"), effects={"slip-sinkage": {}})
    ).wheels["wheel"]
    assert log.truth["torque"].max() < 0.0
    np.testing.assert_allclose(log.measured["slip"].values, -0.3)
    np.testing.assert_allclose(0.125 * log.measured["angular_velocity"].values, 0.7 * 0.1)


def test_a_climb_moves_load_backwards():
    log = log_of({"load-transfer": {"ratio": 0.15, "slope_ratio": 0.1}, "slope": {"factor": 1.0}})
    pull, flat = log.measured["drawbar_pull"].values, log.measured["load"].values
    pitch, acceleration = log.truth["pitch"], log.truth["acceleration"]
    moved = 0.15 * (pull + flat / 9.80665 * acceleration) + 0.1 * flat * np.sin(pitch)
    expected = (flat + moved) * np.cos(pitch)
    np.testing.assert_allclose(log.truth["load"], expected, rtol=1e-8)
    assert np.ptp(log.truth["load"] - flat) > 2.0


def test_a_rover_on_its_own_is_held_by_the_slope_alone():
    log = log_of({"load-transfer": {"ratio": 0.15, "form": "other"}})
    flat, truth = log.measured["load"].values, log.truth
    held = flat * (np.sin(truth["pitch"]) + truth["acceleration"] / 9.80665)
    np.testing.assert_allclose(truth["load"], flat + 0.15 * held, rtol=1e-10)


def test_the_wall_before_a_wheel_is_that_of_terzaghi():
    # Nc, Nq and Nγ of Terzaghi for φ = 30°: 37.2, 22.5 and 19.7 (Bowles, Foundation Analysis and Design).
    soil = replace(SOIL, cohesion=1e3, friction_angle=math.radians(30.0))
    t, cos2 = math.tan(math.radians(30.0)), 0.75
    expected = (
        0.1 * 0.05 * (1e3 * (37.2 - t) * cos2 + 0.5 * 1600 * 9.80665 * (2 * 19.7 / t + 1) * cos2 * 0.05)
    )
    assert sensing.wall(soil, 0.1, np.array([0.05]))[0] == pytest.approx(expected, rel=0.2)
