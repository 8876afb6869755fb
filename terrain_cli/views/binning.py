"""Many samples made few enough to be seen: counts in a grid, bands of quantiles, a share of the points."""

from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Array = NDArray[np.float64]

#: With more points than this a picture shows counts.
MOST_POINTS = 5_000
#: Quantiles of a band come from so many samples at the most.
_BAND_SAMPLES = 1_000_000
#: A hole in a driver, as a share of its range, that a band does not bridge; a step of a driver that
#: has few values is none.
_HOLE, _FEW = 0.15, 12
#: Samples counted at a time.
_BLOCK = 1_000_000


class Grid(NamedTuple):
    """Counts of points in rectangles."""

    x: Array  # x, y: shape (columns + 1,), (rows + 1,): edges
    y: Array
    counts: Array  # Shape (rows, columns)


class Band(NamedTuple):
    """What values do along a driver, bin by bin."""

    centre: Array  # Shape (bins,): median of the driver in the bin
    # low, median, high: shape (bins,): 5 %, 50 % and 95 % of the values. NaN between two bins far apart,
    # where nothing was driven.
    low: Array
    median: Array
    high: Array


def some(n: int, most: int = MOST_POINTS) -> NDArray[np.intp]:
    """Choose at most so many of n samples at random, the same ones each time, as rising indices."""
    if n <= most:
        return np.arange(n)
    # One of each stretch, but not every k-th: that would beat with what is periodic in the data.
    ends = np.arange(most + 1) * n // most
    return ends[:-1] + (np.random.default_rng(0).random(most) * np.diff(ends)).astype(np.intp)


def limits(*columns: Array, margin: float = 0.03) -> tuple[float, float]:
    """Return the range of the finite values, a little wider by `margin`, a share of it."""
    ends = [np.nanpercentile(c, [0.0, 100.0]) for c in columns if np.isfinite(c).any()]
    if not ends:
        return 0.0, 1.0
    low, high = min(float(e[0]) for e in ends), max(float(e[1]) for e in ends)
    space = margin * (high - low) or 0.05 * abs(high) or 1.0
    return low - space, high + space


def grid(x: Array, y: Array, bins: int = 60, *, square: bool = False) -> Grid:
    """Count points, all finite, in a grid over their range; `square` has the same range for both."""
    across, up = (limits(x, y),) * 2 if square else (limits(x), limits(y))
    edges = np.linspace(*across, bins + 1), np.linspace(*up, bins + 1)
    counts = np.zeros((bins, bins))
    for start in range(0, len(x), _BLOCK):
        part = slice(start, start + _BLOCK)
        counts += np.histogram2d(x[part], y[part], bins=edges)[0]
    return Grid(*edges, counts.T)


def band(driver: Array, values: Array, most_bins: int = 24, least: int = 25) -> Band:
    """Follow the quantiles of values along a driver, in bins of equally many samples, at `least` so many."""
    known = np.flatnonzero(np.isfinite(driver) & np.isfinite(values))
    known = known[some(len(known), _BAND_SAMPLES)]
    order = np.argsort(driver[known], kind="stable")
    x, v = driver[known][order], values[known][order]
    rows: list[tuple[float, ...]] = []
    for start, end in _stretches(x, least):
        if rows:
            rows.append((0.5 * (x[start - 1] + x[start]), np.nan, np.nan, np.nan))
        bins = max(1, min(most_bins * (end - start) // len(x), (end - start) // least))
        # A value of the driver is never split over two bins: it may have few of them.
        edges = np.searchsorted(x, x[np.linspace(start, end, bins + 1).astype(int)[1:-1]])
        rows += [
            (float(np.median(x[part])), *np.percentile(v[part], [5.0, 50.0, 95.0]))
            for part in np.split(np.arange(start, end), np.unique(edges[edges > start]) - start)
        ]
    return Band(*np.array(rows).T) if rows else Band(*(np.empty(0),) * 4)


def _stretches(x: Array, least: int) -> list[tuple[int, int]]:
    """Find where rising values have no wide hole, and are many enough."""
    few = np.count_nonzero(np.diff(x)) < _FEW
    holes: list[int] = []
    if len(x) and not few:
        holes = (np.flatnonzero(np.diff(x) > _HOLE * (x[-1] - x[0])) + 1).tolist()
    ends = [0, *holes, len(x)]
    return [(a, b) for a, b in pairwise(ends) if b - a >= least]
