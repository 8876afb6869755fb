"""Windows of thirty samples: least squares, and ridge with exact leave-one-out."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from benchmarks.harness import Case, Stage
from terrain_cli.estimation.line import ridge
from terrain_cli.estimation.line.moments import LINE, fit_line, of_windows
from terrain_cli.estimation.line.window_estimates import blocks

if TYPE_CHECKING:
    from pathlib import Path

POINTS = 30
WINDOWS = {"small": 1_000, "medium": 100_000, "full": 1_000_000}
BY_LSTSQ, BY_RIDGECV = 2_000, 60


def windows(n: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return x, y and bounds of windows, each with its own soil."""
    rng = np.random.default_rng(5)
    x = rng.uniform(5e3, 8e3, (n, 1)) + rng.uniform(200.0, 3e3, (n, 1)) * rng.standard_normal((n, POINTS))
    y = (
        rng.uniform(500.0, 5e3, (n, 1))
        + rng.uniform(0.3, 0.8, (n, 1)) * x
        + 150.0 * rng.standard_normal((n, POINTS))
    )
    return x.ravel(), y.ravel(), np.arange(n + 1) * POINTS


def fitted(x, y, bounds, *, by_ridge):
    """Fit all windows, in the blocks of `estimate_windows`."""
    parts = []
    for first, last in blocks(bounds):
        rows, inner = slice(bounds[first], bounds[last]), bounds[first : last + 1] - bounds[first]
        moments = of_windows(np.array([x[rows], y[rows]]), inner, LINE)
        if by_ridge:
            found = ridge.choose(moments, ridge.losses(x[rows], y[rows], inner, moments, folds=None))
            parts.append((found.cohesion, found.tan_phi, found.delta))
        else:
            line = fit_line(moments)
            parts.append((line.cohesion, line.tan_phi))
    return [np.concatenate(columns) for columns in zip(*parts, strict=True)]


def with_lstsq(x, y):
    found = []
    for a in range(0, BY_LSTSQ * POINTS, POINTS):
        design = np.stack([np.ones(POINTS), x[a : a + POINTS]], axis=1)
        found.append(np.linalg.lstsq(design, y[a : a + POINTS], rcond=None)[0])
    return np.array(found).T


def with_ridgecv(x, y):
    from sklearn.linear_model import RidgeCV

    found = []
    for a in range(0, BY_RIDGECV * POINTS, POINTS):
        xs, ys = x[a : a + POINTS], y[a : a + POINTS]
        scale = np.sqrt(np.mean(xs**2))
        model = RidgeCV(alphas=POINTS * ridge.DELTAS, fit_intercept=False)
        model.fit(np.stack([np.ones(POINTS), xs / scale], axis=1), ys)
        found.append((model.coef_[0], model.coef_[1] / scale, model.alpha_ / POINTS))
    return np.array(found).T


def same_lines(ours, peer) -> str:
    """Compare c and tan φ."""
    worst = max(float(np.max(np.abs(o[:BY_LSTSQ] / p - 1.0))) for o, p in zip(ours, peer, strict=True))
    if worst > 1e-6:
        raise AssertionError(f"lines differ by {worst:.1e}")
    return f"c and tan φ differ by {worst:.0e} at most"


def same_ridges(ours, peer) -> str:
    """Compare c, tan φ and the choice of δ."""
    chosen = np.isclose(ours[2][:BY_RIDGECV], peer[2], rtol=1e-9)
    if chosen.mean() < 0.98:
        raise AssertionError(f"δ chosen alike in {chosen.sum()} of {BY_RIDGECV} windows")
    np.testing.assert_allclose(ours[0][:BY_RIDGECV][chosen], peer[0][chosen], rtol=1e-5)
    np.testing.assert_allclose(ours[1][:BY_RIDGECV][chosen], peer[1][chosen], rtol=1e-5)
    return f"δ chosen alike in {chosen.sum()} of {BY_RIDGECV} windows, c and tan φ then equal"


def make(kind: str, size: str, folder: Path) -> Case:  # noqa: ARG001 - every stage is made so
    """Make the case of one estimator."""
    n = max(WINDOWS[size] // (10 if kind == "ridge" else 1), 500)
    if kind == "line":
        n = max(n, BY_LSTSQ)
    x, y, bounds = windows(n)
    if kind == "line":
        return Case(
            partial(fitted, x, y, bounds, by_ridge=False),
            partial(with_lstsq, x, y),
            same_lines,
            lambda: (x.reshape(-1, POINTS).sum(1), y.reshape(-1, POINTS).sum(1)),
            n,
            BY_LSTSQ,
            "windows",
        )
    return Case(
        partial(fitted, x, y, bounds, by_ridge=True),
        partial(with_ridgecv, x, y),
        same_ridges,
        None,
        n,
        BY_RIDGECV,
        "windows",
    )


STAGES = (
    Stage("windows least squares", "numpy lstsq, window by window", partial(make, "line"), 50.0, 95.0),
    Stage("windows ridge LOO", "sklearn RidgeCV, window by window", partial(make, "ridge"), 100.0, 200.0),
)
