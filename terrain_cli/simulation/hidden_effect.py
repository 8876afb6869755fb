"""An effect drawn at random, of those that a drive can show."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from terrain_cli.errors import ConfigurationError, InputError
from terrain_cli.simulation import course, perfect_sensors
from terrain_cli.simulation.profiles import generator
from terrain_cli.simulation.sensors import Sensor
from terrain_cli.simulation.simulated_effects import Chosen, drawn
from terrain_cli.simulation.simulated_log import channels

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from terrain_cli.simulation.scenario import Scenario

    Array = NDArray[np.float64]

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
