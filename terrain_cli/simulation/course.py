"""Where the rover goes and how, on a fine time base: the body, and each wheel."""

import math
from collections.abc import Iterable
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from terrain_cli.errors import ConfigurationError
from terrain_cli.simulation.scenario import Place, Scenario
from terrain_cli.simulation.sensors import generator
from terrain_cli.telemetry.derived_channels import STANDING
from terrain_cli.vocabulary.arrays import Array, Index, Mask

STEP = 0.01  # Times between the points of a course in s
FLANK = 0.5  # s, over which every change is rounded off: no motor, and no derivative, knows a corner
_SAME_SPOT = 0.01  # In m: no rover comes back to the millimetre
OF_WHEEL = frozenset({"slip", "load"})  # Of one wheel: they swing with phases of their own


@dataclass(frozen=True)
class Ride:
    """Time series of one wheel, or of the origin of the body, at intervals of `STEP`."""

    place: Place
    time: Array  # shape (n,): in s since the start
    # shape (n,): velocity, pitch, roll, slip_angle, yaw_rate, acceleration, motor_temperature, heading, x, y,
    # elevation, and travel: metres along the track, which shrink in reverse. Of a wheel the velocity is that
    # of its centre, and there are load and slip as the soil feels them
    smooth: dict[str, Array]
    soil: Index  # shape (n,): index into the soils of the scenario
    pass_number: Array  # shape (n,)

    def at(self, time: Array) -> dict[str, Array]:
        """Return every series at some times; what jumps (soil, pass number) as it was at the last point."""
        last = np.clip(np.floor(time / STEP + 1e-6).astype(int), 0, len(self.time) - 1)
        found = {name: np.interp(time, self.time, values) for name, values in self.smooth.items()}
        return found | {"soil": self.soil[last], "pass_number": self.pass_number[last]}


def plan(scenario: Scenario) -> Ride:
    """Plan how the body goes: where its origin is there is no wheel, and no soil."""
    count = round(scenario.duration / STEP) + 1
    time = np.arange(count, dtype=np.float64) * STEP
    series = _profiles(scenario, "body", time, set(scenario.parts[0].profiles) - OF_WHEEL)
    velocity = scenario.speed * series.pop("speed")
    body = {
        "velocity": velocity,
        "acceleration": np.gradient(velocity, STEP),
        "yaw_rate": series["yaw_rate"],
        "motor_temperature": series["motor_temperature"],
        **{name: np.radians(series[f"{name}_deg"]) for name in ("pitch", "roll", "slip_angle")},
        "travel": _integral(velocity),
        "heading": _integral(series["yaw_rate"]),
    }
    # The wheels point where the body does; the slip angle is between that and the course.
    course = body["heading"] - body["slip_angle"]
    level = velocity * np.cos(body["pitch"])
    body["x"], body["y"] = _integral(level * np.cos(course)), _integral(level * np.sin(course))
    body["elevation"] = _integral(velocity * np.sin(body["pitch"]))
    return Ride(Place(""), time, body, np.zeros(count, dtype=np.intp), np.zeros(count))


def ride(scenario: Scenario, way: Ride, place: Place) -> Ride:
    """Return the ride of a wheel at its place of the body."""
    own = _profiles(scenario, place.name, way.time, OF_WHEEL)
    velocity = way.smooth["velocity"] - place.y * way.smooth["yaw_rate"]
    smooth_ = {**way.smooth, "velocity": velocity, "load": scenario.load * own["load"], "slip": own["slip"]}
    soils, passes = _soils(scenario, way, place), _passes(scenario, way, place)
    return Ride(place, way.time, smooth_, soils, passes)


def standing(velocity: Array, radius: float) -> Mask:
    """Tell where a wheel of some radius stands (m/s, m), as slow as readers of a log take for that."""
    return np.abs(velocity) <= STANDING * radius


def _profiles(scenario: Scenario, whose: str, time: Array, names: Iterable[str]) -> dict[str, Array]:
    found = {name: np.empty(len(time)) for name in sorted(names)}
    start = 0.0
    for number, part in enumerate(scenario.parts):
        here = time >= start - STEP / 2.0
        for name, series in found.items():
            rng = generator(scenario.seed, f"{whose} {name} {number}")
            series[here] = part.profiles[name].over(time[here] - start, part.duration, rng)
        start += part.duration
    return {name: smooth(series) for name, series in found.items()}


def smooth(values: Array) -> Array:
    """Round off the corners and steps of a course (at intervals of `STEP`), over `FLANK`."""
    half = round(FLANK / STEP / 2.0)
    window = np.hanning(2 * half + 3)[1:-1]
    padded = np.pad(values, half, mode="edge")
    # A constant comes out as it went in, to the last digit.
    return np.asarray(values[0] + np.convolve(padded - values[0], window / window.sum(), mode="valid"))


def _integral(rate: Array) -> Array:
    steps = 0.5 * (rate[1:] + rate[:-1]) * STEP
    return np.concatenate([[0.0], np.cumsum(steps)])


def _soils(scenario: Scenario, way: Ride, place: Place) -> Index:
    """Return the soil at each time: equal shares of the track that the body covers."""
    travel = way.smooth["travel"]
    low, high = float(travel.min()), float(travel.max())
    if len(scenario.soils) == 1:
        return np.zeros(len(travel), dtype=np.intp)
    if high - low < 0.01:
        raise ConfigurationError("the drive goes nowhere, and cannot meet several soils")
    ends = np.linspace(low, high, len(scenario.soils) + 1)[1:-1]
    # What lies beyond the track is like its end.
    return np.searchsorted(ends, travel + place.x, side="right")


def _passes(scenario: Scenario, way: Ride, place: Place) -> Array:
    """Count the wheels that drove before over the spot where a wheel is."""
    travel = way.smooth["travel"]
    spot = travel + place.x
    same = [other.x for other in scenario.wheels if math.isclose(other.y, place.y)]
    count = np.zeros(len(travel))
    turns = _turns(way.smooth["velocity"])
    for first, last in pairwise(turns):
        now = np.arange(first, last)
        forward = travel[last - 1] >= travel[first]
        for x in same:
            path = travel[first:last] + x
            over = (spot >= path.min() - _SAME_SPOT) & (spot <= path.max() + _SAME_SPOT)
            # Once this stretch is behind, whoever was here has been here.
            count[last:] += over[last:]
            if x != place.x:
                ahead = x > place.x if forward else x < place.x
                start = path[0]
                reached = spot[now] >= start if forward else spot[now] <= start
                count[now] += ahead & reached
    return count


def _turns(velocity: Array) -> list[int]:
    """Return where the direction of travel changes, with both ends."""
    sign = np.sign(velocity)
    moving = np.flatnonzero(sign)
    changes = moving[1:][sign[moving[1:]] != sign[moving[:-1]]] if len(moving) else []
    return [0, *(int(change) for change in changes), len(velocity)]
