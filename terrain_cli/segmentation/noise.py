"""What the sensors' noise does to x and y, learnt from neighbouring samples.

x and y are computed from the same noisy channels, so a window of constant load is a cloud whose
own regression slope says nothing of the soil. Every test here therefore needs the covariance of
the noise of (x, y), and that changes along a drive, since noise grows with the values.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

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
#: A sample further from its neighbours than this many mean distances is not the soil's doing.
OUTLIER = 8.0
#: Correlation of x and y that noise may have. Equal relative errors of W, T, z and i leave next to
#: none (below 0.1 on all soils tried); more is a load that varies from sample to sample.
NOISE_CORRELATION = 0.15


#: Samples over which what is left after prewhitening may still be correlated.
LARGEST_LAG = 30
#: Samples worked on at a time: few enough to stay in the processor's cache.
_SLAB = 16_384


def block_noise(x: Array, y: Array, edges: Index) -> Array:
    """Estimate the covariance of the noise of (x, y), block by block.

    From second differences, in which a drift of the load cancels, averaged over `REACH` samples on
    either side. A load that varies from sample to sample moves (x, y) along the soil's line and
    would pass for noise: it shows as a correlation that noise has not, and is taken out.

    Parameters
    ----------
    x, y : ndarray, shape (n,)
        In Pa, n ≥ 3.
    edges : ndarray of int, shape (blocks + 1,)

    Returns
    -------
    ndarray, shape (3, blocks)
        Variance of x, covariance, variance of y, in Pa².
    """
    sizes = np.diff(edges)
    reach = max(1, round(REACH / int(sizes[0])))
    differences = []
    levels = []
    for values in (x, y):
        level = _moving_mean(np.add.reduceat(np.abs(values), edges[:-1]), sizes, reach)
        level = np.maximum(level, 1e-9 * level.max() or 1.0)
        second = np.zeros(len(values))
        second[1:-1] = (values[:-2] - 2.0 * values[1:-1] + values[2:]) / np.sqrt(6.0)
        second /= np.repeat(level, sizes)
        levels.append(level)
        differences.append(second)
    dx, dy = differences
    # The two ends have no second difference; the sums below are over the others.
    counts = sizes - (edges[:-1] == 0) - (edges[1:] == len(x))
    size = np.hypot(dx, dy)
    mean = _moving_mean(np.add.reduceat(size, edges[:-1]), counts, reach)
    limit = np.repeat(WILD * mean, sizes)
    shrink = np.divide(limit, size, out=np.ones_like(size), where=size > limit)
    dx *= shrink
    dy *= shrink
    xx, xy, yy = (
        _moving_mean(np.add.reduceat(product, edges[:-1]), counts, reach)
        for product in (dx * dx, dx * dy, dy * dy)
    )
    xx, yy = xx + FLOOR**2, yy + FLOOR**2
    slope, variance = _load_variation(xx, xy, yy, levels[0] / levels[1])
    return np.stack(
        [
            (xx - variance) * levels[0] ** 2,
            (xy - variance * slope) * levels[0] * levels[1],
            (yy - variance * slope**2) * levels[1] ** 2,
        ]
    )


def tame(x: Array, y: Array, edges: Index) -> tuple[Array, Array]:
    """Replace wild samples, one or two in a row, by the median of five around them.

    Parameters
    ----------
    x, y : ndarray, shape (n,)
    edges : ndarray of int, shape (blocks + 1,)

    Returns
    -------
    x, y : ndarray, shape (n,)
    """
    sizes = np.diff(edges)
    reach = max(1, round(REACH / int(sizes[0])))
    # Where three of five are wild, some are seen only after others have been replaced.
    for _ in range(3):
        middles = [_median_of_five(values) for values in (x, y)]
        wild = np.zeros(len(x), dtype=bool)
        for values, middle in zip((x, y), middles, strict=True):
            away = np.abs(values - middle)
            mean = _moving_mean(np.add.reduceat(away, edges[:-1]), sizes, reach)
            wild |= away > np.repeat(OUTLIER * mean, sizes)
        if not wild.any():
            break
        x, y = np.where(wild, middles[0], x), np.where(wild, middles[1], y)
    return x, y


def _median_of_five(values: Array) -> Array:
    padded = np.pad(values, 2, mode="reflect")
    median = np.empty_like(values)
    for start in range(0, len(values), _SLAB):
        stop = min(start + _SLAB, len(values))
        a, b, c, d, e = (padded[start + k : stop + k] for k in range(5))
        low = np.maximum(np.minimum(a, b), np.minimum(d, e))
        high = np.minimum(np.maximum(a, b), np.maximum(d, e))
        median[start:stop] = np.maximum(np.minimum(low, high), np.minimum(np.maximum(low, high), c))
    return median


def _load_variation(xx: Array, xy: Array, yy: Array, ratio: Array) -> tuple[Array, Array]:
    """Return slope and variance of x of the movement along the soil's line, relative to the means."""
    excess = np.maximum(xy - NOISE_CORRELATION * np.sqrt(xx * yy), 0.0)
    divisor = np.where(excess > 0.0, 2.0 * xy, 1.0)
    # The major axis, as noise is alike in both; but no soil's line is flatter or steeper than these.
    axis = (yy - xx + np.hypot(yy - xx, divisor)) / divisor
    slope = np.clip(axis, SMALLEST_SLOPE * ratio, LARGEST_SLOPE * ratio)
    return slope, np.minimum(excess / slope, 0.9 * np.minimum(xx, yy / slope**2))


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
