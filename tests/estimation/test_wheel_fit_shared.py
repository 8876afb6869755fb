"""Parameters with one value for all windows: the arrow against the dense system, and effects regained."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from profiles import examples
from simulator import (
    CHANNELS,
    Drive,
    Sensor,
    Soil,
    Track,
    Wheel,
    base_contact,
    constant,
    simulate,
    undulation,
)
from wheel_samples import WHEEL, free

from terrain_cli.effects import find as effect_of
from terrain_cli.estimation.further_unknowns import with_contact
from terrain_cli.estimation.wheel_fit import Noise, fit
from terrain_cli.estimation.wheel_fit.gauss_newton import Normal, eliminate, newton
from terrain_cli.estimation.wheel_fit.unknowns import Unknown, Unknowns
from terrain_cli.mechanics.effect import Effect, Parameter
from terrain_cli.mechanics.wheel_model import Model, WheelGeometry
from terrain_cli.models import ModelFile

GEOMETRY = WheelGeometry(WHEEL.radius, WHEEL.width)
NOISE = Noise(dict.fromkeys(("load", "torque", "sinkage", "slip"), 0.01), {"drawbar_pull": 0.3})
FRICTION = Effect(
    id="friction",
    title="Constant friction",
    kind="sensor",
    parameters=(Parameter("tc", "N m", 0.0, 1.0),),
    laws={"torque": lambda q: q["torque"] + q["tc"]},
)
SOFTENING = Effect(
    id="softening",
    title="n grows with slip",
    kind="soil",
    parameters=(Parameter("n1", "1", 0.0, 0.5, lower=0.0, upper=2.0),),
    laws={"sinkage_exponent": lambda q: q["sinkage_exponent"] + q["n1"] * np.abs(q["slip"])},
)


def unknown(name, reach=1e9, step=1e9):
    return Unknown(name=name, logarithm=False, mean=0.0, sd=1.0, lower=-reach, upper=reach, step=step)


@examples(20)
@given(st.integers(1, 6), st.integers(0, 3), st.integers(1, 3), st.integers(0, 2**32))
def test_eliminating_windows_solves_the_dense_system(windows, local, shared, seed):
    rng = np.random.default_rng(seed)
    size = local + shared
    root = rng.standard_normal((windows, size, size + 2))
    normal = Normal(root @ np.swapaxes(root, 1, 2), rng.standard_normal((windows, size)), np.zeros(windows))
    t, common = rng.standard_normal((windows, local)), rng.standard_normal(shared)
    sought = Unknowns(
        tuple(unknown(f"l{k}") for k in range(local)), tuple(unknown(f"s{k}") for k in range(shared)), {}
    )
    step, shift, _ = newton(normal, sought, t, common)

    total = windows * local + shared
    dense, score = np.eye(total), np.concatenate([-t.ravel(), -common])
    for w in range(windows):
        at = np.concatenate([w * local + np.arange(local), windows * local + np.arange(shared)])
        dense[np.ix_(at, at)] += normal.information[w]
        score[at] += normal.score[w]
    expected = np.linalg.solve(dense, score)
    np.testing.assert_allclose(np.concatenate([step.ravel(), shift]), expected, rtol=1e-6, atol=1e-9)

    own, gain, information = eliminate(normal, local)
    covariance = np.linalg.inv(dense)
    held = np.linalg.inv(information)
    np.testing.assert_allclose(held, covariance[windows * local :, windows * local :], rtol=1e-6, atol=1e-12)
    first = own[0] + gain[0] @ held @ gain[0].T
    np.testing.assert_allclose(first, covariance[:local, :local], rtol=1e-6, atol=1e-12)


def test_an_unknown_stays_within_its_bounds_and_the_others_know_it():
    rng = np.random.default_rng(1)
    root = rng.standard_normal((1, 2, 4))
    normal = Normal(root @ np.swapaxes(root, 1, 2), np.array([[40.0, 3.0]]), np.zeros(1))
    sought = Unknowns((unknown("a", reach=0.5), unknown("b")), (), {})
    step, _, _ = newton(normal, sought, np.zeros((1, 2)), np.zeros(0))
    assert step[0, 0] == pytest.approx(0.5)
    information = normal.information[0] + np.eye(2)
    assert step[0, 1] == pytest.approx((3.0 - information[1, 0] * 0.5) / information[1, 1], rel=1e-6)


@pytest.mark.parametrize("limit", [{"reach": 0.01}, {"step": 0.01}])
def test_a_windows_own_unknowns_go_with_as_much_of_a_shared_step_as_is_taken(limit):
    rng = np.random.default_rng(2)
    root = rng.standard_normal((3, 4, 6))
    normal = Normal(root @ np.swapaxes(root, 1, 2), rng.standard_normal((3, 4)), np.zeros(3))
    sought = Unknowns((unknown("a"), unknown("b")), (unknown("c", **limit), unknown("d", **limit)), {})
    t, common = rng.standard_normal((3, 2)), np.zeros(2)
    step, shift, _ = newton(normal, sought, t, common)
    assert np.abs(shift).max() == pytest.approx(0.01)
    for w in range(3):
        own = normal.information[w, :2, :2] + np.eye(2)
        score = normal.score[w, :2] - t[w] - normal.information[w, :2, 2:] @ shift
        np.testing.assert_allclose(step[w], np.linalg.solve(own, score), rtol=1e-6)


def channels_with(model, values, *, seed, windows=24, size=16):
    """Noisy channels of a model with effects, by the model itself: effects have simulators elsewhere."""
    from terrain_cli.mechanics.wheel_model import predict

    truth = free(windows, size, 21)
    soil = {
        "cohesion": truth.cohesion,
        "tan_phi": np.tan(truth.phi),
        "shear_modulus": truth.shear_modulus,
        "stiffness": truth.stiffness,
        "sinkage_exponent": truth.exponent,
    }
    exact = {name: truth.channels[name] for name in ("sinkage", "slip")}
    found = predict(
        model, GEOMETRY, exact, {**{name: np.repeat(x, size) for name, x in soil.items()}, **values}
    )
    rng = np.random.default_rng(seed)
    exact |= {"load": found.load, "torque": found.torque}
    noisy = {name: x * (1.0 + 0.01 * rng.standard_normal(len(x))) for name, x in exact.items()}
    noisy["drawbar_pull"] = found.drawbar_pull + 0.3 * rng.standard_normal(windows * size)
    return truth, noisy


@pytest.mark.parametrize(
    ("model", "values"),
    [
        (Model(effects=(FRICTION,)), {"friction.tc": 0.4}),
        (Model(effects=(SOFTENING,)), {"softening.n1": 0.3}),
        (Model(effects=(FRICTION, SOFTENING)), {"friction.tc": 0.4, "softening.n1": 0.3}),
    ],
    ids=["torque", "soil", "both"],
)
def test_effects_are_regained_within_their_errors(model, values):
    deviations = []
    for seed in range(8):
        truth, channels = channels_with(model, values, seed=seed)
        result = fit(model, GEOMETRY, channels, truth.bounds, noise=NOISE, correlated=False)
        assert result.converged.all()
        deviations.append(
            [(result.shared[name] - x) / result.shared_errors[name] for name, x in values.items()]
        )
    z = np.array(deviations)
    assert np.all(np.abs(z.mean(axis=0)) < 1.1)
    assert np.all(z.std(axis=0) < 1.8)
    assert not any(result.undetermined[name].any() for name in values)
    assert set(result.shared) == set(values)
    assert result.names == (*model.soil, *values)


def test_an_absent_effect_is_found_absent():
    model = Model(effects=(SOFTENING,))
    truth, channels = channels_with(model, {"softening.n1": 0.0}, seed=1)
    result = fit(model, GEOMETRY, channels, truth.bounds, noise=NOISE, correlated=False)
    # Its lower bound is zero.
    assert 0.0 <= result.shared["softening.n1"] < 4.0 * result.shared_errors["softening.n1"]
    held = fit(
        model, GEOMETRY, channels, truth.bounds, noise=NOISE, correlated=False, fixed={"softening.n1": 0.0}
    )
    assert held.shared == {}
    plain = fit(Model(), GEOMETRY, channels, truth.bounds, noise=NOISE, correlated=False)
    np.testing.assert_allclose(held.phi, plain.phi, rtol=1e-6)


def test_a_shared_shear_modulus_is_known_better_than_each_window_knows_it():
    truth = free(1, 240, 22)
    channels = truth.measured(1, 0.02, pull=0.5)
    bounds = np.arange(0, 241, 12)
    noise = Noise(dict.fromkeys(("load", "torque", "sinkage", "slip"), 0.02), {"drawbar_pull": 0.5})
    own = fit(Model(), GEOMETRY, channels, bounds, noise=noise, correlated=False)
    common = fit(Model(), GEOMETRY, channels, bounds, noise=noise, correlated=False, shared=["shear_modulus"])
    k = truth.shear_modulus[0]
    assert abs(common.shared["shear_modulus"] - k) < 3.0 * common.shared_errors["shear_modulus"]
    assert common.shared_errors["shear_modulus"] < 0.5 * np.median(own.errors["shear_modulus"])
    assert np.median(common.phi_se) < np.median(own.phi_se)
    np.testing.assert_allclose(common.values["shear_modulus"], common.shared["shear_modulus"])
    # Its error is part of those of the windows' own parameters.
    assert np.all(np.abs(common.correlation("cohesion", "shear_modulus")) > 0.0)
    held = fit(
        Model(),
        GEOMETRY,
        channels,
        bounds,
        noise=noise,
        correlated=False,
        fixed={"shear_modulus": common.shared["shear_modulus"]},
    )
    assert np.median(held.errors["cohesion"] / common.errors["cohesion"]) < 1.0


def test_every_soil_parameter_may_be_shared():
    truth = free(1, 60, 23)
    channels = truth.measured(2, 0.01, pull=0.2)
    noise = Noise(dict.fromkeys(("load", "torque", "sinkage", "slip"), 0.01), {"drawbar_pull": 0.2})
    model = Model()
    pooled = fit(
        model, GEOMETRY, channels, np.arange(0, 61, 12), noise=noise, correlated=False, shared=model.soil
    )
    one = fit(model, GEOMETRY, channels, [0, 60], noise=noise, correlated=False)
    assert len(set(pooled.phi)) == 1
    np.testing.assert_allclose(pooled.phi[0], one.phi[0], atol=0.2 * one.phi_se[0])
    np.testing.assert_allclose(pooled.errors["cohesion"][0], one.errors["cohesion"][0], rtol=0.3)


@pytest.mark.parametrize("parts", [(0, 340), (0, 295, 340)], ids=["one", "two"])
def test_the_shape_of_the_contact_does_not_take_the_place_of_an_effect(parts):
    soil = base_contact(Soil("soft", 250.0, math.radians(30.0), 0.018, 0.0, 3.5e5, 0.9))
    track = Track("wheel", [(soil, 68.0)], undulation(150.0, 0.25, 19.0, 4), undulation(0.3, 0.85, 27.0, 5))
    noisy = dict.fromkeys(("load", "torque", "sinkage", "slip"), Sensor(relative=0.02))
    told = Drive(
        [track],
        Wheel(radius=0.15, width=0.12),
        constant(0.075),
        effects={"bulldozing": {"factor": 0.3}},
        rate=5.0,
        sensors={**noisy, "drawbar_pull": Sensor(absolute=0.8)},
        channels=(*CHANNELS, "slip", "drawbar_pull"),
        seed=4,
    )
    channels = simulate(told).wheels["wheel"].aligned()
    file = with_contact(ModelFile(model=Model(effects=(effect_of("bulldozing"),))))
    found = fit(file.model, WheelGeometry(0.15, 0.12), channels, parts, priors=file.priors, local=file.local)
    away = (found.shared["bulldozing.factor"] - 0.3) / found.shared_errors["bulldozing.factor"]
    assert abs(away) < 2.0
    assert (found.status == "ok").all()
