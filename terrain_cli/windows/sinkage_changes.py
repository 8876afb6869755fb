"""Changes of soil that the line does not show but the sinkage does, and where a bound stands by both.

Steps 5 and 6 of `change_points`.
"""

from collections.abc import Sequence

import numpy as np

from terrain_cli.vocabulary.arrays import Array, Bounds, Index, median
from terrain_cli.windows.candidate_search import Limits
from terrain_cli.windows.change_points import OWN_PENALTY, change_points, needed, products, solved, sum_left
from terrain_cli.windows.merging import LONGEST_BRIDGE, REACH

#: Share of the logarithms that stands in for a strength: lines that differ by 5 and 8 % are sinkages that
#: differ by 15 and 24 %. In 164 drives over one soil neither a third nor a half nor the whole made a false
#: cut. The line finds 237 of 384 changes between two soils, each of the three 376; false cuts are 89 by the
#: line, and 96, 109 and 102.
_SINKAGE_SHARE = 1.0 / 3.0
#: Samples and metres of such a soil at least: what is shorter is uneven ground. Where the sinkage rises and
#: falls by 42 % in 0.35 m on one line, 10 samples and 0.1 m made 171 cuts, 60 samples and 0.3 m or more none.
_SINKAGE_SAMPLES, _SINKAGE_METRES = 60, 0.5
#: Samples of a block that tell how the sinkage follows load and slip. In 458 drives 32, 64 and 128 found all
#: of 146 changes; in 32 drives, cut as they arrived, 64, 128, 256 and 512 made 6, 1, 1 and 1 false cuts.
_SINKAGE_BLOCK = 128
#: Shares of the median below which a logarithm would tell of noise alone.
_LEAST_LOAD, _LEAST_SINKAGE = 0.2, 0.05


def sinkage_changes(
    load: Array,
    sinkage: Array,
    slip: Array,
    drivers: Sequence[Array],
    bounds: Bounds,
    *,
    distance: Array | None,
    min_samples: int,
    min_distance: float,
    before: int = 0,
) -> Bounds:
    """Cut windows further where the sinkage under a load changes, and `drivers` do not explain it.

    A wheel sinks as z ∝ W^m (m = 2 / (2 n + 1), Bekker 1969), which is a line in logarithms: the search is
    that for the line of a soil. What the sinkage of each window follows of load and slip is taken off first.
    Where an array is not known everywhere, nothing is cut.
    """
    line = _in_logarithms(load, sinkage, slip, bounds)
    if line is None:
        return bounds
    inner: Index = bounds[1:-1]
    found = change_points(
        *line,
        breaks=inner,
        distance=distance,
        min_samples=max(min_samples, _SINKAGE_SAMPLES),
        min_distance=max(min_distance, _SINKAGE_METRES),
        before=before,
    )
    return needed(*line, drivers, found, inner)


def _in_logarithms(load: Array, sinkage: Array, slip: Array, bounds: Bounds) -> tuple[Array, Array] | None:
    """Return the coordinates of a line of slope 1 in each window; None where something is not known."""
    known = _logarithms(load, sinkage, slip)
    if known is None:
        return None
    weight, depth = known
    # A change of soil is a step, which hardly shows within a block.
    blocks = np.unique(np.concatenate([bounds, np.arange(0, len(load), _SINKAGE_BLOCK)]))
    terms = [weight, slip, slip**2, slip * weight]
    # Their means are 0: no term 1 is needed.
    found = solved(products([column - _mean(column, blocks) for column in (*terms, depth)], bounds))
    for own, term in zip(found.T, terms, strict=True):
        depth -= np.repeat(own, np.diff(bounds)) * term
    return 1.0 + _SINKAGE_SHARE * weight, 1.0 + _SINKAGE_SHARE * (weight + depth - _mean(depth, bounds))


def _logarithms(load: Array, sinkage: Array, slip: Array) -> tuple[Array, Array] | None:
    """Return logarithms of load and sinkage over what is usual; None where something is not known."""
    if not all(np.isfinite(column).all() for column in (load, sinkage, slip)) or not len(load):
        return None
    usual_load, usual_sinkage = median(load), median(sinkage)
    if usual_load <= 0.0 or usual_sinkage <= 0.0 or np.ptp(sinkage) == 0.0:
        return None
    weight = np.log(np.maximum(load / usual_load, _LEAST_LOAD))
    return weight, np.log(np.maximum(sinkage / usual_sinkage, _LEAST_SINKAGE))


def placed(
    line: tuple[Array, Array],
    wheel: tuple[Array, Array, Array],
    bounds: Bounds,
    fixed: Index,
    *,
    distance: Array | None,
    min_samples: int,
    min_distance: float,
) -> Bounds:
    """Move bounds that are not `fixed` to the best sample near them, if that is better beyond chance.

    The line alone places a bound badly where an error of the slip or the load bends it. What counts is the
    sum of squares, in units of the noise, that lines on either side leave of y over x, and of the logarithm
    of the sinkage over that of the load and the slip. Of the `wheel` these are load, sinkage and slip.
    """
    known = _logarithms(*wheel)
    if known is None:
        return bounds
    tables = np.stack(line), np.stack([known[0], wheel[2], known[1]])
    driven = None if distance is None else np.append(distance, distance[-1])
    limits = Limits(min_samples, min_distance, driven)
    bounds = bounds.copy()
    for place in np.flatnonzero(~np.isin(bounds[1:-1], fixed)) + 1:
        before, here, after = bounds[place - 1 : place + 2]
        first, last = max(before, here - LONGEST_BRIDGE), min(after, here + LONGEST_BRIDGE)
        cuts = np.arange(max(first + 1, here - REACH), min(last, here + REACH + 1))
        cuts = cuts[(cuts == here) | (limits.met(before, cuts) & limits.met(cuts, after))]
        cost = np.sum([_two_lines(table[:, first:last], cuts - first) for table in tables], axis=0)
        if cost[cuts == here] - cost.min() > OWN_PENALTY:
            bounds[place] = cuts[cost.argmin()]
    return bounds


def placed_by_sinkage(
    wheel: tuple[Array, Array, Array], bounds: Bounds, changes: Index, earliest: Index
) -> Index:
    """Move each of some `changes` among `bounds` to where, from an earliest place on, the sinkage changes.

    Between the two no sample has a line. Of the `wheel` the arrays are load, sinkage and slip, shape (n,).
    """
    known, found = _logarithms(*wheel), changes.copy()
    if known is None:
        return found
    table = np.stack([known[0], wheel[2], known[1]])
    for place in np.flatnonzero(earliest < changes):
        low, here = earliest[place], changes[place]
        at = np.searchsorted(bounds, here)
        first, last = max(bounds[at - 1], low - LONGEST_BRIDGE), min(bounds[at + 1], here + LONGEST_BRIDGE)
        cuts = np.arange(max(low, first + 1), here + 1)
        found[place] = cuts[_two_lines(table[:, first:last], cuts - first).argmin()]
    return found


def _two_lines(table: Array, cuts: Index) -> Array:
    """Return what lines before and from each cut leave of the last row, in units of the noise's variance."""
    rows = np.concatenate([np.ones((1, table.shape[1])), table - table.mean(axis=1, keepdims=True)])
    sums = np.cumsum(np.einsum("an,bn->nab", rows, rows), axis=0)
    left = sums[cuts - 1]
    squares = sum_left(left) + sum_left(sums[-1] - left)
    return np.asarray(squares * (table.shape[1] - 2 * len(table)) / max(float(squares.min()), 1e-300))


def _mean(column: Array, bounds: Bounds) -> Array:
    """Return at each sample the mean of its window."""
    sizes = np.diff(bounds)
    return np.repeat(np.add.reduceat(column, bounds[:-1]) / sizes, sizes)
