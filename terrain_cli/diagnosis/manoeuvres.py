"""Short drives in which one or two things vary, starting from the conditions of a log."""

import tomllib
from collections.abc import Collection, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

import numpy as np

from terrain_cli.comparison.comparison_outcome import UNITS
from terrain_cli.comparison.smoothed_model import SmoothedData
from terrain_cli.mechanics.effect import Effect
from terrain_cli.mechanics.past import Past
from terrain_cli.telemetry.effect_inputs import RUT
from terrain_cli.vocabulary.arrays import Array
from terrain_cli.vocabulary.quantities import number

_DRIVES = tomllib.loads(Path(__file__).with_name("manoeuvres.toml").read_text("utf-8"))["drives"]
RATE = 10.0  # Hz
_WARMER = 40.0  # K by which a motor is warmed
_SPEED = 0.1  # m/s, where no speed was measured
#: Sinkage goes with the load to this power where no model predicts it: Bekker's 2/(2n + 1) for n = 1.
_SINKS = 2.0 / 3.0
_SPURT = 5.0  # s in which a wheel goes from half of its speed to twice of it, or back
#: Share of the usual speed below which a wheel that stops and turns round is left out: laws of speed are
#: not meant for it.
_MOVING = 0.2
#: How a sensor is checked without any soil, by what it shows.
_CHECKS = {
    "load": "calibrate the load cell with known weights",
    "sinkage": "check the sinkage sensor on firm ground",
    "drawbar_pull": "calibrate the drawbar pull sensor with known weights",
    "slip": "measure the distance of ten turns on firm ground, and correct the radius of rover.toml by it",
    "torque": "calibrate the torque with a known brake",
}
_MIRRORED = ("pitch", "roll")  # Turned round while the wheel drives backwards


@dataclass(frozen=True, kw_only=True)
class Conditions:
    """What a log is like in the middle."""

    # load, speed, slip, sinkage: N, m/s, 1, m
    load: float
    speed: float
    slip: float
    sinkage: float
    others: dict[str, float]  # Medians of the further channels, in SI units
    radius: float  # Of the wheel in m

    @classmethod
    def of(cls, data: SmoothedData) -> Self:
        """Return the usual slip, load, speed and sinkage of the data, from which drives are planned."""
        known = {**data.measured, **data.inputs}
        middle = {
            name: float(np.nanmedian(column[data.use]))
            for name, column in known.items()
            if not isinstance(column, Past) and np.isfinite(column[data.use]).any()
        }
        slip = float(np.clip(round(middle["slip"], 2), 0.05, 0.6))
        radius = data.geometry.radius
        turning = radius * (1.0 - slip) * abs(middle.get("angular_velocity", _SPEED / radius))
        speed = abs(middle.get("velocity", turning)) or _SPEED
        # Without a load cell a model knows only the sinkage, and a load is but the share of what it was.
        load = middle.get("load", 1.0)
        return cls(
            load=load,
            speed=float(np.clip(speed, 1e-3, 10.0)),
            slip=slip,
            sinkage=middle.get("sinkage", 0.0),
            others=middle,
            radius=radius,
        )


@dataclass(frozen=True)
class Manoeuvre:
    """A short drive that may be recommended next."""

    text: str  # For a person
    # A `[[part]]` of a drive file of `terrain-est simulate`; load and speed are shares of `load` and `speed`
    # there, which are those of the conditions
    part: dict[str, Any]
    # Channels without which it shows nothing; "speed" is that of the wheel or its centre
    varies: frozenset[str] = frozenset()

    def possible(self, channels: Collection[str]) -> bool:
        """Tell whether a log has what varies."""
        return self.varies <= drivers(channels) | {"load", "slip"}

    def drive(self, at: Conditions) -> dict[str, Array]:
        """Drive it without noise: time and every channel of the course, counted the way the wheel turns."""
        from terrain_cli import simulation
        from terrain_cli.simulation import course, perfect_sensors

        options = {"part": [self.part], "load": max(at.load, 0.1), "speed": at.speed}
        scenario = simulation.read(None, options)
        time = np.arange(0.0, scenario.duration, 1.0 / RATE)
        ride = course.ride(scenario, course.plan(scenario), scenario.wheels[0])
        here = {"time": time, **ride.at(time)}
        back = np.where(here["velocity"] < 0.0, -1.0, 1.0)
        speed = perfect_sensors.wheel_speed(np.abs(here["velocity"]), here["slip"], at.radius)
        here |= {"angular_velocity": back * speed}
        here |= {name: back * here[name] for name in _MIRRORED}
        here["sinkage"] = at.sinkage * (here["load"] / scenario.load) ** _SINKS
        moving = np.abs(here["velocity"]) > _MOVING * at.speed
        return {name: np.asarray(column, dtype=float)[moving] for name, column in here.items()}


def drivers(channels: Collection[str]) -> frozenset[str]:
    """Return what drives channels: the speed for those of the wheel and its rates."""
    speed = {"velocity", "angular_velocity", "wheel_angle"}
    found = {"speed" if name in speed else name for name in channels}
    if {RUT, "time"} & found or any(f"{name}_rate" in found for name in UNITS):
        found.add("rates")
    # A distance is a time at one speed, and not at another.
    if RUT in found:
        found.add("speed")
    return frozenset(found - {"time"})


def checks(effects: Iterable[Effect]) -> list[str]:
    """Return how the sensors among effects are checked."""
    sensed = [name for effect in effects if effect.kind == "sensor" for name in effect.laws]
    return [_CHECKS[name] for name in sensed if name in _CHECKS]


def library(at: Conditions, seconds: float) -> list[Manoeuvre]:
    """List manoeuvres of some length, the plainest first."""
    warm = round(at.others.get("motor_temperature", 25.0))
    calm = {"duration": seconds, "slip": at.slip, "load": 1.0, "speed": 1.0, "motor_temperature": warm}
    for name in ("pitch", "slip_angle"):
        angle = round(float(np.degrees(at.others.get(name, 0.0))), 1)
        if angle:
            calm[f"{name}_deg"] = angle
    quick = [max(at.slip - 0.15, 0.05), min(at.slip + 0.25, 0.7)]
    series: dict[str, Any] = {
        "quick": {"steps": quick * max(2, round(seconds / 6.0))},
        "spurts": [0.5, 2.0] * max(2, round(seconds / (2.0 * _SPURT))),
        "warming": [warm, warm + _WARMER],
        "warm-early": [warm, warm + _WARMER, warm + _WARMER],
    }
    least, usual, most = (number(at.load * share) for share in (0.6, 1.0, 1.4))
    slow, same, fast = (f"{at.speed * share:.2g}" for share in (0.4, 1.0, 2.5))
    words = {
        "here": f"at slip {at.slip:.2f}",
        "usual": usual,
        "loaded": f"{usual} N on the wheel",
        "loads": f"{least}, {usual} and {most} N",
        "lifted": number(at.load * 0.1, 2),
        "heavy": number(at.load * 2.0),
        "speeds": f"{slow}, {same} and {fast} m/s",
        "slow": f"{at.speed * 0.5:.2g}",
        "fast": f"{at.speed * 2.0:.2g}",
        "quicker": f"from {quick[0]:.2f} to {quick[1]:.2f} and back",
        "warmer": f"from {warm} to {warm + _WARMER:.0f} °C",
    }
    ending = f", for {seconds:.0f} s on the same ground"
    found = []
    for one in _DRIVES:
        own = {
            name: series.get(value, value) if isinstance(value, str) else value for name, value in one.items()
        }
        text, varies, without = own.pop("text"), own.pop("varies"), own.pop("without", None)
        part = {name: value for name, value in {**calm, **own}.items() if name != without}
        found.append(Manoeuvre(text.format(**words) + ending, part, frozenset(varies)))
    return found
