"""Changes of soil that the line does not show: strength goes on, but the wheel sinks deeper, or less."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from terrain_cli.windows.segmentation.change_points import Lines, change_points, needed, solved
from terrain_cli.windows.segmentation.plain_windows import distinct

if TYPE_CHECKING:
    from collections.abc import Sequence

    from terrain_cli.vocabulary.arrays import Array, Bounds, Index

#: Share of the logarithms that stands in for a strength: lines that differ by 5 and 8 % are sinkages that
#: differ by 15 and 24 %. In 164 drives over one soil neither a third nor a half nor the whole made a false
#: cut. The line finds 237 of 384 changes between two soils, each of the three 376; false cuts are 89 by the
#: line, and 96, 109 and 102.
_SHARE = 1.0 / 3.0
#: Samples and metres of such a soil at least: what is shorter is uneven ground. Where the sinkage rises and
#: falls by 42 % in 0.35 m on one line, 10 samples and 0.1 m made 171 cuts, 60 samples and 0.3 m or more none.
_SAMPLES, _METRES = 60, 0.5
#: Samples of a block that tell how the sinkage follows load and slip. In 458 drives 32, 64 and 128 found all
#: of 146 changes; in 32 drives, cut as they arrived, 64, 128, 256 and 512 made 6, 1, 1 and 1 false cuts.
_BLOCK = 128
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
    """Cut windows further where the sinkage under a load changes.

    A wheel sinks as z ∝ W^m (m = 2 / (2 n + 1), Bekker 1969), which is a line in logarithms: the search is
    that for the line of a soil. What the sinkage of each window follows of load and slip is taken off first,
    and no cut stays that `drivers` explain. Arrays are of shape (n,) and in SI; where one is not known
    everywhere, nothing is cut.
    """
    line = _line(load, sinkage, slip, bounds)
    if line is None:
        return bounds
    inner: Index = bounds[1:-1]
    found = change_points(
        *line,
        breaks=inner,
        distance=distance,
        min_samples=max(min_samples, _SAMPLES),
        min_distance=max(min_distance, _METRES),
        before=before,
    )
    return needed(*line, drivers, found, inner)


def _line(load: Array, sinkage: Array, slip: Array, bounds: Bounds) -> tuple[Array, Array] | None:
    """Return the coordinates of a line of slope 1 in each window; None where something is not known."""
    if not all(np.isfinite(column).all() for column in (load, sinkage, slip)) or not len(load):
        return None
    usual_load, usual_sinkage = float(np.median(load)), float(np.median(sinkage))
    if usual_load <= 0.0 or usual_sinkage <= 0.0 or np.ptp(sinkage) == 0.0:
        return None
    weight = np.log(np.maximum(load / usual_load, _LEAST_LOAD))
    depth = np.log(np.maximum(sinkage / usual_sinkage, _LEAST_SINKAGE))
    # A change of soil is a step, which hardly shows within a block.
    blocks = distinct(np.concatenate([bounds, np.arange(0, len(load), _BLOCK)]))
    terms = [weight, slip, slip**2, slip * weight]
    line, *others, level = (column - _mean(column, blocks) for column in (*terms, depth))
    # Their means are 0 already: of the moments those with 1 are left out.
    found = solved(Lines(line, others, level, bounds).moments()[:, 1:, 1:])
    for own, term in zip(found.T, terms, strict=True):
        depth -= np.repeat(own, np.diff(bounds)) * term
    return 1.0 + _SHARE * weight, 1.0 + _SHARE * (weight + depth - _mean(depth, bounds))


def _mean(column: Array, bounds: Bounds) -> Array:
    """Return at each sample the mean of its window."""
    sizes = np.diff(bounds)
    return np.repeat(np.add.reduceat(column, bounds[:-1]) / sizes, sizes)
