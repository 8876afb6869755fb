"""Cumulative moments of a stretch of samples, from which those of any window follow at once."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from terrain_cli.segmentation import blocks
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
        self.x, self.y, measured, scale = tame(x, y, step)
        self.noise = block_noise(self.x, self.y, step, measured, scale)
        noise_xx, noise_xy, noise_yy = self.noise
        self._weight = 1.0 / across(noise_xx, noise_xy, noise_yy, MIDDLE_SLOPE)
        number = blocks.sizes(len(x), step)
        #: Sums over all blocks before each, shape (10, blocks + 1).
        self.total = np.zeros((ROWS, len(self.edges)))
        for row, sums in enumerate((number, *measured[blocks.POWERS], *(number * self.noise))):
            np.cumsum(self._weight * sums, out=self.total[row, 1:])
        self.total[-1] = self.edges

    def between(self, first: Index, last: Index) -> Array:
        """Return the moments of the windows [first, last), shape (10, k)."""
        return self.before(last) - self.before(first)

    def before(self, sample: Index) -> Array:
        """Return the sums over all samples before each of these: of whole blocks, then of what is left."""
        block = sample // self.step
        rest = sample - block * self.step
        total = self.total[:, block]
        if rest.any():
            cut = np.flatnonzero(rest)
            counted = np.arange(self.step - 1) < rest[cut, None]
            total[:, cut] += (self._rows(block[cut] * self.step, self.step - 1) * counted).sum(axis=2)
        return np.asarray(total)

    def around(self, block: Index) -> tuple[Index, Array]:
        """Return every bound within a block of the beginning of these, and the sums before it.

        Parameters
        ----------
        block : ndarray of int, shape (k,)

        Returns
        -------
        bounds : ndarray of int, shape (k, 2 step + 1)
            Beyond the ends of the stretch no samples, for which the sums are those at the end.
        sums : ndarray, shape (10, k, 2 step + 1)
        """
        first = np.maximum(block - 1, 0)
        begin = first * self.step
        bounds = begin[:, None] + np.arange(2 * self.step + 1)
        rows = np.concatenate([self.total[:, first, None], self._rows(begin, 2 * self.step)], axis=2)
        return bounds, np.cumsum(rows, axis=2, out=rows)

    def _rows(self, begin: Index, count: int) -> Array:
        """Return the weighted moments of single samples, shape (10, k, count), zero after the last."""
        place = begin[:, None] + np.arange(count)
        inside = place < len(self.x)
        place = np.minimum(place, len(self.x) - 1)
        x, y, block = self.x[place], self.y[place], place // self.step
        weight = np.where(inside, self._weight[block], 0.0)
        rows = np.empty((ROWS, *place.shape))
        rows[0] = weight
        np.multiply(weight, x, out=rows[1])
        np.multiply(weight, y, out=rows[2])
        np.multiply(rows[1], x, out=rows[3])
        np.multiply(rows[1], y, out=rows[4])
        np.multiply(rows[2], y, out=rows[5])
        np.multiply(weight, self.noise[:, block], out=rows[6:9])
        rows[9] = inside
        return rows
