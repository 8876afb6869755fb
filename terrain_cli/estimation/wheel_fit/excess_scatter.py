"""How long residuals last, and how much more they scatter over long stretches, than sensor noise explains."""

from itertools import pairwise
from math import erfc, sqrt
from statistics import NormalDist
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from terrain_cli.estimation.line.moments import segment_sum
from terrain_cli.estimation.line.uncertainty import samples_per_independent
from terrain_cli.vocabulary.arrays import Array, Bounds, Index, Mask, ratio

#: Standard deviations beyond chance at which a scatter is larger, or a sample remembers the last one.
_PLAIN, _MEMORY = 3.0, 2.0
_ITERATIONS = 6
_STRETCHES = 8  # Stretches of a window whose means tell a slow drift from white noise
#: A window of which what is left lasts longer, or is larger, than this many samples of noise is sought again,
#: and what lasts longer is no noise that is learnt. Judged: noise of sensors with an autocorrelation of 0.9
#: lasts for 19 samples.
MISSED = 20.0
#: s in which the autocorrelation of sensors' noise falls e times at the most. Judged: filters and rough
#: ground make 0.05 to 0.5 s, and load, slip and soil vary over several.
NOISE_LASTS = 1.0
#: Decays of the longest noise of sensors after which it counts as forgotten: what takes longer is a misfit.
FORGETS = 3.0
#: Samples after which it does at the least. Judged. Of 64 clean logs whose noise lasts, 60 samples pass for a
#: misfit in 2, and 30 in 3; but at 10 Hz 60 take soil that wanders by 3 % for noise.
_FEWEST = 30
#: Correlations are looked at up to this many times that (judged). Of 1,200 series of noise that lasts up to
#: 1 s, by filters of six kinds and at 10 to 100 Hz, a level of 5 % then finds 3 % to go on.
_SEEN = 4
#: Pairs of samples that tell a correlation, and such stretches that tell whether anything goes on.
_PAIRS, _LONG = 30, 16
#: How rarely chance gives such correlations in a window that the model misses, and the share of the scatter
#: that goes on in it. Of 100 clean drives of another simulator, whose noise has an autocorrelation of 0.5 to
#: 0.95 at 5 to 50 Hz, no row `ok` of 99 is lost by it. Of 120 that lack an effect under such noise 31 rows
#: are `ok`, 8 of them off by more than three errors: 5 by the gain of a load cell, which nothing shows.
_RARELY, _SHARE = 1e-3, 0.3
_HUBER = 1.345  # Standard deviations beyond which a sample counts no more: 5 % of efficiency
NORMAL_MEDIAN = 0.6745  # Median of the magnitude of a standard normal number


def excess(residual: Array, seen: Mask, bounds: Bounds, dof: Array) -> Array:
    """Return the variance of whitened residuals, the largest of the channels', 1 or more, shape (w,).

    It is not known on which of them an estimate hangs. What may be chance is not counted, and a variance
    below 1 is no reason to trust a window more than its sensors. Residuals are of shape (outputs, n); `dof`
    are the degrees of freedom of all outputs together.
    """
    number = segment_sum(seen.astype(float), bounds)
    total = np.maximum(number.sum(axis=0), 1.0)
    # The fit takes its share of every channel's scatter.
    size = np.maximum(number * np.clip(dof / total, 1.0 / total, 1.0), 1.0)
    variance = segment_sum(residual**2, bounds) / size
    variance = np.where(variance > 1.0 + _PLAIN * np.sqrt(2.0 / size), variance, 1.0)
    return np.asarray(variance.max(axis=0, initial=1.0))


def lasting_squares(residuals: Array, bounds: Bounds) -> Array:
    """Return the part of the sums of squares that goes on from one sample to the next, shape (outputs, w).

    Residuals are of shape (outputs, n), 0 where there is none.
    """
    product = residuals[:, 1:] * residuals[:, :-1]
    inside = bounds[1:-1]
    product[:, inside[(inside > 0) & (inside < residuals.shape[1])] - 1] = 0.0
    return segment_sum(np.concatenate([product, np.zeros((len(residuals), 1))], axis=1), bounds)


def exceeded(free: ArrayLike, probability: float) -> Array:
    """Return what χ² of so many degrees of freedom exceeds that rarely (Wilson & Hilferty 1931)."""
    free = np.asarray(free)
    part = 2.0 / (9.0 * free)
    normal = NormalDist().inv_cdf(1.0 - probability)
    return np.asarray(free * (1.0 - part + normal * np.sqrt(part)) ** 3)


def samples_a_second(time: Array | None) -> float:
    """Return how many samples there mostly are in a second; 0 without a clock."""
    steps = np.diff(time) if time is not None else np.zeros(0)
    return 1.0 / float(np.median(steps[steps > 0.0])) if (steps > 0.0).any() else 0.0


def memory(rows: Array, bounds: Bounds, *, taken: Array | float = 0.0, together: bool = False) -> Array:
    """Return how many samples make an independent one, 1 or more, shape (r, w), or (r, 1) if `together`.

    The autocorrelation is taken as that of a first-order process above white noise, from lags 1 and 2 (see
    `uncertainty`). What may be chance is not counted: two small correlations may feign a long memory, which
    the means of n^⅔ samples then do not show. A fit leaves less of the sum of each series, and of its
    autocorrelation, than there was; that is put back: `taken` of a series' sum of squares, were it white, in
    terms of the variance of a sample (1 of the residuals about a mean). `rows`, shape (r, n), are series of
    mean zero, such as the parts of a score; `together` says that the windows are pieces of one series with
    one autocorrelation.
    """
    sums = []
    for lag in (0, 1, 2):
        product = np.zeros_like(rows)
        product[:, lag:] = rows[:, lag:] * rows[:, : rows.shape[1] - lag]
        for step in range(lag):
            first = bounds[:-1] + step
            product[:, first[first < bounds[-1]]] = 0.0
        sums.append(segment_sum(product, bounds))
    length = np.maximum(np.diff(bounds).astype(float), 1.0)
    number = length
    if together:
        sums = [part.sum(axis=1, keepdims=True) for part in sums]
        number, length = length.sum(keepdims=True), length.mean(keepdims=True)
    power, *lagged = sums
    seen = [ratio(part, power) for part in lagged]
    # At least two independent samples: fewer cannot be told from a drift.
    most = np.broadcast_to(np.maximum(1.0 - 2.0 / length, 0.0), power.shape)
    plain = seen[0] > _MEMORY / np.sqrt(number)
    gone = np.zeros_like(power)
    for _ in range(_ITERATIONS):
        one, two = (
            (part * (number - gone) + gone) / np.maximum(number - lag, 1.0)
            for lag, part in zip((1.0, 2.0), seen, strict=True)
        )
        one = np.where(plain, np.clip(one, 0.0, most), 0.0)
        decay = np.clip(ratio(two, one), one, most)
        share = ratio(one, decay)
        lasting = samples_per_independent(decay, share, length)
        gone = np.minimum(taken * lasting, 0.5 * number)
    # Lags 1 and 2 of a drift that is small beside white noise are lost in it; it moves long stretches all the
    # same. They count where they scatter more than white noise does, and more than these lags say.
    length = np.diff(bounds).astype(float)
    scatter = [
        _of_means(rows, bounds, power, taken, size, together=together)
        for size in (length ** (2.0 / 3.0), length / _STRETCHES)
    ]
    most = np.max([means * (1.0 + _PLAIN * error) for means, error in scatter], axis=0)
    found = np.minimum(lasting, np.maximum(most, 1.0))
    lags, number = found, max(len(rows), 1)
    # Of few samples one of several series may seem to last long by chance.
    usual = np.median(lags, axis=0) if len(rows) else 1.0
    for means, error in scatter:
        plain = (means > 1.0 + _PLAIN * error) & (means > (1.0 + error) * found)
        found = np.where(plain, means, found)
        # Drifting sensors are in all series, which together show it sooner than each of them.
        more = np.sum(means / lags, axis=0) / number
        plain = more > 1.0 + _PLAIN * error / np.sqrt(number)
        found = np.maximum(found, np.where(plain, more * usual, 1.0))
    return np.asarray(found)


def _of_means(
    rows: Array, bounds: Bounds, power: Array, taken: Array | float, size: Array, *, together: bool
) -> tuple[Array, Array]:
    """Return how many samples make an independent one by the scatter of means, and its standard deviation.

    The means are of `size` samples, one number for each window; the deviation, of chance, is a share.
    """
    length = np.diff(bounds)
    place = np.arange(bounds[-1]) - np.repeat(bounds[:-1], length)
    starts = np.flatnonzero(place % np.repeat(np.maximum(size.astype(int), 1), length) == 0)
    squares = np.add.reduceat(rows, starts, axis=1) ** 2
    blocks = np.searchsorted(starts, bounds)
    sums, number = segment_sum(squares, blocks), np.diff(blocks).astype(float)
    if together:
        sums, number = sums.sum(axis=1, keepdims=True), number.sum(keepdims=True)
    number = np.maximum(number, 1.0)
    return ratio(sums, power, 1.0) / np.maximum(1.0 - taken / number, 0.5), np.sqrt(2.0 / number)


class GoesOn(NamedTuple):
    """What correlations of samples say that lie farther apart than noise of sensors lasts."""

    chance: float  # How often it gives such correlations; NaN where there are too few stretches
    share: float  # Of the scatter; all of it where the residual is a sine


def all_forgotten(second: float) -> int:
    """Return after how many samples noise of any sensor is forgotten, with so many in a second."""
    return max(_FEWEST, int(FORGETS * NOISE_LASTS * second))


def goes_on(residual: Array, group: Index, forgotten: int) -> GoesOn:
    """Tell whether an ordered residual, NaN where not known, goes on beyond so many samples.

    The covariance of correlations is Σ ρ(j) ρ(j + k − h) / n of lags h and k (Bartlett 1946, Journal of the
    Royal Statistical Society Supplement 8, 27), the sum of their squares a multiple of χ² (Satterthwaite
    1946, Biometrics Bulletin 2, 110). A misfit would hide behind its own ρ: that of noise falls as fast as
    that of the noise which lasts longest. Groups are contiguous, and no pair is of two.
    """
    covariance, pairs = _autocovariance(residual, group, _SEEN * forgotten)
    use = pairs[forgotten:] >= _PAIRS
    # So few stretches speak neither for a misfit nor against it.
    if pairs[0] < _LONG * forgotten or not use.any() or covariance[0] <= 0.0:
        return GoesOn(np.nan, np.nan)
    correlation = covariance / covariance[0]
    slowest = np.exp(-FORGETS * np.arange(forgotten) / forgotten)
    near = np.clip(correlation[:forgotten], -slowest, slowest)
    both = np.concatenate([near[:0:-1], near])
    shared = np.convolve(both, both)[2 * forgotten - 2 :]
    number = np.where(use, 1.0 / np.maximum(pairs[forgotten:], 1.0), 0.0)
    alike = np.convolve(number, number[::-1])[len(number) - 1 :][: len(shared)]
    mean = shared[0] * float(number.sum())
    variance = 4.0 * float(shared[: len(alike)] ** 2 @ alike) - 2.0 * shared[0] ** 2 * alike[0]
    ninth = variance / (9.0 * mean**2)
    squares = (correlation[forgotten:] ** 2)[use]
    # The cube root of χ² over its mean is nearly normal (Wilson & Hilferty 1931).
    beyond = (float(np.cbrt(squares.sum() / mean)) - 1.0 + ninth) / sqrt(ninth)
    return GoesOn(0.5 * erfc(beyond / sqrt(2.0)), sqrt(2.0 * float(squares.mean())))


def going_on(residuals: Array, seen: Mask, bounds: Bounds, second: float) -> Mask:
    """Tell in which windows a residual, shape (outputs, n), goes on, by much of its scatter, shape (w,).

    By the samples of the window or of all windows: what a model lacks is the same in them. How much of a
    window it is, is its own, but for those that are too short to tell.
    """
    count = np.diff(bounds)
    group, after = np.repeat(np.arange(len(count)), count), all_forgotten(second)
    found = np.zeros(len(count), dtype=bool)
    for row in np.where(seen, residuals, np.nan):
        left = np.concatenate([[], *(_bounded(row[a:b]) for a, b in pairwise(bounds))])
        own = np.array([goes_on(left[a:b], group[a:b], after) for a, b in pairwise(bounds)])
        own = own.reshape(-1, 2)
        together = goes_on(left, group, after)
        chance = np.fmin(own[:, 0], together.chance)
        share = np.where(np.isnan(own[:, 1]), together.share, own[:, 1])
        found |= (chance < _RARELY) & (share > _SHARE)
    return found


def _bounded(row: Array) -> Array:
    """Return a residual about its median, as far as it is not wild (Huber 1964)."""
    known = np.isfinite(row)
    if not known.any():
        return row
    left = row - np.median(row[known])
    most = _HUBER * float(np.median(np.abs(left[known]))) / NORMAL_MEDIAN
    return np.clip(left, -most, most) if most > 0.0 else left


def _autocovariance(residual: Array, group: Index, most: int) -> tuple[Array, Array]:
    """Return the covariance of samples up to `most` lags apart, and the numbers of their pairs."""
    known = np.isfinite(residual)
    # Groups lie so far apart that no pair is of two; the shortest have no pairs that matter.
    starts = np.flatnonzero(np.concatenate([[True], group[1:] != group[:-1]]))
    length = np.diff(np.append(starts, len(residual)))
    long = length > most // _SEEN
    known &= np.repeat(long, length)
    place = (np.arange(len(residual)) + most * np.repeat(np.cumsum(long), length))[known]
    if len(place) == 0:
        return np.zeros(most + 1), np.zeros(most + 1)
    size = int(place[-1] - place[0]) + most + 1
    series = np.zeros((2, size))
    series[0, place - place[0]] = residual[known] - residual[known].mean()
    series[1, place - place[0]] = 1.0
    sums, pairs = np.fft.irfft(np.abs(np.fft.rfft(series)) ** 2, size)[:, : most + 1]
    pairs = np.round(pairs)
    return sums / np.maximum(pairs, 1.0), pairs
