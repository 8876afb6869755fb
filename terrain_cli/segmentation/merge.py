"""Which candidate bounds are changes of soil, and at which sample exactly."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from terrain_cli.segmentation import lines

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from terrain_cli.segmentation.moments import Moments
    from terrain_cli.segmentation.search import Limits

    Array = NDArray[np.float64]
    Index = NDArray[np.intp]

#: Samples beside a bound in which a new soil shows.
BESIDE = 60
#: Longest window that may be a bridge.
LONGEST_BRIDGE = 10 * BESIDE
#: A line's slope is known where its standard error is below this share of it ...
KNOWN = 0.15
#: ... and the slope of the steps that load and slip make on that soil is then within this share.
SLOPE_TOLERANCE = 0.2
_ROUNDS = 20


@dataclass(frozen=True)
class Criterion:
    """Gain that makes a bound a change of soil.

    Parameters
    ----------
    penalty : float
        What chance may gain, in units of the noise's variance.
    tolerance : float
        Distance between two lines, as a share of the strength, that one soil may show.
    """

    penalty: float
    tolerance: float

    def ratio(self, left: Array, right: Array, slopes: lines.Slopes | None = None) -> Array:
        """Return the gain of two lines over one, where 1 is just enough."""
        gain, worth = lines.split_gain(left, right, slopes)
        return gain / self.least_gain(left + right, worth)

    def least_gain(self, both: Array, worth: Array) -> Array:
        """Return what the gain must be, given what it is worth that a line is off by 1 Pa."""
        strength = both[lines.Y] / both[lines.W]
        return np.asarray(self.penalty + worth * (self.tolerance * strength) ** 2)


@dataclass(frozen=True)
class Criteria:
    """What a change of soil must meet.

    Parameters
    ----------
    always : Criterion
        For the two windows.
    beside : Criterion
        For their samples beside the bound alone ...
    gradual : Criterion
        ... or else this for the windows.
    """

    always: Criterion
    beside: Criterion
    gradual: Criterion


class Refinement:
    """The way from candidates to the changes of soil of one stretch.

    Parameters
    ----------
    moments : Moments
    limits : Limits
    criteria : Criteria
    """

    def __init__(self, moments: Moments, limits: Limits, criteria: Criteria) -> None:
        self._between = moments.between
        self._before = moments.before
        self._step = moments.step
        self._limits = limits
        self._criteria = criteria
        self._moves: dict[tuple[int, ...], int] = {}
        self._bridges: dict[tuple[int, ...], tuple[float, int]] = {}

    def settle(self, bounds: Index) -> Index:
        """Merge windows, move bounds and give bridges away until nothing changes."""
        bounds = self._merge(bounds, self._ratios)
        for _ in range(_ROUNDS):
            before = bounds
            bounds = self._merge(self._move(bounds), self._ratios)
            bounds = self._without_bridges(bounds)
            bounds = self._merge(bounds, self._sharp_ratios)
            if np.array_equal(bounds, before):
                break
        return bounds

    def _merge(self, bounds: Index, ratios: Callable[[Index], Array]) -> Index:
        """Drop bounds of too little gain, the least among neighbours first."""
        while len(bounds) > 2:
            least = _least_below_one(ratios(bounds))
            if len(least) == 0:
                break
            bounds = np.delete(bounds, least + 1)
        return bounds

    def _ratios(self, bounds: Index) -> Array:
        a, b, c = bounds[:-2], bounds[1:-1], bounds[2:]
        windows = np.diff(self._before(bounds), axis=1)
        ratio = self._criteria.always.ratio(windows[:, :-1], windows[:, 1:])
        # A window that is too short must go, by the bound it can spare.
        long_enough = self._limits.met(a, b) & self._limits.met(b, c)
        return np.where(long_enough, ratio, ratio / (1.0 + np.abs(ratio)) - 2.0)

    def _sharp_ratios(self, bounds: Index) -> Array:
        """Return the ratios for changes that are seen in the samples beside them, or else large.

        A new soil begins at once. What the model leaves out bends the relation as slip or load
        sweep, and that is not to be seen within a few samples.
        """
        a, b, c = bounds[:-2], bounds[1:-1], bounds[2:]
        windows = np.diff(self._before(bounds), axis=1)
        left, right = windows[:, :-1], windows[:, 1:]
        beside = self._criteria.beside.ratio(
            self._between(np.maximum(a, b - BESIDE), b),
            self._between(b, np.minimum(c, b + BESIDE)),
            _slopes_of_steps(left, right),
        )
        sharp = np.maximum(beside, self._criteria.gradual.ratio(left, right))
        return np.minimum(self._ratios(bounds), sharp)

    def _costs(self, first: int, cuts: Index, last: int) -> Array:
        """Return the misfit of the two windows, for each place to cut."""
        sums = self._before(np.concatenate([[first], cuts, [last]]))
        left, right = sums[:, 1:-1] - sums[:, :1], sums[:, -1:] - sums[:, 1:-1]
        misfit = lines.best_line(np.concatenate([left, right], axis=1))[1]
        return np.asarray(misfit[: len(cuts)] + misfit[len(cuts) :])

    def _move(self, bounds: Index) -> Index:
        """Move every bound to the best sample near it."""
        moved = bounds.copy()
        for k in range(1, len(moved) - 1):
            around = tuple(moved[k - 1 : k + 2].tolist())
            if around not in self._moves:
                self._moves[around] = self._best_near(*around)
            moved[k] = self._moves[around]
        return moved

    def _best_near(self, a: int, b: int, c: int) -> int:
        reach = max(2 * BESIDE, 4 * self._step)
        cuts = np.arange(max(a + 1, b - reach), min(c, b + reach + 1))
        long_enough = self._limits.met(np.full_like(cuts, a), cuts)
        cuts = cuts[long_enough & self._limits.met(cuts, np.full_like(cuts, c))]
        return int(cuts[self._costs(a, cuts, c).argmin()]) if len(cuts) else b

    def _without_bridges(self, bounds: Index) -> Index:
        """Give windows away whose samples the lines of both neighbours explain.

        Two soils have a line in common that leads from one cloud to the other. A window that begins
        in one soil and ends in the next can fit better than a bound a few samples off the change.
        """
        while len(bounds) > 3:
            ratio = np.full(len(bounds) - 3, np.inf)
            cut = bounds[1:-2].copy()
            for k in np.flatnonzero(np.diff(bounds[1:-1]) <= LONGEST_BRIDGE):
                around = tuple(bounds[k : k + 4].tolist())
                if around not in self._bridges:
                    self._bridges[around] = self._bridge(*around)
                ratio[k], cut[k] = self._bridges[around]
            given = _least_below_one(ratio)
            if len(given) == 0:
                break
            bounds = bounds.copy()
            bounds[given + 1] = cut[given]
            bounds = np.delete(bounds, given + 2)
        return bounds

    def _bridge(self, a: int, b: int, c: int, d: int) -> tuple[float, int]:
        """Return the gain of the window [b, c) over the best cut in it, 1 being just enough, and that cut."""
        cuts = np.arange(b, c + 1)
        costs = self._costs(a, cuts, d)
        cut = int(cuts[costs.argmin()])
        windows = np.diff(self._before(np.array([a, b, c, d])), axis=1)
        gain = costs.min() - lines.best_line(windows)[1].sum()
        left, middle, right = windows[:, :1], windows[:, 1:2], windows[:, 2:]
        worth = np.zeros(1)
        for share, other in (((cut - b) / (c - b), left), ((c - cut) / (c - b), right)):
            weight = share * middle[lines.W]
            worth += weight * other[lines.W] / (weight + other[lines.W])
        worth /= lines.noise_across(middle, lines.MIDDLE_SLOPE)
        return float(gain / self._criteria.always.least_gain(middle, worth)[0]), cut


def _slopes_of_steps(left: Array, right: Array) -> lines.Slopes:
    """Return the slopes along which load and slip step if the soil is that of one window or the other."""
    lows, highs = [], []
    for window in (left, right):
        slope, _ = lines.best_line(window)
        known = lines.slope_error(window, slope) < KNOWN * slope
        lows.append(np.where(known, (1.0 - SLOPE_TOLERANCE) * slope, -np.inf))
        highs.append(np.where(known, (1.0 + SLOPE_TOLERANCE) * slope, np.inf))
    return np.minimum(*lows), np.maximum(*highs)


def _least_below_one(ratio: Array) -> Index:
    """Return the places of ratios that are below 1 and least among their neighbours, the first of equals."""
    padded = np.concatenate([[np.inf], ratio, [np.inf]])
    return np.flatnonzero((ratio < 1.0) & (ratio < padded[:-2]) & (ratio <= padded[2:]))
