"""Short drives in which one or two things vary, starting from the conditions of a log."""

from collections.abc import Collection, Iterable
from dataclasses import dataclass
from typing import Any, Self

import numpy as np

from terrain_cli.comparison.comparison_outcome import UNITS
from terrain_cli.comparison.smoothed_model import SmoothedData
from terrain_cli.mechanics.effect import Effect
from terrain_cli.mechanics.past import Past
from terrain_cli.telemetry.effect_inputs import RUT
from terrain_cli.vocabulary.arrays import Array
from terrain_cli.vocabulary.quantities import number

RATE = 10.0  # Hz
_WARMER = 40.0  # K by which a motor is warmed
_SPEED = 0.1  # m/s, where no speed was measured
#: Sinkage goes with the load to this power where no model predicts it: Bekker's 2/(2n + 1) for n = 1.
_SINKS = 2.0 / 3.0
_SPURT = 5.0  # s in which a wheel goes from half of its speed to twice of it, or back
#: Shares of the load that are left on a lifted wheel, and that a heavy one carries.
_LIFTED, _HEAVY = 0.1, 2.0
_BRAKED = -0.2  # Slip of a wheel that brakes
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
    around = f"for {seconds:.0f} s on the same ground"
    here = f"at slip {at.slip:.2f}"
    loaded = f"{number(at.load)} N on the wheel"
    loads = ", ".join(number(at.load * share) for share in (0.6, 1.0)) + f" and {number(at.load * 1.4)} N"
    lifted = number(at.load * _LIFTED, 2)
    speeds = ", ".join(f"{at.speed * share:.2g}" for share in (0.4, 1.0)) + f" and {at.speed * 2.5:.2g} m/s"
    spurts = [0.5, 2.0] * max(2, round(seconds / (2.0 * _SPURT)))
    sweep = [0.05, 0.6, 0.05, 0.6, 0.05]
    # Where nothing slips an error of slip shows as it is, and no soil does.
    through = [_BRAKED, 0.6] * 3 + [_BRAKED]
    braked = f"sweep the slip from {_BRAKED} (the wheel brakes) to 0.6 and back"
    quick = [max(at.slip - 0.15, 0.05), min(at.slip + 0.25, 0.7)] * max(2, round(seconds / 6.0))

    def made(text: str, *varies: str, **part: Any) -> Manoeuvre:
        whole = {name: value for name, value in {**calm, **part}.items() if value is not None}
        return Manoeuvre(f"{text}, {around}", whole, frozenset(varies))

    loading = {"steps": [1.0, 0.6, 1.4] * 2}
    pacing = {"steps": [1.0, 0.4, 2.5] * 2}
    return [
        made(f"drive with {loads} on the wheel in turn, {here}", "load", load=loading),
        made(f"drive at {speeds} in turn, {here} with {loaded}", "speed", speed=pacing),
        made(f"sweep the slip from 0.05 to 0.6 and back, with {loaded}", "slip", slip=sweep),
        made(f"drive up and down a slope of 12°, {here}", "pitch", pitch_deg=[0.0, 12.0, -12.0, 12.0, 0.0]),
        made(
            f"drive forwards and back in reverse, {here}",
            "speed",
            speed={"steps": [1.0, 1.0, 0.0, -1.0, -1.0]},
        ),
        made(
            f"drive while the motor warms from {warm} to {warm + _WARMER:.0f} °C, {here}",
            "motor_temperature",
            motor_temperature=[warm, warm + _WARMER],
        ),
        made(
            f"drive out, back and out again on the same track, {here}",
            "pass_number",
            drive="passes",
            speed=None,
        ),
        made(
            f"drive turns to either side with slip angles of up to 12°, {here}",
            "slip_angle",
            drive="turns",
            slip_angle_deg=None,
        ),
        made(
            f"change the slip every 3 s from {quick[0]:.2f} to {quick[1]:.2f} and back, with {loaded}",
            "rates",
            slip={"steps": quick},
        ),
        made(
            f"change the slip every 3 s from {quick[0]:.2f} to {quick[1]:.2f} and back, at {speeds} in turn "
            f"with {loaded}",
            "rates",
            "speed",
            slip={"steps": quick},
            speed={"steps": [1.0, 0.4, 2.5]},
        ),
        made(
            f"accelerate and brake between {at.speed * 0.5:.2g} and {at.speed * 2.0:.2g} m/s, {here}",
            "speed",
            "angular_velocity_rate",
            speed=spurts,
        ),
        made(
            f"lift the wheel until {lifted} N are left on it, and turn it at {speeds}, {here}",
            "load",
            "speed",
            load=_LIFTED,
            speed=pacing,
        ),
        made(
            f"drive with {lifted}, {loads} on the wheel in turn, {here}",
            "load",
            load={"steps": [1.0, _LIFTED, 0.6, 1.4] * 2},
        ),
        made(
            f"drive with {number(at.load)} and {number(at.load * _HEAVY)} N on the wheel in turn, {here}",
            "load",
            load={"steps": [1.0, _HEAVY] * 3},
        ),
        made(
            f"sweep the slip from 0.05 to 0.6 and back with {loads} on the wheel in turn",
            "load",
            "slip",
            load={"steps": [1.0, 0.6, 1.4]},
            slip=[0.05, 0.6] * 3 + [0.05],
        ),
        made(f"{braked}, with {loaded}", "slip", slip=through),
        made(
            f"{braked} with {loads} on the wheel in turn",
            "load",
            "slip",
            load={"steps": [1.0, 0.6, 1.4]},
            slip=through,
        ),
        made(
            f"sweep the slip from 0.05 to 0.6 and back at {speeds}, at each with {loads} in turn",
            "load",
            "slip",
            "speed",
            load={"steps": [1.0, 0.6, 1.4] * 3},
            speed={"steps": [speed for speed in (1.0, 0.4, 2.5) for _ in range(3)]},
            slip=[0.05, 0.6] * 9 + [0.05],
        ),
        made(
            f"drive at {speeds} in turn, at each with {lifted}, {loads} on the wheel, while the motor warms "
            f"from {warm} to {warm + _WARMER:.0f} °C in the first half, {here}",
            "load",
            "speed",
            "motor_temperature",
            load={"steps": [1.0, _LIFTED, 0.6, 1.4] * 3},
            speed={"steps": [speed for speed in (1.0, 0.4, 2.5) for _ in range(4)]},
            # What shows in a few stretches only, heavy and late ones, proves little.
            motor_temperature=[warm, warm + _WARMER, warm + _WARMER],
        ),
    ]
