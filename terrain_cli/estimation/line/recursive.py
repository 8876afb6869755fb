"""c and φ sample by sample: the recursive form of the estimator."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from terrain_cli.estimation.line.least_squares import fit_line
from terrain_cli.estimation.line.moments import KEYS, ROUNDING, ROWS, WindowMoments, X, Y, running
from terrain_cli.estimation.line.uncertainty import uncertainty

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    Array = NDArray[np.float64]

#: The longest lag of the products that the errors need.
_LAGS = max(lag for lag, _, _ in KEYS)


@dataclass(frozen=True)
class Trace:
    """Estimates of every sample from the samples of its window so far, NaN where not known.

    Parameters
    ----------
    c, c_se : ndarray, shape (n,)
        Pa.
    phi, phi_se : ndarray, shape (n,)
        rad.
    corr : ndarray, shape (n,)
        Correlation of the errors of c and φ.
    """

    c: Array
    c_se: Array
    phi: Array
    phi_se: Array
    corr: Array


def recursive(
    x: ArrayLike,
    y: ArrayLike,
    bounds: ArrayLike,
    *,
    load: ArrayLike,
    torque: ArrayLike,
    sinkage: ArrayLike,
    slip: ArrayLike,
    correlated: bool = True,
) -> Trace:
    """Follow c, φ and their errors through each window.

    The Kalman filter of the constant state (c, tan φ) with the measurement y = c + x tan φ,
    started from a prior of no information. In its information form such a filter does nothing
    but add up, so that its states are had from cumulative sums of products, and the last is
    the least-squares answer of `estimate_windows`, with the same errors. The noise of the
    measurement and its correlation are not given beforehand but taken from the residuals so
    far.

    Parameters
    ----------
    x, y : array_like, shape (n,)
        Stresses of `mechanics.linear.line_coordinates`, Pa; finite.
    bounds : array_like of int, shape (w + 1,)
        Window j is the samples bounds[j] to bounds[j + 1] − 1; from 0 to n.
    load, torque, sinkage, slip : array_like, shape (n,)
        W in N, T in N m, z in m, i.
    correlated : bool
        False for steady test points, which have no order in time.
    """
    columns = np.array([x, y, load, torque, sinkage, slip], dtype=float)
    states = np.full((5, columns.shape[1]), np.nan)
    edges = np.asarray(bounds, dtype=np.intp)
    for start, stop in pairwise(edges):
        if stop == start:
            continue
        states[:, start:stop] = _states(running(columns[:, start:stop]), correlated=correlated)
    return Trace(*states)


class RecursiveLine:
    """The same filter with the samples of one window coming one by one: it holds sums, and no sample.

    Its state after any number of samples is that of `recursive` there.
    """

    def __init__(self) -> None:
        self.count = 0
        self._origin = np.zeros((ROWS, 1))
        self._total = np.zeros(ROWS)
        self._products = np.zeros((_LAGS + 1, ROWS, ROWS))
        self._first, self._last = np.empty((ROWS, 0)), np.empty((ROWS, 0))

    def add(self, columns: Array) -> None:
        """Take samples, in the order of time: x, y, load, torque, sinkage and slip; shape (6, n)."""
        size = columns.shape[1]
        if not size:
            return
        if not self.count:
            self._origin = columns[:, :1].copy()
        deviation = columns - self._origin
        beside = np.concatenate([self._last, deviation], axis=1)
        before = beside.shape[1] - size
        self._total += deviation.sum(axis=1)
        for lag in range(_LAGS + 1):
            late = max(lag - before, 0)
            if late < size:
                early = beside[:, before + late - lag : beside.shape[1] - lag]
                self._products[lag] += deviation[:, late:] @ early.T
        self.count += size
        if self._first.shape[1] < _LAGS:
            self._first = np.concatenate([self._first, deviation], axis=1)[:, :_LAGS]
        self._last = beside[:, -_LAGS:]

    @property
    def soil(self) -> tuple[float, float]:
        """Cohesion in Pa and tan φ by now; NaN where x does not vary."""
        n = max(self.count, 1)
        (x, y), products = self._total[[X, Y]] / n, self._products[0]
        spread = products[X, X] - n * x * x
        level = self._origin[:, 0]
        if not spread > n * (ROUNDING * (level[X] + x)) ** 2:
            return np.nan, np.nan
        slope = (products[X, Y] - n * x * y) / spread
        return float(level[Y] + y - slope * (level[X] + x)), float(slope)

    def trace(self, *, correlated: bool = True) -> Trace:
        """Return c, φ and their errors by now, shape (1,); one sample at least."""
        count = np.array([float(self.count)])
        mean = self._total / self.count
        products = {}
        for lag, a, b in KEYS:
            both = 2.0 * self._total
            if lag:
                both = both - self._first[:, :lag].sum(axis=1) - self._last[:, -lag:].sum(axis=1)
            about = 0.5 * (self._products[lag, a, b] + self._products[lag, b, a])
            about += max(self.count - lag, 0) * mean[a] * mean[b]
            products[lag, a, b] = np.array([about - 0.5 * (mean[a] * both[b] + mean[b] * both[a])])
        moments = WindowMoments(count, self._origin + mean[:, None], products)
        return Trace(*_states(moments, correlated=correlated))


def _states(moments: WindowMoments, *, correlated: bool) -> tuple[Array, ...]:
    """Return the columns of a trace."""
    line = fit_line(moments)
    gain = np.broadcast_to(np.eye(2)[:, :, None], (2, 2, len(moments.count)))
    errors = uncertainty(moments, line, line.cohesion, line.tan_phi, gain, correlated=correlated)
    return line.cohesion, errors.cohesion, np.arctan(line.tan_phi), errors.phi, errors.correlation
