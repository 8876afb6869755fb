"""What the sensors' noise does to x and y, learnt from neighbouring samples.

x and y are computed from the same noisy channels, so a window of constant load is a cloud whose
own regression slope says nothing of the soil. Every test here therefore needs the covariance of
the noise of (x, y), and that changes along a drive, since noise grows with the values.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from terrain_cli.segmentation import blocks
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
OUTLIER = 4.7
#: Correlation of x and y that noise may have. Equal relative errors of W, T, z and i leave next to
#: none (below 0.1 on all soils tried); more is a load that varies from sample to sample.
NOISE_CORRELATION = 0.15
#: Samples over which what is left after prewhitening may still be correlated.
LARGEST_LAG = 30


def tame(x: Array, y: Array, step: int) -> tuple[Array, Array, Array, float]:
    """Replace wild samples, one or two in a row, by the median of five around them.

    Parameters
    ----------
    x, y : ndarray, shape (n,)
    step : int
        Samples in a block.

    Returns
    -------
    x, y : ndarray, shape (n,)
    measured : ndarray, shape (14, blocks)
        Of these, from `blocks.measure`.
    scale : float
        By which y was brought to the scale of x in it.
    """
    n = len(x)
    some = slice(None, None, 1 + n // 4096)
    scale = float(np.abs(x[some]).sum() / (np.abs(y[some]).sum() or 1.0)) or 1.0
    number = blocks.sizes(n, step)
    number[0] -= 1
    measured = np.empty((blocks.ROWS, len(number)))
    stale, asked = list(blocks.slabs(n, step)), np.ones(len(number), dtype=bool)
    # Where three of five are wild, some are seen only after others have been replaced.
    for _ in range(3):
        blocks.measure(x, y, step, scale, stale, measured)
        limit = OUTLIER * np.stack([_moving_mean(row, number, step) for row in measured[blocks.STEPS]])
        suspected = (measured[blocks.LARGEST_STEPS] > limit).any(axis=0) & asked
        place = _far(x, y, step, limit, np.flatnonzero(suspected))
        middles = np.stack([_median_of_five(values, place) for values in (x, y)])
        wild = (np.abs(np.stack([x[place], y[place]]) - middles) > limit[:, place // step]).any(axis=0)
        if not wild.any():
            return x, y, measured, scale
        if asked.all():
            x, y = x.copy(), y.copy()
        place = place[wild]
        x[place], y[place] = middles[:, wild]
        stale = list(blocks.about(place, n, step))
        asked = np.zeros(len(number), dtype=bool)
        for first, last in stale:
            asked[max(first - 2 * REACH, 0) // step : (last + 2 * REACH) // step] = True
    blocks.measure(x, y, step, scale, stale, measured)
    return x, y, measured, scale


def _far(x: Array, y: Array, step: int, limit: Array, block: Index) -> Index:
    """Return which samples of some blocks are far from a neighbour: none is further from its median."""
    found = []
    for some in blocks.together(block, step):
        far = np.zeros((len(some), step), dtype=bool)
        for values, most in zip((x, y), limit[:, some, None], strict=True):
            rises = np.abs(blocks.differences(values, some, step)[0]) > most
            far |= rises[:, 1:] | rises[:, :-1]
        row, column = np.nonzero(far)
        found.append(some[row] * step + column)
    return np.concatenate(found)


def block_noise(x: Array, y: Array, step: int, measured: Array, scale: float) -> Array:
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
    measured : ndarray, shape (14, blocks)
        Of these samples, from `blocks.measure`.
    scale : float
        That of y in it.

    Returns
    -------
    ndarray, shape (3, blocks)
        Variance of x, covariance, variance of y, in Pa².
    """
    number = blocks.sizes(len(x), step)
    level = np.sqrt([_moving_mean(measured[row], number, step) for row in (blocks.POWER_X, blocks.POWER_Y)])
    level = np.maximum(level, np.where(level.any(axis=1), 1e-9 * level.max(axis=1), 1.0)[:, None])
    # The two ends have no second difference; the sums below are over the others.
    number[0] -= 1
    number[-1] -= 1
    limit = WILD * _moving_mean(measured[blocks.SIZE], number, step)
    sums = measured[blocks.SECONDS] - _excess(x, y, step, scale, limit, measured[blocks.LARGEST_SIZE])
    # Second differences of white noise have six times its variance.
    level_x, level_y = level
    xx, xy, yy = (
        _moving_mean(total / (6.0 * unit), number, step)
        for total, unit in zip(sums, (level_x**2, level_x * level_y, level_y**2), strict=True)
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


def _excess(x: Array, y: Array, step: int, scale: float, limit: Array, largest: Array) -> Array:
    """Return by how much second differences beyond the limit raise the sums of their products."""
    excess = np.zeros((3, len(limit)))
    for some in blocks.together(np.flatnonzero(largest > limit), step):
        dx, dy = (blocks.differences(values, some, step)[1] for values in (x, y))
        size = np.abs(dy)
        size *= scale
        size += np.abs(dx)
        row, column = np.nonzero(size > limit[some, None])
        place = some[row] * step + column
        inner = (place > 0) & (place < len(x) - 1)
        row, column = row[inner], column[inner]
        dx, dy, size = dx[row, column], dy[row, column], size[row, column]
        beyond = 1.0 - (limit[some[row]] / size) ** 2
        for total, product in zip(excess, (dx * dx, dx * dy, dy * dy), strict=True):
            total[some] = np.bincount(row, beyond * product, len(some))
    return excess


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


def _moving_mean(sums: Array, number: Index, step: int) -> Array:
    """Return the mean over blocks up to `REACH` samples away, near the ends over as many of them."""
    reach = max(1, round(REACH / step))
    width = min(2 * reach + 1, len(sums))
    total = np.concatenate([[0.0], np.cumsum(sums)])
    count = np.concatenate([[0], np.cumsum(number)])
    inner = (total[width:] - total[:-width]) / (count[width:] - count[:-width])
    mean, first = np.empty(len(sums)), min(reach, len(sums) - width)
    last = first + len(inner)
    mean[:first], mean[first:last], mean[last:] = inner[0], inner, inner[-1]
    return mean


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
