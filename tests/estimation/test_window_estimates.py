"""Estimates of windows: values, errors, statuses."""

from __future__ import annotations

from dataclasses import fields
from itertools import pairwise

import numpy as np
import pytest
from drives import GEOMETRY, drive
from hypothesis import given
from hypothesis import strategies as st
from profiles import examples
from simulator import DRY_SAND, Wheel, forces, sinkage_under

from terrain_cli.errors import UsageError
from terrain_cli.estimation.line import window_estimates
from terrain_cli.mechanics.linear import line_coordinates

NUMBERS = ("c", "c_se", "phi", "phi_se", "corr", "strength", "strength_se", "sigma_star", "torque_rmse")


def estimate_windows(x, y, bounds, *, load, torque, sinkage, slip, radius, width, shear_modulus, **options):
    geometry = {"radius": radius, "width": width, "shear_modulus": shear_modulus}
    return window_estimates.estimate_windows([x, y, load, torque, sinkage, slip], bounds, geometry, **options)


def estimate(run, *, bounds=None, **options):
    channels = run.channels
    x, y = line_coordinates(**channels, **GEOMETRY)
    return estimate_windows(x, y, run.bounds if bounds is None else bounds, **channels, **GEOMETRY, **options)


def share_of(status, estimates):
    return np.mean(estimates.status == status)


def test_a_load_step_gives_the_soil_back():
    run = drive(4, 30, 0, kind="steps", share=0.2)
    result = estimate(run)
    assert set(result.status) == {"ok"}
    assert set(result.method) == {"least-squares"}
    np.testing.assert_allclose(np.degrees(result.phi), 30.0, atol=0.1)
    np.testing.assert_allclose(result.c, 800.0, rtol=0.02)
    np.testing.assert_allclose(result.strength, result.c + result.sigma_star * np.tan(result.phi), rtol=1e-9)
    np.testing.assert_allclose(result.torque_rmse, 0.0, atol=1e-3)


def test_strength_of_the_full_model_at_the_pivot():
    wheel = Wheel(radius=GEOMETRY["radius"], width=GEOMETRY["width"])
    loads = np.linspace(40.0, 60.0, 7)
    sinkages = [sinkage_under(DRY_SAND, wheel, load, 0.3) for load in loads]
    torques = [forces(DRY_SAND, wheel, sinkage, 0.3).torque for sinkage in sinkages]
    columns = {"load": loads, "torque": torques, "sinkage": sinkages, "slip": np.full(7, 0.3)}
    x, y = line_coordinates(*columns.values(), **GEOMETRY)
    result = estimate_windows(x, y, [0, 7], **columns, **GEOMETRY, correlated=False)
    assert result.status[0] == "ok"
    # The linearised stresses are the larger part of what is missing.
    assert result.strength[0] == pytest.approx(DRY_SAND.strength(result.sigma_star[0]), rel=0.1)


@pytest.mark.parametrize("samples", [30, 100, 1000])
@pytest.mark.parametrize("rho", [0.0, 0.8])
def test_constant_load_is_not_separable_but_has_a_strength(samples, rho):
    windows = 3000 if samples < 1000 else 400
    result = estimate(drive(windows, samples, 21, noises=0.03, rho=rho))
    assert np.mean(result.separable) < 0.01
    # What is impossible besides is called that.
    assert np.isin(result.status[~result.separable], ("not-separable", "out-of-range")).all()
    truth = 800.0 + result.sigma_star * np.tan(np.radians(30.0))
    # κ3, which the line leaves out, is 0.3 % of the strength here.
    assert np.mean(np.abs(result.strength - truth) < 1.96 * result.strength_se + 0.003 * truth) > 0.9
    assert np.median(result.strength_se / result.strength) < 0.1 / np.sqrt(samples / 30.0)
    assert np.mean(np.abs(result.phi - np.radians(30.0)) < 1.96 * result.phi_se) > 0.97


@pytest.mark.parametrize("noise", [0.0, 1e-4])
def test_constant_load_with_little_or_no_noise(noise):
    result = estimate(drive(20, 50, 22, noises=noise))
    assert not result.separable.any()
    assert set(result.status) <= {"not-separable", "out-of-range"}
    assert set(result.method) == {"ridge"}
    np.testing.assert_allclose(
        result.strength, 800.0 + result.sigma_star * np.tan(np.radians(30.0)), rtol=0.005
    )
    assert np.all(result.c_se > 0.3 * result.strength)


@pytest.mark.parametrize(
    ("kind", "share", "samples", "rho", "lost"),
    [
        ("scatter", 0.15, 30, 0.0, 0.05),
        ("scatter", 0.15, 100, 0.0, 0.01),
        ("scatter", 0.15, 100, 0.8, 0.02),
        ("scatter", 0.3, 30, 0.0, 0.01),
        ("steps", 0.1, 100, 0.0, 0.01),
        ("steps", 0.3, 30, 0.0, 0.03),
        ("undulation", 0.15, 100, 0.0, 0.01),
        ("undulation", 0.15, 1000, 0.8, 0.02),
    ],
)
def test_a_load_that_varies_is_told_from_noise(kind, share, samples, rho, lost):
    windows = 2000 if samples < 1000 else 300
    run = drive(windows, samples, 23, kind=kind, share=share, noises=0.03, rho=rho)
    result = estimate(run)
    assert np.mean(~result.separable) <= lost
    inside = np.abs(result.phi - run.phi) < 1.96 * result.phi_se
    assert inside.mean() >= 0.93
    assert np.mean(np.abs(result.c - run.cohesion) < 1.96 * result.c_se) >= 0.93
    assert np.median(np.degrees(result.phi_se)) < 8.0


@pytest.mark.parametrize("samples", [5, 10, 30])
@pytest.mark.parametrize("kind", ["scatter", "steps", "undulation"])
def test_exact_test_points_are_separable(samples, kind):
    result = estimate(drive(50, samples, 24, kind=kind, share=0.15), correlated=False)
    assert result.separable.all()
    # Five points at random may lie close together.
    assert share_of("ok", result) > 0.9
    np.testing.assert_allclose(np.degrees(result.phi), 30.0, atol=0.2)


def test_a_slip_sweep_at_constant_load():
    result = estimate(drive(300, 60, 25, slip_share=0.6, noises=0.01))
    assert share_of("ok", result) > 0.97
    assert np.mean(np.abs(result.phi - np.radians(30.0)) < 1.96 * result.phi_se) > 0.93


def test_ten_percent_noise_leaves_nothing_to_separate():
    result = estimate(drive(500, 30, 26, kind="scatter", share=0.15, noises=0.1))
    assert share_of("ok", result) < 0.02


def test_negative_cohesion_is_shown():
    run = drive(3, 40, 27, kind="steps", share=0.2, cohesion=-400.0)
    result = estimate(run)
    assert set(result.status) == {"out-of-range"}
    assert np.all(result.c < -300.0)


def test_little_variation_is_ill_conditioned_and_goes_to_ridge():
    run = drive(3, 40, 28, kind="steps", share=0.01)
    result = estimate(run)
    assert set(result.method) == {"ridge"}
    assert set(result.status) == {"ill-conditioned"}
    np.testing.assert_array_equal(result.phi, result.phi_ridge)
    assert np.all(np.abs(result.phi - run.phi) < 2.0 * result.phi_se + 0.01)


def test_each_method_says_what_it_is():
    run = drive(5, 30, 29, kind="scatter", share=0.15, noises=0.02)
    auto, plain, ridge, recursive = (
        estimate(run, method=method) for method in ("auto", "least-squares", "ridge", "recursive")
    )
    np.testing.assert_array_equal(auto.phi, plain.phi)
    np.testing.assert_array_equal(plain.phi, plain.phi_ls)
    np.testing.assert_array_equal(ridge.phi, ridge.phi_ridge)
    np.testing.assert_array_equal(recursive.phi, plain.phi_ls)
    assert set(ridge.method) == {"ridge"}
    assert set(recursive.method) == {"recursive"}
    assert np.all(ridge.phi != plain.phi)


@pytest.mark.parametrize("method", ["least-squares", "ridge"])
def test_errors_are_consistent_with_each_other(method):
    result = estimate(drive(20, 60, 30, kind="scatter", share=0.15, noises=0.03), method=method)
    # The strength at σ* is c + σ* tan φ: its variance follows from those of c, tan φ and their correlation.
    tan_se = result.phi_se * (1.0 + np.tan(result.phi) ** 2)
    variance = (
        result.c_se**2
        + 2.0 * result.sigma_star * result.corr * result.c_se * tan_se
        + (result.sigma_star * tan_se) ** 2
    )
    np.testing.assert_allclose(result.strength_se**2, variance, rtol=1e-5)
    np.testing.assert_allclose(result.corr * result.c_se + result.sigma_star * tan_se, 0.0, atol=1e-6)
    assert np.all(np.abs(result.corr) <= 1.0)


def test_short_windows():
    run = drive(1, 20, 31, kind="steps", share=0.2, noises=0.01)
    result = estimate(run, bounds=[0, 0, 1, 3, 7, 20], min_samples=5)
    assert result.status.tolist() == ["too-few-samples"] * 4 + ["ok"]
    np.testing.assert_array_equal(result.n, [0, 1, 2, 4, 13])
    assert np.isnan([getattr(result, name)[0] for name in NUMBERS]).all()
    assert np.isnan(result.c_se[:3]).all()
    assert np.isfinite(result.c_se[3:]).all()
    # One sample is no line.
    assert np.isnan(result.strength[1])
    assert np.isfinite(result.strength[2:]).all()


def test_no_windows():
    result = estimate_windows([], [], [0], load=[], torque=[], sinkage=[], slip=[], **GEOMETRY)
    assert len(result) == 0


def test_torque_rmse_is_that_of_the_prediction():
    run = drive(1, 200, 32, kind="scatter", share=0.2, noises=(0.0, 0.05, 0.0, 0.0))
    result = estimate(run)
    assert result.torque_rmse[0] == pytest.approx(0.05 * run.torque.mean(), rel=0.1)


def test_many_blocks_of_work():
    run = drive(1500, 60, 33, kind="scatter", share=0.15, noises=0.02)
    assert run.load.size > 2 * 32_768
    together = estimate(run)
    last = drive(1500, 60, 33, kind="scatter", share=0.15, noises=0.02)
    alone = estimate(
        type(last)(*(getattr(last, f.name)[-1:] for f in fields(last)[:4]), last.cohesion, last.phi)
    )
    for name in NUMBERS:
        np.testing.assert_allclose(getattr(together, name)[-1:], getattr(alone, name), rtol=1e-12)


def test_however_windows_are_parted_the_estimates_are_the_same(monkeypatch):
    run = drive(9, 70, 34, kind="scatter", share=0.15, noises=0.02)
    together = estimate(run)
    monkeypatch.setattr(window_estimates, "_BLOCK", 100)
    monkeypatch.setattr(window_estimates, "_TOGETHER", 4)
    parted = estimate(run)
    for name in NUMBERS:
        np.testing.assert_allclose(getattr(parted, name), getattr(together, name), rtol=1e-9)


@examples(25)
@given(
    seed=st.integers(0, 10_000),
    cuts=st.lists(st.integers(1, 199), max_size=6, unique=True),
    method=st.sampled_from(["auto", "least-squares", "ridge"]),
    folds=st.sampled_from([None, 2, 5]),
)
def test_windows_do_not_know_of_each_other(seed, cuts, method, folds):
    run = drive(1, 200, seed, kind="undulation", share=0.15, noises=0.03)
    bounds = np.array([0, *sorted(cuts), 200])
    together = estimate(run, bounds=bounds, method=method, folds=folds)
    channels = run.channels
    x, y = line_coordinates(**channels, **GEOMETRY)
    for j, (start, stop) in enumerate(pairwise(bounds)):
        part = {name: values[start:stop] for name, values in channels.items()}
        alone = estimate_windows(
            x[start:stop], y[start:stop], [0, stop - start], **part, **GEOMETRY, method=method, folds=folds
        )
        for field in fields(alone):
            one, other = getattr(alone, field.name)[0], getattr(together, field.name)[j]
            assert one == other or one == pytest.approx(other, rel=1e-12, nan_ok=True)


@examples(25)
@given(seed=st.integers(0, 10_000), shift=st.floats(-5e3, 5e3))
def test_moving_x_moves_cohesion(seed, shift):
    run = drive(1, 40, seed, kind="undulation", share=0.15, noises=0.02)
    x, y = line_coordinates(**run.channels, **GEOMETRY)
    options = {**run.channels, **GEOMETRY, "method": "least-squares"}
    here, moved = (estimate_windows(x + by, y, [0, 40], **options) for by in (0.0, shift))
    assert moved.phi[0] == pytest.approx(here.phi[0], rel=1e-9)
    assert moved.c[0] == pytest.approx(here.c[0] - shift * np.tan(here.phi[0]), rel=1e-6, abs=1e-3)
    assert moved.strength[0] == pytest.approx(here.strength[0], rel=1e-9)
    assert moved.strength_se[0] == pytest.approx(here.strength_se[0], rel=1e-6)


@examples(25)
@given(seed=st.integers(0, 10_000), unit=st.sampled_from([1e-3, 1e-6, 7.0]))
def test_unit_of_stress_does_not_matter(seed, unit):
    run = drive(1, 40, seed, kind="undulation", share=0.15, noises=0.02)
    x, y = line_coordinates(**run.channels, **GEOMETRY)
    options = {**run.channels, **GEOMETRY, "method": "ridge"}
    pascal, other = (estimate_windows(x * by, y * by, [0, 40], **options) for by in (1.0, unit))
    assert other.status[0] == pascal.status[0]
    for name in ("phi", "phi_se", "corr", "delta", "condition_number"):
        assert getattr(other, name)[0] == pytest.approx(getattr(pascal, name)[0], rel=1e-6)
    for name in ("c", "c_se", "sigma_star", "strength", "strength_se"):
        assert getattr(other, name)[0] == pytest.approx(unit * getattr(pascal, name)[0], rel=1e-6)


@pytest.mark.parametrize("method", ["auto", "least-squares", "ridge", "recursive"])
def test_soils_alone_are_those_with_their_errors(method):
    run = drive(40, 30, 3, kind="steps", share=0.02, noises=0.03)
    bounds = np.concatenate([[0, 0, 1, 3], run.bounds[1:]])
    result = estimate(run, bounds=bounds, method=method)
    alone = window_estimates.soils(*line_coordinates(**run.channels, **GEOMETRY), bounds, method)
    np.testing.assert_array_equal(alone, [result.c, np.tan(result.phi)])


def test_wrong_use():
    run = drive(1, 10, 0, kind="steps", share=0.2)
    with pytest.raises(UsageError, match="no method 'ols'"):
        estimate(run, method="ols")
    with pytest.raises(UsageError, match="1 blocks"):
        estimate(run, folds=1)
