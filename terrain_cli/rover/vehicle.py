"""The content of rover.toml: wheels, sources of their channels, and data to derive missing channels from."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Literal

from terrain_cli.errors import ConfigurationError, nearest
from terrain_cli.vocabulary import units
from terrain_cli.vocabulary.choices import K_FACTOR
from terrain_cli.vocabulary.units import Unit

FILE_NAME = "rover.toml"
Suspension = Literal["rigid", "rocker", "rocker-bogie"]
Vector = tuple[float, float, float]
#: Channels whose noise the estimate of the whole model weighs.
NOISY = ("load", "torque", "sinkage", "slip", "drawbar_pull")


@dataclass(frozen=True, slots=True, kw_only=True)
class ChannelEntry:
    """Where rover.toml says one channel is found: a column, a field of a topic, or a constant."""

    channel: str
    #: Where this stands, such as ``rover.toml: channels.torque``, for messages.
    place: str
    column: str | None = None
    #: Topic of a bag and dotted path of the field in its message; without a field, its only one.
    topic: str | None = None
    field: str | None = None
    name: str | None = None
    #: Which element of a list, by the text beside it or by its place.
    index: int | None = None
    constant: float | str | None = None
    unit: Unit | None = None  # None where the header or the message type is to tell
    #: The channel is unit(raw · scale + offset).
    scale: float = 1.0
    offset: float = 0.0


@dataclass(frozen=True, slots=True)
class SensorNoise:
    """Standard deviation of a sensor's noise, whose relative and absolute parts add in quadrature."""

    relative: float = 0.0  # As a share of the value
    absolute: float = 0.0  # In the channel's SI unit
    offset: float = 0.0  # Standard deviation of a constant offset, in the same unit
    gain: float = 0.0  # Standard deviation of a constant error of the scale, as a share
    known: bool = True  # Whether the noise is known, and not the calibration alone


@dataclass(frozen=True, slots=True, kw_only=True)
class Motor:
    """Drive motor and gear, for the torque from its current."""

    #: N m/A at the reference temperature.
    torque_constant: float
    gear_ratio: float = 1.0
    efficiency: float = 1.0
    temperature_coefficient: float = 0.0  # Relative change of the torque constant, 1/K
    reference_temperature: float = 25.0  # °C
    no_load_current: float = 0.0  # A


@dataclass(frozen=True, slots=True, kw_only=True)
class Vehicle:
    """Body of the rover, for the load of each wheel."""

    mass: float  # kg, wheels and suspension included
    #: x forward, y left, z up in m, from the same origin as the positions of the wheels.
    centre_of_mass: Vector
    #: m/s².
    gravity: float = units.STANDARD_GRAVITY
    suspension: Suspension = "rigid"
    #: x and z in m.
    rocker_pivot: tuple[float, float] | None = None
    bogie_pivot: tuple[float, float] | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Wheel:
    """One wheel; what its own table does not give is that of [wheel], [channels] and [motor]."""

    name: str = ""  # Empty where rover.toml names no wheels
    #: m.
    radius: float | None = None
    width: float | None = None
    #: Standard deviations of both in m; 0 where they are not stated.
    radius_error: float = 0.0
    width_error: float = 0.0
    grouser_count: int = 0
    grouser_height: float = 0.0  # m
    #: Of the point of contact: x forward, y left, z up in m.
    position: Vector | None = None
    channels: Mapping[str, ChannelEntry] = field(default_factory=dict)
    motor: Motor | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Rover:
    path: Path | None = None
    #: [wheel], [channels] and [motor]: every wheel of a file that names none.
    default: Wheel = field(default_factory=Wheel)
    #: [wheels.NAME], complete with what they take from the default.
    wheels: Mapping[str, Wheel] = field(default_factory=dict)
    shear_modulus: float | None = None  # k of [soil] in m
    #: Within which it is expected to be right (one standard deviation).
    shear_modulus_factor: float = K_FACTOR
    vehicle: Vehicle | None = None
    max_gap: float | None = None  # [sampling]: longest time in s over which a channel is interpolated
    steady: bool = False  # [sampling]: the rows of tables are steady test points, whatever columns they have
    #: [noise]: what is known of the sensors, by channel.
    noise: Mapping[str, SensorNoise] = field(default_factory=dict)
    #: [estimate]: long options of `terrain-est estimate` and their values.
    estimate: Mapping[str, str | int | float] = field(default_factory=dict)

    @property
    def label(self) -> str:
        return str(self.path) if self.path else FILE_NAME

    def wheel(self, name: str = "") -> Wheel:
        """Return the wheel of a name, or, where the data name none, the only one there is."""
        if name in self.wheels:
            return self.wheels[name]
        if not self.wheels:
            return replace(self.default, name=name)
        if not name and len(self.wheels) == 1:
            return next(iter(self.wheels.values()))
        listed = ", ".join(self.wheels)
        if not name:
            what = f"the data do not say which of the wheels {listed} they are of"
            raise ConfigurationError(f"{self.label}: {what}", hint="choose it with --wheel NAME")
        what = f"no [wheels.{name}] for wheel {name!r} of the data{nearest(name, self.wheels)}"
        raise ConfigurationError(f"{self.label}: {what}", hint=f"its wheels are {listed}")

    def soil_shear_modulus(self) -> float:
        """Return the shear modulus k in m."""
        if self.shear_modulus is None:
            raise self._missing("the shear modulus", "[soil]\nshear_modulus = …  # m")
        return self.shear_modulus

    def positions(self) -> dict[str, Vector]:
        """Return where each wheel touches the ground: x, y, z in m."""
        places = {name: wheel.position for name, wheel in self.wheels.items()}
        missing = [name for name, place in places.items() if place is None]
        if missing or not places:
            lines = "\n".join(f"[wheels.{name}]\nposition = [x, y, z]  # m" for name in missing or ["NAME"])
            raise self._missing(f"the positions of the wheels {', '.join(missing)}".rstrip(), lines)
        return {name: place for name, place in places.items() if place is not None}

    def _missing(self, what: str, lines: str) -> ConfigurationError:
        where = f"{self.path} does not give" if self.path else "there is no rover.toml to give"
        nowhere = "write rover.toml beside the input, or name one with --rover"
        add = f"add to {self.path}" if self.path else nowhere
        return ConfigurationError(f"{where} {what}", hint=f"{add}:\n{lines}")
