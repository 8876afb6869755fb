"""How much more the residuals of a window scatter, over long stretches, than sensor noise explains."""

from statistics import NormalDist

import numpy as np
from numpy.typing import ArrayLike

from terrain_cli.estimation.line.moments import segment_sum
from terrain_cli.estimation.line.uncertainty import samples_per_independent
from terrain_cli.vocabulary.arrays import Array, Bounds, Mask, ratio

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
