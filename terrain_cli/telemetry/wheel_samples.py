"""The samples of one wheel: every channel on the clock of its torque."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, NamedTuple, TypedDict

import numpy as np

from terrain_cli.telemetry.raw_columns import take
from terrain_cli.vocabulary.choices import K_FACTOR
from terrain_cli.vocabulary.units import STANDARD_GRAVITY

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from numpy.typing import NDArray

    from formats import Column, Labels
    from terrain_cli.mechanics.wheel_model import WheelGeometry
    from terrain_cli.rover import SensorNoise
    from terrain_cli.telemetry.channel_sources import Feed

#: What the line y = c + x tan φ is computed from.
NEEDED = ("load", "torque", "sinkage", "slip")


class Notice(str):
    """A remark that every command says on stderr, whatever else it shows."""

    __slots__ = ()


class LineGeometry(TypedDict):
    """Geometry and shear modulus, in m, by the names that the equations of the line have."""

    radius: float
    width: float
    shear_modulus: float


class Geometry(NamedTuple):
    """Of a wheel, and the shear modulus assumed of its soil."""

    #: r, b and k in m.
    radius: float
    width: float
    shear_modulus: float
    #: In m.
    grouser_height: float = 0.0
    grouser_count: int = 0
    #: In m/s².
    gravity: float = STANDARD_GRAVITY
    #: Within which k is expected to be right (one standard deviation).
    shear_modulus_factor: float = K_FACTOR

    @property
    def line(self) -> LineGeometry:
        """What the line y = c + x tan φ is computed with."""
        return LineGeometry(radius=self.radius, width=self.width, shear_modulus=self.shear_modulus)

    @property
    def wheel(self) -> WheelGeometry:
        """The constants of the wheel for the whole model."""
        from terrain_cli.mechanics.wheel_model import WheelGeometry

        return WheelGeometry(self.radius, self.width, self.grouser_height, self.grouser_count, self.gravity)


@dataclass(kw_only=True)
class Raw:
    """The channels of one wheel on one clock, before anything is derived or judged."""

    wheel: str
    #: Whole seconds taken off the clock.
    origin: float
    #: In s; shape (n,).
    time: NDArray[np.float64] | None
    #: In SI units; shape (n,).
    channels: dict[str, NDArray[np.float64]]
    labels: dict[str, Labels]
    #: Further columns that were asked for, as read; shape (n,).
    extras: dict[str, Column]
    feeds: dict[str, Feed]
    remarks: list[str] = field(default_factory=list)

    def __len__(self) -> int:
        columns = (*self.channels.values(), *self.labels.values(), *self.extras.values())
        return len(self.time) if self.time is not None else max(map(len, columns), default=0)

    def select(self, rows: NDArray[np.intp] | NDArray[np.bool_]) -> None:
        """Keep some samples only."""
        self.time = None if self.time is None else self.time[rows]
        self.channels = {name: values[rows] for name, values in self.channels.items()}
        self.labels = {name: column.take(rows) for name, column in self.labels.items()}
        self.extras = {name: take(column, rows) for name, column in self.extras.items()}


@dataclass(kw_only=True)
class Samples:
    """One wheel of one input."""

    source: str  # The input, as the user named it
    wheel: str
    geometry: Geometry
    origin: float  # Whole seconds that were taken off the clock
    # Shape (n,), or None: s since `origin`; None for a table of steady test points
    time: NDArray[np.float64] | None
    # Shape (n,): by the names of the contract, in SI units; NaN where not known
    channels: dict[str, NDArray[np.float64]]
    labels: dict[str, Labels]  # "run" and "terrain", where the input has them
    # Shape (n,): number of the continuous stretch: a new one begins with every run, gap or restart of the
    # clock
    stretch: NDArray[np.intp]
    # Shape (n,), or None: metres driven since the first sample; None where no channel tells
    distance: NDArray[np.float64] | None
    set_aside: Labels  # Why a sample is not used; code −1 for those that are
    origins: dict[str, str] = field(default_factory=dict)  # Where each channel comes from, in words
    remarks: list[str] = field(default_factory=list)  # What a person should know about the input
    # Shape (n,): what makes a difference to the effects of the model, by the names they have there
    drivers: dict[str, NDArray[np.float64]] = field(default_factory=dict)
    # What rover.toml says of the sensors, by channel
    noise: Mapping[str, SensorNoise] = field(default_factory=dict)
    # Shape (n,), or None: where only pieces of a log were kept: number of the continuous stretch of the log
    # that each sample is of. `stretch` then tells the pieces apart.
    drive: NDArray[np.intp] | None = None
    total: int | None = None  # Usable samples of the log, where only pieces of it were kept

    def __len__(self) -> int:
        return len(self.set_aside)

    @property
    def usable(self) -> NDArray[np.intp]:
        """Indices of the samples that are not set aside."""
        return np.flatnonzero(self.set_aside.codes < 0)

    def taken(self, rows: NDArray[np.intp] | NDArray[np.bool_] | slice) -> Samples:
        """Return some of the samples."""
        return replace(
            self,
            time=None if self.time is None else self.time[rows],
            channels={name: column[rows] for name, column in self.channels.items()},
            labels={name: column.take(rows) for name, column in self.labels.items()},
            stretch=self.stretch[rows],
            distance=None if self.distance is None else self.distance[rows],
            set_aside=self.set_aside.take(rows),
            drivers={name: column[rows] for name, column in self.drivers.items()},
            drive=None if self.drive is None else self.drive[rows],
        )

    def reasons(self) -> dict[str, int]:
        """Count the samples set aside by reason, the most frequent first."""
        codes = self.set_aside.codes
        counts = np.bincount(codes[codes >= 0], minlength=len(self.set_aside.names))
        return {
            self.set_aside.names[j]: int(counts[j]) for j in np.argsort(-counts, kind="stable") if counts[j]
        }


def joined_columns(
    parts: Sequence[Samples], of: Callable[[Samples], Mapping[str, NDArray[np.float64]]]
) -> dict[str, NDArray[np.float64]]:
    """Join the channels or drivers of some samples, NaN where one lacks a column."""
    names = dict.fromkeys(name for part in parts for name in of(part))
    return {
        name: np.concatenate([of(part).get(name, np.full(len(part), np.nan)) for part in parts])
        for name in names
    }
