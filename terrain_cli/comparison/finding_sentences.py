"""Findings in words."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from terrain_cli.comparison import comparison_criteria as criteria
from terrain_cli.vocabulary.quantities import listed

if TYPE_CHECKING:
    from collections.abc import Sequence

    from terrain_cli.comparison.shapes import Shape

#: SI unit → the one a person reads, and the factor to it.
_SHOWN = {"rad": ("°", math.degrees(1.0)), "rad/s": ("°/s", math.degrees(1.0)), "1": ("", 1.0)}
#: Drivers with one of their own.
_OWN = {"sinkage": ("mm", 1e3), "angular_velocity": ("rad/s", 1.0)}
_CHANNELS = {
    "torque": ("torque", "N m", 1.0),
    "drawbar_pull": ("drawbar pull", "N", 1.0),
    "sinkage": ("sinkage", "mm", 1e3),
}
_NAMES = {
    "velocity": "speed",
    "angular_velocity": "wheel speed",
    "pass_number": "pass",
    "wheel_angle": "angle of the wheel",
}


def of(
    channel: str,
    shape: Shape,
    amplitude: float,
    label: str,
    alternatives: Sequence[str],
    unit: str,
    seen: float = 1.0,
) -> str:
    """Say a finding in one sentence.

    `amplitude` is measured less predicted, in SI, and `seen` the part of it that shows in the residuals;
    `label` is the meaning of a label's code, `unit` the SI unit of the driver. `alternatives` are drivers
    that vary so much alike that it may be theirs.
    """
    name, shown, factor = _CHANNELS[channel]
    size = f"{_number(abs(amplitude) * factor)} {shown}"
    verb = "under-predicted" if amplitude > 0.0 else "over-predicted"
    driver = named(shape.driver)
    if shape.name == "constant":
        text = f"{name} is {verb} by {size} throughout"
    elif shape.name == "periodic":
        times = 2.0 * math.pi / (shape.at or 1.0)
        text = f"{name} swings by ± {size} about its prediction, {times:.0f} times in a turn of the wheel"
    elif shape.name == "label":
        text = f"{name} is {verb} by {size} where {driver} is {label}, against the others"
    elif shape.name == "step":
        text = f"{name} is {verb} by {size} above {driver} {_at(shape.at or 0.0, shape.driver, unit)}"
    else:
        low, high = (_at(value, shape.driver, unit) for value in (shape.low, shape.high))
        if shape.name == "quadratic":
            text = (
                f"{name} is {verb} by {size} at both ends of {driver}, {low} and {high}, against the middle"
            )
        else:
            text = f"{name} is more and more {verb} as {driver} rises: by {size} from {low} to {high}"
        if shape.name == "saturating":
            text += f", most of it in the first {_at(shape.at or 0.0, shape.driver, unit)}"
    if seen < criteria.HIDDEN:
        left = f"{_number(abs(amplitude) * seen * factor)} {shown}"
        text += f"; the fitted soil takes up all but {left} of that"
    if alternatives:
        text += f" (or with {listed([named(other) for other in alternatives], 'or')}, which varied alike)"
    return text


def missed(channel: str, error: float) -> str:
    """Say by how much a channel is missed: `error` is held out, root mean square, in SI."""
    name, shown, factor = _CHANNELS[channel]
    return f"the held-out error of {name} is {_number(error * factor)} {shown}"


def named(driver: str) -> str:
    """Return what a driver is called."""
    return _NAMES.get(driver, driver.replace("_", " "))


def _at(value: float, driver: str, unit: str) -> str:
    shown, factor = _OWN.get(driver) or _SHOWN.get(unit, (unit, 1.0))
    gap = "" if shown in ("", "°", "°/s") else " "
    return f"{_number(value * factor)}{gap}{shown}"


def _number(value: float) -> str:
    """Write two significant digits at the most; whole numbers of three and more as they are."""
    if value == 0.0 or not math.isfinite(value):
        return f"{value:g}"
    text = f"{value:.{max(0, 1 - math.floor(math.log10(abs(value))))}f}"
    return text.rstrip("0").rstrip(".") if "." in text else text
