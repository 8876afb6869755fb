"""What the sensors' noise does to x and y, learnt from neighbouring samples.

x and y are computed from the same noisy channels, so a window of constant load is a cloud whose
own regression slope says nothing of the soil. Every test here therefore needs the covariance of
the noise of (x, y), and that changes along a drive, since noise grows with the values.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from terrain_cli.windows.segmentation import sample_blocks
from terrain_cli.windows.segmentation.line_costs import LARGEST_SLOPE, SMALLEST_SLOPE

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from terrain_cli.windows.segmentation.sample_blocks import ReplacedSamples

    Array = NDArray[np.float64]
    Index = NDArray[np.intp]
    Parts = Sequence[Index]

#: No channel is known better than this share of its value.
FLOOR = 2e-3
#: No level of x or y is below this share of the usual one: noise is a share of it.
LEVEL_FLOOR = 1e-9
#: Correlation of x and y that noise may have. Equal relative errors of W, T, z and i leave next to
#: none (below 0.1 on all soils tried); more is a load that varies from sample to sample.
NOISE_CORRELATION = 0.15
#: Samples over which what is left after prewhitening may still be correlated.
LARGEST_LAG = 30


def tame(samples: ReplacedSamples, step: int) -> tuple[Array, Array]:
    """Replace wild samples, one or two in a row, by the median of five around them.

    Of three or more. Returns the sums of x, y, x², xy and y² over blocks, shape (5, blocks), and the noise:
    variance of x, covariance, variance of y, in Pa², shape (3, blocks). ValueError where a sample is not
    finite.
    """
    n = len(samples)
    number = sample_blocks.sizes(n, step)
    rows = np.empty((sample_blocks.ROWS, len(number)))
    usual = np.abs(samples.at(np.arange(0, n, 1 + n // 4096))).mean(axis=1)
    usual[usual == 0.0] = 1.0
    stale = list(sample_blocks.slabs(n, step))
    with np.errstate(invalid="ignore"):
        place, middles = _measure(samples, step, usual, stale, rows)
    # The sums are there already; they may overflow.
    if not np.isfinite(rows[sample_blocks.SUMS]).all():
        samples.check_finite()
    # Where three of five are wild, some are seen only after others have been replaced.
    for _ in range(3):
        if not len(place):
            break
        samples.replace(place, middles)
        stale = list(sample_blocks.about(place, n, step))
        place, middles = _measure(samples, step, usual, stale, rows)
    return rows[sample_blocks.POWERS], block_noise(rows, number, step, LEVEL_FLOOR * usual)


def _measure(
    samples: ReplacedSamples, step: int, usual: Array, parts: Parts, out: Array
) -> tuple[Index, Array]:
    """Fill in the rows of these blocks, one part after another in the same memory.

    Returns which of their samples are wild, and the medians of x and y there.
    """
    spans = [sample_blocks.around(part, len(samples), step) for part in parts]
    room = np.empty((6, max(len(span) for span in spans) * step))
    far = []
    for part, span in zip(parts, spans, strict=True):
        x, y = samples.of_blocks(span, step)
        rows, place, limit = sample_blocks.summed(x, y, step, usual[0] / usual[1], room)
        own = sample_blocks.as_index(np.searchsorted(span, part))
        out[:, sample_blocks.as_index(part)] = rows[:, own]
        asked = np.zeros(len(span), dtype=bool)
        asked[own] = True
        mine = asked[place // step]
        place = place[mine]
        far.append((span[place // step] * step + place % step, limit[:, mine], _five(x, y, place)))
    place, limit, five = (np.concatenate(some, axis=-1) for some in zip(*far, strict=True))
    # No sample is further from its median than from one of its neighbours.
    middles = _median_of_five(five)
    wild = (np.abs(five[:, 2] - middles) > limit).any(axis=0)
    return place[wild], middles[:, wild]


def block_noise(rows: Array, number: Index, step: int, least: Array) -> Array:
    """Estimate the covariance of the noise of (x, y), block by block.

    From second differences, in which a drift of the load cancels, averaged over `sample_blocks.REACH`
    samples on either side. A load that varies from sample to sample moves (x, y) along the soil's
    line and would pass for noise: it shows as a correlation that noise has not, and is taken out.

    `rows` are from `sample_blocks.summed`; below `least`, shape (2,), in Pa, no level of x and y is believed.
    Returns variance of x, covariance, variance of y, in Pa², shape (3, blocks).
    """
    squares = sample_blocks.moving_mean(rows[[sample_blocks.POWER_X, sample_blocks.POWER_Y]], number, step)
    xx, yy = np.maximum(squares, least[:, None] ** 2)
    # Relative to the levels of x and y.
    units = np.stack([xx, np.sqrt(xx * yy), yy])
    # The two ends have no second difference; the sums are over the others.
    number = number.copy()
    number[0] -= 1
    number[-1] -= 1
    # Second differences of white noise have six times its variance.
    noise_xx, noise_xy, noise_yy = found = sample_blocks.moving_mean(
        rows[sample_blocks.SECONDS] / (6.0 * units), number, step
    )
    noise_xx += FLOOR**2
    noise_yy += FLOOR**2
    slope, variance = _load_variation(noise_xx, noise_xy, noise_yy, np.sqrt(xx / yy))
    found -= [variance, variance * slope, variance * slope**2]
    found *= units
    return found


def _five(x: Array, y: Array, place: Index) -> Array:
    """Return samples of x and y with two on either side, shape (2, 5, k); beyond an end they are mirrored."""
    end = len(x) - 1
    around = end - np.abs(end - np.abs(place + np.arange(-2, 3)[:, None]))
    return np.stack([x[around], y[around]])


def _median_of_five(five: Array) -> Array:
    a, b, c, d, e = five.swapaxes(0, 1)
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

    Residuals are about the lines, in units of the standard deviation from second differences; `starts` are
    the first samples of the windows, without 0: no products are taken across them. The factor is at least 1.
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
