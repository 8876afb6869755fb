"""What channels say of their noise by how they vary in time, before any model is fitted.

Load and slip may stay the same throughout a window: then all that varies of what was measured is noise. The
true inputs are sought sample by sample (`linearised`), so that this noise stands for variation that no force
follows: torque seems not to depend on slip, so that k is near 0, or on load, so that φ is, with a small
error. It is the attenuation of a slope by noise of the regressor (Fuller 1987, Measurement Error Models,
section 1.1), where the regressor is nothing but noise. Elsewhere noise is at most what a channel does in a
fraction of a second.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from statistics import NormalDist
from typing import Self

import numpy as np

from terrain_cli.estimation.line.moments import segment_sum, window_products
from terrain_cli.estimation.wheel_fit.excess_scatter import NOISE_LASTS, NORMAL_MEDIAN, memory
from terrain_cli.estimation.wheel_fit.fit_data import BALANCE, FitData
from terrain_cli.vocabulary.arrays import Array, Bounds, Mask

#: Standard deviations beyond chance at which an input varies from more than noise, or a channel follows it.
_PLAIN = 3.0
#: Variance of a sensor that drifts beside that of its noise within a second, up to which it may be all that
#: varies. Judged: a drift as large as the noise.
_DRIFTS = 2.0
EACH = 30  # Samples of a window that tell noise from soil
BY_CHANCE = 0.01  # Samples of pure noise that are left out of a whole log, on average. Judged.
#: Standard deviation of a normal number beside the second largest of four: that one has the variance 0.36.
_BEYOND = float(np.sqrt(1.36))
#: Neighbouring second differences of white noise share so much that so many are worth an independent one.
_SHARED = 1.0 + 2.0 * (4.0**2 + 1.0) / 6.0**2
_RHO = np.linspace(0.0, 0.99, 100)  # Autocorrelations among which that of noise is sought
_ROUNDING = 1e-9  # Added to correlations, so that of channels that are the same something is left


@dataclass(frozen=True)
class LargestNoise:
    """How large the noise of a channel is at the most, in each window, shape (w,)."""

    variance: Array
    degrees: Array  # Degrees of freedom that tell it; 0 where nothing does
    steady: Mask  # Whether nothing but noise varies there, so that it is as large as that

    @classmethod
    def of(cls, column: Array, data: FitData, steady: Mask, second: float) -> Self:
        """Tell it from a channel of so many samples in a `second`.

        With the variance R and the autocorrelation ρ of the noise over some time, the mean squares of second
        differences over once and twice that time are 6 R times (1 − ρ)(1 − ρ/3) and (1 − ρ²)(1 − ρ²/3). Their
        ratio tells ρ of a first-order process. True values that vary only enlarge R. It is not larger than
        the mean square over the time in which all noise is gone either.
        """
        lag = max(round(0.25 * NOISE_LASTS * second), 1)
        (one, number), (two, both), (four, _) = (
            _differences(column, data.bounds, k * lag) for k in (1, 2, 4)
        )
        ratio = np.sum(both * two) / max(float(np.sum(both * one)), np.finfo(float).tiny)
        rho = np.interp(ratio, (1.0 + _RHO) * (1.0 - _RHO**2 / 3.0) / (1.0 - _RHO / 3.0), _RHO)
        lasting = one / ((1.0 - rho) * (1.0 - rho / 3.0))
        variance = np.where(four > 0.0, np.minimum(lasting, four), lasting)
        return cls(variance, np.where(variance > 0.0, number / _SHARED, 0.0), steady)


def _differences(column: Array, bounds: Bounds, lag: int) -> tuple[Array, Array]:
    """Return the mean of (u₋ − 2 u + u₊)²/6 of samples that far apart, and their number, shape (w,)."""
    count = np.diff(bounds)
    second = np.zeros_like(column)
    middle = slice(lag, len(column) - lag)
    if len(column) > 2 * lag:
        second[middle] = (column[2 * lag :] - 2.0 * column[middle] + column[: -2 * lag]) ** 2 / 6.0
    place = np.arange(len(column)) - np.repeat(bounds[:-1], count)
    inside = (place >= lag) & (place < np.repeat(count, count) - lag)
    number = segment_sum(inside.astype(float), bounds)
    return segment_sum(np.where(inside, second, 0.0), bounds) / np.maximum(number, 1.0), number


def spikes(data: FitData) -> Mask:
    """Tell which samples have an input too far beyond those before and after it for noise, shape (n,).

    They weigh on a slope as many others do, and a robust fit to the outputs does not find them (leverage:
    Rousseeuw & Leroy 1987, section 1.1). Steps, and changes that last, are no spikes.
    """
    n = data.measured.shape[1]
    found = np.zeros(n, dtype=bool)
    if n <= 2:
        return found
    limit = _BEYOND * NormalDist().inv_cdf(1.0 - 0.5 * BY_CHANCE / (n * len(data.inputs)))
    for name in data.inputs:
        # At the ends a ramp goes on.
        padded = np.pad(data.channels[name], 2, mode="reflect", reflect_type="odd")
        before, middle, after = padded[1:-3], padded[2:-2], padded[3:-1]
        scatter = _medians(np.abs(before - 2.0 * middle + after), data.bounds) / (
            np.sqrt(6.0) * NORMAL_MEDIAN
        )
        near = np.sort([padded[:-4], before, after, padded[4:]], axis=0)
        # One of the four may be a spike itself.
        beyond = np.maximum(middle - near[2], near[1] - middle)
        found |= np.repeat(scatter > 0.0, data.count) & (beyond > limit * np.repeat(scatter, data.count))
    return found


def _medians(values: Array, bounds: Bounds) -> Array:
    """Return the median of each window, 0 without samples, shape (w,)."""
    count = np.diff(bounds)
    ordered = values[np.lexsort((values, np.repeat(np.arange(len(count)), count)))]
    found = np.zeros(len(count))
    found[count > 0] = ordered[(bounds[:-1] + count // 2)[count > 0]]
    return found


def steadied(data: FitData, second: float) -> FitData:
    """Hold load and slip at their means in the windows in which they only seem to vary.

    There they vary no more than noise may (`LargestNoise`), with so many samples in a `second`, and no other
    channel follows them, given the rest of the inputs; nor another input, given nothing.
    """
    outputs = {
        name: np.where(data.seen[row], data.measured[row], np.nan)
        for row, name in enumerate(data.outputs)
        if name != BALANCE
    }
    steady = np.zeros((len(data.inputs), len(data.windows)), dtype=bool)
    for row, name in enumerate(data.inputs):
        if name == "sinkage" and BALANCE in data.outputs:
            # The load on the wheel holds it.
            continue
        column, given = data.channels[name], {n: data.channels[n] for n in data.inputs if n != name}
        largest = LargestNoise.of(column, data, steady[row], second)
        varies = segment_sum((column - np.repeat(data.mean[row], data.count)) ** 2, data.bounds)
        chance = 1.0 + _PLAIN * np.sqrt(2.0 / np.maximum(largest.degrees, 1.0))
        most = np.maximum(chance, _DRIFTS) * largest.variance * data.count
        still = (data.count >= EACH) & (varies <= most)
        for follower, responds in {**given, **outputs}.items() if still.any() else ():
            others = [one for other, one in given.items() if other != follower]
            # Where load and sinkage step together, each given the other has nothing left to follow.
            for beside in [others, []] if follower in given else [others]:
                still &= ~_follows(responds, column, beside, data.bounds)
        steady[row] = still
    return replace(data, steady=steady)


def _follows(channel: Array, column: Array, given: Sequence[Array], bounds: Bounds) -> Mask:
    """Tell in which windows a channel follows another one beyond chance, some others given, shape (w,).

    Two channels that both drift seem to follow one another (Granger & Newbold 1974, Journal of Econometrics
    2, 111): what lasts in their product counts for fewer samples.
    """
    table = np.stack([np.ones_like(column), *given, column, channel])
    known = np.asarray(np.isfinite(table).all(axis=0))
    table = np.where(known, table, 0.0)
    products = window_products(table[None], table[None], bounds)
    size = np.sqrt(np.maximum(np.einsum("waa->wa", products), np.finfo(float).tiny))
    related = products / (size[:, :, None] * size[:, None, :]) + _ROUNDING * np.eye(len(table))
    count = np.diff(bounds)
    table /= np.repeat(size, count, axis=0).T
    shares = np.repeat(np.linalg.solve(related[:, :-2, :-2], related[:, :-2, -2:]), count, axis=0)
    own, other = table[-2:] - np.einsum("ngk,gn->kn", shares, table[:-2])
    power = segment_sum(own**2, bounds)
    slope = segment_sum(own * other, bounds) / np.maximum(power, np.finfo(float).tiny)
    rest = other - np.repeat(slope, count) * own
    lasting = memory((own * rest)[None], bounds)[0]
    free = np.maximum(segment_sum(known.astype(float), bounds) - len(table), 0.0)
    return np.asarray(free * slope**2 * power > _PLAIN**2 * lasting * segment_sum(rest**2, bounds))
