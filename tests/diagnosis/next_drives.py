"""The drive that a diagnosis recommends, driven over the same soil with the same effect hidden."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from hidden_drives import LOAD, SPEED, drive_of, ramps, samples_from
from simulator import simulate, undulation

from terrain_cli.simulation.drive_file import CALM, PRESETS
from terrain_cli.windows.cut_windows import cut

#: What the words of a part mean here: the profile that they set, in which unit.
_UNITS = {
    "load": ("load", LOAD),
    "speed": ("speed", SPEED),
    "slip": ("slip", 1.0),
    "pitch_deg": ("pitch", math.radians(1.0)),
    "slip_angle_deg": ("slip_angle", math.radians(1.0)),
    "yaw_rate": ("yaw_rate", 1.0),
    "motor_temperature": ("motor_temperature", 1.0),
    "pass_number": ("pass_number", 1.0),
}
#: m/s, below which the wheel stands: those samples are left out.
SLOWEST = 0.1 * SPEED
_OF_TRACK = ("load", "slip", "motor_temperature", "pass_number")


def appended(seed, kind, soil_seed, settings, segments="auto"):
    """Drive what is recommended, and return its windows.

    Parameters
    ----------
    seed : int
        Of the noise.
    kind : Kind
        Of the drive that was diagnosed: its effect is hidden in this one too.
    soil_seed : int
        That drive's.
    settings : mapping
        A part of a drive, as `terrain-est simulate` takes it.
    """
    drive = drive_of(soil_seed, kind)
    part = {**CALM, **PRESETS.get(settings.get("drive", ""), {}), **settings}
    seconds = float(part.get("duration", kind.seconds))
    profiles = {
        name: _profile(part[word], factor, seconds, seed)
        for word, (name, factor) in _UNITS.items()
        if word in part
    }
    way = profiles["speed"]
    profiles |= {
        "speed": lambda t: np.maximum(np.abs(way(t)), SLOWEST),
        # Backwards, uphill is downhill: angles count the way the wheel turns.
        "pitch": _times_sign(profiles["pitch"], way),
        "pass_number": _passes(way, seconds),
    }
    track = replace(
        drive.tracks[0],
        soils=[(drive.tracks[0].soils[0][0], seconds)],
        **{name: profile for name, profile in profiles.items() if name in _OF_TRACK},
    )
    further = replace(
        drive,
        tracks=[track],
        seed=seed,
        **{name: profile for name, profile in profiles.items() if name not in _OF_TRACK},
    )
    columns = simulate(further).wheels["wheel"].aligned()
    speed = way(columns["time"])
    for name in ("velocity", "angular_velocity"):
        columns[name] = np.copysign(columns[name], speed)
    moving = np.abs(speed) > SLOWEST
    columns = {name: column[moving] for name, column in columns.items()}
    return [cut(samples_from(f"drive {seed}", columns, replace(kind, seconds=seconds)), segments)]


def _times_sign(profile, way):
    return lambda t: profile(t) * np.where(way(t) < 0.0, -1.0, 1.0)


def _passes(way, seconds):
    """Count how often the wheel has turned round: it comes back in its own rut."""
    grid = np.arange(0.0, seconds, 0.1)
    sign = np.sign(np.where(np.abs(way(grid)) > SLOWEST, way(grid), np.nan))
    known = np.flatnonzero(np.isfinite(sign))
    turns = grid[known[1:]][np.diff(sign[known]) != 0.0]
    return lambda t: np.searchsorted(turns, t, side="right").astype(float)


def _profile(value, factor, seconds, seed):
    """Return a profile as `terrain-est simulate` writes it: a number, ramps, steps or a swing."""
    if isinstance(value, dict) and "steps" in value:
        values = np.asarray(value["steps"], dtype=float) * factor
        return ramps(values, seconds / len(values))
    if isinstance(value, dict):
        mean, swing = value["mean"] * factor, value["swing"] * factor
        wave = undulation(1.0, 1.0, value["period"], seed)
        return lambda t: mean + swing * (wave(t) - 1.0)
    values = np.atleast_1d(np.asarray(value, dtype=float)) * factor
    return lambda t: np.interp(t, np.linspace(0.0, seconds, len(values)), values)
