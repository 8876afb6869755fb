"""The recursive estimate against a Kalman filter written out. Pooling of windows."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from drives import GEOMETRY, drive
from simulator import Soil, forces, sinkage_under
from simulator.paper import WHEEL

import terrain_cli as terrain
from terrain_cli.estimation import estimate_windows, pool, recursive
from terrain_cli.estimation.line.pooled import RecursiveLine
from terrain_cli.estimation.strength import strength_at
from terrain_cli.mechanics.linear import line_coordinates

STRESS = 1e4


def kalman(x, y, noise):
    """Filter the constant state (c, tan φ), sample by sample, from a wide prior."""
    state, covariance = np.zeros(2), np.diag([1e12, 1e4])
    for stress, strength in zip(x, y, strict=True):
        row = np.array([1.0, stress])
        gain = covariance @ row / (row @ covariance @ row + noise)
        state = state + gain * (strength - row @ state)
        covariance = covariance - np.outer(gain, row) @ covariance
        yield state, covariance


@pytest.fixture
def run():
    return drive(3, 120, 7, kind="undulation", share=0.2, noises=(0.0, 0.02, 0.0, 0.0))


@pytest.fixture
def stresses(run):
    return line_coordinates(**run.channels, **GEOMETRY)


def test_follows_the_filter(run, stresses):
    x, y = stresses
    trace = recursive([x, y, *run.channels.values()], run.bounds)
    for start in run.bounds[:-1]:
        states = list(kalman(x[start : start + 120], y[start : start + 120], noise=200.0**2))
        for k in (10, 40, 119):
            state, covariance = states[k]
            assert trace.c[start + k] == pytest.approx(state[0], rel=1e-4, abs=0.1)
            assert np.tan(trace.phi[start + k]) == pytest.approx(state[1], rel=1e-4)
            # Errors of the trace also hold what a filter does not know: the κ3 that the line leaves out.
            assert trace.corr[start + k] == pytest.approx(
                covariance[0, 1] / np.sqrt(covariance[0, 0] * covariance[1, 1]), abs=0.05
            )


def test_ends_at_the_batch_answer(run, stresses):
    trace = recursive([*stresses, *run.channels.values()], run.bounds)
    batch = estimate_windows([*stresses, *run.channels.values()], run.bounds, GEOMETRY, method="recursive")
    last = run.bounds[1:] - 1
    for name in ("c", "c_se", "phi", "phi_se", "corr"):
        np.testing.assert_allclose(getattr(trace, name)[last], getattr(batch, name), rtol=1e-9)


def test_is_every_time_the_batch_answer_so_far(run, stresses):
    x, y = stresses
    trace = recursive([x, y, *run.channels.values()], run.bounds)
    for k in (4, 17, 80):
        part = {name: values[:k] for name, values in run.channels.items()}
        batch = estimate_windows([x[:k], y[:k], *part.values()], [0, k], GEOMETRY, method="recursive")
        for name in ("c", "c_se", "phi", "phi_se", "corr"):
            assert getattr(trace, name)[k - 1] == pytest.approx(getattr(batch, name)[0], rel=1e-6)


def test_errors_shrink_and_begin_unknown(run, stresses):
    trace = recursive([*stresses, *run.channels.values()], run.bounds)
    for start in run.bounds[:-1]:
        assert np.isnan(trace.phi[start])
        assert np.isnan(trace.phi_se[start : start + 2]).all()
        assert np.isfinite(trace.phi_se[start + 2 : start + 120]).all()
        assert trace.phi_se[start + 119] < 0.5 * trace.phi_se[start + 9]


def test_empty_windows_have_no_samples(stresses, run):
    trace = recursive([*stresses, *run.channels.values()], [0, 0, 120, 240, 360, 360])
    assert len(trace.c) == 360


def test_sample_by_sample_it_is_the_trace(run, stresses):
    """Whatever number of samples comes at once, with sums alone that are held."""
    columns = np.array(stresses)[:, :120]
    channels = {name: channel[:120] for name, channel in run.channels.items()}
    trace = recursive([*columns, *channels.values()], [0, 120])
    line, done = RecursiveLine(), 0
    for size in (1, 1, 1, 2, 3, 1, 31, 80):
        line.add(columns[:, done : done + size])
        done += size
        np.testing.assert_allclose(line.soil, (trace.c[done - 1], np.tan(trace.phi[done - 1])), rtol=1e-9)
    line.add(columns[:, :0])
    assert line.count == done == 120


def test_a_load_that_does_not_vary_tells_no_soil():
    line = RecursiveLine()
    line.add(np.tile([[1e4], [7e3]], 50))
    assert np.isnan(line.soil).all()


def windows(strength, strength_se, tan_phi, tan_se, tan_bias=0.0, stress=STRESS):
    """Return estimates of windows that know their strength at a stress."""
    strength, strength_se, tan_phi, tan_se, tan_bias, stress = np.broadcast_arrays(
        *(
            np.atleast_1d(np.asarray(v, dtype=float))
            for v in (strength, strength_se, tan_phi, tan_se, tan_bias, stress)
        )
    )
    c_se = np.hypot(strength_se, stress * tan_se)
    by_phi = 1.0 + tan_phi**2
    return of_data(
        c=strength - stress * tan_phi,
        c_se=c_se,
        phi=np.arctan(tan_phi),
        phi_se=tan_se / by_phi,
        corr=-stress * tan_se / c_se,
        phi_bias=tan_bias / by_phi,
    )


def of_data(**given):
    """Return estimates that have no priors."""
    c, c_se, phi, phi_se, corr, phi_bias = np.broadcast_arrays(
        *(np.atleast_1d(given[name]) for name in ("c", "c_se", "phi", "phi_se", "corr", "phi_bias"))
    )
    return SimpleNamespace(
        c=c,
        c_se=c_se,
        phi=phi,
        phi_se=phi_se,
        corr=corr,
        phi_bias=phi_bias,
        data_c=c,
        data_c_se=c_se,
        data_tan_phi=np.tan(phi),
        data_tan_phi_se=phi_se * (1.0 + np.tan(phi) ** 2),
        data_corr=corr,
        sigma_star=np.full(len(c), np.nan)
        if np.any(phi_se == 0.0)
        else -corr * c_se * np.cos(phi) ** 2 / phi_se,
        status=np.full(len(c), "ok", dtype="<U15"),
        separable=np.full(len(c), fill_value=True),
        **dict.fromkeys(("assumed_c_se", "assumed_tan_phi_se", "assumed_corr"), np.zeros(len(c))),
    )


def test_one_window_is_its_own_pool():
    given = windows(6500.0, 80.0, 0.55, 0.04, tan_bias=0.03)
    pooled = pool(given)
    assert pooled.windows == 1
    for name in ("c", "c_se", "phi", "phi_se", "corr"):
        assert getattr(pooled, name) == pytest.approx(getattr(given, name)[0], rel=1e-6)
    assert pooled.sigma_star == pytest.approx(STRESS)
    assert pooled.strength == pytest.approx(6500.0)
    assert pooled.strength_se == pytest.approx(80.0)
    assert pooled.strength_between == 0.0


def test_the_pivot_stays_within_the_stresses_of_the_windows():
    """Where the errors of c and φ rise together, the strength is surest at a stress below 0."""
    given = of_data(c=1000.0, c_se=30.0, phi=0.55, phi_se=0.002, corr=0.8, phi_bias=0.0)
    given.sigma_star = np.array([5000.0])
    pooled = pool(given)
    assert pooled.sigma_star == 5000.0
    assert pooled.strength == pytest.approx(1000.0 + 5000.0 * np.tan(0.55), rel=1e-6)
    assert (pooled.strength, pooled.strength_se) == pytest.approx(strength_at(5000.0, pooled), rel=1e-6)
    error = 0.002 * (1.0 + np.tan(0.55) ** 2) * 8000.0
    assert strength_at(8000.0, pooled)[1] ** 2 == pytest.approx(30.0**2 + 2.0 * 0.8 * 30.0 * error + error**2)


def test_weights_are_inverse_variances():
    # Weights 1 and 1/4 of variances 100² and 200²: (6000 + 6200/4)/1.25 = 6040, 100/√1.25.
    pooled = pool(windows([6000.0, 6200.0], [100.0, 200.0], [0.5, 0.52], [0.04, 0.04]))
    assert pooled.strength == pytest.approx(6040.0, rel=1e-6)
    assert pooled.strength_se == pytest.approx(100.0 / np.sqrt(1.25), rel=1e-6)
    assert np.tan(pooled.phi) == pytest.approx(0.51, rel=1e-6)
    assert pooled.phi_se * (1.0 + 0.51**2) == pytest.approx(0.04 / np.sqrt(2.0), rel=1e-6)


def test_soil_that_differs_between_windows():
    rng = np.random.default_rng(1)
    size = 4000
    strength = 6000.0 + rng.normal(0.0, 300.0, size) + rng.normal(0.0, 100.0, size)
    pooled = pool(windows(strength, 100.0, 0.5 + rng.normal(0.0, 0.05, size), 0.05))
    assert pooled.strength_between == pytest.approx(300.0, rel=0.05)
    assert pooled.phi_between < 0.01
    assert pooled.strength_se == pytest.approx(np.hypot(300.0, 100.0) / np.sqrt(size), rel=0.05)
    assert abs(pooled.strength - 6000.0) < 3.0 * pooled.strength_se


def test_what_the_sensors_do_is_not_averaged_out():
    pooled = pool(windows(np.full(100, 6000.0), 50.0, 0.5, 0.05, tan_bias=0.04))
    own = 0.03 / 10.0
    assert pooled.phi_se * 1.25 == pytest.approx(np.hypot(own, 0.04), rel=1e-3)
    assert pooled.strength_se == pytest.approx(5.0, rel=1e-3)


def test_strengths_at_two_stresses_make_a_line():
    stress = np.repeat([8e3, 1.6e4], 5)
    pooled = pool(windows(500.0 + 0.6 * stress, 20.0, 0.05, np.hypot(0.6, 0.05), tan_bias=0.6, stress=stress))
    assert np.tan(pooled.phi) == pytest.approx(0.6, abs=0.01)
    assert pooled.c == pytest.approx(500.0, abs=100.0)
    assert np.degrees(pooled.phi_se) < 1.0


def test_windows_that_cannot_be_pooled_are_passed_over():
    given = windows([6000.0, 1.0, 2.0], 50.0, 0.5, 0.05)
    given.data_tan_phi_se[1] = np.nan
    given.status[2] = "too-few-samples"
    pooled = pool(given)
    assert pooled.windows == 1
    assert pooled.strength == pytest.approx(6000.0)
    nothing = pool(given, [1, 2])
    assert nothing.windows == 0
    assert np.isnan(nothing.c)


@pytest.mark.parametrize("select", [[0, 2], [True, False, True]])
def test_select_is_by_index_or_mask(select):
    pooled = pool(windows([6000.0, 1.0, 6000.0], 50.0, 0.5, 0.05), select)
    assert pooled.windows == 2
    assert pooled.strength == pytest.approx(6000.0)


def test_exact_windows_can_be_pooled():
    given = windows([6000.0, 6000.0], 1.0, 0.5, 0.0)
    given.data_c_se, given.data_corr = np.zeros(2), np.full(2, np.nan)
    pooled = pool(given)
    assert pooled.windows == 2
    assert pooled.c == pytest.approx(1e3)
    assert pooled.phi == pytest.approx(np.arctan(0.5))


def test_windows_of_one_soil_hold_the_truth():
    inside = []
    for seed in range(40):
        run = drive(12, 60, seed, kind="scatter", share=0.2, noises=0.03)
        x, y = line_coordinates(**run.channels, **GEOMETRY)
        estimates = estimate_windows([x, y, *run.channels.values()], run.bounds, GEOMETRY)
        pooled = pool(estimates)
        assert pooled.phi_se < estimates.phi_se.mean()
        inside.append(
            (
                abs(pooled.phi - run.phi) < 1.96 * pooled.phi_se,
                abs(pooled.c - run.cohesion) < 1.96 * pooled.c_se,
            )
        )
    assert np.mean(inside, axis=0).min() >= 0.9


def test_errors_of_any_size_pool_to_finite_ones():
    rng = np.random.default_rng(11)
    for trial in range(300):
        count = int(rng.choice([1, 2, 300]))
        # Exact in a third of the windows, and in all of some trials.
        c_se, phi_se = (
            10.0 ** rng.uniform(-12.0, high, count) * (rng.random(count) > trial % 4 / 3.0)
            for high in (20.0, 1.0)
        )
        given = of_data(
            c=rng.standard_normal(count) * 10.0 ** rng.uniform(-10.0, 20.0) * (trial % 2),
            c_se=c_se,
            phi=rng.uniform(-1.5, 1.5, count) * (trial % 3 == 0),
            phi_se=phi_se,
            corr=rng.choice([-1.0, 0.0, 0.5, 1.0], count),
            phi_bias=phi_se * rng.uniform(0.0, 1.0, count),
        )
        pooled = pool(given)
        for name in ("c", "phi", "sigma_star", "strength"):
            assert np.isfinite(getattr(pooled, name)), (trial, name)
        for name in ("c_se", "phi_se"):
            assert 0.0 < getattr(pooled, name) < np.inf, (trial, name)


def test_a_prior_counts_once_and_not_in_every_window(tmp_path):
    # Clay of Table I of the paper; each window is too steady to tell c from φ.
    clay = Soil("clay", 4140.0, np.radians(13.0), 0.010, 13.2e3, 692.2e3, 0.5, c1=0.5, c2=0.0)
    rng = np.random.default_rng(7)
    rows = []
    for load, slip in rng.uniform((80.0, 0.2), (100.0, 0.4), (25, 2)):
        sinkage = sinkage_under(clay, WHEEL, load, slip)
        exact = np.array([load, forces(clay, WHEEL, sinkage, slip).torque, sinkage, slip])
        rows.append(exact * (1.0 + 0.02 * rng.standard_normal((40, 4))))
    table = pd.DataFrame(np.concatenate(rows), columns=["load", "torque", "sinkage", "slip"])
    table["time"] = np.arange(len(table)) / 10.0
    (tmp_path / "rover.toml").write_text(
        f"[wheel]\nradius = {WHEEL.radius}\nwidth = {WHEEL.width}\n[soil]\nshear_modulus = 0.012\n"
    )
    (samples,) = terrain.from_frame(table, tmp_path / "rover.toml")
    windows = terrain.segment(samples, "fixed", window_samples=40)
    assert len(windows) == 25
    (entry,) = terrain.summarise(windows)
    pooled = entry["pooled"]
    assert abs(pooled["phi_deg"] - 13.0) < 2.0 * pooled["phi_se_deg"]
    assert abs(pooled["c_kPa"] - 4.14) < 2.0 * pooled["c_se_kPa"]
    strength = 4.14 + pooled["stress_kPa"] * np.tan(np.radians(13.0))
    assert abs(pooled["strength_at_stress_kPa"] - strength) < 2.0 * pooled["strength_at_stress_se_kPa"]
