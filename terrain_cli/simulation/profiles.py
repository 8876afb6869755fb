"""How slip, load, speed and the like vary in time: numbers, ramps, steps and swings.

A profile is written as a number; as a list of values, evenly spaced in time, with straight lines
between; as ``{ steps = [...] }``, evenly long, one after another; or as
``{ mean = …, swing = …, period = … }``, smooth and never repeating.
"""

from __future__ import annotations

import math
import zlib
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from terrain_cli.errors import ConfigurationError
from terrain_cli.vocabulary import toml_files

if TYPE_CHECKING:
    from terrain_cli.vocabulary.arrays import Array
    from terrain_cli.vocabulary.toml_files import Rule

#: Times between the points of a course in s.
STEP = 0.01
#: s, over which every change is rounded off: no motor, and no derivative, knows a corner.
FLANK = 0.5


@dataclass(frozen=True, slots=True)
class Profile:
    """A quantity over one part of a drive."""

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


def constant(value: float) -> Profile:
    return Profile("ramps", (value,))


def profile_rule(what: str, low: float, high: float) -> Rule:
    """Return the rule for a `Profile` with values within bounds, which `what` says in words."""
    number = toml_files.number(what, low, high)
    swing = toml_files.table(
        {
            "mean": number,
            "swing": toml_files.number("a number, at least 0", 0.0),
            "period": toml_files.number("a positive number of seconds", toml_files.ABOVE_ZERO),
        }
    )
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
            raise ConfigurationError(
                f"{place}: must be a number, a list of numbers, {{ steps = […] }} or "
                f"{{ mean = …, swing = …, period = … }}, not {value!r}"
            )
        return constant(number(value, place))

    return rule


def generator(seed: int, key: str) -> np.random.Generator:
    """Return random numbers for `key` that stay the same when others are drawn or not."""
    return np.random.default_rng([seed, zlib.crc32(key.encode())])


def smooth(values: Array) -> Array:
    """Round off the corners and steps of a course (at intervals of `STEP`), over `FLANK`."""
    half = round(FLANK / STEP / 2.0)
    window = np.hanning(2 * half + 3)[1:-1]
    padded = np.pad(values, half, mode="edge")
    # A constant comes out as it went in, to the last digit.
    return np.asarray(values[0] + np.convolve(padded - values[0], window / window.sum(), mode="valid"))
