"""Changes of soil that the line does not show: strength goes on, but the wheel sinks deeper, or less."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from terrain_cli.windows.segmentation.change_points import Lines, change_points, needed, solved

if TYPE_CHECKING:
    from collections.abc import Sequence

    from terrain_cli.vocabulary.arrays import Array, Bounds, Index

#: Share of the logarithms that stands in for a strength: lines that differ by 5 and 8 % are sinkages that
#: differ by 15 and 24 %. In 164 drives over one soil, 106 of them with an effect of the catalogue, a third and
#: a half made no false cut, the whole 9. Of 384 changes between two soils, most with an effect, the line finds
#: 316, and each of the three finds 381; false cuts there are 83 by the line, and 91, 99, 113.
_SHARE = 1.0 / 3.0
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
        min_samples=min_samples,
        min_distance=min_distance,
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
    terms = [slip, slip**2, slip * weight]
    lines = Lines(weight, terms, depth, bounds)
    level, growth, *shared = (np.repeat(one, np.diff(bounds)) for one in solved(lines.moments()).T)
    expected = level + growth * weight + sum(own * term for own, term in zip(shared, terms, strict=True))
    return 1.0 + _SHARE * weight, 1.0 + _SHARE * (weight + depth - expected)
