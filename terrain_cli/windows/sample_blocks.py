"""Samples in blocks of equal length, the last perhaps shorter, and all sums over these, in one pass."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Iterator

    from numpy.typing import NDArray

    from terrain_cli.vocabulary.arrays import Array, Index

#: Rows of what `summed` returns: sums of x, y, x², xy and y²;
POWERS, SUMS, POWER_X, POWER_Y = slice(0, 5), slice(0, 2), 2, 4
#: and of squares and products of the second differences of x and y, as far as they are noise.
SECONDS = slice(5, 8)
ROWS = 8
#: Samples on either side from which the noise of a sample is learnt.
REACH = 64
#: A difference larger than this many mean differences is a step or a wild value, not noise.
WILD = 3.0
#: A sample further from its neighbours than this many mean steps is not the soil's doing.
OUTLIER = 4.7
#: Samples worked on at a time: few enough to stay in the processor's cache.
_SLAB = 131_072


def sizes(n: int, step: int) -> Index:
    """Return the number of samples of each block of so many."""
    number = np.full(-(-n // step), step, dtype=np.intp)
    number[-1] = n - (len(number) - 1) * step
    return number


def reach(step: int) -> int:
    """Return the blocks on either side from which the noise of a block is learnt."""
    return max(1, round(REACH / step))


def slabs(n: int, step: int) -> Iterator[Index]:
    """Part blocks, by their rising numbers, into runs."""
    count, length = len(sizes(n, step)), max(1, _SLAB // step)
    for first in range(0, count, length):
        yield np.arange(first, min(first + length, count))


def about(place: Index, n: int, step: int) -> Iterator[Index]:
    """Part the blocks that depend on some samples into pieces, with what is around them as long as a run."""
    away = 2 * reach(step) + 2
    block = _beside(np.unique(place // step), away, (n - 1) // step)
    length = max(1, _SLAB // step // (2 * away))
    for first in range(0, len(block), length):
        yield block[first : first + length]


def around(block: Index, n: int, step: int) -> Index:
    """Return the blocks on which depends what `summed` tells of blocks, and these: rising."""
    # At an end of the series means are those of its first or last blocks, as many as elsewhere.
    return _beside(block, 2 * reach(step) + 1, (n - 1) // step)


def _beside(block: Index, away: int, last: int) -> Index:
    """Return rising blocks and all so far away from them, none behind the last."""
    if block[-1] - block[0] == len(block) - 1:
        return np.arange(max(block[0] - away, 0), min(block[-1] + away, last) + 1)
    return np.unique(np.clip(block[:, None] + np.arange(-away, away + 1), 0, last).ravel())


def summed(x: Array, y: Array, step: int, scale: float) -> tuple[Array, Index, Array]:
    """Sum what is to be known of the samples over blocks, and look for samples far from a neighbour.

    `scale` is s, which brings y to the scale of x: a second difference is of size |Δ²x| + s |Δ²y|. Returns
    the rows, shape (8, blocks), in which the first and the last sample have no second difference; places,
    rising, among them all samples of which a step of x or y, to or from them, is beyond the limit; and that
    limit for x and y there, shape (2, k).
    """
    n, number = len(x), sizes(len(x), step)
    values, rises, seconds = np.zeros((3, 2, len(number) * step))
    values[:, :n] = x, y
    np.subtract(values[:, 1:n], values[:, : n - 1], out=rises[:, 1:n])
    np.subtract(rises[:, 2:n], rises[:, 1 : n - 1], out=seconds[:, 1 : n - 1])
    np.abs(rises, out=rises)
    size = np.abs(scale * seconds[1]) + np.abs(seconds[0])
    u, v, p, q, d, e, w = (series.reshape(-1, step) for series in (*values, *rises, *seconds, size))
    squares = ((u, u), (u, v), (v, v), (d, d), (d, e), (e, e))
    products = [np.einsum("ij,ij->i", *pair) for pair in squares]
    of_x, of_y, *mean = (np.einsum("ij->i", series) for series in (u, v, p, q, w))
    rows = np.stack([of_x, of_y, *products])

    # There is no step to the first sample.
    number[0] -= 1
    usual = moving_mean(np.stack(mean), number, step)
    limit, most = OUTLIER * usual[:2], WILD * usual[2]
    # A step is too large for the sample behind it or for that before it, perhaps of the block before.
    least = limit.copy()
    np.minimum(limit[:, 1:], limit[:, :-1], out=least[:, 1:])
    beyond = ((p > least[0, :, None]) | (q > least[1, :, None])).ravel()
    beyond[:-1] |= beyond[1:]
    far = np.flatnonzero(beyond)
    # Beyond the limit a second difference counts as if it were as long as that.
    large = np.flatnonzero(w > most[:, None])
    dx, dy, block = seconds[0, large], seconds[1, large], large // step
    excess = 1.0 - (most[block] / size[large]) ** 2
    rows[SECONDS] -= [
        np.bincount(block, excess * product, len(number)) for product in (dx * dx, dx * dy, dy * dy)
    ]
    return rows, far, limit[:, far // step]


def moving_mean(sums: Array, number: Index, step: int) -> Array:
    """Return means over blocks up to `REACH` samples away, (k, blocks); `number` values are in each sum."""
    blocks, near = len(number), reach(step)
    width = min(2 * near + 1, blocks)
    mean = _running(sums, width) / _running(number, width)
    # Near an end that of its first or last blocks.
    place = np.arange(blocks) - min(near, blocks - 1)
    return np.asarray(mean[:, np.clip(place, 0, mean.shape[1] - 1)])


def _running(values: NDArray[np.number], width: int) -> NDArray[np.number]:
    """Return the sums of so many values in a row: of halves, as cumulative sums are slow to make."""
    if width == 1:
        return values
    half = width // 2
    part = _running(values, half)
    total = part[..., :-half] + part[..., half:]
    return total if width == 2 * half else total[..., :-1] + values[..., width - 1 :]


class ReplacedSamples:
    """Samples (x, y), in Pa, in the order of time; one at least."""

    def __init__(self, x: Array, y: Array) -> None:
        self._values = x, y
        self._place = np.empty(0, dtype=np.intp)
        self._instead = np.empty((2, 0))

    def __len__(self) -> int:
        return len(self._values[0])

    def check_finite(self) -> None:
        if not all(np.isfinite(values).all() for values in self._values):
            raise ValueError("x and y must be finite")

    def replace(self, place: Index, values: Array) -> None:
        """Take other values, shape (2, k), for some samples."""
        place = np.concatenate([place, self._place])
        # What came last is the first of equals.
        order = np.argsort(place, kind="stable")
        order = order[np.diff(place[order], prepend=-1) > 0]
        self._place = place[order]
        self._instead = np.concatenate([values, self._instead], axis=1)[:, order]

    def at(self, place: Index) -> Array:
        """Return samples, shape (2, ...); behind the end the last one is repeated."""
        place = np.minimum(place, len(self) - 1)
        found = np.stack([values[place] for values in self._values])
        if len(self._place):
            nearest = np.minimum(np.searchsorted(self._place, place), len(self._place) - 1)
            replaced = self._place[nearest] == place
            found[:, replaced] = self._instead[:, nearest[replaced]]
        return found

    def of_blocks(self, block: Index, step: int) -> Array:
        """Return x and y of the samples of rising blocks; the last block of all may be shorter."""
        place = (block[:, None] * step + np.arange(step)).ravel()
        return self.at(place[place < len(self)])

    def blocks(self, block: Index, step: int) -> Array:
        """Return the samples of blocks of equal length, shape (2, k, step), as from `at`."""
        return self.at(block[:, None] * step + np.arange(step))
