"""Estimates of one soil that samples or windows add to: recursive within a window, pooled over windows."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike

from terrain_cli.estimation.line.moments import ROUNDING, WindowMoments, X, Y, fit_line, running
from terrain_cli.estimation.line.uncertainty import uncertainty
from terrain_cli.estimation.line.window_estimates import WindowEstimates
from terrain_cli.vocabulary.arrays import Array

#: Errors below this share of the strength and of 1 (Pa, or in tan φ) do not weigh more than that:
#: exact windows would otherwise make the normal equations singular.
_SMALLEST = 1e-6
_UNSURE = 1e-9  # Correlations are not believed nearer to ±1 than this: no inverse would be left of them


@dataclass(frozen=True)
class Trace:
    """Estimates of every sample from the samples of its window so far, NaN where not known."""

    c: Array  # c, c_se: shape (n,): Pa
    c_se: Array
    phi: Array  # phi, phi_se: shape (n,): rad
    phi_se: Array
    corr: Array  # Shape (n,): correlation of the errors of c and φ


def recursive(columns: Sequence[ArrayLike], bounds: ArrayLike, *, correlated: bool = True) -> Trace:
    """Follow c, φ and their errors through each window; columns are those of `estimate_windows`.

    The Kalman filter of the constant state (c, tan φ) with the measurement y = c + x tan φ, started from a
    prior of no information. In its information form such a filter does nothing but add up: its states are had
    from cumulative sums of products, and the last is least squares, with the noise of the residuals so far.
    """
    rows = np.array(columns, dtype=float)
    states = np.full((5, rows.shape[1]), np.nan)
    for start, stop in pairwise(np.asarray(bounds, dtype=np.intp)):
        if stop > start:
            states[:, start:stop] = _states(running(rows[:, start:stop]), correlated=correlated)
    return Trace(*states)


class RecursiveLine:
    """The soil by the same filter, with the samples of one window coming one by one: it holds sums alone."""

    def __init__(self) -> None:
        self.count = 0
        self._origin, self._total = np.zeros((2, 1)), np.zeros(2)
        self._products = np.zeros((2, 2))

    def add(self, line: Array) -> None:
        """Take samples, in the order of time: x and y; shape (2, n)."""
        if not line.size:
            return
        if not self.count:
            self._origin = line[:, :1].copy()
        deviation = line - self._origin
        self._total += deviation.sum(axis=1)
        self._products += deviation @ deviation.T
        self.count += line.shape[1]

    @property
    def soil(self) -> tuple[float, float]:
        """Cohesion in Pa and tan φ by now; NaN where x does not vary."""
        n = max(self.count, 1)
        (x, y), products = self._total / n, self._products
        spread = products[X, X] - n * x * x
        level = self._origin[:, 0]
        if not spread > n * (ROUNDING * (level[X] + x)) ** 2:
            return np.nan, np.nan
        slope = (products[X, Y] - n * x * y) / spread
        return float(level[Y] + y - slope * (level[X] + x)), float(slope)


def _states(moments: WindowMoments, *, correlated: bool) -> tuple[Array, ...]:
    line = fit_line(moments)
    gain = np.broadcast_to(np.eye(2)[:, :, None], (2, 2, len(moments.count)))
    errors, _ = uncertainty(moments, line, line.cohesion, line.tan_phi, gain, correlated=correlated)
    return line.cohesion, errors.c_se, np.arctan(line.tan_phi), errors.phi_se, errors.corr


@dataclass(frozen=True, kw_only=True)
class PooledEstimate:
    """Estimate from windows of one soil, NaN where not known."""

    windows: int = 0  # Those pooled
    c: float = np.nan  # c, c_se, phi, phi_se, corr: Pa and rad, with the correlation of the errors of c and φ
    c_se: float = np.nan
    phi: float = np.nan
    phi_se: float = np.nan
    corr: float = np.nan
    # sigma_star, strength, strength_se: stress at which the strength is least correlated with φ, among those
    # of the windows, and the strength there, Pa
    sigma_star: float = np.nan
    strength: float = np.nan
    strength_se: float = np.nan
    # strength_between, phi_between: standard deviations of the soil from window to window, beyond the
    # windows' own errors, Pa and rad
    strength_between: float = np.nan
    phi_between: float = np.nan


def pool(estimates: WindowEstimates, select: ArrayLike | None = None) -> PooledEstimate:
    """Combine windows, or those to `select`, by generalised least squares with random effects.

    Each window gives its strength at one common stress and its tan φ, with the covariance of the two; each is
    weighted by the inverse of that covariance plus the variance of the soil between windows (DerSimonian &
    Kacker 2007). What is the same in every window, as what the sensors' noise does to φ and what all of them
    take for true, is not averaged out. A window that cannot tell c from φ still knows its strength, and
    strengths at several stresses fix the line; leaving out negative c would bias c.
    """
    chosen = slice(None) if select is None else np.asarray(select)
    status = estimates.status[chosen]
    columns = np.array(
        [
            getattr(estimates, name)[chosen]
            for name in ("data_c", "data_c_se", "data_tan_phi", "data_tan_phi_se", "data_corr", "phi_bias")
        ]
    )
    # Of estimates without error the correlation is not known, nor needed.
    columns[4, columns[1] == 0.0] = 0.0
    used = np.isfinite(columns).all(axis=0) & (status != "too-few-samples")
    cohesion, cohesion_se, tan_phi, tan_se, correlation, phi_bias = columns[:, used]
    if len(cohesion) == 0:
        return PooledEstimate()

    tan_bias = phi_bias * (1.0 + tan_phi**2)
    pivots = -correlation * cohesion_se / np.where(tan_se > 0.0, tan_se, np.inf)
    stress = float(pivots.mean())
    assumed_c, assumed_t, assumed_corr = (
        getattr(estimates, name)[chosen][used]
        for name in ("assumed_c_se", "assumed_tan_phi_se", "assumed_corr")
    )
    # Two causes at most: one that moves both, one that moves the slope alone.
    slopes = assumed_t * np.array([assumed_corr, np.sqrt(1.0 - assumed_corr**2)])
    assumed = np.array([[assumed_c + stress * slopes[0], stress * slopes[1]], slopes])
    value = np.array([cohesion + stress * tan_phi, tan_phi])
    # A window's strength at its own σ* is uncorrelated with tan φ; moving it to the common
    # stress brings in the error of tan φ, and the shared part of that error.
    lever = np.array([stress - pivots, np.ones_like(pivots)])
    # What is the same in every window: strength and slope, window, cause.
    bias = np.concatenate([(lever * tan_bias)[:, :, None], np.moveaxis(assumed, 1, 2)], axis=2)
    shared = np.linalg.norm(bias, axis=2)
    own = lever[:, None] * lever * np.maximum(tan_se**2 - tan_bias**2, 0.0)
    own[0, 0] += cohesion_se**2 * (1.0 - correlation**2)
    own[[0, 1], [0, 1]] += (_SMALLEST * np.array([[1.0 + np.abs(value[0]).max()], [1.0]])) ** 2

    between = np.array([_between(value[a], own[a, a], bias[a]) for a in (0, 1)])
    own[[0, 1], [0, 1]] += between[:, None] + _UNSURE * (own[[0, 1], [0, 1]] + shared**2)
    own, each = np.moveaxis(own, -1, 0), np.moveaxis(bias, 1, 0)
    weight = np.linalg.inv(own + each @ np.swapaxes(each, 1, 2))
    share = np.linalg.inv(weight.sum(axis=0)) @ weight
    strength, slope = np.einsum("wab,bw->a", share, value)
    # What each independent error does to strength and slope: rounding makes no sum of squares negative.
    moved = np.concatenate([*(share @ np.linalg.cholesky(own)), (share @ each).sum(axis=0)], axis=1)
    by_strength, by_slope = moved
    by_c, var_t = by_strength - stress * by_slope, by_slope @ by_slope
    pivot = stress - (by_strength @ by_slope) / var_t
    applied = estimates.sigma_star[chosen][used]
    if np.isfinite(applied).any():
        pivot = float(np.clip(pivot, np.nanmin(applied), np.nanmax(applied)))
    to_pivot = pivot - stress
    c_se, strength_se = (float(np.linalg.norm(by)) for by in (by_c, by_strength + to_pivot * by_slope))
    return PooledEstimate(
        windows=len(cohesion),
        c=float(strength - stress * slope),
        c_se=c_se,
        phi=float(np.arctan(slope)),
        phi_se=float(np.sqrt(var_t) / (1.0 + slope**2)),
        corr=float(np.clip(by_c @ by_slope / (c_se * np.sqrt(var_t)), -1.0, 1.0)) if c_se > 0.0 else np.nan,
        sigma_star=float(pivot),
        strength=float(strength + to_pivot * slope),
        strength_se=strength_se,
        strength_between=float(np.sqrt(between[0])),
        phi_between=float(np.sqrt(between[1]) / (1.0 + slope**2)),
    )


def _between(value: Array, own: Array, shared: Array) -> float:
    """Variance between windows by the method of moments: the scatter that errors do not explain.

    A shared error scatters the windows only as far as it differs between them. Nothing is known
    of it from one window, or where one window outweighs all others.
    """
    weight = 1.0 / (own + np.sum(shared**2, axis=1))
    total = weight.sum()
    others = weight * (1.0 - weight / total)
    if others.sum() <= _SMALLEST * total:
        return 0.0

    def scatter(values: Array) -> float:
        return float(np.sum(weight * (values - np.sum(weight * values) / total) ** 2))

    unexplained = scatter(value) - sum(map(scatter, shared.T)) - np.sum(others * own)
    return float(max(unexplained, 0.0) / others.sum())
