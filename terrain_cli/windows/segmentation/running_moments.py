"""Cumulative moments of a stretch of samples, from which those of any window follow at once."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from terrain_cli.windows.segmentation import sample_blocks
from terrain_cli.windows.segmentation.line_costs import (
    MIDDLE_SLOPE,
    NOISE_XX,
    NOISE_YY,
    ROWS,
    YY,
    N,
    W,
    X,
    across,
)
from terrain_cli.windows.segmentation.sample_blocks import ReplacedSamples
from terrain_cli.windows.segmentation.sensor_noise import tame

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Array = NDArray[np.float64]
    Index = NDArray[np.intp]

#: Samples in the blocks of long drives, and between the bounds that are tried first within one.
LONG, FINE = 64, 8


class RunningMoments:
    """Moments of all windows of one stretch.

    Sums are accumulated block by block; what ten million of them lose by cancellation is far below
    `sensor_noise.FLOOR`. Windows may begin at any sample.

    The noise is taken as constant over the `step` samples of a block.
    """

    def __init__(self, x: Array, y: Array, step: int) -> None:
        self.step = step
        self.edges = np.append(np.arange(0, len(x), step, dtype=np.intp), len(x))
        self.samples = ReplacedSamples(x, y)
        sums, self.noise = tame(self.samples, step)
        number = sample_blocks.sizes(len(x), step)
        noise_xx, noise_xy, noise_yy = self.noise
        self._weight = 1.0 / across(noise_xx, noise_xy, noise_yy, MIDDLE_SLOPE)
        #: Sums over all blocks before each, shape (10, blocks + 1).
        self.total = np.zeros((ROWS, len(self.edges)))
        for row, total in zip((number, *sums, *self.noise), self.total, strict=False):
            np.multiply(self._weight, row, out=total[1:])
        self.total[NOISE_XX : NOISE_YY + 1, 1:] *= number
        np.cumsum(self.total[:N], axis=1, out=self.total[:N])
        self.total[N] = self.edges

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
            counted = np.arange(self.step) < rest[cut, None]
            x, y = self.samples.blocks(block[cut], self.step) * counted
            total[:, cut] += self._weighted(block[cut], _powers(x, y), rest[cut])
        return np.asarray(total)

    def finer(self, block: Index) -> tuple[Index, Array]:
        """Return bounds `FINE` samples apart from the beginning of blocks on, and the sums before each.

        Blocks are of a multiple of `FINE` samples. What is beyond the end of the stretch means nothing.
        Shapes (k, step / FINE) and (10, k, step / FINE).
        """
        count = self.step // FINE
        x, y = self.samples.blocks(block, self.step).reshape(2, -1, FINE)
        powers = _powers(x, y).reshape(5, len(block), count)[:, :, :-1]
        rows = np.empty((ROWS, count, len(block)))
        rows[:, 0] = self.total.take(block, axis=1)
        rows[:, 1:] = self._weighted(block, powers.swapaxes(1, 2), np.full((1, 1), FINE))
        for place in range(1, count):
            rows[:, place] += rows[:, place - 1]
        return block[:, None] * self.step + np.arange(0, self.step, FINE), rows.swapaxes(1, 2)

    def _weighted(self, block: Index, powers: Array, number: Index) -> Array:
        """Return the weighted moments of parts of blocks, shape (10, ..., k).

        `powers`, shape (5, ..., k), are sums over the parts of x, y, x², xy and y²; `number`, shape (..., k),
        is their samples.
        """
        weight = self._weight[block]
        rows = np.empty((ROWS, *powers.shape[1:]))
        rows[W] = number * weight
        np.multiply(powers, weight, out=rows[X : YY + 1])
        for row, noise in zip(rows[NOISE_XX : NOISE_YY + 1], self.noise, strict=True):
            row[:] = number * (weight * noise[block])
        rows[N] = number
        return rows

    def around(self, sample: Index, reach: int) -> tuple[Index, Array]:
        """Return every bound within reach of k samples, and the sums before it, shape (10, k, 2 reach + 1).

        Beyond the ends of the stretch there are no samples: the sums are those at the end.
        """
        begin = np.maximum(sample - reach, 0)
        bounds = begin[:, None] + np.arange(2 * reach + 1)
        rows = np.concatenate([self.before(begin)[:, :, None], self._rows(begin, 2 * reach)], axis=2)
        return bounds, np.cumsum(rows, axis=2, out=rows)

    def _rows(self, begin: Index, count: int) -> Array:
        """Return the weighted moments of single samples, shape (10, k, count), zero after the last."""
        place = begin[:, None] + np.arange(count)
        inside = place < len(self.samples)
        (x, y), block = self.samples.at(place), np.minimum(place // self.step, len(self._weight) - 1)
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


def _powers(x: Array, y: Array) -> Array:
    """Return the sums of x, y, x², xy and y² over rows of samples, shape (5, rows)."""
    return np.stack(
        [
            np.einsum("ks->k" if len(factors) == 1 else "ks,ks->k", *factors)
            for factors in ((x,), (y,), (x, x), (x, y), (y, y))
        ]
    )
