"""Whether residuals go on for longer than noise of any sensor does, whatever its spectrum."""

from itertools import pairwise
from math import erfc, sqrt
from typing import NamedTuple

import numpy as np

from terrain_cli.estimation.wheel_fit.channel_series import NORMAL_MEDIAN
from terrain_cli.estimation.wheel_fit.excess_scatter import NOISE_LASTS
from terrain_cli.vocabulary.arrays import Array, Bounds, Index, Mask

#: Decays of the longest noise of sensors after which it counts as forgotten: what takes longer is a misfit.
FORGETS = 3.0
#: Samples after which it does at the least. Judged. Of 64 clean logs whose noise lasts, 60 samples pass for a
#: misfit in 2, and 30 in 3; but at 10 Hz 60 take soil that wanders by 3 % for noise.
_FEWEST = 30
#: Correlations are looked at up to this many times that (judged). Of 1,200 series of noise that lasts up to
#: 1 s, by filters of six kinds and at 10 to 100 Hz, a level of 5 % then finds 3 % to go on.
_SEEN = 4
#: Pairs of samples that tell a correlation, and such stretches that tell whether anything goes on.
_PAIRS, _STRETCHES = 30, 16
#: How rarely chance gives such correlations in a window that the model misses, and the share of the scatter
#: that goes on in it. Of 100 clean drives of another simulator, whose noise has an autocorrelation of 0.5 to
#: 0.95 at 5 to 50 Hz, no row `ok` of 99 is lost by it. Of 120 that lack an effect under such noise 31 rows
#: are `ok`, 8 of them off by more than three errors: 5 by the gain of a load cell, which nothing shows.
_RARELY, _SHARE = 1e-3, 0.3
_HUBER = 1.345  # Standard deviations beyond which a sample counts no more: 5 % of efficiency


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
    if pairs[0] < _STRETCHES * forgotten or not use.any() or covariance[0] <= 0.0:
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


def missed(residuals: Array, seen: Mask, bounds: Bounds, second: float) -> Mask:
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
