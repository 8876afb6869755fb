"""What a least-squares solution tells of the soil, against derivatives by differences."""

from __future__ import annotations

from copy import copy
from dataclasses import replace

import numpy as np
import pytest
from known_misfits import Kind, samples_of

from terrain_cli import effects
from terrain_cli.comparison import smoothed_fit, smoothed_model
from terrain_cli.comparison.fitted_wheel import FittedWheel
from terrain_cli.estimation.estimators import FitSettings
from terrain_cli.mechanics.wheel_model import Model
from terrain_cli.windows.cut_windows import cut


@pytest.fixture(scope="module")
def wheel():
    """Two windows, and friction in the drive, which both share."""
    samples = samples_of(5, Kind({"drivetrain-friction": {"Tc": 0.3, "Bv": 0.07}}))
    windows = cut(samples, "fixed", window_samples=len(samples) // 2)
    model = Model(effects=(effects.catalogue()["drivetrain-friction"],))
    return FittedWheel(windows, model, FitSettings({}, {}, (), None))


@pytest.fixture(scope="module")
def solution(wheel):
    data = wheel.least_squares_data()
    return data, smoothed_fit.solve(wheel.model, wheel.sought, data, *wheel.beginning())


def test_covariance_is_the_inverse_of_the_information_by_differences(wheel, solution):
    data, found = solution
    w, q = found.t.shape
    assert (w, len(found.common)) == (2, 2)
    x = np.concatenate([found.t.ravel(), found.common])

    def residual(x):
        t, common = x[: w * q].reshape(w, q), x[w * q :]
        numbers = smoothed_model.parameters(wheel.sought, t[data.window], common, data.window)
        return smoothed_model.residual(data, smoothed_model.forecast(wheel.model, data, numbers)[0]).ravel()

    step = 1e-4
    columns = [(residual(x + step * e) - residual(x - step * e)) / (2.0 * step) for e in np.eye(len(x))]
    design = np.stack(columns, axis=1)
    expected = np.linalg.inv(design.T @ design / found.spread + np.eye(len(x)))
    own, common = smoothed_fit.covariance(data, found)
    slope = [u.slope(found.t[:, j]) for j, u in enumerate(found.unknowns.local)]
    outside = [float(u.slope(found.common[j])) for j, u in enumerate(found.unknowns.shared)]
    for window in range(w):
        places = [*range(window * q, (window + 1) * q), *range(w * q, len(x))]
        scale = np.array([*(s[window] for s in slope), *outside])
        part = expected[np.ix_(places, places)] * np.outer(scale, scale)
        size = np.sqrt(np.outer(np.diag(part), np.diag(part)))
        np.testing.assert_allclose(own[window] / size, part / size, atol=0.02)
    np.testing.assert_allclose(common, own[0][q:, q:], rtol=1e-9)


def test_strength_is_told_at_the_stress_where_it_is_known_best(wheel, solution):
    data, found = solution
    fit = smoothed_fit.as_fit(data, found, wheel.fit)
    numbers = smoothed_fit.parameters(found)
    c, tan = (fit.names.index(name) for name in ("cohesion", "tan_phi"))
    assert np.all(fit.sigma_star > 0.0)

    def variance(sigma):
        weights = np.zeros((len(sigma), len(fit.names)))
        weights[:, c], weights[:, tan] = 1.0, sigma
        return np.einsum("wa,wab,wb->w", weights, fit.covariance, weights)

    np.testing.assert_allclose(fit.strength, numbers["cohesion"] + fit.sigma_star * numbers["tan_phi"])
    np.testing.assert_allclose(fit.strength_se**2, variance(fit.sigma_star))
    for factor in (0.9, 1.1):
        assert np.all(variance(factor * fit.sigma_star) > variance(fit.sigma_star))


def test_what_windows_share_has_one_value_and_one_error(wheel, solution):
    data, found = solution
    fit, numbers = smoothed_fit.as_fit(data, found, wheel.fit), smoothed_fit.parameters(found)
    for place, unknown in enumerate(found.unknowns.shared):
        assert np.ptp(numbers[unknown.name]) == 0.0
        assert fit.shared[unknown.name] == numbers[unknown.name][0]
        column = fit.names.index(unknown.name)
        own = np.sqrt(fit.covariance[:, column, column])
        np.testing.assert_allclose(own, np.sqrt(fit.shared_covariance[place, place]))
        assert fit.shared_errors[unknown.name] == pytest.approx(own[0])


def test_what_the_data_leave_open_is_of_the_fit_that_took_the_place(wheel, solution):
    """A fit that went astray may leave open what this one tells to a few percent."""
    data, found = solution
    every = (*found.unknowns.local, *found.unknowns.shared)
    astray = replace(wheel.fit, undetermined={u.name: np.ones(len(wheel.fit.n), dtype=bool) for u in every})
    fit = smoothed_fit.as_fit(data, found, astray)
    known = {"cohesion": 0.1, "tan_phi": 0.1}
    for name, most in known.items():
        (unknown,) = (u for u in every if u.name == name)
        assert np.all(fit.errors[name] < most * unknown.sd)
        assert not fit.undetermined[name].any()


def test_what_ran_to_a_bound_takes_up_no_misfit(wheel):
    """A soil whose exponent is as small as can be hides nothing that an even smaller one would explain."""
    stuck = copy(wheel)
    (unknown,) = (u for u in wheel.sought.local if u.name == "sinkage_exponent")
    least = float(unknown.value(np.array(unknown.lower)))
    exponent = wheel.parameters["sinkage_exponent"].copy()
    exponent[0] = least
    stuck.parameters = {**wheel.parameters, "sinkage_exponent": exponent}
    rows = np.arange(0, len(wheel), 7)
    column, first = wheel.soil.index("sinkage_exponent"), wheel.window[rows] == 0
    channels, slopes = stuck.noiseless(rows)
    tables = stuck.slopes(channels, rows)
    for name, free in slopes.items():
        expected = tables[name].copy()
        expected[first, column] = 0.0
        np.testing.assert_array_equal(free, expected)
