"""Noise that the data tell, outliers, and residuals that follow each other."""

from __future__ import annotations

import numpy as np
import pytest
from wheel_samples import WHEEL, free

from terrain_cli.effects import find as effect_of
from terrain_cli.estimation.wheel_fit import Noise, fit
from terrain_cli.estimation.wheel_fit.excess_scatter import excess, memory
from terrain_cli.mechanics.wheel_model import Model, WheelGeometry

GEOMETRY = WheelGeometry(WHEEL.radius, WHEEL.width)
FOUR = ("load", "torque", "sinkage", "slip")


def run(channels, bounds, **options):
    return fit(Model(), GEOMETRY, {name: channels[name] for name in FOUR}, bounds, **options)


def smooth(size, seed, slip=0.4, varies=0.5):
    """Return one window of noise-free samples along a slow drive, and its soil's φ."""
    from simulator import forces

    truth = free(1, 1, seed)
    step = np.arange(size)
    z, i = 0.018 * (1.0 + 0.3 * np.sin(step / 23.0)), slip * (1.0 + varies * np.sin(step / 31.0))
    found = [forces(truth.soils[0], WHEEL, a, b) for a, b in zip(z, i, strict=True)]
    channels = {
        "load": np.array([f.load for f in found]),
        "torque": np.array([f.torque for f in found]),
        "sinkage": z,
        "slip": i,
    }
    return channels, truth.phi[0]


def shares(noise, channels):
    """Return the noise of each channel as a share of its root mean square."""
    return {
        name: float(np.sqrt(np.mean(noise.variance(name, column)) / np.mean(column**2)))
        for name, column in channels.items()
        if name in FOUR
    }


def test_noise_of_test_points_is_learnt_from_their_scatter():
    truth = free(60, 10, 31)
    result = run(truth.measured(1, 0.02), truth.bounds, correlated=False)
    found = shares(result.noise, truth.measured(1, 0.02))
    # Beyond small slips the forces hardly change with slip: they do not tell its noise.
    assert 0.005 < found.pop("slip") < 0.04
    assert list(found.values()) == pytest.approx([0.02] * 3, rel=0.25)
    given = run(truth.measured(1, 0.02), truth.bounds, correlated=False, noise=Noise.equal(0.02))
    np.testing.assert_allclose(result.phi_se, given.phi_se, rtol=0.4)


def test_noise_of_a_log_is_learnt_channel_by_channel():
    channels, _ = smooth(400, 32)
    levels = {"load": 0.01, "torque": 0.03, "sinkage": 0.05, "slip": 0.02}
    rng = np.random.default_rng(3)
    noisy = {name: x * (1.0 + levels[name] * rng.standard_normal(400)) for name, x in channels.items()}
    result = run(noisy, [0, 200, 400])
    assert shares(result.noise, noisy) == pytest.approx(levels, rel=0.3)


def test_few_points_know_their_noise_badly_and_their_errors_show_it():
    truth = free(1, 6, 33)
    one = run(truth.measured(1, 0.02), truth.bounds, correlated=False)
    known = run(truth.measured(1, 0.02), truth.bounds, correlated=False, noise=one.noise)
    assert np.all(one.errors["cohesion"] > 1.05 * known.errors["cohesion"])


def test_slip_that_hardly_varies_leaves_its_noise_and_so_the_soil_open():
    """How much of its variation is noise decides on k; the shape of the contact stays as open as before."""
    channels, phi = smooth(400, 38, slip=0.25, varies=0.08)
    rng = np.random.default_rng(4)
    channels = {name: x * (1.0 + 0.03 * rng.standard_normal(400)) for name, x in channels.items()}
    model = Model(effects=(effect_of("max-stress-angle"), effect_of("rear-contact")))
    options = {"local": model.parameters, "second": 10.0}
    learnt = fit(model, GEOMETRY, channels, [0, 400], **options)
    told = fit(model, GEOMETRY, channels, [0, 400], noise=learnt.noise, **options)
    assert learnt.errors["shear_modulus"] > 1.5 * told.errors["shear_modulus"]
    assert abs(learnt.phi - phi) < 3.0 * learnt.phi_se


def test_errors_do_not_hang_on_the_sides_that_the_axes_of_the_noise_point_to(monkeypatch):
    truth = free(1, 40, 34)
    channels = truth.measured(1, 0.05)
    usual = run(channels, truth.bounds)
    axes_of = np.linalg.eigh

    def turned(matrix):
        size, axes = axes_of(matrix)
        return size, -axes

    monkeypatch.setattr(np.linalg, "eigh", turned)
    other = run(channels, truth.bounds)
    for name in ("cohesion", "tan_phi"):
        np.testing.assert_allclose(other.errors[name], usual.errors[name], rtol=1e-6)
    np.testing.assert_allclose(other.sigma_star, usual.sigma_star, rtol=1e-6)


def test_outliers_are_given_less_weight_on_request():
    truth = free(40, 25, 34)
    clean = truth.measured(1, 0.02)
    noisy = {name: column.copy() for name, column in clean.items()}
    rng = np.random.default_rng(5)
    for name in ("load", "torque", "sinkage"):
        hit = rng.random(1000) < 0.02
        noisy[name][hit] *= 1.0 + rng.choice([-0.6, 0.8], hit.sum())
    options = {"correlated": False, "noise": Noise.equal(0.02)}

    def error(channels, **more):
        result = run(channels, truth.bounds, **options, **more)
        return np.degrees(np.sqrt(np.mean((result.phi - truth.phi) ** 2)))

    assert error(noisy, robust=True) < 1.6 * error(clean)
    assert error(noisy) > 2.0 * error(noisy, robust=True)
    # 5 % of the efficiency is 2.6 % of the error.
    assert error(clean, robust=True) < 1.15 * error(clean)
    plain, robust = (run(clean, truth.bounds, **options, robust=r) for r in (False, True))
    assert 1.0 < np.median(robust.errors["cohesion"] / plain.errors["cohesion"]) < 1.1
    result = run(noisy, truth.bounds, correlated=False, robust=True)
    assert shares(result.noise, clean)["torque"] == pytest.approx(0.02, rel=0.3)


def test_residuals_that_follow_each_other_widen_the_errors():
    channels, phi = smooth(400, 35)
    rng = np.random.default_rng(7)
    deviations = {True: [], False: []}
    for _ in range(25):
        noise = rng.standard_normal((4, 400))
        for step in range(1, 400):
            noise[:, step] = 0.9 * noise[:, step - 1] + np.sqrt(1.0 - 0.81) * noise[:, step]
        noisy = {name: x * (1.0 + 0.02 * e) for (name, x), e in zip(channels.items(), noise, strict=True)}
        for correlated, found in deviations.items():
            result = run(noisy, [0, 400], noise=Noise.equal(0.02), correlated=correlated)
            found.append((result.phi[0] - phi) / result.phi_se[0])
    naive, allowed = (np.sqrt(np.mean(np.square(deviations[correlated]))) for correlated in (False, True))
    assert naive > 1.5
    assert allowed < 1.4
    assert allowed < 0.6 * naive


def test_white_residuals_are_left_alone():
    truth = free(60, 20, 36)
    options = {"noise": Noise.equal(0.02)}
    result = run(truth.measured(1, 0.02), truth.bounds, **options)
    assert np.mean(result.inflation == 1.0) > 0.6
    assert result.inflation.mean() < 1.3


def test_more_scatter_than_the_noise_says_widens_the_errors():
    truth = free(20, 20, 37)
    noisy = truth.measured(1, 0.04)
    honest = run(noisy, truth.bounds, noise=Noise.equal(0.04), correlated=False)
    bold = run(noisy, truth.bounds, noise=Noise.equal(0.01), correlated=False)
    assert np.median(bold.inflation) == pytest.approx(16.0, rel=0.4)
    assert np.median(bold.phi_se / honest.phi_se) == pytest.approx(1.0, abs=0.35)


def test_memory_of_a_first_order_process():
    rng = np.random.default_rng(8)
    series = rng.standard_normal((2, 20_000))
    for step in range(1, 20_000):
        series[1, step] = 0.6 * series[1, step - 1] + 0.8 * series[1, step]
    found = memory(series, np.array([0, 20_000]))
    np.testing.assert_allclose(found[:, 0], [1.0, 4.0], rtol=0.1)
    together = memory(series, np.arange(0, 20_001, 100), together=True)
    np.testing.assert_allclose(together[:, 0], [1.0, 4.0], rtol=0.1)


def test_a_scatter_that_may_be_chance_is_not_counted():
    rng = np.random.default_rng(9)
    residual = rng.standard_normal((2, 400))
    seen = np.ones((2, 400), dtype=bool)
    bounds = np.arange(0, 401, 20)
    dof = np.full(20, 36.0)
    assert np.mean(excess(residual, seen, bounds, dof) == 1.0) > 0.9
    np.testing.assert_allclose(excess(3.0 * residual, seen, bounds, dof).mean(), 11.0, rtol=0.3)


@pytest.mark.parametrize("base", ["linear", "wong-reece"])
@pytest.mark.parametrize("size", [1, 40])
def test_equal_rows_have_finite_estimates_and_errors(base, size):
    row = {"load": 80.9996, "torque": 3.0125, "sinkage": 0.01081, "slip": 0.285057}
    channels = {name: np.full(2 * size, value) for name, value in row.items()}
    for bounds in ([0, 2 * size], [0, size, 2 * size]):
        result = fit(Model(base=base), GEOMETRY, channels, bounds)
        for name, values in result.values.items():
            assert np.isfinite(values).all(), name
            assert (result.errors[name] >= 0.0).all(), name
        assert (result.errors["tan_phi"] > 0.0).all()


def test_a_torque_of_nothing_is_no_exact_one():
    truth = free(1, 40, 39)
    channels = {name: truth.channels[name] for name in FOUR} | {"torque": np.zeros(40)}
    for noise in (None, Noise.equal(0.0)):
        result = fit(Model(base="linear"), GEOMETRY, channels, [0, 40], noise=noise)
        assert np.isfinite(result.errors["cohesion"]).all()
