"""What is simulated: the wheel, the soils along the drive, their effects, and the sensors."""

import math
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any, Literal

import numpy as np

from terrain_cli import models
from terrain_cli.errors import ConfigurationError, TerrainError, nearest
from terrain_cli.mechanics.effect import Effect, Parameter
from terrain_cli.mechanics.wheel_model import Model, WheelGeometry
from terrain_cli.simulation.sensors import KEYS, Sensor
from terrain_cli.vocabulary import toml_files
from terrain_cli.vocabulary.arrays import Array
from terrain_cli.vocabulary.choices import Base
from terrain_cli.vocabulary.toml_files import Rule

_PUBLISHED = tomllib.loads(Path(__file__).with_name("soils.toml").read_text("utf-8"))
PLAUSIBLE: dict[str, list[float]] = _PUBLISHED["plausible"]
#: 2026-01-01 00:00:00 UTC, in s since 1970: every drive starts then, so that files do not depend on the day.
START = 1_767_225_600.0
#: Between rows of wheels, and between left and right, in m.
_WHEELBASE, _TRACK = 0.40, 0.60
_ROWS = {1: ("front",), 2: ("front", "rear"), 3: ("front", "middle", "rear")}


@dataclass(frozen=True, slots=True, kw_only=True)
class Soil:
    """What a soil is to a rigid wheel."""

    name: str
    cohesion: float  # c in Pa
    tan_phi: float  # Tangent of the internal friction angle φ
    shear_modulus: float  # k of Janosi and Hanamoto in m
    sinkage_exponent: float  # n of Bekker
    # cohesive_modulus, frictional_modulus: kc in Pa/m^(n−1) and kφ in Pa/m^n, of Bekker
    cohesive_modulus: float
    frictional_modulus: float
    reference: str = ""  # Where the values are from

    def values(self, width: float) -> dict[str, float]:
        """Return the parameters of the model in SI units; the stiffness is kc/b + kφ, b the wheel's width."""
        return {
            "cohesion": self.cohesion,
            "tan_phi": self.tan_phi,
            "shear_modulus": self.shear_modulus,
            "stiffness": self.cohesive_modulus / width + self.frictional_modulus,
            "sinkage_exponent": self.sinkage_exponent,
        }


SOILS: dict[str, Soil] = {
    name: Soil(
        name=name,
        cohesion=c * 1e3,
        tan_phi=math.tan(math.radians(phi)),
        shear_modulus=0.018,
        sinkage_exponent=n,
        cohesive_modulus=kc * 1e3,
        frictional_modulus=kphi * 1e3,
        reference=reference,
    )
    for reference, soils in _PUBLISHED["soils"].items()
    for name, (n, kc, kphi, c, phi) in soils.items()
}

_SOIL = toml_files.rules(KEYS["soil"])


def soils_rule(value: Any, place: str) -> dict[str, Soil]:
    """Read the tables [soils.NAME] of a user."""
    return {name: _own(name, inner, where) for name, inner, where in toml_files.each(value, place)}


def _own(name: str, value: Any, place: str) -> Soil:
    given = _SOIL(value, place)
    toml_files.require(given, place, "cohesion", "shear_modulus", "sinkage_exponent")
    if ("tan_phi" in given) == ("phi_deg" in given):
        raise ConfigurationError(f"{place}: give one of tan_phi and phi_deg")
    bekker = {"cohesive_modulus", "frictional_modulus"} & given.keys()
    if ("stiffness" in given) == bool(bekker):
        raise ConfigurationError(f"{place}: give stiffness, or cohesive_modulus and frictional_modulus")
    if bekker:
        toml_files.require(given, place, "cohesive_modulus", "frictional_modulus")
    else:
        given |= {"cohesive_modulus": 0.0, "frictional_modulus": given.pop("stiffness")}
    if "phi_deg" in given:
        given["tan_phi"] = math.tan(math.radians(given.pop("phi_deg")))
    return Soil(name=name, **given)


def find(name: str, own: Mapping[str, Soil], place: str) -> Soil:
    """Find a soil by its name; those of the user stand above the published ones."""
    known = {**SOILS, **own}
    if name not in known:
        what = f"{place}: no soil {name!r}{nearest(name, known)}"
        raise ConfigurationError(what, hint=f"known are {', '.join(known)}")
    return known[name]


@dataclass(frozen=True, slots=True)
class Chosen:
    """An effect of a drive."""

    effect: Effect
    values: Mapping[str, float] = field(default_factory=dict)  # Every parameter by its short name, SI
    hidden: bool = False  # Drawn at random, and told only in the truth


#: Of the table [effects]: id or file → its parameters; names are not looked up here.
effects_rule = toml_files.tables(toml_files.tables(toml_files.number("a number")))


def choose(name: str, given: Mapping[str, float], place: str, under: tuple[float, float]) -> Chosen:
    """Find an effect by id or path; parameters that are not given have their typical size."""
    try:
        effect = models.find_effect(name)
    except TerrainError as error:
        raise ConfigurationError(f"{place}: {error}", hint=error.hint) from None
    return settle(effect, given, place, under)


def settle(effect: Effect, given: Mapping[str, float], place: str, under: tuple[float, float]) -> Chosen:
    """Give every parameter of an effect a value, by short name; those not given their typical size.

    Those given are possible `under` a load, N, on a wheel of a radius, m.
    """
    known = {p.name: p for p in effect.parameters}
    for parameter, value in given.items():
        if parameter not in known:
            what = f"effect {effect.id} has no parameter {parameter!r}{nearest(parameter, known)}"
            raise ConfigurationError(f"{place}: {what}", hint=f"it has {', '.join(known)}")
        bounds = known[parameter].under(*under)
        if not bounds.lower <= value <= bounds.upper:
            unit = f" {bounds.unit}" if bounds.unit != "1" else ""
            what = f"{parameter} of {effect.id} must be from {bounds.lower:g} to {bounds.upper:g}{unit}"
            raise ConfigurationError(f"{place}: {what}, not {value:g}")
    return Chosen(effect, {n: given.get(n, typical(p, effect.qualified(p))) for n, p in known.items()})


def typical(parameter: Parameter, name: str = "") -> float:
    """Return a value that is not given: in the middle of `PLAUSIBLE`, else one typical size from the null."""
    if name in PLAUSIBLE:
        return 0.5 * sum(PLAUSIBLE[name])
    return parameter.null if parameter.shape or parameter.held else _away(parameter, 1.0)


def drawn(effect: Effect, rng: np.random.Generator) -> dict[str, float]:
    """Draw the size of an effect, as it may occur, by short names of its parameters."""
    values = {}
    for parameter in effect.parameters:
        size, side = float(rng.uniform(0.6, 1.6)), float(rng.choice([-1.0, 1.0]))
        below, above = parameter.null - parameter.lower, parameter.upper - parameter.null
        if (name := effect.qualified(parameter)) in PLAUSIBLE:
            low, high = PLAUSIBLE[name]
            values[parameter.name] = low + (high - low) * (size - 0.6)
        elif parameter.held:
            values[parameter.name] = parameter.null
        elif parameter.shape:
            values[parameter.name] = _away(parameter, 0.5 * side * (size - 0.6))
        else:
            # What may be off either way has bounds that are as far on either side.
            either = effect.kind == "sensor" and math.isclose(below, above)
            values[parameter.name] = _away(parameter, size * side if either else size)
    return values


def _away(parameter: Parameter, sizes: float) -> float:
    """Return a value some typical sizes from the null, on the other side where this one is out of bounds."""
    step = sizes * parameter.scale
    for value in (parameter.null + step, parameter.null - step):
        if parameter.lower <= value <= parameter.upper:
            return value
    return parameter.upper if step > 0.0 else parameter.lower


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
class Profile:
    """A quantity over one part of a drive: it varies in time by ramps, by steps or as a smooth swing."""

    form: Literal["ramps", "steps", "swing"]
    values: tuple[float, ...]  # Of the ramps or steps; of a swing its mean, its amplitude and its period in s

    def over(self, time: Array, duration: float, rng: np.random.Generator) -> Array:
        """Evaluate the profile over times since its part began, in s; `rng` gives the phases of a swing."""
        if self.form == "ramps":
            return np.asarray(np.interp(time, np.linspace(0.0, duration, len(self.values)), self.values))
        if self.form == "steps":
            place = np.floor(time / duration * len(self.values) + 1e-9).astype(int)
            values = np.array(self.values, dtype=np.float64)
            return np.asarray(values[np.clip(place, 0, len(values) - 1)])
        mean, swing, period = self.values
        # Three sines whose periods have no common multiple.
        lengths = period / np.sqrt([1.0, 3.0, 8.0])
        phases = rng.uniform(0.0, math.tau, 3)
        weights = np.array([0.5, 0.3, 0.2])
        return np.asarray(mean + swing * np.sin(math.tau * np.divide.outer(time, lengths) + phases) @ weights)


def profile_rule(what: str, low: float, high: float) -> Rule:
    """Return the rule for a `Profile` with values within bounds, which `what` says in words."""
    number = toml_files.number(what, low, high)
    size = toml_files.number("a number, at least 0", 0.0)
    seconds = toml_files.number("a positive number of seconds", toml_files.ABOVE_ZERO)
    swing = toml_files.table({"mean": number, "swing": size, "period": seconds})
    steps = toml_files.table({"steps": toml_files.several(number)})

    def rule(value: Any, place: str) -> Profile:
        if isinstance(value, list) and value:
            return Profile("ramps", tuple(toml_files.several(number)(value, place)))
        if isinstance(value, dict) and "steps" in value:
            values = steps(value, place)["steps"]
            toml_files.require(dict.fromkeys(["steps"] * bool(values)), place, "steps")
            return Profile("steps", tuple(values))
        if isinstance(value, dict):
            given = swing(value, place)
            toml_files.require(given, place, "mean", "swing", "period")
            if not low <= given["mean"] - given["swing"] <= given["mean"] + given["swing"] <= high:
                raise ConfigurationError(f"{place}: swings beyond what it can be: each value is {what}")
            return Profile("swing", (given["mean"], given["swing"], given["period"]))
        if isinstance(value, list | str | bool):
            forms = "a number, a list of numbers, { steps = […] } or { mean = …, swing = …, period = … }"
            raise ConfigurationError(f"{place}: must be {forms}, not {value!r}")
        return Profile("ramps", (number(value, place),))

    return rule


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
        return Model(self.base, tuple(chosen.effect for chosen in self.effects))

    def effect_values(self) -> dict[str, float]:
        return {
            one.effect.qualified(p): one.values[p.name] for one in self.effects for p in one.effect.parameters
        }
