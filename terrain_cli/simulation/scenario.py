"""The settings of a simulation: rover, course, soils, effects and sensors."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING

from terrain_cli.mechanics.wheel_model import Model, WheelGeometry

if TYPE_CHECKING:
    from collections.abc import Mapping

    from terrain_cli.simulation.profiles import Profile
    from terrain_cli.simulation.sensors import Sensor
    from terrain_cli.simulation.simulated_effects import Chosen
    from terrain_cli.simulation.simulated_soils import Soil
    from terrain_cli.vocabulary.choices import Base

#: 2026-01-01 00:00:00 UTC, in s since 1970: every drive starts then, so that files do not depend on the day.
START = 1_767_225_600.0
#: Between rows of wheels, and between left and right, in m.
_WHEELBASE, _TRACK = 0.40, 0.60
_ROWS = {1: ("front",), 2: ("front", "rear"), 3: ("front", "middle", "rear")}


@dataclass(frozen=True, slots=True)
class Place:
    """A wheel and where it touches the ground.

    Parameters
    ----------
    x, y : float
        Forward and left of the body's origin, in m.
    """

    name: str
    x: float = 0.0
    y: float = 0.0


def places(count: int) -> tuple[Place, ...]:
    """Place some wheels in rows of two.

    Parameters
    ----------
    count : int
        At least 1.

    Returns
    -------
    tuple of Place
        One wheel alone is named "wheel" and stands at the origin.
    """
    if count == 1:
        return (Place("wheel"),)
    rows = (count + 1) // 2
    names = _ROWS.get(rows) or tuple(f"row{row + 1}" for row in range(rows))
    every = (
        Place(f"{name}-{side}", _WHEELBASE * (0.5 * (rows - 1) - row), 0.5 * _TRACK * sign)
        for row, name in enumerate(names)
        for side, sign in (("left", 1.0), ("right", -1.0))
    )
    return tuple(every)[:count]


@dataclass(frozen=True, slots=True)
class DrivePart:
    """A stretch of the drive.

    Parameters
    ----------
    duration : float
        In s.
    profiles : mapping of str to Profile
        Every quantity of `prepared_drives.CALM`.
    """

    duration: float
    profiles: Mapping[str, Profile]


@dataclass(frozen=True, kw_only=True)
class Scenario:
    """A drive, the wheels and soils, the physics, and the sensors.

    Parameters
    ----------
    soils : tuple of Soil
        In turn, over equal distances of the track.
    geometry : WheelGeometry
        Of every wheel.
    load : float
        Mean load of each wheel in N.
    speed : float
        Mean speed in m/s.
    rate : float
        Hz, of every channel that `rates` does not name.
    rates : mapping of str to float
        channel → Hz.
    base : {"wong-reece", "linear"}
    sensors : mapping of str to Sensor
        By channel; the others are perfect.
    start : float
        s since 1970.
    drawbar_pull : bool
        Whether it is measured.
    """

    parts: tuple[DrivePart, ...]
    soils: tuple[Soil, ...]
    geometry: WheelGeometry
    wheels: tuple[Place, ...]
    load: float
    speed: float = 0.1
    rate: float = 20.0
    rates: Mapping[str, float] = field(default_factory=dict)
    base: Base = "wong-reece"
    effects: tuple[Chosen, ...] = ()
    sensors: Mapping[str, Sensor] = field(default_factory=dict)
    seed: int = 0
    start: float = START
    drawbar_pull: bool = True

    @property
    def duration(self) -> float:
        """Length of the drive in s."""
        return sum(part.duration for part in self.parts)

    @property
    def summary(self) -> str:
        """How long is driven with what and where, without a hidden effect."""
        wheels = "1 wheel" if len(self.wheels) == 1 else f"{len(self.wheels)} wheels"
        soils = ", ".join(dict.fromkeys(soil.name for soil in self.soils))
        told = [chosen.effect.id for chosen in self.effects if not chosen.hidden]
        drive = f"{self.duration:g} s, {wheels} of {self.load:g} N on {soils}"
        return drive + (f", with {', '.join(told)}" if told else "")

    @cached_property
    def model(self) -> Model:
        """The model that makes the truth."""
        return Model(self.base, tuple(chosen.effect for chosen in self.effects))

    def effect_values(self) -> dict[str, float]:
        """Return the parameters of all effects by their qualified names."""
        return {name: value for chosen in self.effects for name, value in chosen.qualified().items()}
