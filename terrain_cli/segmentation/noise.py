"""What the sensors' noise does to x and y, learnt from neighbouring samples.

x and y are computed from the same noisy channels, so a window of constant load is a cloud whose
own regression slope says nothing of the soil. Every test here therefore needs the covariance of
the noise of (x, y), and that changes along a drive, since noise grows with the values.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from terrain_cli.segmentation.blocks import in_blocks, slabs
from terrain_cli.segmentation.lines import LARGEST_SLOPE, SMALLEST_SLOPE

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Array = NDArray[np.float64]
    Index = NDArray[np.intp]

#: Samples on either side from which the noise of a sample is learnt.
REACH = 64
#: No channel is known better than this share of its value.
FLOOR = 2e-3
#: A difference larger than this many mean differences is a step or a wild value, not noise.
WILD = 3.0
#: A sample further from its neighbours than this many mean steps is not the soil's doing.
OUTLIER = 4.0
#: Correlation of x and y that noise may have. Equal relative errors of W, T, z and i leave next to
#: none (below 0.1 on all soils tried); more is a load that varies from sample to sample.
NOISE_CORRELATION = 0.15


#: Samples over which what is left after prewhitening may still be correlated.
LARGEST_LAG = 30


def block_noise(x: Array, y: Array, step: int, power: Array) -> Array:
    """Estimate the covariance of the noise of (x, y), block by block.

    From second differences, in which a drift of the load cancels, averaged over `REACH` samples on
    either side. A load that varies from sample to sample moves (x, y) along the soil's line and
    would pass for noise: it shows as a correlation that noise has not, and is taken out.

    Parameters
    ----------
    x, y : ndarray, shape (n,)
        In Pa, n ≥ 3.
    step : int
        Samples in a block.
    power : ndarray, shape (2, blocks)
        Sums of x² and of y².

    Returns
    -------
    ndarray, shape (3, blocks)
        Variance of x, covariance, variance of y, in Pa².
    """
    n, blocks = len(x), power.shape[1]
    reach = _reach(step)
    sizes = _sizes(n, step)
    level = np.sqrt([_moving_mean(row, sizes, reach) for row in power])
    level = np.maximum(level, np.where(level.any(axis=1), 1e-9 * level.max(axis=1), 1.0)[:, None])
    # The two ends have no second difference; the sums below are over the others.
    counts = sizes.copy()
    counts[0] -= 1
    counts[-1] -= 1
    # What is wild is told by the size of both differences, for which y is brought to the scale of x.
    to_x = float(np.sqrt(power[0].sum() / power[1].sum())) if power.any(axis=1).all() else 1.0
    sums, size, largest = np.empty((3, blocks)), np.empty(blocks), np.empty(blocks)
    for first, last in slabs(n, step):
        at = slice(first // step, -(-last // step))
        dx, dy = (_second_differences(values, first, last, step) for values in (x, y))
        squares = dy * dy
        sums[:, at] = np.stack(
            [np.einsum("ij,ij->i", dx, dx), np.einsum("ij,ij->i", dx, dy), np.einsum("ij->i", squares)]
        )
        squares *= to_x**2
        squares += dx * dx
        length = np.sqrt(squares, out=squares)
        size[at] = np.einsum("ij->i", length)
        largest[at] = np.maximum.reduceat(length.ravel(), np.arange(0, length.size, step))
    limit = WILD * _moving_mean(size, counts, reach)
    wild = np.flatnonzero(largest > limit)
    if len(wild):
        place = wild[:, None] * step + np.arange(step)
        dx, dy = (
            np.where((place > 0) & (place < n - 1), _second(values, np.clip(place, 1, n - 2)), 0.0)
            for values in (x, y)
        )
        size = np.sqrt(dx * dx + to_x**2 * dy * dy)
        shrink = limit[wild, None] / np.maximum(size, limit[wild, None])
        dx, dy = shrink * dx, shrink * dy
        sums[:, wild] = [(dx * dx).sum(1), (dx * dy).sum(1), (dy * dy).sum(1)]
    # Second differences of white noise have six times its variance.
    level_x, level_y = level
    xx, xy, yy = (
        _moving_mean(total / (6.0 * scale), counts, reach)
        for total, scale in zip(sums, (level_x**2, level_x * level_y, level_y**2), strict=True)
    )
    xx, yy = xx + FLOOR**2, yy + FLOOR**2
    slope, variance = _load_variation(xx, xy, yy, level_x / level_y)
    return np.stack(
        [
            (xx - variance) * level_x**2,
            (xy - variance * slope) * level_x * level_y,
            (yy - variance * slope**2) * level_y**2,
        ]
    )


def _second(values: Array, place: Index) -> Array:
    return np.asarray(values[place - 1] - 2.0 * values[place] + values[place + 1])


def _second_differences(values: Array, first: int, last: int, step: int) -> Array:
    """Return the second differences of the samples from first to last, zero at either end, in blocks."""
    begin, end = max(first, 1), min(last, len(values) - 1)
    rises = np.diff(values[begin - 1 : end + 1])
    second = np.zeros(-(-(last - first) // step) * step)
    np.subtract(rises[1:], rises[:-1], out=second[begin - first : end - first])
    return second.reshape(-1, step)


def tame(x: Array, y: Array, step: int) -> tuple[Array, Array]:
    """Replace wild samples, one or two in a row, by the median of five around them.

    Parameters
    ----------
    x, y : ndarray, shape (n,)
    step : int
        Samples in a block.

    Returns
    -------
    x, y : ndarray, shape (n,)
    """
    n, reach = len(x), _reach(step)
    counts = _sizes(n, step)
    counts[0] -= 1
    blocks = len(counts)
    mean, largest = np.empty((2, blocks)), np.empty((2, blocks))
    stale = list(slabs(n, step))
    changed = False
    # Where three of five are wild, some are seen only after others have been replaced.
    for _ in range(3):
        for first, last in stale:
            at = slice(first // step, -(-last // step))
            for row, values in enumerate((x, y)):
                mean[row, at], largest[row, at] = _rises(values, first, last, step)
        limit = OUTLIER * np.stack([_moving_mean(row, counts, reach) for row in mean])
        # No sample is further from the median about it than from a neighbour.
        suspected = np.flatnonzero((largest > limit).any(axis=0))
        place = suspected[:, None] * step + np.arange(step)
        inside = place < n
        place = np.minimum(place, n - 1)
        middles = [_median_of_five(values, place) for values in (x, y)]
        wild = np.zeros(place.shape, dtype=bool)
        for values, middle, most in zip((x, y), middles, limit[:, suspected, None], strict=True):
            wild |= np.abs(values[place] - middle) > most
        wild &= inside
        if not wild.any():
            break
        if not changed:
            x, y, changed = x.copy(), y.copy(), True
        x[place[wild]], y[place[wild]] = middles[0][wild], middles[1][wild]
        stale = [(a, b) for a, b in stale if ((place[wild] >= a - 1) & (place[wild] <= b)).any()]
    return x, y


def _rises(values: Array, first: int, last: int, step: int) -> tuple[Array, Array]:
    """Return for each block from first to last the sum of steps to its samples, and the largest to or from them."""
    rises = np.zeros(-(-(last - first) // step) * step + 1)
    begin, end = max(first, 1), min(last + 1, len(values))
    np.subtract(values[begin:end], values[begin - 1 : end - 1], out=rises[begin - first : end - first])
    np.abs(rises, out=rises)
    largest = np.maximum.reduceat(rises[:-1], np.arange(0, len(rises) - 1, step))
    return np.einsum("ij->i", rises[:-1].reshape(-1, step)), np.maximum(largest, rises[step::step])


def _median_of_five(values: Array, place: Index) -> Array:
    """Return the median of each sample and two on either side; beyond an end the samples are mirrored."""
    end = len(values) - 1
    a, b, c, d, e = (values[end - np.abs(end - np.abs(place + away))] for away in range(-2, 3))
    low = np.maximum(np.minimum(a, b), np.minimum(d, e))
    high = np.minimum(np.maximum(a, b), np.maximum(d, e))
    return np.asarray(np.maximum(np.minimum(low, high), np.minimum(np.maximum(low, high), c)))


def _load_variation(xx: Array, xy: Array, yy: Array, ratio: Array) -> tuple[Array, Array]:
    """Return slope and variance of x of the movement along the soil's line, relative to the means."""
    excess = np.maximum(xy - NOISE_CORRELATION * np.sqrt(xx * yy), 0.0)
    divisor = np.where(excess > 0.0, 2.0 * xy, 1.0)
    # The major axis, as noise is alike in both; but no soil's line is flatter or steeper than these.
    axis = (yy - xx + np.sqrt((yy - xx) ** 2 + divisor**2)) / divisor
    slope = np.clip(axis, SMALLEST_SLOPE * ratio, LARGEST_SLOPE * ratio)
    return slope, np.minimum(excess / slope, 0.9 * np.minimum(xx, yy / slope**2))


def _reach(step: int) -> int:
    """Return the blocks on either side from which the noise of a block is learnt."""
    return max(1, round(REACH / step))


def _moving_mean(sums: Array, counts: Index, reach: int) -> Array:
    """Return the mean over the blocks up to `reach` away, near the ends over as many of those there are."""
    blocks = len(sums)
    width = min(2 * reach + 1, blocks)
    first = np.clip(np.arange(blocks) - reach, 0, blocks - width)
    total = np.concatenate([[0.0], np.cumsum(sums)])
    number = np.concatenate([[0], np.cumsum(counts)])
    return np.asarray((total[first + width] - total[first]) / (number[first + width] - number[first]))


def correlation_factor(residuals: Array, starts: Index, fitted: int) -> float:
    """Return how much more the mean of correlated residuals scatters than neighbours tell.

    Long-run variance by prewhitening (Andrews & Monahan 1992, Econometrica 60(4)) with a
    first-order autoregression and Bartlett's window, over the variance from second differences.

    Parameters
    ----------
    residuals : ndarray, shape (n,)
        About the lines, in units of the standard deviation from second differences.
    starts : ndarray of int
        First samples of the windows, without 0: no products are taken across them.
    fitted : int
        Number of parameters fitted to these residuals.

    Returns
    -------
    float
        At least 1.
    """
    n = len(residuals)
    limit = 6.0 * 1.4826 * float(np.median(np.abs(residuals)))
    r = np.clip(residuals, -limit, limit)
    inside = np.ones(n - 1, dtype=bool)
    inside[starts - 1] = False
    power = _dot(r, r)
    if power == 0.0:
        return 1.0
    # A fit takes about one correlation of 1/n away for each of its parameters.
    memory = float((r[1:] * r[:-1])[inside].sum()) / power + fitted / n
    memory = min(max(memory, 0.0), 0.97)
    white = (r[1:] - memory * r[:-1])[inside]
    long_run = _dot(white, white)
    lags = min(int(1.5 * len(white) ** (1.0 / 3.0)), LARGEST_LAG)
    for lag in range(1, lags + 1):
        long_run += 2.0 * (1.0 - lag / (lags + 1.0)) * _dot(white[lag:], white[:-lag])
    freedom = max(n - fitted, n / 3.0)
    return max(1.0, long_run / freedom / (1.0 - memory) ** 2)


def _dot(a: Array, b: Array) -> float:
    """Sum of products. BLAS would take threads for it, that wait for busy cores: 10 times slower there."""
    return float(np.einsum("i,i", a, b))
