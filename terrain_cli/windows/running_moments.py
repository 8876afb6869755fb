"""Cumulative moments of a stretch of samples, from which those of any window follow, and their noise.

x and y are computed from the same noisy channels, so a window of constant load is a cloud whose own
regression slope says nothing of the soil. Every test here therefore needs the covariance of the noise of
(x, y), and that changes along a drive, since noise grows with the values: it is learnt from neighbours.
"""

import numpy as np

from terrain_cli.vocabulary.arrays import Array, Index, Mask, median
from terrain_cli.windows import line_costs, sample_blocks
from terrain_cli.windows.sample_blocks import ReplacedSamples

FLOOR = 2e-3  # No channel is known better than this share of its value
LEVEL_FLOOR = 1e-9  # No level of x or y is below this share of the usual one: noise is a share of it
#: Correlation of x and y that noise may have. Equal relative errors of W, T, z and i leave next to
#: none (below 0.1 on all soils tried); more is a load that varies from sample to sample.
NOISE_CORRELATION = 0.15
LARGEST_LAG = 30  # Samples over which what is left after prewhitening may still be correlated
#: Samples in the blocks of long drives, and between the bounds that are tried first within one.
LONG, FINE = 64, 8


def tame(samples: ReplacedSamples, step: int) -> tuple[Array, Array]:
    """Replace wild samples, one or two in a row, by the median of five around them.

    Of three or more. Returns the sums of x, y, x², xy and y² over blocks, shape (5, blocks), and the noise:
    variance of x, covariance, variance of y, in Pa², shape (3, blocks).
    """
    n = len(samples)
    usual = np.abs(samples.at(np.arange(0, n, 1 + n // 4096))).mean(axis=1)
    usual[usual == 0.0] = 1.0
    rows, place, middles = _measure(samples, step, usual)
    # Where three of five are wild, some are seen only after others have been replaced.
    for _ in range(3):
        if not len(place):
            break
        samples.replace(place, middles)
        rows, place, middles = _measure(samples, step, usual)
    number = sample_blocks.sizes(n, step)
    return rows[sample_blocks.POWERS], block_noise(rows, number, step, LEVEL_FLOOR * usual)


def _measure(samples: ReplacedSamples, step: int, usual: Array) -> tuple[Array, Index, Array]:
    """Sum over blocks, one slab after another in the same memory.

    Returns the rows of `sample_blocks.summed`, which samples are wild, and the medians of x and y there.
    """
    n = len(samples)
    slabs = list(sample_blocks.slabs(n, step))
    out = np.empty((sample_blocks.ROWS, slabs[-1][1]))
    room = np.empty((6, max(end - begin for _, _, begin, end in slabs) * step))
    far = []
    for first, last, begin, end in slabs:
        x, y = samples.between(begin * step, min(end * step, n))
        rows, place, limit = sample_blocks.summed(x, y, step, usual[0] / usual[1], room)
        out[:, first:last] = rows[:, first - begin : last - begin]
        mine = (place >= (first - begin) * step) & (place < (last - begin) * step)
        place = place[mine]
        far.append((begin * step + place, limit[:, mine], _five(x, y, place)))
    place, limit, five = (np.concatenate(some, axis=-1) for some in zip(*far, strict=True))
    # No sample is further from its median than from one of its neighbours.
    middles = np.median(five, axis=1)
    wild = (np.abs(five[:, 2] - middles) > limit).any(axis=0)
    return out, place[wild], middles[:, wild]


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


def _load_variation(xx: Array, xy: Array, yy: Array, ratio: Array) -> tuple[Array, Array]:
    """Return slope and variance of x of the movement along the soil's line, relative to the means."""
    excess = np.maximum(xy - NOISE_CORRELATION * np.sqrt(xx * yy), 0.0)
    divisor = np.where(excess > 0.0, 2.0 * xy, 1.0)
    # The major axis, as noise is alike in both; but no soil's line is flatter or steeper than these.
    axis = (yy - xx + np.sqrt((yy - xx) ** 2 + divisor**2)) / divisor
    slope = np.clip(axis, line_costs.SMALLEST_SLOPE * ratio, line_costs.LARGEST_SLOPE * ratio)
    return slope, np.minimum(excess / slope, 0.9 * np.minimum(xx, yy / slope**2))


def correlation_factor(residuals: Array, starts: Index, fitted: int) -> float:
    """Return how much more the mean of correlated residuals scatters than neighbours tell.

    Long-run variance by prewhitening (Andrews & Monahan 1992, Econometrica 60(4)) with a
    first-order autoregression and Bartlett's window, over the variance from second differences.

    Residuals are about the lines, in units of the standard deviation from second differences; `starts` are
    the first samples of the windows, without 0: no products are taken across them. The factor is at least 1.
    """
    n = len(residuals)
    limit = 6.0 * 1.4826 * median(np.abs(residuals))
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
    lags = min(int(1.5 * len(white) ** (1.0 / 3.0)), LARGEST_LAG)
    # The products at all lags, with Bartlett's weights, are the squares of sums of neighbours.
    ends = np.zeros(lags)
    sums = sample_blocks.running(np.concatenate([ends, white, ends]), lags + 1)
    long_run = _dot(sums, sums) / (lags + 1)
    freedom = max(n - fitted, n / 3.0)
    return max(1.0, long_run / freedom / (1.0 - memory) ** 2)


def _dot(a: Array, b: Array) -> float:
    """Sum of products. BLAS would take threads for it, that wait for busy cores: 10 times slower there."""
    return float(np.einsum("i,i", a, b))


class RunningMoments:
    """Moments of all windows of one stretch.

    Sums are accumulated block by block; what ten million of them lose by cancellation is far below
    `running_moments.FLOOR`. Windows may begin at any sample.

    The noise is taken as constant over the `step` samples of a block.
    """

    def __init__(self, x: Array, y: Array, step: int) -> None:
        self.step = step
        self.edges = np.append(np.arange(0, len(x), step, dtype=np.intp), len(x))
        self.samples = ReplacedSamples(x, y)
        sums, self.noise = tame(self.samples, step)
        number = sample_blocks.sizes(len(x), step)
        noise_xx, noise_xy, noise_yy = self.noise
        self._weight = 1.0 / line_costs.across(noise_xx, noise_xy, noise_yy, line_costs.MIDDLE_SLOPE)
        #: Sums over all blocks before each, shape (10, blocks + 1).
        self.total = np.zeros((line_costs.ROWS, len(self.edges)))
        for row, total in zip((number, *sums, *self.noise), self.total, strict=False):
            np.multiply(self._weight, row, out=total[1:])
        self.total[line_costs.NOISE_XX : line_costs.NOISE_YY + 1, 1:] *= number
        np.cumsum(self.total[: line_costs.N], axis=1, out=self.total[: line_costs.N])
        self.total[line_costs.N] = self.edges

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
        rows = np.empty((line_costs.ROWS, count, len(block)))
        rows[:, 0] = self.total.take(block, axis=1)
        rows[:, 1:] = self._weighted(block, powers.swapaxes(1, 2), np.full((1, 1), FINE))
        for place in range(1, count):
            rows[:, place] += rows[:, place - 1]
        return block[:, None] * self.step + np.arange(0, self.step, FINE), rows.swapaxes(1, 2)

    def _weighted(self, block: Index, powers: Array, number: Index | Mask) -> Array:
        """Return the weighted moments of parts of blocks, shape (10, ..., k).

        `powers`, shape (5, ..., k), are sums over the parts of x, y, x², xy and y²; `number`, shape (..., k),
        is their samples.
        """
        weight = self._weight[block]
        rows = np.empty((line_costs.ROWS, *powers.shape[1:]))
        rows[line_costs.W] = number * weight
        np.multiply(powers, weight, out=rows[line_costs.X : line_costs.YY + 1])
        for row, noise in zip(rows[line_costs.NOISE_XX : line_costs.NOISE_YY + 1], self.noise, strict=True):
            row[:] = number * (weight * noise[block])
        rows[line_costs.N] = number
        return rows

    def around(self, sample: Index, reach: int) -> tuple[Index, Array]:
        """Return every bound within reach of k samples, and the sums before it, shape (10, k, 2 reach + 1).

        Beyond the ends of the stretch there are no samples: the sums are those at the end.
        """
        begin = np.maximum(sample - reach, 0)
        place = begin[:, None] + np.arange(2 * reach)
        inside = place < len(self.samples)
        x, y = self.samples.at(place) * inside
        block = np.minimum(place // self.step, len(self._weight) - 1)
        single = self._weighted(block, np.stack([x, y, x * x, x * y, y * y]), inside)
        rows = np.concatenate([self.before(begin)[:, :, None], single], axis=2)
        return begin[:, None] + np.arange(2 * reach + 1), np.cumsum(rows, axis=2, out=rows)


def _powers(x: Array, y: Array) -> Array:
    """Return the sums of x, y, x², xy and y² over rows of samples, shape (5, rows)."""
    return np.stack(
        [
            np.einsum("ks->k" if len(factors) == 1 else "ks,ks->k", *factors)
            for factors in ((x,), (y,), (x, x), (x, y), (y, y))
        ]
    )
