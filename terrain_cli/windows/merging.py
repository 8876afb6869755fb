"""Which candidate bounds are changes of soil, and at which sample exactly."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from terrain_cli.vocabulary.arrays import Array, Index, Mask
from terrain_cli.windows import line_costs
from terrain_cli.windows.candidate_search import Limits, residuals_about
from terrain_cli.windows.running_moments import FINE, LONG, RunningMoments, correlation_factor

BESIDE = 60  # Samples beside a bound in which a new soil shows
REACH = 2 * BESIDE  # Samples by which a bound is moved at the most in a round
LONGEST_BRIDGE = 10 * BESIDE  # Longest window that may be a bridge
KNOWN = 0.15  # A line's slope is known where its standard error is below this share of it ..
#: ... and the slope of the steps that load and slip make on that soil is then within this share.
SLOPE_TOLERANCE = 0.2
#: Neighbours that move by less than this share of a window do not move its other bound.
HARDLY = 0.01
_ROUNDS = 20
_TOGETHER = 512  # Bounds moved together: few enough to stay in the processor's cache


@dataclass(frozen=True)
class Criterion:
    """Gain that makes a bound a change of soil."""

    penalty: float  # What chance may gain, in units of the noise's variance
    tolerance: float  # Distance between two lines, as a share of the strength, that one soil may show

    def ratio(self, left: Array, right: Array, slopes: line_costs.Slopes | None = None) -> Array:
        """Return the gain of two lines over one, where 1 is just enough."""
        gain, worth = line_costs.split_gain(left, right, slopes)
        return gain / self.least_gain(left + right, worth)

    def least_gain(self, both: Array, worth: Array) -> Array:
        """Return what the gain must be, given what it is worth that a line is off by 1 Pa."""
        strength = both[line_costs.Y] / both[line_costs.W]
        return np.asarray(self.penalty + worth * (self.tolerance * strength) ** 2)


@dataclass(frozen=True)
class Criteria:
    """What a change of soil must meet."""

    always: Criterion  # For the two windows
    beside: Criterion  # For their samples beside the bound alone ..
    gradual: Criterion  # ... or else this for the windows


class Refinement:
    """The way from candidates to the changes of soil of one stretch."""

    def __init__(self, moments: RunningMoments, limits: Limits, criteria: Criteria) -> None:
        self._moments = moments
        self._before = moments.before
        self._n = len(moments.samples)
        self._limits = limits
        self._criteria = criteria
        # Bounds that were found best, between their neighbours: none so far.
        self._settled = np.full((3, 1), -1, dtype=np.intp)

    def settle(self, bounds: Index) -> Index:
        """Merge windows, move bounds and give bridges away until nothing changes."""
        # A block that holds the end of one soil and the beginning of the next is a window of its own.
        bounds = self._without_bridges(self._merge(bounds))
        seen = bounds[:0]
        for _ in range(_ROUNDS):
            bounds = self._move(bounds)
            if np.array_equal(bounds, seen):
                break
            bounds = seen = self._without_bridges(self._merge(bounds))
            bounds = self._merge(bounds, sharp=True)
        return bounds

    def _merge(self, bounds: Index, *, sharp: bool = False) -> Index:
        """Drop bounds of too little gain, the least among neighbours first.

        Sharp changes are seen in the samples beside them, or else large. A new soil begins at once.
        What the model leaves out bends the relation as slip or load sweep, and that is not to be
        seen within a few samples.
        """
        # The sums before each bound, and before the samples that are beside it.
        aside = (0, -BESIDE, BESIDE) if sharp else (0,)
        sums = np.stack([self._before(np.clip(bounds + away, 0, self._n)) for away in aside])
        while len(bounds) > 2:
            least = _least_below_one(self._ratios(bounds, sums))
            if len(least) == 0:
                break
            kept = np.ones(len(bounds), dtype=bool)
            kept[least + 1] = False
            bounds, sums = bounds[kept], sums[:, :, kept]
        return bounds

    def _ratios(self, bounds: Index, sums: Array) -> Array:
        """Return the gain of each bound, where 1 is just enough."""
        windows = np.diff(sums[0], axis=1)
        left, right = windows[:, :-1], windows[:, 1:]
        gain, worth = line_costs.split_gain(left, right)
        both = left + right
        ratio = gain / self._criteria.always.least_gain(both, worth)
        # A window that is too short must go, by the bound it can spare.
        long_enough = self._limits.met(bounds[:-1], bounds[1:])
        ratio = np.where(long_enough[:-1] & long_enough[1:], ratio, ratio / (1.0 + np.abs(ratio)) - 2.0)
        if len(sums) == 1:
            return ratio
        near = np.diff(bounds) < BESIDE
        beside = self._criteria.beside.ratio(
            np.where(near[:-1], left, sums[0, :, 1:-1] - sums[1, :, 1:-1]),
            np.where(near[1:], right, sums[2, :, 1:-1] - sums[0, :, 1:-1]),
            _slopes_of_steps(windows),
        )
        return np.minimum(ratio, np.maximum(beside, gain / self._criteria.gradual.least_gain(both, worth)))

    def _move(self, bounds: Index) -> Index:
        """Move every other bound to the best sample near it, between fixed neighbours, and then the rest."""
        bounds, around = bounds.copy(), np.empty((3, len(bounds) - 2), dtype=np.intp)
        for begin in (0, 1):
            at = np.arange(begin, len(bounds) - 2, 2)
            a, b, c = around[:, at] = bounds[at], bounds[at + 1], bounds[at + 2]
            at = at[~self._is_settled(a, b, c)]
            for some in np.split(at, range(_TOGETHER, len(at), _TOGETHER)) if len(at) else ():
                before, here, behind = around[:, some]
                low, high = np.maximum(before + 1, here - REACH), np.minimum(behind - 1, here + REACH)
                best, cost = self._best_between(before, low, high, behind)
                bounds[some + 1] = np.where(np.isfinite(cost), best, here)
        far = np.abs(bounds[1:-1] - around[1]) > BESIDE
        around[1] = bounds[1:-1]
        self._settled = around[:, ~far] if not far.all() else self._settled
        return bounds

    def _is_settled(self, a: Index, b: Index, c: Index) -> Mask:
        """Return which bounds b are where they were found best, between neighbours that hardly moved."""
        at = np.minimum(np.searchsorted(self._settled[1], b), self._settled.shape[1] - 1)
        last_a, last_b, last_c = self._settled[:, at]
        near = np.maximum(np.abs(last_a - a) / (b - a), np.abs(last_c - c) / (c - b)) <= HARDLY
        return np.asarray((last_b == b) & near)

    def _best_between(self, a: Index, low: Index, high: Index, c: Index) -> tuple[Index, Array]:
        """Return where to cut [a, c) best, by blocks, then finer, then at any sample; and the misfit."""
        ends = self._before(a)[:, :, None], self._before(c)[:, :, None]
        moments, step = self._moments, self._moments.step
        block = -(-low // step)[:, None] + np.arange(int((high - low).max()) // step + 1)
        block = np.minimum(block, high[:, None] // step)
        best, _ = self._cheapest(block * step, moments.total[:, block], ends, (a, low, high, c))
        reach = step
        if step >= LONG:
            reach = FINE
            block = np.clip(best // step + np.array([[-1], [0]]), 0, moments.total.shape[1] - 2)
            cuts, sums = moments.finer(block.ravel())
            cuts = cuts.reshape(2, len(best), -1).transpose(1, 0, 2).reshape(len(best), -1)
            sums = sums.reshape(len(sums), 2, len(best), -1).transpose(0, 2, 1, 3)
            best, _ = self._cheapest(cuts, sums.reshape(len(sums), *cuts.shape), ends, (a, low, high, c))
        return self._cheapest(*moments.around(best, reach), ends, (a, low, high, c))

    def _cheapest(
        self, cuts: Index, sums: Array, ends: tuple[Array, Array], inside: tuple[Index, ...]
    ) -> tuple[Index, Array]:
        """Return the best of some cuts of [a, c) into windows long enough, and the misfit of these."""
        a, low, high, c = (bound[:, None] for bound in inside)
        parts = np.stack([sums - ends[0], ends[1] - sums], axis=1).reshape(line_costs.ROWS, -1)
        misfit = line_costs.best_line(parts)[1].reshape(2, *cuts.shape).sum(axis=0)
        cut = np.minimum(np.maximum(cuts, a), c)
        allowed = (cuts >= low) & (cuts <= high) & self._limits.met(a, cut) & self._limits.met(cut, c)
        costs = np.where(allowed, misfit, np.inf)
        best = costs.argmin(axis=1)[:, None]
        return np.take_along_axis(cuts, best, axis=1)[:, 0], np.take_along_axis(costs, best, axis=1)[:, 0]

    def _without_bridges(self, bounds: Index) -> Index:
        """Give windows away whose samples the lines of both neighbours explain.

        Two soils have a line in common that leads from one cloud to the other. A window that begins
        in one soil and ends in the next can fit better than a bound a few samples off the change.
        """
        while len(bounds) > 3:
            ratio = np.full(len(bounds) - 3, np.inf)
            cut = bounds[1:-2].copy()
            short = np.flatnonzero(np.diff(bounds[1:-1]) <= LONGEST_BRIDGE)
            for some in np.split(short, range(_TOGETHER, len(short), _TOGETHER)):
                if len(some):
                    ratio[some], cut[some] = self._bridge(*(bounds[some + k] for k in range(4)))
            given = _least_below_one(ratio)
            if len(given) == 0:
                break
            bounds = bounds.copy()
            bounds[given + 1] = cut[given]
            found = np.stack([bounds[given], cut[given], bounds[given + 3]])
            found = np.concatenate([self._settled, found], axis=1)
            self._settled = found[:, np.argsort(found[1])]
            bounds = np.delete(bounds, given + 2)
        return bounds

    def _bridge(self, a: Index, b: Index, c: Index, d: Index) -> tuple[Array, Index]:
        """Return the gain of windows [b, c) over the best cuts in them, 1 being just enough, and the cuts."""
        cut, cost = self._best_between(a, b, c, d)
        bounds = np.concatenate([a, b, c, d])
        windows = np.diff(self._before(bounds).reshape(line_costs.ROWS, 4, -1), axis=1)
        gain = cost - line_costs.best_line(windows.reshape(line_costs.ROWS, -1))[1].reshape(3, -1).sum(axis=0)
        left, middle, right = windows.transpose(1, 0, 2)
        worth = np.zeros(len(b))
        for share, other in (((cut - b) / (c - b), left), ((c - cut) / (c - b), right)):
            weight = share * middle[line_costs.W]
            worth += weight * other[line_costs.W] / (weight + other[line_costs.W])
        worth /= line_costs.noise_across(middle, line_costs.MIDDLE_SLOPE)
        return gain / self._criteria.always.least_gain(middle, worth), cut


def joined(lines: Sequence[tuple[Array, Array]], bounds: Index, step: int, criterion: Criterion) -> Index:
    """Join the windows of a stretch that one line of some k explains as well as two, each of a k of its own.

    `lines` are x and y by several k; the penalty of `criterion` is that of white noise.
    """
    moments = [RunningMoments(x, y, step) for x, y in lines]
    while len(bounds) > 2:
        windows = np.stack([np.diff(some.before(bounds), axis=1) for some in moments], axis=2)
        apart, own = _of_the_best(windows)
        together, shared = _of_the_best(windows[:, :-1] + windows[:, 1:])
        residuals = np.empty(bounds[-1])
        for number, some in enumerate(moments):
            mine = own == number
            residuals[np.repeat(mine, np.diff(bounds))] = residuals_about(
                some, bounds[:-1][mine], bounds[1:][mine]
            )
        factor = correlation_factor(residuals, bounds[1:-1], 3 * len(own))
        at = np.arange(len(shared))
        left, right = windows[:, at, shared], windows[:, at + 1, shared]
        both = left + right
        variance = line_costs.noise_across(both, line_costs.MIDDLE_SLOPE)
        worth = left[line_costs.W] * right[line_costs.W] / both[line_costs.W] / variance
        raised = replace(criterion, penalty=factor * criterion.penalty)
        goes = _least_below_one((together - apart[:-1] - apart[1:]) / raised.least_gain(both, worth))
        if not len(goes):
            break
        bounds = np.delete(bounds, goes + 1)
    return bounds


def _of_the_best(windows: Array) -> tuple[Array, Index]:
    """Return what the best of several lines leaves of each window, and which one that is."""
    misfit = line_costs.best_line(windows.reshape(line_costs.ROWS, -1))[1].reshape(windows.shape[1:])
    return misfit.min(axis=1), misfit.argmin(axis=1)


def _slopes_of_steps(windows: Array) -> line_costs.Slopes:
    """Return the slopes along which load and slip step on the soil before a bound or that behind it."""
    slope, _ = line_costs.best_line(windows)
    known = line_costs.slope_error(windows, slope) < KNOWN * slope
    low = np.where(known, (1.0 - SLOPE_TOLERANCE) * slope, -np.inf)
    high = np.where(known, (1.0 + SLOPE_TOLERANCE) * slope, np.inf)
    return np.minimum(low[:-1], low[1:]), np.maximum(high[:-1], high[1:])


def _least_below_one(ratio: Array) -> Index:
    """Return the places of ratios that are below 1 and least among their neighbours, the first of equals."""
    padded = np.concatenate([[np.inf], ratio, [np.inf]])
    return np.flatnonzero((ratio < 1.0) & (ratio < padded[:-2]) & (ratio <= padded[2:]))
