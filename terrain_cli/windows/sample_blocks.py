"""Samples in blocks of equal length, and sums over these; the last block may be shorter.

Everything that is asked of all samples is summed here, in one pass over them. A few samples are replaced,
without a copy of the others.
"""

from collections.abc import Iterator

import numpy as np

from terrain_cli.vocabulary.arrays import Array, Index

#: Rows of what `summed` returns: sums of x, y, x², xy and y²;
POWERS, POWER_X, POWER_Y = slice(0, 5), 2, 4
#: and of squares and products of the second differences of x and y, as far as they are noise.
SECONDS = slice(5, 8)
ROWS = 8
REACH = 64  # Samples on either side from which the noise of a sample is learnt
WILD = 3.0  # A difference larger than this many mean differences is a step or a wild value, not noise
OUTLIER = 4.7  # A sample further from its neighbours than this many mean steps is not the soil's doing
_SLAB = 131_072  # Samples worked on at a time: few enough to stay in the processor's cache


def sizes(n: int, step: int) -> Index:
    """Return the number of samples of each block of so many."""
    number = np.full(-(-n // step), step, dtype=np.intp)
    number[-1] = n - (len(number) - 1) * step
    return number


def reach(step: int) -> int:
    """Return the blocks on either side from which the noise of a block is learnt."""
    return max(1, round(REACH / step))


def slabs(n: int, step: int) -> Iterator[tuple[int, int, int, int]]:
    """Part blocks into runs: where each begins and ends, and where what `summed` needs for it does."""
    # At an end of the series means are those of its first or last blocks, as many as elsewhere.
    count, length, away = len(sizes(n, step)), max(1, _SLAB // step), 2 * reach(step) + 1
    for first in range(0, count, length):
        last = min(first + length, count)
        yield first, last, max(first - away, 0), min(last + away, count)


def summed(x: Array, y: Array, step: int, scale: float, room: Array) -> tuple[Array, Index, Array]:
    """Sum what is to be known of the samples over blocks, and look for samples far from a neighbour.

    `scale` is s, which brings y to the scale of x: a second difference is of size |Δ²x| + s |Δ²y|. `room`,
    shape (6, n rounded up to blocks), is overwritten.

    Returns the rows, shape (8, blocks), in which the first and the last sample have no second difference;
    places, rising, among them all samples of which a step of x or y, to or from them, is beyond the limit;
    and that limit for x and y there, shape (2, k).
    """
    n, number = len(x), sizes(len(x), step)
    samples = len(number) * step
    rows, mean = np.empty((ROWS, len(number))), np.empty((3, len(number)))
    u, v = (
        (series if n == samples else np.append(series, np.zeros(samples - n))).reshape(-1, step)
        for series in (x, y)
    )
    rises, seconds, (size, spare) = room[:2, :samples], room[2:4, :samples], room[4:6, :samples]
    for series, rise, second in zip((x, y), rises, seconds, strict=True):
        rise[0] = rise[n:] = second[0] = second[n - 1 :] = 0.0
        np.subtract(series[1:], series[:-1], out=rise[1:n])
        np.subtract(rise[2:n], rise[1 : n - 1], out=second[1 : n - 1])
        np.abs(rise, out=rise)
    np.abs(np.multiply(seconds[1], scale, out=size), out=size)
    size += np.abs(seconds[0], out=spare)
    p, q, d, e, w = (series.reshape(-1, step) for series in (*rises, *seconds, size))
    for row, factors in zip(
        (*rows, *mean),
        ((u,), (v,), (u, u), (u, v), (v, v), (d, d), (d, e), (e, e), (p,), (q,), (w,)),
        strict=True,
    ):
        np.einsum("ij->i" if len(factors) == 1 else "ij,ij->i", *factors, out=row)

    # There is no step to the first sample.
    number[0] -= 1
    moving_mean(mean, number, step, out=mean)
    limit, most = OUTLIER * mean[:2], WILD * mean[2]
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


def moving_mean(sums: Array, number: Index, step: int, out: Array | None = None) -> Array:
    """Return the mean over blocks up to `REACH` samples away, near the ends over as many: (k, blocks).

    `sums` are of each block, and `number` is how many values were summed there; `out` may be the sums.
    """
    blocks, near = len(number), reach(step)
    width = min(2 * near + 1, blocks)
    inner = running(sums, width) / running(number.astype(float), width)
    mean = np.empty(sums.shape) if out is None else out
    first = min(near, blocks - 1)
    last = first + inner.shape[1]
    mean[:, :first], mean[:, first:last], mean[:, last:] = inner[:, :1], inner, inner[:, -1:]
    return mean


def running(values: Array, width: int) -> Array:
    """Return the sums of so many values in a row: of halves, as cumulative sums are slow to make."""
    if width == 1:
        return values
    half = width // 2
    part = running(values, half)
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

    def between(self, first: int, last: int) -> Array | tuple[Array, Array]:
        """Return x and y of the samples from the first up to the last."""
        begin, end = np.searchsorted(self._place, [first, last])
        x, y = (values[first:last] for values in self._values)
        if begin == end:
            return x, y
        found = np.stack([x, y])
        found[:, self._place[begin:end] - first] = self._instead[:, begin:end]
        return found

    def blocks(self, block: Index, step: int) -> Array:
        """Return the samples of blocks of equal length, shape (2, k, step), as from `at`."""
        found = np.empty((2, len(block), step))
        whole = len(self) // step
        # Rows are copied faster than single samples.
        odd = np.searchsorted(self._place, block * step) < np.searchsorted(self._place, (block + 1) * step)
        odd |= block >= whole
        if whole:
            for values, rows in zip(self._values, found, strict=True):
                values[: whole * step].reshape(-1, step).take(block, axis=0, out=rows, mode="clip")
        row = np.flatnonzero(odd)
        if len(row):
            found[:, row] = self.at(block[row, None] * step + np.arange(step))
        return found
