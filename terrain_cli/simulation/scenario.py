"""A drive, the wheels and soils, the physics and the sensors; and the rover.toml that fits its log."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING

from terrain_cli.mechanics.wheel_model import Model, WheelGeometry
from terrain_cli.toml import toml_text

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
    """A wheel and where it touches the ground."""

    name: str
    # x, y: forward and left of the body's origin, in m
    x: float = 0.0
    y: float = 0.0


def places(count: int) -> tuple[Place, ...]:
    """Place some wheels in rows of two; one alone is named "wheel" and stands at the origin."""
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
    """A stretch of the drive."""

    duration: float
    profiles: Mapping[str, Profile]  # Every quantity of `drive_file.CALM`


@dataclass(frozen=True, kw_only=True)
class Scenario:
    """A drive, the wheels and soils, the physics, and the sensors."""

    parts: tuple[DrivePart, ...]
    soils: tuple[Soil, ...]  # In turn, over equal distances of the track
    geometry: WheelGeometry  # Of every wheel
    wheels: tuple[Place, ...]
    load: float  # Mean load of each wheel in N
    speed: float = 0.1  # Mean speed in m/s
    rate: float = 20.0  # Hz, of every channel that `rates` does not name
    rates: Mapping[str, float] = field(default_factory=dict)  # channel → Hz
    base: Base = "wong-reece"
    effects: tuple[Chosen, ...] = ()
    sensors: Mapping[str, Sensor] = field(default_factory=dict)  # By channel; the others are perfect
    seed: int = 0
    start: float = START  # s since 1970
    drawbar_pull: bool = True  # Whether it is measured

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


JOINTS = "/joint_states"
#: A file that begins so may be replaced.
HEADER = "# Written by terrain-est simulate, which replaces it as long as this line stands first."


def identifier(wheel: str) -> str:
    """Return the name of a wheel as topics and joints have it: no hyphens."""
    return wheel.replace("-", "_")


def joint(wheel: str) -> str:
    """Return the name of a wheel's joint."""
    return f"{identifier(wheel)}_joint"


def rover_text(scenario: Scenario) -> str:
    """Write what a reader of the log needs to know of the rover; nothing of its effects."""
    wheel = scenario.geometry
    lines = [
        HEADER,
        "# Tables name their columns as channels: the entries with a topic are for bags.",
        "",
        "[wheel]",
        f"radius = {toml_text.value(wheel.radius)}  # m",
        f"width = {toml_text.value(wheel.width)}  # m",
    ]
    if wheel.grouser_count:
        lines.append(f"grouser_count = {wheel.grouser_count}")
        lines.append(f"grouser_height = {toml_text.value(wheel.grouser_height)}  # m")
    shear_modulus = toml_text.value(scenario.soils[0].shear_modulus)
    lines += ["", "[soil]", f"shear_modulus = {shear_modulus}  # m, of {scenario.soils[0].name}"]
    for place in scenario.wheels:
        lines += ["", f"[wheels.{toml_text.key(place.name)}]"]
        if len(scenario.wheels) > 1:
            lines.append(f"position = {toml_text.value([place.x, place.y, 0.0])}  # m")
        entry = {"topic": JOINTS, "field": "effort", "name": joint(place.name), "unit": "N m"}
        lines += [
            f"[wheels.{toml_text.key(place.name)}.channels]",
            "# A JointState does not say whether its effort is a torque or a current.",
            f"torque = {toml_text.value(entry)}",
        ]
    return "\n".join(lines) + "\n"
