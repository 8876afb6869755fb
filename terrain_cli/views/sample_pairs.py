"""The samples of a comparison over all its wheels: measured, predicted, held out."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from terrain_cli.vocabulary import quantities

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from terrain_cli.comparison.comparison_outcome import Comparison

    Array = NDArray[np.float64]
    # Half as long as usual: ten million samples have thirty million of these.
    Index = NDArray[np.int32]


#: Drivers that are shown before others.
USUAL = (
    *("slip", "load", "sinkage", "velocity", "acceleration", "pitch", "yaw_rate", "motor_temperature"),
    *("pass_number", "terrain", "time", "x", "y"),
)
#: Every segment has a picture of its own.
_UNSEEN = frozenset({"segment"})
#: Labels that fit under an axis.
MOST_LABELS = 12


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
        """Return some of them."""
        return Pairs(
            self.measured[chosen],
            self.predicted[chosen],
            self.wheel[chosen],
            self.segment[chosen],
            self.row[chosen],
        )


def channels(comparison: Comparison) -> list[str]:
    """Return the channels compared, in the order in which they are shown."""
    return [name for name in quantities.PREDICTED if name in comparison.channels]


def pairs(comparison: Comparison, channel: str) -> Pairs:
    """Collect measured and predicted values of a channel."""
    factor = quantities.quantity(channel, comparison.channels[channel].unit).factor
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
