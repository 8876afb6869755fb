"""The noise in a residual: its part that changes from sample to sample, and not with the drive."""

from collections.abc import Mapping
from itertools import product
from typing import NamedTuple

import numpy as np

from terrain_cli.comparison import comparison_criteria as criteria
from terrain_cli.estimation.wheel_fit.excess_scatter import FORGETS, all_forgotten, goes_on
from terrain_cli.vocabulary.arrays import Array, Index

_FAR_LAGS = 15  # Lags of the variogram beyond the twelfth
#: Correlations at lag 1 that are tried, and samples in which the correlation falls e times.
_MEMORIES = np.array([0.2, 0.35, 0.5, 0.6, 0.7, 0.75, 0.8, 0.84, 0.88, 0.91, 0.94])
_DECAYS = np.concatenate([[0.0], -1.0 / np.log(_MEMORIES), [22.0, 30.0, 42.0, 59.0]])
#: Decays that lags must reach over beside a misfit: with fewer, what levels off is not told from what rises.
_REACH = 3.7
#: How often chance gives such correlations, or a variogram that rises as much: 95 % of χ² with two degrees of
#: freedom is what the amplitudes of a misfit must take off the sum of squares.
_LEVEL, _BY_CHANCE = 0.05, 5.99


class NoiseLevel(NamedTuple):
    deviation: float  # Standard deviation; NaN where the data do not tell
    forgotten: int  # Samples after which the noise is another one; 0 for white noise


def of_all(errors: Mapping[str, Array], group: Index, second: float) -> dict[str, NoiseLevel]:
    """Estimate the noise of some residuals of ordered samples, by channel; see `of_series`."""
    return {name: of_series(error, group, second) for name, error in errors.items()}


def of_series(residual: Array, group: Index, second: float = 0.0) -> NoiseLevel:
    """Estimate the noise of an ordered residual, NaN where not known, with so many samples in a `second`.

    Where nothing goes on for longer than noise of sensors does, all of it is noise, whatever its spectrum.
    Else its variogram tells, as it does in any case how long noise is remembered: γ(h), which is
    ½ E (e(t + h) − e(t))², of noise w² + a² (1 − ρʰ), white and first-order correlated, levels off at
    w² + a² after a few samples; what a misfit adds rises with h, like h² where it follows a smooth drive and
    like h where soil changes in patches (Cressie 1993, Statistics for Spatial Data, section 2.4). The
    amplitudes are fitted, none of them negative, for a range of ρ.
    Differences are not taken across groups, which are contiguous.
    """
    longest = all_forgotten(second)
    lags, gamma, pairs = _variogram(residual, group, longest)
    if len(lags) < 3 or not np.any(gamma > 0.0):
        return NoiseLevel(float(np.sqrt(gamma[0])) if len(lags) else np.nan, 0)
    scale = float(gamma.max())
    # The variance of γ(h) goes with γ² h: longer lags share their samples.
    weight = np.sqrt(pairs / lags) / np.maximum(gamma, 0.05 * scale)
    far = lags / lags[-1]
    decays = _DECAYS[longest >= _DECAYS * FORGETS]
    lasting = np.zeros((len(decays), len(lags)))
    lasting[1:] = 1.0 - np.exp(-lags / decays[1:, None])
    columns = np.stack(np.broadcast_arrays(np.ones_like(far), lasting, far, far**2), axis=-1)
    still, plain = _not_negative(columns[..., :2] * weight[:, None], gamma * weight)
    far_enough = longest >= decays * _REACH
    amplitudes, left = _not_negative(columns[far_enough] * weight[:, None], gamma * weight)
    place = int(np.argmin(left))
    if left[place] >= left[0] - criteria.MEMORY_BELIEVED:
        place = 0  # White noise
    elif plain.min() < left[place] + _BY_CHANCE:
        # Noise that lasts wanders by chance as a misfit would.
        amplitudes, place = still, int(np.argmin(plain))
    decay, amplitude = float(decays[place]), amplitudes[place]
    variance = amplitude[0] + amplitude[1]
    share = amplitude[1] / variance if variance > 0.0 else 0.0
    forgotten = 0
    if decay > 0.0 and share > criteria.FORGOTTEN:
        forgotten = int(np.ceil(np.log(share / criteria.FORGOTTEN) * decay))
    if goes_on(residual, group, longest).chance >= _LEVEL:
        return NoiseLevel(float(np.nanstd(residual)), forgotten)
    # A misfit that outweighs the noise can take all of the variogram, but not what jumps between samples.
    return NoiseLevel(max(float(np.sqrt(variance)), _jumps(residual, group)), forgotten)


def _not_negative(columns: Array, values: Array) -> tuple[Array, Array]:
    """Fit values, shape (n,), by m sets of columns, shape (m, n, k), with no amplitude below 0.

    Few columns need no search: the answer is the best fit by those of their choices whose amplitudes are not
    negative. Returned are the amplitudes, shape (m, k), and the sums of squares that are left, shape (m,).
    """
    amplitudes = np.zeros((len(columns), columns.shape[2]))
    least = np.full(len(columns), float(values @ values))
    for taken in product((False, True), repeat=columns.shape[2]):
        chosen = columns[:, :, taken]
        found = np.linalg.pinv(chosen) @ values
        left = ((values - np.einsum("mnk,mk->mn", chosen, found)) ** 2).sum(axis=1)
        better = (found >= 0.0).all(axis=1) & (left < least)
        least[better] = left[better]
        amplitudes[better] = 0.0
        amplitudes[np.ix_(better, taken)] = found[better]
    return amplitudes, least


def _jumps(residual: Array, group: Index) -> float:
    """Return a lower bound of the noise from second differences: right if it is white, less if it lasts."""
    second = residual[:-2] - 2.0 * residual[1:-1] + residual[2:]
    second = np.abs(second[(group[2:] == group[:-2]) & np.isfinite(second)])
    if len(second) < criteria.NOISE_SAMPLES:
        return 0.0
    return float(criteria.NOISE_OF_JUMPS * float(np.median(second)) / (0.6745 * np.sqrt(6.0)))


def _variogram(residual: Array, group: Index, most: int) -> tuple[Array, Array, Array]:
    lags, gamma, pairs = [], [], []
    longest = min(most, max(len(residual) // 8, 3))
    for lag in range(1, longest + 1):
        if lag > 12 and lag % (-(-most // _FAR_LAGS)):
            continue
        change = residual[lag:] - residual[:-lag]
        change = change[(group[lag:] == group[:-lag]) & np.isfinite(change)]
        if len(change) < criteria.NOISE_SAMPLES:
            break
        lags.append(lag)
        gamma.append(0.5 * float(change @ change) / len(change))
        pairs.append(len(change))
    return np.array(lags, dtype=float), np.array(gamma), np.array(pairs, dtype=float)


def of_all_points(errors: Mapping[str, Array], group: Index, drivers: Array) -> dict[str, NoiseLevel]:
    """Estimate the noise of steady test points by channel: from repeated ones, else from neighbours."""
    levels = {}
    for name, error in errors.items():
        level = of_points(error, group, drivers)
        levels[name] = NoiseLevel(level if np.isfinite(level) else of_neighbours(error, group, drivers), 0)
    return levels


def of_points(residual: Array, group: Index, drivers: Array) -> float:
    """Estimate the noise of steady test points from those that were run under the same conditions.

    Nearest neighbours of one group are compared where all `drivers`, shape (n, d), differ by less than
    `SAME_CONDITIONS`; each is in the unit in which a difference of 1 is large. The standard deviation is NaN
    where there are too few such pairs.
    """
    from scipy.spatial import KDTree

    changes = []
    for label in np.unique(group):
        rows = np.flatnonzero((group == label) & np.isfinite(residual) & np.isfinite(drivers).all(axis=1))
        if len(rows) < 2:
            continue
        distance, nearest = KDTree(drivers[rows]).query(drivers[rows], k=2, p=np.inf)
        own, other = np.arange(len(rows)), nearest[:, 1]
        # Each pair once, though both may name each other.
        once = (distance[:, 1] <= criteria.SAME_CONDITIONS) & ((own < other) | (other[other] != own))
        changes.append(residual[rows[own[once]]] - residual[rows[other[once]]])
    change = np.concatenate(changes) if changes else np.zeros(0)
    return float(np.sqrt(0.5 * np.mean(change**2))) if len(change) >= criteria.EQUAL_PAIRS else np.nan


class Between(NamedTuple):
    """Steady test points that lie between two others, as one condition varies and the rest stay."""

    # shape (m,): places of the three points
    before: Index
    middle: Index
    after: Index
    share: Array  # shape (m,): weight of the one before in a straight line between the outer two
    line: Index  # shape (n,): which points were run under the same other conditions

    def off(self, values: Array) -> Array:
        """Return how far points are off the line between their neighbours; white noise keeps its variance."""
        share = self.share.reshape(-1, *(1 for _ in values.shape[1:]))
        straight = share * values[self.before] + (1.0 - share) * values[self.after]
        return np.asarray((values[self.middle] - straight) / np.sqrt(1.0 + share**2 + (1.0 - share) ** 2))


def between(group: Index, drivers: Array) -> Between:
    """Order test points by the first of `drivers` (see `of_points`), where group and the others are alike."""
    line = np.asarray(group, dtype=np.intp)
    for column in drivers.T[1:]:
        order = np.lexsort((column, line))
        apart = (np.diff(line[order]) != 0) | ~(np.diff(column[order]) <= criteria.SAME_CONDITIONS)
        start = np.flatnonzero(np.concatenate([[True], apart]))
        length = np.diff(np.append(start, len(order)))
        # One load that scatters is the same; loads all over a range are each another one.
        span = column[order][start + length - 1] - column[order][start]
        wide = np.repeat(span > criteria.SCATTERED_CONDITIONS, length)
        line = np.empty_like(line)
        line[order] = np.cumsum(np.concatenate([[True], apart]) | wide) - 1
    first = drivers[:, 0]
    order = np.lexsort((first, line))
    before, middle, after = order[:-2], order[1:-1], order[2:]
    use = (line[before] == line[after]) & np.isfinite(first[after])
    before, middle, after = before[use], middle[use], after[use]
    span = first[after] - first[before]
    share = np.where(span > 0.0, (first[after] - first[middle]) / np.where(span > 0.0, span, 1.0), 0.5)
    return Between(before, middle, after, share, line)


def of_neighbours(residual: Array, group: Index, drivers: Array) -> float:
    """Estimate the noise of steady test points from how far each is off the line between its neighbours.

    What a misfit bends counts as noise (Gasser, Sroka & Jennen-Steinmetz 1986, Biometrika 73, 625). The
    standard deviation is NaN where too few points lie between others.
    """
    off = between(group, drivers).off(residual)
    off = off[np.isfinite(off)]
    return float(np.sqrt(np.mean(off**2))) if len(off) >= criteria.POINTS_BETWEEN else np.nan


def worst(sizes: Mapping[str, float], levels: Mapping[str, float]) -> float:
    """Return the largest mean square of the residuals of a channel, in units of its noise's."""
    return max((size / levels[name] ** 2 for name, size in sizes.items() if levels[name] > 0.0), default=0.0)
