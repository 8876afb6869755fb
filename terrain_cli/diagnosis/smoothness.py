"""Whether what is left of steady test points follows their slip too smoothly for chance."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from terrain_cli.comparison.noise import between

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from terrain_cli.comparison.noise import Between
    from terrain_cli.diagnosis.refits import Ground

    Array = NDArray[np.float64]

#: Orders that are drawn.
DRAWS = 1999
#: Points of a wheel from which on the scores of effects tell all there is to tell.
_MANY = 200


def chance(data: Ground, seed: int) -> float:
    """Return how often steady points in another order would leave as smooth a residual.

    A score needs some ten blocks to stand out; six points that rise from slip to slip are no chance
    either, as noise would be the same in whatever order they are put.

    Parameters
    ----------
    data : Ground
    seed : int

    Returns
    -------
    float
        Of the wheel that is least likely; 1 where none was measured at steady points.
    """
    least = 1.0
    for wheel, part, rows, solution in zip(data.wheels, data.data, data.rows, data.base, strict=True):
        known = np.flatnonzero(part.seen.any(axis=1))
        if wheel.ordered or not 0 < len(known) < _MANY:
            continue
        places = between(part.window[known], wheel.conditions(("slip", "load"))[rows][known])
        if len(places.middle):
            least = min(least, of_points(solution.residual[known], places, seed))
    return least


def of_points(left: Array, places: Between, seed: int) -> float:
    """Return how often points in another order would leave as smooth a residual in some channel.

    The measure is the ratio of squared steps to the variance of von Neumann (1941, Annals of
    Mathematical Statistics 12, 367). All channels of a point move together, as noise of its load or slip
    is in all of them.

    Parameters
    ----------
    left : ndarray, shape (n, c)
    places : Between
        Points are mixed within their lines.
    seed : int

    Returns
    -------
    float
    """
    count = np.bincount(places.line)
    middle = np.stack([np.bincount(places.line, column) / count for column in left.T], axis=1)
    left = left - middle[places.line]
    size = np.maximum((left**2).sum(axis=0), 1e-300)
    key = np.random.default_rng(seed).random((len(left), DRAWS))
    order = np.argsort(places.line, kind="stable")
    mixed = np.empty((len(left), DRAWS, left.shape[1]))
    mixed[order] = left[np.lexsort((key, np.broadcast_to(places.line[:, None], key.shape)), axis=0)]
    here, drawn = (((places.off(one) ** 2).sum(axis=0) / size).min(axis=-1) for one in (left, mixed))
    return float((1.0 + np.count_nonzero(drawn <= here * (1.0 + 1e-9))) / (1.0 + DRAWS))
