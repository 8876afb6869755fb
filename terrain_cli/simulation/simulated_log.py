"""From a drive, as it is described, to the measurements of its sensors, and the truth behind them."""

import secrets
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from terrain_cli import effects
from terrain_cli.errors import ConfigurationError, InputError, UsageError
from terrain_cli.simulation import course, drive_file, perfect_sensors, sensors
from terrain_cli.simulation.course import Ride
from terrain_cli.simulation.scenario import Chosen, Scenario, drawn
from terrain_cli.vocabulary.arrays import Array

#: Channels that the message of a bag holds together, and how often it is sent: parts of the rate.
TOGETHER: dict[str, tuple[tuple[str, ...], float]] = {
    "joints": (("torque", "angular_velocity"), 1.0),
    "force": (("load", "drawbar_pull"), 1.0),
    "sinkage": (("sinkage",), 0.5),
    "odometry": (("velocity", "x", "y", "elevation"), 0.5),
    "attitude": (("pitch", "roll", "yaw_rate"), 2.0),
    "acceleration": (("acceleration",), 2.0),
    "slip_angle": (("slip_angle",), 0.5),
    "motor_temperature": (("motor_temperature",), 0.1),
    "pass_number": (("pass_number",), 1.0),
}


class SimulatedSeries(NamedTuple):
    """A measured channel."""

    time: Array  # shape (n,): in s since the start
    values: Array  # shape (n,): SI units; NaN where the sample was lost


class Stretch(NamedTuple):
    """A soil under a wheel, from start to end in s since the start of the drive."""

    soil: int
    start: float
    end: float


@dataclass(frozen=True)
class SimulatedLog:
    """What was measured of a drive, and the truth."""

    scenario: Scenario
    wheels: dict[str, dict[str, SimulatedSeries]]  # wheel → channel → `SimulatedSeries`
    body: dict[str, SimulatedSeries]  # Of the origin of the body
    # wheel → what perfect sensors show and what the soil feels, as `Physics.at` gives it, with "time" in s
    # since the start: whenever anything of the wheel was measured
    truth: dict[str, dict[str, Array]]
    stretches: dict[str, list[Stretch]]


def channels(scenario: Scenario) -> tuple[str, ...]:
    """Return the channels that a drive has: always the same, so that none tells of an effect."""
    return tuple(name for name in sensors.CHANNELS_WRITTEN if scenario.drawbar_pull or name != "drawbar_pull")


def rates(scenario: Scenario, *, bag: bool) -> dict[str, float]:
    """Return the rate of every channel in Hz; those of one message of a bag share the highest asked for."""
    if not bag:
        return {name: scenario.rates.get(name, scenario.rate) for name in channels(scenario)}
    found = {}
    for members, part in TOGETHER.values():
        asked = [scenario.rates[name] for name in members if name in scenario.rates]
        found.update(dict.fromkeys(members, max(asked) if asked else part * scenario.rate))
    return {name: found[name] for name in channels(scenario)}


def simulate(scenario: Scenario, *, bag: bool = False) -> SimulatedLog:
    """Drive and measure, as a bag or a table does; one scenario always gives the same numbers."""
    perfect_sensors.check_needs(scenario, channels(scenario))
    way = course.plan(scenario)
    clocks = {name: sensors.clock(rate, scenario.duration) for name, rate in rates(scenario, bag=bag).items()}
    log = SimulatedLog(scenario, {}, {}, {}, {})
    for place in scenario.wheels:
        ride = course.ride(scenario, way, place)
        time = np.unique(np.concatenate([*clocks.values()]))
        truth = {"time": time, **perfect_sensors.Physics(scenario, ride).at(time)}
        log.truth[place.name] = truth
        series = {name: _measure(scenario, place.name, name, at, truth) for name, at in clocks.items()}
        log.wheels[place.name] = series
        log.stretches[place.name] = _stretches(ride)
    for name in sorted(sensors.OF_BODY & clocks.keys()):
        log.body[name] = _measure(scenario, "", name, clocks[name], way.at(clocks[name]))
    return log


def _measure(
    scenario: Scenario, wheel: str, channel: str, time: Array, truth: Mapping[str, Array]
) -> SimulatedSeries:
    true = truth[channel]
    rows = np.searchsorted(truth["time"], time) if "time" in truth else np.arange(len(time))
    key = f"{'body' if channel in sensors.OF_BODY else wheel} {channel}"
    shown = true[rows]
    sensor = scenario.sensors.get(channel, sensors.Sensor())
    error = sensor.error(time, shown, scenario.duration, scenario.seed, key)
    if channel == "angular_velocity" and sensors.SLIP in scenario.sensors:
        # The wheel speeds from which a wrong slip follows.
        slip, velocity = truth["slip"][rows], truth["velocity"][rows]
        known = ~np.isnan(slip)
        slip = np.where(known, slip, 0.0)
        key = f"{wheel} {sensors.SLIP}"
        wrong = scenario.sensors[sensors.SLIP].error(time, slip, scenario.duration, scenario.seed, key)
        wrong = np.clip(slip + wrong, -0.95, 0.99)
        speed = perfect_sensors.wheel_speed(np.abs(velocity), wrong, scenario.geometry.radius)
        shown = np.where(known, np.copysign(speed, shown), shown)
    return SimulatedSeries(time, sensor.rounded(shown + error))


def _stretches(ride: Ride) -> list[Stretch]:
    bounds = [0, *(np.flatnonzero(np.diff(ride.soil)) + 1).tolist(), len(ride.soil) - 1]
    return [
        Stretch(int(ride.soil[start]), round(float(ride.time[start]), 6), round(float(ride.time[end]), 6))
        for start, end in pairwise(bounds)
    ]


#: Channels in which an effect must show.
_SEEN = ("load", "torque", "sinkage", "drawbar_pull", "angular_velocity")
#: Least rms change of one of them, as a share of its rms, and as a multiple of its noise.
_SHARE, _NOISES = 0.03, 1.0
#: Sizes drawn for an effect before another is taken.
_TRIES = 4
_SAMPLES = 400


def draw(scenario: Scenario) -> Scenario:
    """Add an effect and its size, drawn by the seed."""
    rng = sensors.generator(scenario.seed, "hidden effect")
    taken = {chosen.effect.id for chosen in scenario.effects}
    catalogue = effects.catalogue()
    names = sorted(catalogue.keys() - taken)
    way = course.plan(scenario)
    ride = course.ride(scenario, way, scenario.wheels[-1])
    time = np.linspace(0.0, scenario.duration, _SAMPLES)
    without = perfect_sensors.Physics(scenario, ride).at(time)
    for name in rng.permutation(names).tolist():
        for _ in range(_TRIES):
            chosen = Chosen(catalogue[name], drawn(catalogue[name], rng), hidden=True)
            candidate = replace(scenario, effects=(*scenario.effects, chosen))
            if _shows(candidate, ride, time, without) and _drives(candidate, way):
                return candidate
    hint = "vary slip, load and speed, as --drive mixed"
    raise InputError("no effect of the catalogue shows in this drive", hint=hint)


def _shows(scenario: Scenario, ride: Ride, time: Array, without: dict[str, Array]) -> bool:
    try:
        perfect_sensors.check_needs(scenario, channels(scenario))
        with np.errstate(all="ignore"):
            shown = perfect_sensors.Physics(scenario, ride).at(time)
    except (ConfigurationError, InputError):
        return False
    for name in set(_SEEN).intersection(channels(scenario)):
        change, size = shown[name] - without[name], _rms(without[name])
        if not np.all(np.isfinite(shown[name])):
            return False
        noise = _rms(scenario.sensors.get(name, sensors.Sensor()).white.at(without[name]))
        if _rms(change) > max(_SHARE * size, _NOISES * noise):
            return True
    return False


def _drives(scenario: Scenario, way: Ride) -> bool:
    """Tell whether no wheel gets stuck: later, the reason would tell of the effect."""
    try:
        for place in scenario.wheels:
            perfect_sensors.Physics(scenario, course.ride(scenario, way, place)).at(way.time)
    except InputError:
        return False
    return True


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


def drive(
    path: str | None,
    options: Mapping[str, Any],
    *,
    label: str = drive_file.COMMAND_LINE,
    hide: bool = False,
    bag: bool = False,
) -> SimulatedLog:
    """Simulate what a TOML file and options describe; with `hide` an effect drawn at random is added.

    UsageError tells of an impossible option; ConfigurationError the same of the file, or of an effect that
    needs what the drive does not have; InputError that a soil does not carry the load, that effects
    contradict each other, or that none to be hidden shows.
    """
    # A riddle that comes again is none.
    seed = secrets.randbits(31) if hide else 0
    try:
        scenario = drive_file.read(path, options, seed=seed, label=label)
    except ConfigurationError as error:
        if str(error).startswith(label):
            raise UsageError(str(error), hint=error.hint) from None
        raise
    return simulate(draw(scenario) if hide else scenario, bag=bag)


def table(log: SimulatedLog) -> dict[str, Array | list[str]]:
    """Return the log as one table, by time and then by wheel; NaN where a channel was not measured then."""
    parts = []
    for name, measured in log.wheels.items():
        time = log.truth[name]["time"]
        columns = {channel: np.full(len(time), np.nan) for channel in measured}
        for channel, series in measured.items():
            columns[channel][np.searchsorted(time, series.time)] = series.values
        parts.append((name, time, columns))
    return _stack(log, parts)


def truth_table(log: SimulatedLog) -> dict[str, Array | list[str]]:
    """Return the truth as one table with the rows of the log."""
    # Beside what perfect sensors show it has the soil, what that has of load, slip and sinkage ("true_…"),
    # and the parameters of the soil and of the effects.
    names = (*channels(log.scenario), "slip", "true_load", "true_slip", "true_sinkage")
    soils = log.scenario.soils
    called = np.array([soil.name for soil in soils], dtype=object)
    values = [soil.values(log.scenario.geometry.width) for soil in soils]
    parts = []
    for wheel, truth in log.truth.items():
        own = truth["soil"].astype(int)
        columns: dict[str, NDArray[Any]] = {"soil": called[own]}
        columns |= {name: sensors.ten_digits(truth[name]) for name in names}
        for parameter, column in SOIL_COLUMNS.items():
            columns[column] = np.array([row[parameter] for row in values])[own]
        for parameter, number in log.scenario.effect_values().items():
            columns[parameter] = np.full(len(own), number)
        parts.append((wheel, truth["time"], columns))
    return _stack(log, parts)


#: Parameter → its column in the truth.
SOIL_COLUMNS = {
    "cohesion": "cohesion_Pa",
    "tan_phi": "tan_phi",
    "shear_modulus": "shear_modulus_m",
    "stiffness": "stiffness_Pa_per_m_n",
    "sinkage_exponent": "sinkage_exponent",
}


def _stack(
    log: SimulatedLog, parts: Sequence[tuple[str, Array, Mapping[str, NDArray[Any]]]]
) -> dict[str, Array | list[str]]:
    time = np.concatenate([time for _, time, _ in parts])
    order = np.argsort(time, kind="stable")
    wheels = [name for name, time, _ in parts for _ in time]
    moments = np.round(log.scenario.start + time[order], 6)
    stacked: dict[str, Array | list[str]] = {"time": moments, "wheel": [wheels[row] for row in order]}
    for name in parts[0][2]:
        column = np.concatenate([columns[name] for _, _, columns in parts])[order]
        stacked[name] = column.tolist() if column.dtype == object else column
    return stacked
