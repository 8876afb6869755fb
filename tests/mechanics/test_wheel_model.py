"""The forward model against the independent wheel: both bases, both uses, laws and derivatives."""

from __future__ import annotations

import math

import numpy as np
import pytest
from simulator import SNOW, SOILS, Soil, Wheel
from simulator import wheel as exact
from simulator.effects import base_contact

from terrain_cli.errors import ConfigurationError, InputError
from terrain_cli.mechanics.dual import Dual, slopes, value
from terrain_cli.mechanics.effect import Effect, Parameter
from terrain_cli.mechanics.wheel_model import Model, WheelGeometry, predict

WHEEL = Wheel(radius=0.1, width=0.1)
GEOMETRY = WheelGeometry(WHEEL.radius, WHEEL.width)
LOOSE, CARRYING = Model(), [soil for soil in SOILS.values() if soil is not SNOW]
NAMES = ("cohesion", "tan_phi", "shear_modulus", "stiffness", "sinkage_exponent")


def values_of(soil, width=WHEEL.width):
    return {
        "cohesion": soil.cohesion,
        "tan_phi": soil.tan_phi,
        "shear_modulus": soil.shear_modulus,
        "stiffness": soil.stiffness(width),
        "sinkage_exponent": soil.exponent,
    }


def drawn(n, seed=0):
    """Draw soils within ranges that enclose published ones; every value an array."""
    rng = np.random.default_rng(seed)
    return {
        "cohesion": rng.uniform(0.5e3, 10e3, n),
        "tan_phi": np.tan(np.radians(rng.uniform(15.0, 40.0, n))),
        "shear_modulus": rng.uniform(0.01, 0.03, n),
        "stiffness": rng.uniform(0.9e3, 15e3, n) / WHEEL.width + rng.uniform(0.5e6, 1.6e6, n),
        "sinkage_exponent": rng.uniform(0.5, 1.2, n),
    }


def soil_of(values, j):
    c, tan_phi, k, keq, n = (float(values[name][j]) for name in NAMES)
    return Soil("drawn", c, math.atan(tan_phi), k, 0.0, keq, n, c1=0.5, c2=0.0)


def changed(quantity, law, parameters=(), needs=()):
    """Return an effect of one law, whose parameters have the null value 0."""
    return Effect(
        id="trial",
        title="Trial",
        kind="contact",
        parameters=tuple(Parameter(p, "1", 0.0, 1.0) for p in parameters),
        laws={quantity: law},
        needs=needs,
    )


# Values


@pytest.mark.parametrize("soil", CARRYING, ids=lambda soil: soil.name)
def test_forces_at_a_measured_sinkage_are_those_of_the_wheel(soil):
    sinkage, slip = np.array([0.002, 0.01, 0.03, 0.07]), np.array([0.0, 0.1, 0.5, 0.95])
    found = predict(LOOSE, GEOMETRY, {"sinkage": sinkage, "slip": slip}, values_of(soil))
    assert found.balance is None
    for j in range(4):
        truth = exact.forces(base_contact(soil), WHEEL, sinkage[j], slip[j])
        assert found.load[j] == pytest.approx(truth.load, rel=1e-8)
        assert found.torque[j] == pytest.approx(truth.torque, rel=1e-8)
        assert found.drawbar_pull[j] == pytest.approx(truth.pull, abs=1e-8 * truth.load)


@pytest.mark.parametrize("soil", CARRYING, ids=lambda soil: soil.name)
def test_sinkage_under_a_load_is_that_of_the_wheel(soil):
    load, slip = np.array([30.0, 80.0, 120.0]), np.array([0.05, 0.3, 0.9])
    found = predict(LOOSE, GEOMETRY, {"load": load, "slip": slip}, values_of(soil), given="load")
    for j in range(3):
        depth = exact.sinkage_under(base_contact(soil), WHEEL, load[j], slip[j])
        truth = exact.forces(base_contact(soil), WHEEL, depth, slip[j])
        assert found.sinkage[j] == pytest.approx(depth, rel=1e-8)
        assert found.torque[j] == pytest.approx(truth.torque, rel=1e-8)
        assert found.drawbar_pull[j] == pytest.approx(truth.pull, abs=1e-8 * load[j])


@pytest.mark.parametrize("soil", CARRYING, ids=lambda soil: soil.name)
def test_linear_base_is_the_wheel_with_triangular_stresses(soil):
    sinkage, slip = np.array([0.002, 0.01, 0.03, 0.07]), np.array([0.0, 0.1, 0.5, 0.95])
    truth = [exact.forces(soil, WHEEL, sinkage[j], slip[j], "linear") for j in range(4)]
    load = np.array([force.load for force in truth])
    values = {name: values_of(soil)[name] for name in NAMES[:3]}
    found = predict(Model("linear"), GEOMETRY, {"load": load, "sinkage": sinkage, "slip": slip}, values)
    np.testing.assert_allclose(found.torque, [force.torque for force in truth], rtol=1e-9)
    np.testing.assert_allclose(found.drawbar_pull / load, [f.pull / f.load for f in truth], atol=1e-9)
    assert found.sinkage is None


def test_balance_is_the_load_carried_less_the_load_measured():
    channels = {
        "sinkage": np.array([0.01, 0.02]),
        "slip": np.array([0.2, 0.4]),
        "load": np.array([50.0, 60.0]),
    }
    found = predict(LOOSE, GEOMETRY, channels, values_of(SOILS["dry sand"]))
    np.testing.assert_allclose(found.balance, found.load - channels["load"], rtol=1e-12)


def test_every_draw_that_is_carried_finds_its_sinkage():
    n = 20_000
    rng = np.random.default_rng(5)
    values, slip, load = drawn(n, seed=5), rng.uniform(0.0, 1.0, n), 98.1 * rng.uniform(0.05, 4.0, n)
    found = predict(LOOSE, GEOMETRY, {"load": load, "slip": slip}, values, given="load")
    deep = np.full(n, WHEEL.radius * (1.0 - math.cos(1.5)))
    limit = predict(LOOSE, GEOMETRY, {"sinkage": deep, "slip": slip}, values).load
    np.testing.assert_array_equal(np.isnan(found.sinkage), limit < load)
    carried = np.flatnonzero(~np.isnan(found.sinkage))
    assert len(carried) > 0.9 * n
    again = predict(
        LOOSE,
        GEOMETRY,
        {"sinkage": found.sinkage[carried], "slip": slip[carried]},
        {name: number[carried] for name, number in values.items()},
    )
    np.testing.assert_allclose(again.load, load[carried], rtol=1e-7)
    for j in carried[:: len(carried) // 20]:
        depth = exact.sinkage_under(soil_of(values, j), WHEEL, load[j], slip[j])
        assert found.sinkage[j] == pytest.approx(depth, rel=1e-7)


def test_a_load_that_sinks_the_wheel_to_its_axle_has_no_sinkage():
    channels = {"load": np.array([5.0, 80.0, -3.0]), "slip": np.full(3, 0.3)}
    found = predict(LOOSE, GEOMETRY, channels, values_of(SNOW), given="load")
    np.testing.assert_array_equal(np.isnan(found.sinkage), [False, True, True])
    assert found.sinkage[0] == pytest.approx(
        exact.sinkage_under(base_contact(SNOW), WHEEL, 5.0, 0.3), rel=1e-8
    )


def test_many_samples_are_sample_by_sample():
    n = 5000
    values, rng = drawn(n, seed=6), np.random.default_rng(6)
    channels = {"load": rng.uniform(20.0, 120.0, n), "slip": rng.uniform(0.0, 1.0, n)}
    found = predict(LOOSE, GEOMETRY, channels, values, given="load", by=["cohesion"])
    for j in (0, 1023, 1024, 4999):
        one = predict(
            LOOSE,
            GEOMETRY,
            {name: column[[j]] for name, column in channels.items()},
            {name: number[[j]] for name, number in values.items()},
            given="load",
            by=["cohesion"],
        )
        assert value(one.torque)[0] == pytest.approx(value(found.torque)[j], rel=1e-8)
        assert slopes(one.torque)["cohesion"][0] == pytest.approx(
            slopes(found.torque)["cohesion"][j], rel=1e-6
        )


# Derivatives


def differenced(run, channels, values, name, size):
    """Differentiate by sixth-order differences whatever `run` returns as an array."""
    step = 1e-3 * size
    total = 0.0
    for m, weight in ((1.0, 1.5), (2.0, -0.6), (3.0, 0.1)):
        ends = []
        for sign in (1.0, -1.0):
            moved = [
                {**part, name: part[name] + sign * m * step} if name in part else part
                for part in (channels, values)
            ]
            ends.append(run(*moved))
        total = total + weight * (ends[0] - ends[1]) / (2.0 * m * step)
    return total


@pytest.mark.parametrize(
    ("name", "given"), [(name, given) for given in ("sinkage", "load") for name in (*NAMES, "slip", given)]
)
def test_derivatives_are_exact(name, given):
    n = 200
    rng, values = np.random.default_rng(7), drawn(n, seed=7)
    channels = {"slip": rng.uniform(0.05, 0.95, n)}
    channels[given] = rng.uniform(0.003, 0.05, n) if given == "sinkage" else rng.uniform(20.0, 100.0, n)
    rows = ("load", "torque", "drawbar_pull") if given == "sinkage" else ("sinkage", "torque", "drawbar_pull")

    def run(channels, values):
        found = predict(LOOSE, GEOMETRY, channels, values, given=given)
        return np.array([getattr(found, row) for row in rows])

    found = predict(LOOSE, GEOMETRY, channels, values, given=given, by=[name])
    size = np.maximum(np.abs({**channels, **values}[name]), 1e-3)
    differences = differenced(run, channels, values, name, size)
    scales = np.abs(run(channels, values)) / size
    for row, difference, scale in zip(rows, differences, scales, strict=True):
        exactly = slopes(getattr(found, row))[name]
        np.testing.assert_array_less(
            np.abs(exactly - difference), 1e-7 * (np.abs(difference) + scale) + 1e-300
        )


@pytest.mark.parametrize("name", [*NAMES[:3], "slip", "sinkage", "load"])
def test_derivatives_of_the_linear_base_are_exact(name):
    n = 200
    rng = np.random.default_rng(8)
    values = {key: drawn(n, seed=8)[key] for key in NAMES[:3]}
    channels = {
        "slip": rng.uniform(0.05, 0.95, n),
        "sinkage": rng.uniform(0.003, 0.05, n),
        "load": rng.uniform(20.0, 100.0, n),
    }

    def run(channels, values):
        found = predict(Model("linear"), GEOMETRY, channels, values)
        return np.array([found.torque, found.drawbar_pull])

    found = predict(Model("linear"), GEOMETRY, channels, values, by=[name])
    size = np.abs({**channels, **values}[name])
    differences = differenced(run, channels, values, name, size)
    for row, difference in zip(("torque", "drawbar_pull"), differences, strict=True):
        exactly = slopes(getattr(found, row))[name]
        scale = np.abs(difference) + channels["load"] * (0.1 if row == "torque" else 1.0) / size
        np.testing.assert_array_less(np.abs(exactly - difference), 1e-7 * scale)


# Laws


def stiffen(ground, p):
    before = ground.pressure
    ground.pressure = lambda depth: before(depth) * (1.0 + p * depth / 0.01)


def soften(ground, p):
    before = ground.mobilised
    ground.mobilised = lambda j, theta: before(j, theta) * (1.0 - p * (1.0 - math.exp(-j / 0.02)))


LAWS = {
    "max_stress_angle": (
        lambda q: q["max_stress_angle"] + q["p"] * (0.3 * q["slip"] - 0.07) * q["entry_angle"],
        lambda g, p: setattr(g, "peak", g.peak + p * (0.3 * g.slip - 0.07) * g.entry),
        "angles",
    ),
    "exit_angle": (
        lambda q: q["exit_angle"] - q["p"] * q["entry_angle"],
        lambda g, p: setattr(g, "leave", g.leave - p * g.entry),
        "angles",
    ),
    "radius": (
        lambda q: q["radius"] * (1.0 - 0.2 * q["p"]),
        lambda g, p: (
            setattr(g, "radius", g.radius * (1.0 - 0.2 * p)),
            setattr(g, "shear_radius", g.radius),
        ),
        "numbers",
    ),
    "shear_radius": (
        lambda q: q["shear_radius"] + 0.05 * q["p"],
        lambda g, p: setattr(g, "shear_radius", g.shear_radius + 0.05 * p),
        "numbers",
    ),
    "sinkage_exponent": (
        lambda q: q["sinkage_exponent"] + q["p"] * np.absolute(q["slip"]),
        lambda g, p: setattr(g, "exponent", g.exponent + p * g.slip),
        "numbers",
    ),
    "normal_stress": (
        lambda q: q["normal_stress"] * (1.0 + q["p"] * q["depth"] / 0.01),
        stiffen,
        "stresses",
    ),
    "shear_stress": (
        lambda q: q["shear_stress"] * (1.0 - q["p"] * (1.0 - np.exp(-q["shear_displacement"] / 0.02))),
        soften,
        "stresses",
    ),
}


@pytest.mark.parametrize("given", ["sinkage", "load"])
@pytest.mark.parametrize("quantity", LAWS)
def test_a_law_changes_the_wheel_as_it_says(quantity, given):
    law, own, phase = LAWS[quantity]
    model = Model(effects=(changed(quantity, law, ("p",)),))
    soil, p = base_contact(SOILS["sandy loam"]), 0.3

    def laws(ground, at):
        if at == phase:
            own(ground, p)

    sinkage, slip = np.array([0.005, 0.02]), np.array([0.15, 0.6])
    truth = [exact.forces(soil, WHEEL, sinkage[j], slip[j], laws=laws) for j in range(2)]
    channels = {"slip": slip}
    channels[given] = sinkage if given == "sinkage" else np.array([f.load for f in truth])
    found = predict(model, GEOMETRY, channels, {**values_of(soil), "trial.p": p}, given=given)
    np.testing.assert_allclose(found.load, [f.load for f in truth], rtol=1e-8)
    np.testing.assert_allclose(found.torque, [f.torque for f in truth], rtol=1e-8)
    np.testing.assert_allclose(found.drawbar_pull / found.load, [f.pull / f.load for f in truth], atol=1e-8)
    if given == "load":
        np.testing.assert_allclose(found.sinkage, sinkage, rtol=1e-8)


@pytest.mark.parametrize("given", ["sinkage", "load"])
@pytest.mark.parametrize("quantity", [*LAWS, "slip", "load", "sinkage", "torque", "drawbar_pull"])
def test_derivatives_flow_through_a_law(quantity, given):
    plain = {
        name: lambda q, name=name: q[name] * (1.0 + 0.3 * q["p"]) + 0.001 * q["p"]
        for name in ("slip", "load", "sinkage", "torque", "drawbar_pull")
    }
    law = LAWS[quantity][0] if quantity in LAWS else plain[quantity]
    model = Model(effects=(changed(quantity, law, ("p",)),))
    n = 40
    rng, values = np.random.default_rng(9), {**drawn(n, seed=9), "trial.p": np.full(n, 0.2)}
    channels = {"slip": rng.uniform(0.1, 0.7, n), "load": rng.uniform(20.0, 80.0, n)}
    if given == "sinkage":
        channels["sinkage"] = rng.uniform(0.004, 0.03, n)
    rows = (
        ("balance", "torque", "drawbar_pull") if given == "sinkage" else ("sinkage", "torque", "drawbar_pull")
    )
    names = ["trial.p", "stiffness", "slip", "load" if given == "load" else "sinkage"]

    def run(channels, values):
        found = predict(model, GEOMETRY, channels, values, given=given)
        return np.array([getattr(found, row) for row in rows])

    found = predict(model, GEOMETRY, channels, values, given=given, by=names)
    for name in names:
        size = np.abs({**channels, **values}[name])
        differences = differenced(run, channels, values, name, size)
        for row, difference in zip(rows, differences, strict=True):
            number = getattr(found, row)
            exactly = np.broadcast_to(slopes(number).get(name, 0.0), n)
            scale = np.abs(difference) + np.maximum(np.abs(value(number)), 0.01) / size
            np.testing.assert_array_less(np.abs(exactly - difference), 2e-7 * scale)


def test_a_law_without_effect_is_the_base():
    channels = {"slip": np.linspace(0.05, 0.9, 9), "sinkage": np.linspace(0.004, 0.04, 9)}
    values = values_of(SOILS["dry sand"])
    base = predict(LOOSE, GEOMETRY, channels, values)
    for quantity, (law, _, _) in LAWS.items():
        model = Model(effects=(changed(quantity, law, ("p",)),))
        found = predict(model, GEOMETRY, channels, {**values, **model.nulls()})
        np.testing.assert_allclose(found.load, base.load, rtol=1e-12)
        np.testing.assert_allclose(found.torque, base.torque, rtol=1e-12)
        np.testing.assert_allclose(found.drawbar_pull / base.load, base.drawbar_pull / base.load, atol=1e-12)


# What cannot be


def test_a_missing_channel_is_named():
    with pytest.raises(InputError, match="slip, which is not measured"):
        predict(LOOSE, GEOMETRY, {"sinkage": np.array([0.01])}, values_of(SOILS["dry sand"]))
    model = Model(effects=(changed("torque", lambda q: q["torque"] + q["pitch"], (), ("pitch",)),))
    with pytest.raises(InputError, match="pitch, which is not measured"):
        predict(
            model,
            GEOMETRY,
            {"sinkage": np.array([0.01]), "slip": np.array([0.1])},
            values_of(SOILS["dry sand"]),
        )


def test_a_model_that_makes_no_sense_is_refused():
    with pytest.raises(ConfigurationError, match="no base"):
        Model("bekker")
    twice = changed("slip", lambda q: q["slip"])
    with pytest.raises(ConfigurationError, match="twice"):
        Model(effects=(twice, twice))
    with pytest.raises(ConfigurationError, match="which the base linear does not have"):
        Model("linear", (changed("stiffness", lambda q: q["stiffness"]),))


def test_only_what_was_asked_for_has_derivatives():
    channels = {"slip": np.array([0.3]), "sinkage": np.array([0.02])}
    found = predict(LOOSE, GEOMETRY, channels, values_of(SOILS["dry sand"]))
    assert isinstance(found.torque, np.ndarray)
    found = predict(LOOSE, GEOMETRY, channels, values_of(SOILS["dry sand"]), by=["tan_phi", "slip"])
    assert isinstance(found.torque, Dual)
    assert set(slopes(found.torque)) == {"tan_phi", "slip"}
