"""c and φ sample by sample: the recursive form of the estimator."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from terrain_cli.estimation.line.least_squares import fit_line
from terrain_cli.estimation.line.moments import running
from terrain_cli.estimation.line.uncertainty import uncertainty

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    Array = NDArray[np.float64]


@dataclass(frozen=True)
class Trace:
    """Estimates of every sample from the samples of its window so far, NaN where not known."""

    c: Array  # c, c_se: shape (n,): Pa
    c_se: Array
    phi: Array  # phi, phi_se: shape (n,): rad
    phi_se: Array
    corr: Array  # Shape (n,): correlation of the errors of c and φ


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
        moments = running(columns[:, start:stop])
        line = fit_line(moments)
        gain = np.broadcast_to(np.eye(2)[:, :, None], (2, 2, stop - start))
        errors = uncertainty(moments, line, line.cohesion, line.tan_phi, gain, correlated=correlated)
        states[:, start:stop] = (
            line.cohesion,
            errors.cohesion,
            np.arctan(line.tan_phi),
            errors.phi,
            errors.correlation,
        )
    return Trace(*states)
