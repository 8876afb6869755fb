"""Cumulative moments of a stretch of samples, from which those of any window follow at once."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from terrain_cli.segmentation.lines import MIDDLE_SLOPE, ROWS, across
from terrain_cli.segmentation.noise import block_noise, tame

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Array = NDArray[np.float64]
    Index = NDArray[np.intp]


class Moments:
    """Moments of all windows of one stretch.

    Sums are accumulated block by block; what ten million of them lose by cancellation is far below
    `noise.FLOOR`. Windows may begin at any sample.

    Parameters
    ----------
    x, y : ndarray, shape (n,)
        In Pa.
    step : int
        Samples in a block, over which the noise is taken as constant.
    """

    def __init__(self, x: Array, y: Array, step: int) -> None:
        self.step = step
        self.edges = np.append(np.arange(0, len(x), step, dtype=np.intp), len(x))
        self.x, self.y = tame(x, y, self.edges)
        self.noise = block_noise(self.x, self.y, self.edges)
        noise_xx, noise_xy, noise_yy = self.noise
        self._weight = 1.0 / across(noise_xx, noise_xy, noise_yy, MIDDLE_SLOPE)
        sums = np.stack(
            [
                np.diff(self.edges).astype(float),
                *(
                    np.add.reduceat(product, self.edges[:-1])
                    for product in (self.x, self.y, self.x**2, self.x * self.y, self.y**2)
                ),
            ]
        )
        steps = np.concatenate([self._weight * sums, self._weight * sums[0] * self.noise, sums[:1]])
        self._total = np.concatenate([np.zeros((ROWS, 1)), np.cumsum(steps, axis=1)], axis=1)

    def between(self, first: Index, last: Index) -> Array:
        """Return the moments of the windows [first, last), shape (10, k)."""
        return self.before(last) - self.before(first)

    def between_blocks(self, first: Index, last: Index) -> Array:
        """Return the moments of the windows from block `first` up to block `last`."""
        # Row by row in memory; picking columns with brackets takes three times as long.
        between = self._total.take(last, axis=1)
        between -= self._total.take(first, axis=1)
        return between

    def before(self, sample: Index) -> Array:
        """Return the sums over all samples before each of these: of whole blocks, then of what is left."""
        block = sample // self.step
        total = self._total[:, block]
        rest = sample - block * self.step
        if not rest.any():
            return np.asarray(total)
        block = np.minimum(block, len(self._weight) - 1)
        place = np.minimum(block[:, None] * self.step + np.arange(self.step - 1), len(self.x) - 1)
        counted = np.arange(self.step - 1) < rest[:, None]
        x, y = np.where(counted, self.x[place], 0.0), np.where(counted, self.y[place], 0.0)
        weight = self._weight[block]
        part = np.stack([rest, x.sum(1), y.sum(1), (x * x).sum(1), (x * y).sum(1), (y * y).sum(1)])
        return np.concatenate(
            [total[:6] + weight * part, total[6:9] + weight * rest * self.noise[:, block], total[9:] + rest]
        )
