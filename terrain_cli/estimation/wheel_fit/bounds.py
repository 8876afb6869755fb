"""Means and errors of unknowns whose best values lie at or beyond their bounds.

About the bound the posterior is taken as normal, with its peak as far outside as the next step of
the search would lead, and cut off: the mean and the deviation of what remains stand for the
unknown, and the others move along as they are correlated with it (Johnson, Kotz & Balakrishnan
1994, section 13.10.1).
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from terrain_cli.estimation.wheel_fit.gauss_newton import Normal, eliminate, limits

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from terrain_cli.estimation.wheel_fit.unknowns import Unknown

    Array = NDArray[np.float64]

#: At its bound is what is no further from it, in prior standard deviations.
_NEAR = 1e-9
#: Deviations by which a peak is taken to be outside at the most: the model is not normal that far.
_FARTHEST = 5.0


def overshoot(normal: Normal, local: tuple[Unknown, ...], t: Array) -> Array:
    """Return how far beyond their bounds the next step would take the windows' own unknowns, shape (w, p).

    0 or more where an unknown is at its bound, else −1.
    """
    low, high, _ = limits(local)
    at_low, at_high = t <= low + _NEAR, t >= high - _NEAR
    if not (at_low | at_high).any():
        return np.full(t.shape, -1.0)
    own, _, _ = eliminate(normal, t.shape[1])
    step = np.einsum("wab,wb->wa", own, normal.score[:, : t.shape[1]] - t)
    outward = np.where(at_low, -step, step)
    return np.where(at_low | at_high, np.maximum(outward, 0.0), -1.0)


def truncate(t: Array, own: Array, beyond: Array, local: tuple[Unknown, ...]) -> tuple[Array, Array]:
    """Cut the distribution of the windows' unknowns (covariance `own`) off at bounds they are at."""
    low, high, _ = limits(local)
    t, own = t.copy(), own.copy()
    for w in np.flatnonzero((beyond >= 0.0).any(axis=1)):
        for j in np.argsort(-beyond[w]):
            # An unknown that moved along with another may be beyond its bound now.
            outside = max(low[j] - t[w, j], t[w, j] - high[j], beyond[w, j])
            variance = own[w, j, j]
            # Rounding leaves nothing of a variance that is all but none, and there is nothing to cut off.
            if outside < 0.0 or variance <= 0.0:
                continue
            deviation = math.sqrt(variance)
            mean, share = _half(min(outside / deviation, _FARTHEST))
            lower = t[w, j] - low[j] < high[j] - t[w, j]
            to = low[j] + mean * deviation if lower else high[j] - mean * deviation
            along = own[w, :, j] / variance
            t[w] += along * (to - t[w, j])
            own[w] -= np.outer(along, along) * variance * (1.0 - share)
            # What is left of a variance that goes along all the way may be rounded below none.
            np.fill_diagonal(own[w], np.maximum(np.diagonal(own[w]), 0.0))
    return np.clip(t, low, high), own


def _half(outside: float) -> tuple[float, float]:
    """Return mean and variance of what a standard normal distribution has beyond `outside`, from there on."""
    density = math.exp(-0.5 * outside**2) / math.sqrt(2.0 * math.pi)
    rate = density / (0.5 * math.erfc(outside / math.sqrt(2.0)))
    return rate - outside, 1.0 - rate * (rate - outside)
