"""Effects that are in no catalogue: what they do to a drive, and the answers that are right."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, TypeAlias

import numpy as np
from simulator import undulation

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

Shown: TypeAlias = dict[str, np.ndarray]
#: Levels and s of the columns that go in steps.
LEVELS, STEP = 6, 4.0


@dataclass(frozen=True)
class Outside:
    """An effect in no catalogue.

    Parameters
    ----------
    says : str
        What it is, with its full size.
    right : mapping of str to tuple of str
        Channel, or inner quantity → the drivers that are right for it.
    change : callable, optional
        Changes what perfect sensors show, given the size.
    column : str, optional
        The further column that drives it.
    soil : bool
        Whether it changes the soil: the friction of patches then follows `column`.
    near : tuple of str
        Effects of the catalogue whose name would not be wrong.
    values : callable, optional
        Profile of the column, given the length in s and the seed.
    """

    says: str
    right: Mapping[str, tuple[str, ...]]
    change: Callable[[Shown, float], None] | None = None
    column: str | None = None
    soil: bool = False
    near: tuple[str, ...] = ()
    values: Callable[[float, int], Callable[[np.ndarray], np.ndarray]] | None = None

    def columns(self, seconds, seed):
        """Return the column that drives it, as a profile by its name."""
        return {self.column: self.values(seconds, seed)} if self.column and self.values else {}

    def law(self, size):
        """Return what changes the sensors, as `simulator.Drive` takes it."""
        return lambda shown: self.change(shown, size)

    def patches(self, soil, seconds, size, seed):
        """Return the soil in patches, whose tan φ falls by 15 % from a column of 0 to one of 0.2."""
        n = math.ceil(seconds / STEP)
        share = self.values(seconds, seed)((np.arange(n) + 0.5) * STEP)
        varieties = {
            s: replace(
                soil,
                name=f"{soil.name} {s}",
                friction_angle=math.atan((1.0 - 0.75 * size * s) * soil.tan_phi),
            )
            for s in np.unique(share).tolist()
        }
        return [(varieties[s], seconds / n) for s in share.tolist()]


def _levels(_seconds, seed):
    """Return levels from 0 to 0.2 that change every 4 s."""
    some = np.random.default_rng([7, seed]).integers(LEVELS, size=1000) / (LEVELS - 1) * 0.2
    return lambda t: some[np.floor(np.maximum(t, 0.0) / STEP + 1e-9).astype(int)]


def _flag(_seconds, seed):
    """Return 0 or 1, for 12 s each or so."""
    some = np.random.default_rng([8, seed]).random(400)
    return lambda t: (
        (some[np.floor(np.maximum(t, 0.0) / 12.0 + 1e-9).astype(int)] + (t // 12.0 % 2) > 1.0) * 1.0
    )


def _wave(mean, share, span):
    return lambda _seconds, seed: undulation(mean, share, span, seed + 12)


def _add(channel, of):
    def change(shown, size):
        shown[channel] = shown[channel] + size * of(shown)

    return change


_SPEED = ("angular_velocity", "velocity")
_DRAG = ("torque", "drawbar_pull", "tan_phi", "shear_stress")

OUTSIDE: dict[str, Outside] = {
    "cable": Outside(
        "a cable is dragged along in turns: DP − 40 N s/rad · |yaw rate|",
        {"drawbar_pull": ("yaw_rate",)},
        _add("drawbar_pull", lambda shown: -40.0 * np.abs(shown["yaw_rate"])),
    ),
    "tilted-camera": Outside(
        "the camera that sees the sinkage tilts with the rover: z + 10 mm/rad · pitch",
        {"sinkage": ("pitch",)},
        _add("sinkage", lambda shown: 0.010 * shown["pitch"]),
    ),
    "warm-cell": Outside(
        "the cell of the drawbar pull warms with the motor: DP + 0.05 N/K · (Tm − 25 °C)",
        {"drawbar_pull": ("motor_temperature",)},
        _add("drawbar_pull", lambda shown: 0.05 * (shown["motor_temperature"] - 25.0)),
    ),
    "eccentric": Outside(
        "the wheel is out of balance: T + 0.25 N m · sin(angle)",
        {"torque": ("wheel_angle",)},
        _add("torque", lambda shown: 0.25 * np.sin(shown["wheel_angle"] + 0.7)),
    ),
    "amplifier": Outside(
        "the amplifier's zero follows the bus: T + 0.15 N m/V · (U − 28 V)",
        {"torque": ("bus_voltage",)},
        _add("torque", lambda shown: 0.15 * (shown["bus_voltage"] - 28.0)),
        "bus_voltage",
        values=_wave(28.0, 0.1, 16.0),
    ),
    "drill": Outside(
        "the rover stands deeper while a drill hangs out: z + 1.2 mm",
        {"sinkage": ("drill_out",)},
        _add("sinkage", lambda shown: 0.0012 * shown["drill_out"]),
        "drill_out",
        values=_flag,
    ),
    "hitch": Outside(
        "a hitch pulls, and slips: DP + 2 N · tanh(angle / 0.1 rad)",
        {"drawbar_pull": ("hitch_angle",)},
        _add("drawbar_pull", lambda shown: 2.0 * np.tanh(shown["hitch_angle"] / 0.1)),
        "hitch_angle",
        values=lambda _seconds, seed: lambda t: undulation(0.3, 1.0, 14.0, seed + 12)(t) - 0.3,
    ),
    "moisture": Outside(
        "moist soil is slippery: tan φ (1 − 0.75 · moisture), moisture from 0 to 0.2",
        dict.fromkeys(_DRAG, ("moisture",)),
        column="moisture",
        soil=True,
        values=_levels,
    ),
    "seal": Outside(
        "a seal drags with the square of the wheel's speed: T + 0.08 N m s²/rad² · ω²",
        {"torque": _SPEED},
        _add("torque", lambda shown: 0.08 * shown["angular_velocity"] ** 2),
        near=("drivetrain-friction",),
    ),
}
