"""Ridge regression against scikit-learn and against refits."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from sklearn.linear_model import Ridge, RidgeCV

from terrain_cli.estimation.line import ridge
from terrain_cli.estimation.line.moments import of_windows
from terrain_cli.estimation.line.ridge import DELTAS, choose, losses

COUNTS = (5, 12, 30, 61)


def windows(seed, spread=0.08, scatter=0.03):
    """Return x and y of windows of unequal length, and their bounds."""
    rng = np.random.default_rng(seed)
    bounds = np.cumsum([0, *COUNTS])
    x = 1.3e4 * (1.0 + spread * rng.uniform(-1.0, 1.0, bounds[-1]))
    y = (800.0 + 0.58 * x) * (1.0 + scatter * rng.standard_normal(bounds[-1]))
    return x, y, bounds


def ridge_of(x, y, bounds, folds=None):
    columns = np.ones((6, len(x)))
    columns[0], columns[1] = x, y
    moments = of_windows(columns, bounds)
    return choose(moments, losses(x, y, bounds, moments, folds=folds))


def design_of(x):
    """Return the columns 1 and x of unit root mean square, and the scale of x."""
    scale = np.sqrt(np.mean(x**2))
    return np.column_stack([np.ones_like(x), x / scale]), scale


@pytest.mark.parametrize("seed", range(20))
def test_leave_one_out_chooses_and_fits_as_sklearn_does(seed):
    x, y, bounds = windows(seed)
    fitted = ridge_of(x, y, bounds)
    for j, count in enumerate(COUNTS):
        window = slice(bounds[j], bounds[j + 1])
        design, scale = design_of(x[window])
        model = RidgeCV(alphas=count * DELTAS, fit_intercept=False).fit(design, y[window])
        assert fitted.delta[j] == pytest.approx(model.alpha_ / count)
        np.testing.assert_allclose(
            (fitted.cohesion[j], fitted.tan_phi[j] * scale), model.coef_, rtol=1e-6, atol=1e-6 * y.mean()
        )


@pytest.mark.parametrize("folds", [2, 5, 7])
def test_blocks_left_out_are_those_of_refits(folds):
    x, y, bounds = windows(3)
    fitted = ridge_of(x, y, bounds, folds)
    for j, count in enumerate(COUNTS):
        window = slice(bounds[j], bounds[j + 1])
        design, _ = design_of(x[window])
        edges = [count * fold // folds for fold in range(folds + 1)]
        loss = np.zeros(len(DELTAS))
        for row, delta in enumerate(DELTAS):
            for start, stop in pairwise(edges):
                kept = np.r_[0:start, stop:count]
                model = Ridge(alpha=count * delta, fit_intercept=False, solver="svd")
                model.fit(design[kept], y[window][kept])
                held = np.arange(start, stop)
                if len(held):
                    loss[row] += np.sum((y[window][held] - model.predict(design[held])) ** 2)
        assert fitted.delta[j] == pytest.approx(DELTAS[np.argmin(loss)])


def test_unit_of_stress_does_not_matter():
    x, y, bounds = windows(1)
    pascal, kilopascal = ridge_of(x, y, bounds), ridge_of(x / 1e3, y / 1e3, bounds)
    np.testing.assert_array_equal(pascal.delta, kilopascal.delta)
    np.testing.assert_allclose(pascal.cohesion, kilopascal.cohesion * 1e3, rtol=1e-9)
    np.testing.assert_allclose(pascal.tan_phi, kilopascal.tan_phi, rtol=1e-9)


def test_noise_free_window_is_not_drawn():
    x, y, bounds = windows(2, scatter=0.0)
    fitted = ridge_of(x, y, bounds)
    np.testing.assert_array_equal(fitted.delta, DELTAS[0])
    np.testing.assert_allclose(fitted.tan_phi, 0.58, rtol=1e-4)
    np.testing.assert_allclose(fitted.cohesion, 800.0, rtol=1e-3)


def test_without_variation_strength_is_shared_equally():
    fitted = ridge_of(np.full(8, 1e4), np.full(8, 6e3), np.array([0, 8]))
    assert fitted.cohesion[0] == pytest.approx(3e3, rel=1e-7)
    assert fitted.tan_phi[0] == pytest.approx(0.3, rel=1e-7)


def test_gain_is_the_derivative_by_the_line_of_least_squares():
    x, y, bounds = windows(4)
    base = ridge_of(x, y, bounds)
    mean = np.add.reduceat(x, bounds[:-1]) / COUNTS
    for column, step in enumerate((1.0 + 0.0 * x, x - np.repeat(mean, COUNTS))):
        moved = ridge_of(x, y + 1e-3 * step, bounds)
        np.testing.assert_array_equal(moved.delta, base.delta)
        slope = (moved.tan_phi - base.tan_phi) / 1e-3
        stress = (moved.cohesion - base.cohesion) / 1e-3 + mean * slope
        np.testing.assert_allclose(base.gain[0, column], stress, rtol=1e-4, atol=1e-4)
        np.testing.assert_allclose(base.gain[1, column], slope, rtol=1e-4, atol=1e-9)


def test_long_windows_one_by_one_are_all_windows_at_once(monkeypatch):
    x, y, bounds = windows(6)
    together = ridge_of(x, y, bounds)
    monkeypatch.setattr(ridge, "_LONG", 1)
    monkeypatch.setattr(ridge, "_TOGETHER", 7)
    one_by_one = ridge_of(x, y, bounds)
    np.testing.assert_array_equal(one_by_one.delta, together.delta)
    np.testing.assert_allclose(one_by_one.cohesion, together.cohesion, rtol=1e-12)
    columns = np.array([x, y, *np.ones((4, len(x)))])
    moments = of_windows(columns, bounds)
    np.testing.assert_allclose(
        ridge.losses(x, y, bounds, moments, folds=None), losses_by_hand(x, y, bounds), rtol=1e-9
    )


def losses_by_hand(x, y, bounds):
    """Leave out one sample after the other, and fit the rest with the penalty of them all."""
    loss = np.zeros((len(DELTAS), len(bounds) - 1))
    for j, (start, stop) in enumerate(pairwise(bounds)):
        design, _ = design_of(x[start:stop])
        n = stop - start
        for row, delta in enumerate(DELTAS):
            for out in range(n):
                kept = np.arange(n) != out
                normal = design[kept].T @ design[kept] + n * delta * np.eye(2)
                found = np.linalg.solve(normal, design[kept].T @ y[start:stop][kept])
                loss[row, j] += (y[start + out] - design[out] @ found) ** 2
    return loss
