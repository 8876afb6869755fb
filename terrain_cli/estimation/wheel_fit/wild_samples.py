"""Samples that are too far from a fit for noise: spikes, dropped digits, the edge of another soil.

A few lead a fit by least squares astray however many samples there are. They are found by a robust fit
(Huber's weights), and left out of the final one (Rousseeuw & Leroy 1987, sections 1.2 and 4.4). Samples of
noise alone stay, so that nothing is lost on clean data.
"""

from __future__ import annotations

from statistics import NormalDist
from typing import TYPE_CHECKING

import numpy as np

from terrain_cli.estimation.line.moments import segment_sum
from terrain_cli.estimation.wheel_fit.gauss_newton import accumulate

if TYPE_CHECKING:
    from terrain_cli.estimation.wheel_fit.fit_data import FitData
    from terrain_cli.estimation.wheel_fit.gauss_newton import State
    from terrain_cli.estimation.wheel_fit.linearised import Equations, Problem
    from terrain_cli.vocabulary.arrays import Array, Index, Mask


#: Samples of pure noise that are left out of a whole log, on average. Judged.
_BY_CHANCE = 0.01
#: Share of a window's samples above which it is the model that misses, and not they. Judged.
_MOST = 0.1
#: Passes in which the true values of the inputs come to rest.
_PASSES = 3


def wild_samples(problem: Problem, data: FitData, found: State, order: int | None) -> Mask:
    """Tell which samples are too far from a robust fit, of these or of some, for the noise of `problem`."""
    limits = _squares(data.measured.shape[0], _BY_CHANCE / max(data.measured.shape[1], 1))
    far = np.flatnonzero(_squared(problem, data, found, order, 1) > limits[data.seen.sum(axis=0)])
    wild = np.zeros(data.measured.shape[1], dtype=bool)
    if len(far):
        # True values of the inputs that come to rest take a residual down, not up.
        part = data.take(far, np.diff(np.searchsorted(far, data.bounds)), np.arange(len(data.windows)))
        squared = _squared(problem, part, found, order, _PASSES)
        wild[far] = squared > limits[part.seen.sum(axis=0)]
    share = segment_sum(wild.astype(float), data.bounds) / np.maximum(data.count, 1)
    return np.asarray(wild & np.repeat(share <= _MOST, data.count))


def _squared(problem: Problem, data: FitData, found: State, order: int | None, passes: int) -> Array:
    """Return the sum of squares of each sample's residuals after some passes, shape (n,)."""
    squared = np.zeros(data.measured.shape[1])

    def keep(block: Index, _: FitData, equations: Equations) -> None:
        rows = slice(data.bounds[block[0]], data.bounds[block[-1] + 1])
        squared[rows] = np.einsum("an,an->n", equations.residual, equations.residual)

    latent = np.array([data.channels[name] for name in data.inputs])
    for _ in range(passes):
        accumulate(problem, data, found.t, found.common, latent, order=order, each=keep)
    return squared


def _squares(most: int, probability: float) -> Array:
    """Return what χ² of 0 to so many degrees of freedom exceeds that rarely (Wilson & Hilferty 1931)."""
    free = np.arange(1, most + 1)
    part = 2.0 / (9.0 * free)
    normal = NormalDist().inv_cdf(1.0 - probability)
    return np.concatenate([[np.inf], free * (1.0 - part + normal * np.sqrt(part)) ** 3])
