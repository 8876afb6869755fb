"""Quantities, numbers and words as people read them."""

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

from terrain_cli.vocabulary.channels import CHANNELS

#: SI unit → the unit shown, and the factor from one to the other.
_SHOWN = {
    "1": ("", 1.0),
    "Pa": ("kPa", 1e-3),
    "rad": ("°", 57.29577951308232),
    "rad/s": ("°/s", 57.29577951308232),
    "rad/s²": ("°/s²", 57.29577951308232),
}
_IN_MM = frozenset({"sinkage"})  # Lengths are shown in m, save these
#: What a channel is called in sentences and pictures, where that is not its name.
_WORDS = {"velocity": "speed", "angular_velocity": "wheel speed", "pass_number": "pass"}
_DERIVED = frozenset({"wheel_angle"})  # Drivers that no log holds
#: The forces on a wheel, in the order in which they are shown.
PREDICTED = ("torque", "drawbar_pull", "sinkage")


ONLY_WHEEL = "wheel"  # The name of a wheel that nothing names


def the_wheel(name: str) -> str:
    """Return what a wheel is called in a sentence."""
    return "the wheel" if name == ONLY_WHEEL else f"wheel {name}"


def counted(number: int, noun: str, ending: str = "s") -> str:
    return f"{number:,} {noun}{'' if number == 1 else ending}"


def listed(names: Sequence[str], last: str = "and") -> str:
    """Join names: "a, b and c"."""
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} {last} {names[-1]}"


class Quantity(NamedTuple):
    """Something measured, as it is shown."""

    #: Name, symbol and unit; the latter two may be empty.
    words: str
    symbol: str
    unit: str
    factor: float  # From SI to `unit`

    @property
    def label(self) -> str:
        """Name, symbol and unit: "torque T (N m)"."""
        symbol = f" {self.symbol}" if self.symbol and self.symbol != self.words else ""
        return f"{self.words}{symbol}{self.in_unit}"

    @property
    def in_unit(self) -> str:
        """The unit in brackets behind a space, or nothing."""
        return f" ({self.unit})" if self.unit else ""


def quantity(name: str, unit: str) -> Quantity:
    """Return how a channel or driver is shown; its unit is SI, and empty where it is not known."""
    channel = CHANNELS.get(name)
    shown, factor = ("mm", 1e3) if name in _IN_MM and unit == "m" else _SHOWN.get(unit, (unit, 1.0))
    if name == "angular_velocity":
        # The speed of a wheel is not told in degrees.
        shown, factor = unit, 1.0
    words = _WORDS.get(name) or (name.replace("_", " ") if channel or name in _DERIVED else name)
    return Quantity(words, channel.symbol if channel else "", shown, factor)


def number(value: float, digits: int = 3) -> str:
    """Write a number for a person: so many digits, no exponent where its size is common, – where unknown."""
    if value != value:  # noqa: PLR0124 - NaN
        return "–"
    text = f"{value:.{digits}g}"
    if "e" in text and 1e-5 <= abs(value) < 1e7:
        text = f"{value:.0f}" if abs(value) >= 1.0 else f"{value:.{digits + 4}f}".rstrip("0")
    return text


def plus_minus(value: float, error: float) -> str:
    """Write a value with its standard error, if that is known, to the digits that the error leaves."""
    if not error > 0.0 or error == float("inf") or value != value:  # noqa: PLR0124 - NaN
        return number(value)
    digits = max(0, 1 - int(f"{error:.1e}".partition("e")[2]))
    return f"{value:.{digits}f} ± {error:.{digits}f}"


def short(value: float, digits: int = 3) -> str:
    """Write a number rounded to so many digits, – where it is unknown or infinite."""
    return number(float(f"{value:.{digits}g}"), digits) if math.isfinite(value) else "–"


def known(value: float) -> float | None:
    """Return a number as JSON has it: null where unknown."""
    return float(value) if math.isfinite(value) else None


def entries(found: object, *names: str) -> dict[str, Any]:
    """Return some of what a result holds as JSON has it: null for an unknown number and an empty text."""
    values: dict[str, Any] = {}
    for name in names:
        value = getattr(found, name)
        if isinstance(value, float):
            value = known(value)
        values[name] = list(value) if isinstance(value, tuple) else None if value == "" else value
    return values
