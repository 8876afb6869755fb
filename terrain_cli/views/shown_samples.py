"""The samples of a comparison as they are shown: measured and predicted, and made few enough to be seen."""

from __future__ import annotations

from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from terrain_cli.comparison.comparison_outcome import Comparison
from terrain_cli.vocabulary import quantities
from terrain_cli.vocabulary.arrays import Array

Index = NDArray[np.int32]

MOST_POINTS = 5_000  # With more points than this a picture shows counts
_BAND_SAMPLES = 1_000_000  # Quantiles of a band come from so many samples at the most
#: Bins of a band, and samples of one.
_MOST_BINS, _LEAST = 24, 25
#: A hole in a driver, as a share of its range, that a band does not bridge; a step of a driver that
#: has few values is none.
_HOLE, _FEW = 0.15, 12
#: Drivers that are shown before others.
USUAL = (
    *("slip", "load", "sinkage", "velocity", "acceleration", "pitch", "yaw_rate", "motor_temperature"),
    *("pass_number", "terrain", "time", "x", "y"),
)
_UNSEEN = frozenset({"segment"})  # Every segment has a picture of its own
MOST_LABELS = 12  # Labels that fit under an axis


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


def band(driver: Array, values: Array) -> Band:
    """Follow the quantiles of values along a driver, in bins of equally many samples, `_LEAST` or more."""
    known = np.flatnonzero(np.isfinite(driver) & np.isfinite(values))
    known = known[some(len(known), _BAND_SAMPLES)]
    order = np.argsort(driver[known], kind="stable")
    x, v = driver[known][order], values[known][order]
    rows: list[tuple[float, ...]] = []
    for start, end in _stretches(x):
        if rows:
            rows.append((0.5 * (x[start - 1] + x[start]), np.nan, np.nan, np.nan))
        bins = max(1, min(_MOST_BINS * (end - start) // len(x), (end - start) // _LEAST))
        # A value of the driver is never split over two bins: it may have few of them.
        edges = np.searchsorted(x, x[np.linspace(start, end, bins + 1).astype(int)[1:-1]])
        rows += [
            (np.median(x[part]), *np.quantile(v[part], [0.05, 0.5, 0.95]))
            for part in np.split(np.arange(start, end), np.unique(edges[edges > start]) - start)
        ]
    return Band(*np.array(rows).T) if rows else Band(*(np.empty(0),) * 4)


def _stretches(x: Array) -> list[tuple[int, int]]:
    """Find where rising values have no wide hole, and are many enough."""
    few = np.count_nonzero(np.diff(x)) < _FEW
    holes: list[int] = []
    if len(x) and not few:
        holes = (np.flatnonzero(np.diff(x) > _HOLE * (x[-1] - x[0])) + 1).tolist()
    ends = [0, *holes, len(x)]
    return [(a, b) for a, b in pairwise(ends) if b - a >= _LEAST]


class Pairs(NamedTuple):
    """Measured and predicted values of one channel, as shown."""

    measured: Array  # measured, predicted: shape (n,): finite, in the unit of `quantities.quantity`
    predicted: Array
    wheel: Index  # Shape (n,): index into `Comparison.wheels`
    segment: Index  # Shape (n,): row in the table of segments
    row: Index  # Shape (n,): sample of the wheel

    @property
    def residual(self) -> Array:
        """Measured less predicted: positive where the model predicts too little."""
        return self.measured - self.predicted

    def take(self, chosen: NDArray[np.intp]) -> Pairs:
        return Pairs._make(column[chosen] for column in self)


def channels(comparison: Comparison) -> dict[str, quantities.Quantity]:
    """Return how the channels compared are shown, in their order."""
    there = comparison.channels
    return {
        name: quantities.quantity(name, there[name].unit) for name in quantities.PREDICTED if name in there
    }


def pairs(comparison: Comparison, channel: str) -> Pairs:
    factor = channels(comparison)[channel].factor
    parts, before = [], 0
    for index, wheel in enumerate(comparison.wheels):
        series = wheel.series.get(channel)
        bounds = wheel.segments.bounds
        if series is not None:
            known = np.flatnonzero(np.isfinite(series.measured) & np.isfinite(series.predicted))
            window = np.searchsorted(bounds, known, side="right") - 1
            parts.append(
                Pairs(
                    series.measured[known] * factor,
                    series.predicted[known] * factor,
                    np.full(len(known), index, dtype=np.int32),
                    (before + window).astype(np.int32),
                    known.astype(np.int32),
                )
            )
        before += len(bounds) - 1
    if len(parts) == 1:
        return parts[0]
    return Pairs(*(np.concatenate(columns) for columns in zip(*parts, strict=True)))


class Along(NamedTuple):
    """A driver over pooled samples."""

    quantity: quantities.Quantity
    values: Array  # Shape (n,): in the unit shown, NaN where not known; of a label its place in `labels`
    labels: tuple[str, ...]  # Empty for a number


def driver(comparison: Comparison, name: str, pooled: Pairs) -> Along:
    """Collect a driver of samples, whichever of the wheels have it."""
    those = {j: wheel.drivers[name] for j, wheel in enumerate(comparison.wheels) if name in wheel.drivers}
    quantity = quantities.quantity(name, next(iter(those.values())).unit)
    # Each wheel counts its labels for itself.
    labels = tuple(dict.fromkeys(label for one in those.values() for label in one.labels))
    values = np.full(len(pooled.row), np.nan)
    for index, one in those.items():
        here = pooled.wheel == index
        found = one.values[pooled.row[here]]
        if one.labels:
            places = np.array([labels.index(label) for label in one.labels], dtype=float)
            known = np.isfinite(found)
            found[known] = places[found[known].astype(int)]
        values[here] = found * quantity.factor
    return Along(quantity, values, labels)


def drivers(comparison: Comparison, channel: str, pooled: Pairs, most: int) -> list[str]:
    """Choose the drivers to show: those of findings first, none that does not vary."""
    found = [f.driver for f in sorted(comparison.failures, key=lambda f: -f.share) if f.channel == channel]
    there = dict.fromkeys(name for wheel in comparison.wheels for name in wheel.drivers)
    result: list[str] = []
    for name in dict.fromkeys([*found, *USUAL, *there]):
        if len(result) == most or name not in there or name in _UNSEEN or name == channel:
            continue
        one = driver(comparison, name, pooled)
        finite = one.values[np.isfinite(one.values)]
        if len(finite) and finite.min() < finite.max() and len(one.labels) <= MOST_LABELS:
            result.append(name)
    return result


def misfit(comparison: Comparison, channel: str) -> Array:
    """Return the rms of the residual of a channel in every segment, NaN where it is not measured."""
    pooled = pairs(comparison, channel)
    n = sum(len(wheel.segments) for wheel in comparison.wheels)
    count = np.bincount(pooled.segment, minlength=n)
    total = np.bincount(pooled.segment, weights=pooled.residual**2, minlength=n)
    mean = np.divide(total, count, out=np.full(n, np.nan), where=count > 0)
    return np.asarray(np.sqrt(mean))
