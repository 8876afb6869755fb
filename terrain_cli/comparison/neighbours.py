"""A channel just before and after each sample: the same true value with independent noise."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from terrain_cli.vocabulary.arrays import Array


def from_neighbours(values: Array, group: NDArray[np.intp], *, gap: int, reach: int) -> Array:
    """Interpolate each sample from its neighbours, itself and the nearest ones left out.

    As far as noise is forgotten within `gap` samples, the result has none of the sample's own. Means
    at distances g and 3 g on both sides weigh 9/16 and −1/16 each, which keeps a cubic; near the ends
    of a group only the nearer ones count, or those of one side.

    `gap` samples are left out on either side (0: only the sample itself), and `reach` averaged at each
    place. Values, shape (n,), are NaN where not known, and the result where there is no neighbour. Samples of
    different groups are no neighbours; a group is contiguous.
    """
    n = len(values)
    if n == 0:
        return np.zeros(0)
    starts = np.flatnonzero(np.concatenate([[True], group[1:] != group[:-1]]))
    lengths = np.diff(np.append(starts, n))
    first, last = np.repeat(starts, lengths), np.repeat(starts + lengths, lengths)
    known = np.isfinite(values)
    middle = float(np.mean(values[known])) if known.any() else 0.0
    # About the mean, so that running sums of long logs lose no digits.
    total = np.concatenate([[0.0], np.cumsum(np.where(known, values - middle, 0.0))])
    number = np.concatenate([[0], np.cumsum(known)])
    place = np.arange(n)

    def mean(low: NDArray[np.intp], high: NDArray[np.intp]) -> Array:
        low, high = np.maximum(low, first), np.minimum(high, last)
        count = np.where(high > low, number[np.clip(high, 0, n)] - number[np.clip(low, 0, n)], 0)
        side = total[np.clip(high, 0, n)] - total[np.clip(low, 0, n)]
        return np.where(count > 0, side / np.maximum(count, 1), np.nan)

    def both(skip: int) -> tuple[Array, Array]:
        return mean(place - skip - reach, place - skip), mean(place + skip + 1, place + skip + 1 + reach)

    before, after = both(gap)
    # The middle of the nearer samples is gap + (reach + 1) / 2 away.
    farther = sum(both(3 * gap + reach + 1))
    near = 0.5 * (before + after)
    near = np.where(np.isfinite(near), near, np.where(np.isfinite(before), before, after))
    smooth = 1.125 * near - 0.0625 * farther
    inside = np.isfinite(before) & np.isfinite(after) & np.isfinite(smooth)
    return np.asarray(middle + np.where(inside, smooth, near))
