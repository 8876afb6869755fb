"""The fit where the model is wrong or the data tell little: no soil that cannot be, no error without end."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from profiles import examples
from simulator import (
    CHANNELS,
    DRY_SAND,
    SANDY_LOAM,
    Drive,
    Sensor,
    Track,
    Wheel,
    base_contact,
    constant,
    simulate,
    undulation,
)
from wheel_samples import free

from benchmarks import rover_bag
from terrain_cli.effects import find as effect_of
from terrain_cli.estimation.line.window_estimates import STATUSES
from terrain_cli.estimation.wheel_fit import DEFAULT, Noise, fit, gauss_newton
from terrain_cli.estimation.wheel_fit.gauss_newton import truncate
from terrain_cli.estimation.wheel_fit.unknowns import Unknown
from terrain_cli.mechanics.wheel_model import Model, WheelGeometry

WHEEL = Wheel(0.125, 0.1)
GEOMETRY = WheelGeometry(WHEEL.radius, WHEEL.width)
#: Samples of a drive.
WHOLE = 320
HIDDEN = {
    "bulldozing": {"factor": 0.3},
    "slip-sinkage": {"n1": 0.5},
    "wheel-radius": {"relative_error": 0.15},
    "drawbar-bias": {"offset": -25.0},
    "load-bias": {"gain": 0.8, "offset": 30.0},
}


@cache
def drive(effect: str, samples: int, *, varied: bool, seed: int = 1):
    """Return channels and bounds of a minute of a drive with an effect that is not in the model."""
    speed = undulation(0.07, 0.4, 11.0, 3) if varied else constant(0.07)
    track = Track(
        "wheel",
        [(base_contact(DRY_SAND if seed % 2 else SANDY_LOAM), 64.0)],
        undulation(60.0, 0.25, 7.0, seed) if varied else constant(60.0),
        undulation(0.3, 0.8, 9.0, seed + 1),
    )
    noisy = dict.fromkeys(("load", "torque", "sinkage", "slip"), Sensor(relative=0.03))
    columns = (
        simulate(
            Drive(
                [track],
                WHEEL,
                speed,
                effects={effect: HIDDEN[effect]},
                rate=5.0,
                sensors={**noisy, "drawbar_pull": Sensor(absolute=0.45)},
                channels=(*CHANNELS, "slip", "drawbar_pull"),
                seed=seed,
            )
        )
        .wheels["wheel"]
        .aligned()
    )
    n = len(columns["time"])
    return columns, np.append(np.arange(0, n, samples)[: n // samples], n)


@cache
def fitted(effect: str, samples: int, *, varied: bool):
    """Return what the model without effects makes of that drive."""
    return fit(Model(), GEOMETRY, *drive(effect, samples, varied=varied))


def possible(result):
    """Check that every soil is one, or that its status says why it is not."""
    filled = result.n > 0
    assert set(result.status) <= set(STATUSES)
    phi = np.degrees(result.phi[filled])
    assert np.all((phi >= 0.0) & (phi <= 60.0))
    for name in ("cohesion", "tan_phi"):
        value, error = result.values[name][filled], result.errors[name][filled]
        assert np.all(np.isfinite(value) & np.isfinite(error))
        assert np.all(error <= 1.05 * DEFAULT[name].sd)
    negative = result.values["cohesion"][filled] < 0.0
    assert not np.isin(result.status[filled][negative], ("ok",)).any()
    at_bound = np.any(
        [there for name, there in result.bounded.items() if name in {"cohesion", "tan_phi"}], axis=0
    )
    assert not np.isin(result.status[filled & at_bound], ("ok", "ill-conditioned")).any()


@pytest.mark.parametrize("samples", [8, 30, WHOLE])
@pytest.mark.parametrize("varied", [True, False], ids=["rich", "poor"])
@pytest.mark.parametrize("effect", HIDDEN)
def test_soils_are_possible_where_an_effect_is_missing(effect, varied, samples):
    possible(fitted(effect, samples, varied=varied))


@pytest.mark.parametrize("wrong", ["drivetrain-friction", "load-bias"])
@pytest.mark.parametrize("effect", ["bulldozing", "wheel-radius"])
def test_so_they_are_with_the_wrong_effect_in_the_model(effect, wrong):
    channels, bounds = drive(effect, 30, varied=True)
    model = Model(effects=(effect_of(wrong),))
    result = fit(model, GEOMETRY, channels, bounds)
    possible(result)
    assert all(np.isfinite(error) for error in result.shared_errors.values())


def test_no_other_beginning_leads_lower():
    channels, bounds = drive("slip-sinkage", WHOLE, varied=True)
    result = fitted("slip-sinkage", WHOLE, varied=True)
    # Held at soils far apart, the others are fitted: no such fit may be much better.
    for c in (0.0, 2e3, 6e3):
        for tan_phi in (0.2, 0.5, 0.9):
            held = fit(
                Model(),
                GEOMETRY,
                channels,
                bounds,
                fixed={"cohesion": c, "tan_phi": tan_phi},
                noise=result.noise,
            )
            better = held.converged & (held.chi2 < 0.7 * result.chi2)
            assert not better.any() or np.all(result.excess[better] > 1.0)


def test_noise_that_a_model_cannot_explain_is_told_from_that_of_the_sensors():
    channels, bounds = drive("bulldozing", 30, varied=False)
    noise = Noise(dict.fromkeys(("load", "torque", "sinkage", "slip"), 0.03), {"drawbar_pull": 0.45})
    result = fit(Model(), GEOMETRY, channels, bounds, noise=noise)
    assert np.all(result.excess > 10.0)
    # The misfit is told in terms of the sensors' noise, not of what it was raised to.
    assert np.all(result.chi2 > 10.0 * result.dof)
    assert not result.separable.any()
    assert set(result.status) <= {"out-of-range", "at-bound", "prior-bound", "model-misses"}
    # Where the model holds nothing is raised.
    truth = free(20, 20, 8)
    fine = fit(
        Model(),
        WheelGeometry(0.1, 0.1),
        truth.measured(1, 0.02),
        truth.bounds,
        noise=Noise.equal(0.02),
        correlated=False,
    )
    np.testing.assert_array_equal(fine.excess, 1.0)
    assert not any(there.any() for there in fine.bounded.values())


def test_a_soil_beyond_its_bound_has_the_error_of_what_remains():
    # A wheel that sinks without torque: no friction is too much already.
    rng = np.random.default_rng(2)
    sinkage = np.linspace(0.01, 0.02, 40) * (1.0 + 0.01 * rng.standard_normal(40))
    channels = {
        "load": np.full(40, 60.0),
        "torque": np.zeros(40),
        "sinkage": sinkage,
        "slip": np.tile(np.linspace(0.1, 0.5, 8), 5),
    }
    result = fit(
        Model(),
        GEOMETRY,
        channels,
        np.arange(6) * 8,
        fixed={"cohesion": 500.0},
        noise=Noise.equal(0.03),
        correlated=False,
    )
    low = result.bounded["tan_phi"]
    assert low.any()
    assert np.all(result.phi[low] > 0.0)
    assert np.all(result.phi[low] < 3.0 * result.phi_se[low])
    assert np.all(result.undetermined["tan_phi"][low])
    assert set(result.status[low]) == {"at-bound"}


# What is not set aside beforehand: a load, and a wheel less deep than its axle.
loads = st.floats(0.1, 1e4) | st.sampled_from([1e-3, 1e6])
torques = st.floats(-1e3, 1e3) | st.sampled_from([0.0, 1e-9, 1e6])
samples = st.tuples(loads, torques, st.floats(1e-4, 0.12), st.floats(-0.99, 0.99))


@examples(25)
@given(st.lists(samples, min_size=3, max_size=12), st.booleans())
def test_any_telemetry_gives_a_possible_soil_or_says_why_not(rows, correlated):
    channels = dict(zip(("load", "torque", "sinkage", "slip"), np.array(rows).T, strict=True))
    result = fit(Model(), GEOMETRY, channels, [0, len(rows)], correlated=correlated, noise=Noise.equal(0.03))
    possible(result)


@pytest.mark.parametrize("outside", [0.0, 0.7, 4.0])
def test_a_normal_distribution_is_cut_off_at_a_bound(outside):
    # One unknown at its lower bound 1, correlated with a free one: drawn, and those outside left out.
    own = np.array([[[0.25, 0.1], [0.1, 0.5]]])
    local = (
        Unknown(name="a", logarithm=False, mean=0.0, sd=1.0, lower=1.0, upper=9.0, step=1.0),
        Unknown(name="b", logarithm=False, mean=0.0, sd=1.0, lower=-9.0, upper=9.0, step=1.0),
    )
    t, covariance = truncate(np.array([[1.0, 2.0]]), own, np.array([[0.5 * outside, -1.0]]), local)
    rng = np.random.default_rng(1)
    drawn = 1.0 - 0.5 * outside + 0.5 * rng.standard_normal(4_000_000)
    inside = drawn[drawn > 1.0]
    assert t[0, 0] == pytest.approx(inside.mean(), abs=0.01 * inside.std() + 2e-3)
    assert covariance[0, 0, 0] == pytest.approx(inside.var(), rel=0.15)
    assert t[0, 1] == pytest.approx(2.0 + 0.4 * (t[0, 0] - 1.0))
    assert covariance[0, 1, 1] == pytest.approx(0.5 - 0.4**2 * (0.25 - covariance[0, 0, 0]))


@pytest.mark.parametrize("varied", [True, False], ids=["varied", "steady"])
@pytest.mark.parametrize("effect", HIDDEN)
def test_the_last_digit_of_the_data_is_of_no_consequence(effect, varied):
    columns, bounds = drive(effect, WHOLE, varied=varied)
    channels = {name: columns[name] for name in ("load", "torque", "sinkage", "slip", "drawbar_pull")}
    rng = np.random.default_rng(1)
    rounded = {name: column * (1.0 + 1e-13 * rng.normal(size=WHOLE)) for name, column in channels.items()}
    first, second = fitted(effect, WHOLE, varied=varied), fit(Model(), GEOMETRY, rounded, bounds)
    # The noise is the sensors' with what the model misses, not what a search that is lost makes of it.
    noise, again = (np.sqrt(np.mean(one.noise.variance("load", channels["load"]))) for one in (first, second))
    assert 0.02 < noise / channels["load"].mean() < 0.25
    assert again == pytest.approx(noise, rel=0.03)
    for name, value in first.values.items():
        assert second.values[name] == pytest.approx(value, abs=0.05 * float(first.errors[name][0])), name
    assert second.torque_rmse == pytest.approx(first.torque_rmse, rel=0.01)


@pytest.mark.parametrize("effect", ["bulldozing", "drawbar-bias"])
def test_nor_is_it_of_a_few_points_at_the_bounds(effect):
    columns, _ = drive(effect, WHOLE, varied=True)
    rows = np.linspace(0, len(columns["time"]) - 1, 12).astype(int)
    channels = {name: columns[name][rows] for name in ("load", "torque", "sinkage", "slip", "drawbar_pull")}
    model = Model(effects=tuple(effect_of(name) for name in ("max-stress-angle", "rear-contact")))
    rng = np.random.default_rng(1)
    rounded = {name: column * (1.0 + 1e-13 * rng.normal(size=12)) for name, column in channels.items()}
    first, second = (
        fit(model, GEOMETRY, one, [0, 12], local=model.parameters, correlated=False)
        for one in (channels, rounded)
    )
    assert second.status == first.status
    for name, value in first.values.items():
        assert second.values[name] == pytest.approx(value, abs=0.05 * float(first.errors[name][0])), name


@pytest.mark.parametrize("seed", [1, 3])
@pytest.mark.parametrize(("lasts", "second", "missed"), [(0.5, 50.0, False), (2.0, 0.0, True)])
def test_noise_that_lasts_half_a_second_is_no_misfit(seed, lasts, second, missed):
    """Without a clock only samples count, and noise of 2 s lasts for a hundred of them."""
    lasting = dict.fromkeys(
        ("load", "torque", "sinkage", "slip"), Sensor(relative=0.02, correlation_time=lasts)
    )
    track = Track(
        "wheel",
        [(base_contact(DRY_SAND), 44.0)],
        undulation(60.0, 0.25, 7.0, seed),
        undulation(0.3, 0.8, 9.0, seed + 1),
    )
    told = Drive(
        [track],
        WHEEL,
        constant(0.07),
        rate=50.0,
        sensors={**lasting, "drawbar_pull": Sensor(absolute=0.3, correlation_time=lasts)},
        channels=(*CHANNELS, "slip", "drawbar_pull"),
        seed=seed,
    )
    channels = simulate(told).wheels["wheel"].aligned()
    ends = [0, len(channels["time"])]
    assert fit(Model(), GEOMETRY, channels, ends, second=second).missed[0] == missed


def test_a_miss_takes_few_passes_over_all_samples(monkeypatch):
    """Residuals that last for hundreds of samples are told by some of them as well as by all."""
    driven, wheel = rover_bag.drive(240.0, 50.0), 1
    channels = {name: driven[name][:, wheel] for name in ("load", "torque", "sinkage")}
    turned = rover_bag.GEOMETRY["radius"] * driven["angular_velocity"][:, wheel]
    bounds = np.linspace(0, len(turned), len(rover_bag.SOILS) + 1).astype(int)
    model = Model(effects=(effect_of("max-stress-angle"), effect_of("rear-contact")))
    geometry = WheelGeometry(rover_bag.GEOMETRY["radius"], rover_bag.GEOMETRY["width"])
    passed, equations = [], gauss_newton.equations

    def counted(problem, data, *args, **options):
        passed.append(data.measured.shape[1])
        return equations(problem, data, *args, **options)

    monkeypatch.setattr(gauss_newton, "equations", counted)
    slip = 1.0 - driven["speed"] / turned
    result = fit(model, geometry, {**channels, "slip": slip}, bounds, local=model.parameters, second=50.0)
    assert result.missed.all()
    assert sum(passed) < 30 * len(slip)
