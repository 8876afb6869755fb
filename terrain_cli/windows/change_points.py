"""Change points along a drive: of the relation y = c + x tan φ, and of how deep the wheel sinks on one line.

1. `running_moments`: the covariance of the noise of (x, y), from differences of neighbouring samples.
2. `candidate_search`: candidates by exact optimal partitioning of blocks of samples, on cumulative moments.
3. `merging`: candidates that chance, a load that moves along one line or the model's own misfit
   explain are dropped, and the rest are moved to the very sample.
   `of_any_modulus`: a k that is not that of the soil bends its line as slip and sinkage change.
4. `needed`: cuts that something recorded explains go too. A model without an effect that follows the drive
   needs a new soil at every turn. So y is given terms γ1 d + γ2 d² + γ3 d x of a driver d (of the wheel's
   angle: its sine and cosine, by themselves and times x), first those of each window, then such as all share,
   and windows are joined as long as a bound between them gains less than the penalty. The terms of a driver
   cost as much as one change does.
5. `sinkage_changes`: where strength goes on, but the wheel sinks deeper, or less, the line shows nothing.
6. `placed`: bounds move to where the line and the sinkage together say that the soil changes.

The constants were chosen by benchmarks/segmentation_study.py; its table is in benchmarks/results.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from operator import itemgetter

import numpy as np
from numpy.typing import ArrayLike, NDArray

from terrain_cli.processes import keep_freed
from terrain_cli.vocabulary.arrays import Array, Bounds, Index
from terrain_cli.vocabulary.choices import CUT_SAMPLES, MIN_DISTANCE
from terrain_cli.windows.candidate_search import Limits, candidates
from terrain_cli.windows.merging import Criteria, Criterion, Refinement, joined
from terrain_cli.windows.running_moments import LONG, RunningMoments, correlation_factor

Breaks = Sequence[int] | NDArray[np.integer]

#: Gain in units of the noise's variance, χ² with 2 degrees of freedom if there is no change. Chance
#: exceeds 25 once in 270,000, and the best of all places in a clean run less than once in 300 runs.
PENALTY = 25.0
TOLERANCE = 0.02  # Share of the strength by which lines must differ, as the samples tell
#: The same in the samples beside the change, whose gain need only be this share of the penalty.
BESIDE_TOLERANCE, BESIDE_SHARE = 0.05, 0.4
GRADUAL_TOLERANCE = 0.08  # Share of the strength by which lines must differ where that does not show
CANDIDATE_SHARE = 0.5  # A candidate need gain only this share of the penalty
#: Longest blocks whose edges alone are searched, and samples of a stretch that may have `LONG` ones.
_LONGEST, _LONG_SAMPLES = 15, 1 << 14
_FEWEST = 6  # Fewer samples than this are not searched: they tell nothing of their noise
#: Of bounds between five numbers instead of two, chance gains this as rarely (χ², five degrees of freedom).
#: By as much the place of a bound must be better than that by the line alone.
OWN_PENALTY = 33.0
#: Samples, or means of neighbours, that tell whether a bound is needed. In 112 drives of 60,000 samples these
#: leave 407 false cuts, and means of 2 207: of means a correlation shows that lasts longer. Of 1,584 changes
#: between two soils that are passed several times both miss none, but means of 4 134.
_ENOUGH = 1 << 15
_RIDGE = 1e-10  # Share of its trace that is added to a matrix, lest a constant load make it singular


def whole_windows(n: int, *, breaks: Breaks = ()) -> Bounds:
    """Return bounds of windows, 0 and n among them: one for each stretch between breaks."""
    return np.unique(np.concatenate([[0, n], breaks])).astype(np.intp)


def change_points(
    x: ArrayLike,
    y: ArrayLike,
    *,
    breaks: Breaks = (),
    distance: Array | None = None,
    min_samples: int = CUT_SAMPLES,
    min_distance: float = MIN_DISTANCE,
    penalty: float | None = None,
    before: int = 0,
) -> Bounds:
    """Find the windows in which one line y = c + x tan φ holds: bounds, rising from 0 to n.

    A step of load or slip moves (x, y) along the line of a soil and is no change. Constant load, whose
    samples determine no line, is the rule and no special case. Two clouds of samples always lie on one line:
    where load and slip are constant on both sides of a change of soil, it is found only if that line is none
    a soil can have (`line_costs`). The same data give the same windows; the time grows with the number of
    samples.

    x and y, shape (n,), in Pa and finite, are samples of one wheel in the order of time; any scale of both
    gives the same windows. `breaks` are always bounds: what lies on either side is searched by itself, and a
    stretch that is shorter than a window may be is a window all the same. `penalty` is what splitting a
    window must gain, in units of the noise's (long-run) variance. `before` counts the samples of the first
    stretch that came before these: the longer a stretch, the coarser the first search.
    """
    keep_freed()
    x, y = np.asarray(x, dtype=float), np.asarray(y, dtype=float)
    penalty = PENALTY if penalty is None else penalty
    if min_samples < 1 or min_distance < 0.0 or not penalty > 0.0:
        raise ValueError(f"{min_samples=}, {min_distance=} and {penalty=} must be positive")
    bounds = whole_windows(len(x), breaks=breaks)
    found = [bounds]
    for a, b in pairwise(bounds):
        metres = None if distance is None else np.append(distance[a:b], distance[b - 1])
        block = _block(b - a, before if a == 0 else 0)
        found.append(a + _changes(x[a:b], y[a:b], Limits(min_samples, min_distance, metres), penalty, block))
    return np.unique(np.concatenate(found).astype(np.intp))


def _block(n: int, before: int) -> int:
    """Return the samples of a block: 2 of hundreds, 3 of a thousand, 10 of 10⁵, then `LONG`."""
    length = max(int(0.57 * (n + before) ** 0.25 + 0.5), 1)
    return LONG if length > _LONGEST and n >= _LONG_SAMPLES else min(length, _LONGEST)


class Means:
    """Means of neighbouring samples within windows, where there are more than enough; else the samples."""

    def __init__(self, bounds: Bounds) -> None:
        self.step = max(-(-int(bounds[-1]) // _ENOUGH), 1)
        every = [np.arange(a, b, self.step) for a, b in pairwise(bounds)]
        self.edges: Bounds = np.concatenate([*every, bounds[-1:]])

    def of(self, values: Array) -> Array:
        """Return the means of values, shape (n,) or (k, n)."""
        if self.step == 1:
            return values
        return np.asarray(np.add.reduceat(values, self.edges[:-1], axis=-1) / np.diff(self.edges))

    def places(self, bounds: Bounds) -> Bounds:
        """Return which means begin at some bounds of windows."""
        return np.searchsorted(self.edges, bounds).astype(np.intp)


def of_any_modulus(
    lines: Sequence[tuple[Array, Array]], bounds: Bounds, fixed: Index, *, before: int = 0
) -> Bounds:
    """Return the bounds that are needed whatever the k of each soil; the `fixed` ones stay.

    `lines` are x and y by several k.
    """
    found = [whole_windows(len(lines[0][0]), breaks=fixed)]
    for a, b in pairwise(found[0]):
        inner = bounds[(bounds >= a) & (bounds <= b)] - a
        if len(inner) > 2:
            here = [(x[a:b], y[a:b]) for x, y in lines]
            block = _block(b - a, before if a == 0 else 0)
            found.append(a + joined(here, inner, block, Criterion(OWN_PENALTY, TOLERANCE)))
    return np.unique(np.concatenate(found))


def _changes(x: Array, y: Array, limits: Limits, penalty: float, block: int) -> Bounds:
    n = len(x)
    if n < max(2 * limits.samples, _FEWEST):
        return np.array([0, n], dtype=np.intp)
    moments = RunningMoments(x, y, block)
    bounds, factor = candidates(moments, limits, CANDIDATE_SHARE * penalty)
    penalty *= factor
    criteria = Criteria(
        always=Criterion(penalty, TOLERANCE),
        beside=Criterion(BESIDE_SHARE * penalty, BESIDE_TOLERANCE),
        gradual=Criterion(penalty, GRADUAL_TOLERANCE),
    )
    return Refinement(moments, limits, criteria).settle(bounds)


def needed(x: Array, y: Array, drivers: Sequence[Array], bounds: Bounds, fixed: Index) -> Bounds:
    """Return the bounds that are needed whatever y follows of known drivers; the `fixed` ones stay.

    A driver is of shape (n,), or (2, n): the sine and the cosine of an angle.
    """
    if not len(np.setdiff1d(bounds[1:-1], fixed)):
        return bounds
    means = Means(bounds)
    line, level = (_standard(means.of(values)) for values in (x, y))
    if line is None or level is None:
        return bounds
    bounds, fixed = means.places(bounds), means.places(fixed)
    columns, each = [np.ones(len(line)), line], []
    for terms in filter(None, (_terms(means.of(driver), line) for driver in drivers)):
        each.append([len(columns) + place for place in range(len(terms))])
        columns += terms
    columns.append(level)
    every = Lines(columns, products(columns, bounds), len(columns) - 1, bounds)
    # What a driver does may be another thing on each soil.
    left = every.of([], 2).left()
    own = [_saved(every.of(terms, 2 + len(terms)), left, fixed, OWN_PENALTY) for terms in each]
    saved, joined = max(own, key=itemgetter(0), default=(0.0, bounds))
    bounds = joined if saved > 0.0 else bounds
    shared: list[int] = []
    while each:
        every = every.joined(bounds)
        left = every.of(shared, 2).left()
        tried = [_saved(every.of([*shared, *terms], 2), left, fixed, PENALTY) for terms in each]
        place = max(range(len(each)), key=lambda place: tried[place][0])
        if tried[place][0] <= 0.0:
            break
        bounds = tried[place][1]
        shared += each.pop(place)
    return means.edges[bounds]


def _saved(lines: Lines, plain: float, fixed: Index, penalty: float) -> tuple[float, Bounds]:
    """Return what further terms save, less their cost, and the bounds that remain with them.

    `plain` is the sum of squares that is left without them.
    """
    joined, lost = _joined(lines, plain, fixed, penalty)
    return PENALTY * (len(lines.bounds) - 3) - penalty * (len(joined) - 2) - lost, joined


def _terms(driver: Array, line: Array) -> list[Array]:
    """Return what y may follow of a driver; nothing where it is not known, or always the same."""
    if driver.ndim > 1:
        return [*driver, *driver * line]
    standard = _standard(driver)
    return [] if standard is None else [standard, standard**2, standard * line]


def _standard(values: Array) -> Array | None:
    """Return values of mean 0 and variance 1; None where they are not all known, or all the same."""
    spread = float(np.std(values))
    if not np.isfinite(spread) or spread <= np.finfo(float).eps * float(np.max(np.abs(values))):
        return None
    return np.asarray((values - values.mean()) / spread, float)


def products(columns: Sequence[Array], bounds: Bounds) -> Array:
    """Return the sums of products of columns in each window, shape (w, p, p)."""
    size = len(columns)
    sums = np.empty((len(bounds) - 1, size, size))
    for i in range(size):
        for j in range(i + 1):
            sums[:, i, j] = sums[:, j, i] = np.add.reduceat(columns[i] * columns[j], bounds[:-1])
    return sums


@dataclass(frozen=True)
class Lines:
    """A line for each window, with terms of its own, and terms that all share."""

    columns: Sequence[Array]  # 1, x, the other terms, and y
    moments: Array  # Their `products`
    own: int  # How many of the first columns have a coefficient in each window
    bounds: Bounds

    def of(self, terms: Sequence[int], own: int) -> Lines:
        """Return lines with some of the terms."""
        chosen = [0, 1, *terms, len(self.columns) - 1]
        columns = [self.columns[place] for place in chosen]
        return Lines(columns, self.moments[:, chosen][:, :, chosen], own, self.bounds)

    def joined(self, bounds: Bounds) -> Lines:
        """Return lines of whole windows joined."""
        sums = np.add.reduceat(self.moments, np.searchsorted(self.bounds, bounds[:-1]), axis=0)
        return replace(self, moments=sums, bounds=bounds)

    def without_own(self, moments: Array) -> Array:
        """Return the moments of what the own terms of each window leave (the Schur complement)."""
        n = self.own
        found = np.linalg.solve(_regular(moments[:, :n, :n]), moments[:, :n, n:])
        return np.asarray(moments[:, n:, n:] - moments[:, n:, :n] @ found)

    def left(self) -> float:
        """Return the sum of squares that lines and terms leave."""
        return float(sum_left(self.without_own(self.moments).sum(axis=0)))

    def scatter(self) -> float:
        """Return the long-run variance of the residuals."""
        n, moments = self.own, self.moments
        shared = solved(self.without_own(moments).sum(axis=0))
        rest = moments[:, :n, -1] - moments[:, :n, n:-1] @ shared
        own = np.linalg.solve(_regular(moments[:, :n, :n]), rest[..., None])[..., 0]
        level, *slopes = np.repeat(own.T, np.diff(self.bounds), axis=1)
        residuals = self.columns[-1] - level
        for slope, term in zip([*slopes, *shared], self.columns[1:-1], strict=True):
            residuals -= slope * term
        size = float(np.std(residuals))
        fitted = own.size + len(shared)
        return size**2 * correlation_factor(residuals / size, self.bounds[1:-1], fitted) if size else _RIDGE


def _joined(lines: Lines, plain: float, fixed: Index, penalty: float) -> tuple[Bounds, float]:
    """Join windows; return the bounds that remain, and by how much more is left than `plain`, in its unit."""
    unit = lines.scatter()
    reduced = lines.without_own(lines.moments)
    total = reduced.sum(axis=0)
    while len(reduced) > 1:
        pairs = lines.without_own(lines.moments[:-1] + lines.moments[1:])
        gain = (sum_left(total - reduced[:-1] - reduced[1:] + pairs) - sum_left(total)) / unit
        gain[np.isin(lines.bounds[1:-1], fixed)] = np.inf
        # Of neighbours the one that gains less goes first: without it the other may be needed.
        ends = np.concatenate([[np.inf], gain, [np.inf]])
        goes = (gain < penalty) & (gain <= ends[:-2]) & (gain < ends[2:])
        if not goes.any():
            break
        lines = lines.joined(lines.bounds[np.concatenate([[True], ~goes, [True]])])
        reduced = lines.without_own(lines.moments)
        total = reduced.sum(axis=0)
    return lines.bounds, float(sum_left(total) - plain) / unit


def solved(moments: Array) -> Array:
    """Return the coefficients of the shared terms."""
    return np.asarray(
        np.linalg.solve(_regular(moments[..., :-1, :-1]), moments[..., :-1, -1:])[..., 0], float
    )


def sum_left(moments: Array) -> Array:
    """Return the sum of squares that lines and shared terms leave."""
    return np.asarray(moments[..., -1, -1] - np.sum(moments[..., :-1, -1] * solved(moments), axis=-1))


def _regular(matrices: Array) -> Array:
    size = matrices.shape[-1]
    trace = np.asarray(np.trace(matrices, axis1=-2, axis2=-1), float)[..., None, None]
    return np.asarray(matrices + _RIDGE * (trace + np.finfo(float).tiny) * np.eye(size), float)
