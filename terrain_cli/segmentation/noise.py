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
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from terrain_cli.segmentation.samples import Samples

    Array = NDArray[np.float64]
    Index = NDArray[np.intp]
    Parts = Sequence[tuple[int, int]]

#: No channel is known better than this share of its value.
FLOOR = 2e-3
#: No level of x or y is below this share of the usual one: noise is a share of it.
LEVEL_FLOOR = 1e-9
#: Correlation of x and y that noise may have. Equal relative errors of W, T, z and i leave next to
#: none (below 0.1 on all soils tried); more is a load that varies from sample to sample.
NOISE_CORRELATION = 0.15
#: Samples over which what is left after prewhitening may still be correlated.
LARGEST_LAG = 30


def tame(samples: Samples, step: int) -> tuple[Array, Array]:
    """Replace wild samples, one or two in a row, by the median of five around them.

    Parameters
    ----------
    samples : Samples
        Three or more; some are replaced.
    step : int
        Samples in a block.

    Returns
    -------
    sums : ndarray, shape (5, blocks)
        Of x, y, x², xy and y² over blocks.
    noise : ndarray, shape (3, blocks)
        Variance of x, covariance, variance of y, in Pa².
    """
    n = len(samples)
    sums, noise = np.empty((5, -(-n // step))), np.empty((3, -(-n // step)))
    stale = list(blocks.slabs(n, step))
    usual = np.abs(samples.at(np.arange(0, n, 1 + n // 4096))).mean(axis=1)
    usual[usual == 0.0] = 1.0
    # Where three of five are wild, some are seen only after others have been replaced.
    for _ in range(3):
        place, middles = _measure(samples, step, usual, stale, (sums, noise))
        if not len(place):
            return sums, noise
        samples.replace(place, middles)
        stale = list(blocks.about(place, n, step))
    _measure(samples, step, usual, stale, (sums, noise))
    return sums, noise


def _measure(
    samples: Samples, step: int, usual: Array, parts: Parts, out: tuple[Array, Array]
) -> tuple[Index, Array]:
    """Fill in sums and noise of the blocks of these parts, one after another in the same memory.

    Returns which of their samples are wild, and the medians of x and y there.
    """
    spans = [blocks.around(first, last, len(samples), step) for first, last in parts]
    room = np.empty((6, -(-max(end - begin for begin, end in spans) // step) * step))
    found = []
    for (first, last), (begin, end) in zip(parts, spans, strict=True):
        x, y = samples.between(begin, end)
        rows, place, limit = blocks.summed(x, y, step, usual[0] / usual[1], room)
        noise = block_noise(rows, blocks.sizes(end - begin, step), step, LEVEL_FLOOR * usual)
        inner = slice((first - begin) // step, -(-(last - begin) // step))
        for whole, part in zip(out, (rows[blocks.POWERS], noise), strict=True):
            whole[:, first // step : -(-last // step)] = part[:, inner]
        # No sample is further from its median than from one of its neighbours.
        own = (place >= first - begin) & (place < last - begin)
        place, limit = place[own], limit[:, own]
        middles = np.stack([_median_of_five(series, place) for series in (x, y)])
        wild = (np.abs(np.stack([x[place], y[place]]) - middles) > limit).any(axis=0)
        found.append((place[wild] + begin, middles[:, wild]))
    places, medians = zip(*found, strict=True)
    return np.concatenate(places), np.concatenate(medians, axis=1)


def block_noise(rows: Array, number: Index, step: int, least: Array) -> Array:
    """Estimate the covariance of the noise of (x, y), block by block.

    From second differences, in which a drift of the load cancels, averaged over `blocks.REACH`
    samples on either side. A load that varies from sample to sample moves (x, y) along the soil's
    line and would pass for noise: it shows as a correlation that noise has not, and is taken out.

    Parameters
    ----------
    rows : ndarray, shape (8, blocks)
        From `blocks.summed`, of 3 samples or more.
    number : ndarray of int, shape (blocks,)
        Samples of each block.
    step : int
        Samples in a block.
    least : ndarray, shape (2,)
        Below this no level of x and y is believed, in Pa.

    Returns
    -------
    ndarray, shape (3, blocks)
        Variance of x, covariance, variance of y, in Pa².
    """
    squares = blocks.moving_mean(rows[[blocks.POWER_X, blocks.POWER_Y]], number, step)
    xx, yy = np.maximum(squares, least[:, None] ** 2)
    # Relative to the levels of x and y.
    units = np.stack([xx, np.sqrt(xx * yy), yy])
    # The two ends have no second difference; the sums are over the others.
    number = number.copy()
    number[0] -= 1
    number[-1] -= 1
    # Second differences of white noise have six times its variance.
    noise_xx, noise_xy, noise_yy = found = blocks.moving_mean(
        rows[blocks.SECONDS] / (6.0 * units), number, step
    )
    noise_xx += FLOOR**2
    noise_yy += FLOOR**2
    slope, variance = _load_variation(noise_xx, noise_xy, noise_yy, np.sqrt(xx / yy))
    found -= [variance, variance * slope, variance * slope**2]
    found *= units
    return found


def _median_of_five(series: Array, place: Index) -> Array:
    """Return the median of each sample and two on either side; beyond an end the samples are mirrored."""
    end = len(series) - 1
    a, b, c, d, e = (series[end - np.abs(end - np.abs(place + away))] for away in range(-2, 3))
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
