"""A drive as the command line and DRIVE.toml describe it, also one with an effect that nobody names."""

from __future__ import annotations

import secrets
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from terrain_cli.errors import ConfigurationError, InputError, UsageError
from terrain_cli.simulation import course, drive_file, perfect_sensors
from terrain_cli.simulation.profiles import generator
from terrain_cli.simulation.scenario import Chosen, drawn
from terrain_cli.simulation.sensors import Sensor
from terrain_cli.simulation.simulated_log import SimulatedLog, channels, simulate

if TYPE_CHECKING:
    from collections.abc import Mapping

    from terrain_cli.simulation.scenario import Scenario
    from terrain_cli.vocabulary.arrays import Array


#: Channels in which an effect must show.
_SEEN = ("load", "torque", "sinkage", "drawbar_pull", "angular_velocity")
#: Least rms change of one of them, as a share of its rms, and as a multiple of its noise.
_SHARE, _NOISES = 0.03, 1.0
#: Sizes drawn for an effect before another is taken.
_TRIES = 4
_SAMPLES = 400


def draw(scenario: Scenario) -> Scenario:
    """Add an effect and its size, drawn by the seed."""
    from terrain_cli import effects

    rng = generator(scenario.seed, "hidden effect")
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
    raise InputError(
        "no effect of the catalogue shows in this drive", hint="vary slip, load and speed, as --drive mixed"
    )


def _shows(scenario: Scenario, ride: course.Ride, time: Array, without: dict[str, Array]) -> bool:
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
        noise = _rms(scenario.sensors.get(name, Sensor()).white.at(without[name]))
        if _rms(change) > max(_SHARE * size, _NOISES * noise):
            return True
    return False


def _drives(scenario: Scenario, way: course.Course) -> bool:
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
    """Simulate what a TOML file and options describe.

    Options are as for `drive_file.read`, and `label` is what messages call them; `bag` is as for `simulate`.
    With `hide` an effect drawn at random is added; without a seed, by a new one. UsageError tells of an
    option with an unknown name or an impossible value; ConfigurationError the same of the file, or of an
    effect that needs what the drive does not have; InputError that a soil does not carry the load, that
    effects contradict each other, or that none to be hidden shows.
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
