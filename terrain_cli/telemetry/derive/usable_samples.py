"""Which samples the estimators cannot use, and why; where a drive is interrupted."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from formats import Labels
from terrain_cli.telemetry.alignment import RESOLUTION, split_clock, stretch_gap
from terrain_cli.telemetry.derived_channels import STANDING
from terrain_cli.telemetry.wheel_samples import NEEDED

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from numpy.typing import NDArray

    Array = NDArray[np.float64]

#: The densest soils bear 0.6 MPa with a safety of 3 (BS 8004, presumed bearing values); Pa.
MOST_PRESSURE = 2e6
#: Cohesion of a soil that bears it: a strip presses with (2 + π) c at the most (Prandtl 1921); Pa.
_MOST_COHESION = MOST_PRESSURE / (2.0 + np.pi)
#: T/(W r) of friction alone, four times what the equations give (`plausibility.MOST_TORQUE`): judged.
_MOST_FRICTION = 10.0
#: z/r: on firm ground a sensor's noise may make a sinkage as small as it likes. Judged.
_LEAST_DEPTH = 0.01
#: No vehicle on soil is faster; m/s.
MOST_SPEED = 100.0
BACKWARDS = "time runs backwards"
STANDS = "wheel stands (ω = 0, slip undefined)"
SKIDS = "wheel skids (slip < 0)"


def set_aside(
    channels: Mapping[str, Array], time: Array | None, radius: float, width: float, *, skids: bool = False
) -> tuple[Labels, NDArray[np.intp]]:
    """Give each sample the first reason for which it cannot be used (else −1), and find clock restarts.

    Of the channels (SI) load and slip are needed, and others used where they are there. `skids` keeps the
    samples of a skidding wheel, which the whole model covers and the line does not.
    """
    n = len(channels["load"])
    names: list[str] = []
    codes = np.full(n, -1, dtype=np.int32)

    def because(reason: str, where: NDArray[np.bool_]) -> None:
        # Most are true of no sample.
        if not where.any():
            return
        first = where & (codes < 0)
        if first.any():
            codes[first] = len(names)
            names.append(reason)

    restarts = np.array([], dtype=np.intp)
    if time is not None:
        because("no time", ~np.isfinite(time))
        restarts, backwards, repeated = split_clock(time)
        because(BACKWARDS, backwards)
        because("time repeated", repeated)
    with np.errstate(invalid="ignore"):
        for reason, where in _unusable(channels, radius, width, skids=skids):
            because(reason, where)
    return Labels(codes, tuple(names)), restarts


def _unusable(
    channels: Mapping[str, Array], radius: float, width: float, *, skids: bool
) -> Iterator[tuple[str, NDArray[np.bool_]]]:
    """Yield what can be wrong with the values of a sample, and where it is, the plainest reason first."""
    omega = channels.get("angular_velocity")
    for name in NEEDED:
        if name not in channels:
            continue
        # A standing wheel has no slip, and is better told as that.
        if name == "slip" and omega is not None:
            yield STANDS, np.abs(omega) <= STANDING
        odd = ~np.isfinite(channels[name])
        if odd.any():
            yield f"no {name}", np.isnan(channels[name])
            yield f"{name} is infinite", odd
    for name in ("angular_velocity", "velocity"):
        if name in channels:
            yield f"{name} is infinite", np.isinf(channels[name])
    slip, load = channels["slip"], channels["load"]
    yield "wheel turns against its course (slip < -1)", slip < -1.0
    yield "wheel rolls against its drive (slip > 1)", slip > 1.0
    if "sinkage" in channels:
        yield "sinkage not positive", channels["sinkage"] <= 0.0
        yield "sinkage beyond the wheel radius", channels["sinkage"] >= radius
    yield "load not positive", load <= 0.0
    yield from _beyond(channels, radius, width)
    if not skids:
        # Last: what has no other fault is on the ground, which goes on under it.
        yield SKIDS, slip < 0.0


def _beyond(
    channels: Mapping[str, Array], radius: float, width: float
) -> Iterator[tuple[str, NDArray[np.bool_]]]:
    """Yield what no single sample can be, and where it is."""
    depth = np.clip(channels.get("sinkage", np.array(radius)) / radius, _LEAST_DEPTH, 1.0)
    area = width * radius * np.sqrt((2.0 - depth) * depth)
    force = _MOST_COHESION * area + _MOST_FRICTION * np.abs(channels["load"])
    limits = {
        "load": (MOST_PRESSURE * area, "load beyond what soil bears"),
        "torque": (force * radius, "torque beyond what soil takes"),
        "drawbar_pull": (force, "drawbar_pull beyond what soil takes"),
        "velocity": (MOST_SPEED, "velocity beyond that of any vehicle"),
        "angular_velocity": (MOST_SPEED / radius, "angular_velocity beyond that of any vehicle"),
    }
    for name, (limit, reason) in limits.items():
        if name in channels:
            yield reason, np.abs(channels[name]) > limit


def also_aside(reasons: Labels, reason: str, where: NDArray[np.bool_]) -> Labels:
    """Set further samples aside; where there was a reason already, that stays."""
    new = where & (reasons.codes < 0)
    if not new.any():
        return reasons
    codes = np.where(new, np.int32(len(reasons.names)), reasons.codes)
    return Labels(codes, (*reasons.names, reason))


def stretches(
    time: Array | None,
    reasons: Labels,
    *,
    runs: Labels | None = None,
    restarts: NDArray[np.intp] | None = None,
    max_gap: float,
) -> NDArray[np.intp]:
    """Give each sample the number of its continuous stretch of the drive.

    A new one begins with another run, a restart of the clock, and after a gap: nothing recorded, or
    nothing usable, for longer than `max_gap`. A wheel that stands or skids does not interrupt the
    ground under it.

    Numbers rise from 0; a gap is counted at the first sample on the ground behind it. Without a clock only
    runs count.
    """
    n = len(reasons)
    begins = np.zeros(n, dtype=bool)
    if runs is not None:
        begins[1:] |= runs.codes[1:] != runs.codes[:-1]
    if restarts is not None:
        begins[restarts] = True
    if time is not None and n:
        if not begins.any() and (reasons.codes < 0).all() and np.all(np.diff(time) <= max_gap):
            # As most drives are; the rest would find the same.
            return np.zeros(n, dtype=np.intp)
        driven = driving_time(time, reasons, max_gap)
        ground = on_ground(reasons)
        begins[ground[1:][np.diff(driven[ground]) > max_gap + RESOLUTION]] = True
    return np.cumsum(begins)


def longest_gap(time: Array, reasons: Labels, max_gap: float | None) -> float:
    """Return the longest time without a sample (s) that does not interrupt a drive: see `stretch_gap`.

    A sample of which a value is missing is as good as none.
    """
    missing = [code for code, name in enumerate(reasons.names) if name.startswith("no ")]
    there = time[~np.isin(reasons.codes, missing)] if missing else time
    return stretch_gap(there if len(there) > 1 else time, max_gap)


def on_ground(reasons: Labels) -> NDArray[np.intp]:
    """Return the samples that follow the ground: those usable, and those in which the wheel skids."""
    return np.flatnonzero((reasons.codes < 0) | _is(reasons, SKIDS))


def driving_time(time: Array, reasons: Labels, max_gap: float) -> Array:
    """Return a clock (s, never falling) that stops while the wheel stands: only lost driving is a gap."""
    standing, astray = (_is(reasons, reason) for reason in (STANDS, BACKWARDS))
    known, clock, n = np.isfinite(time) & ~astray, time, len(time)
    if not known.all():
        clock = np.interp(np.arange(n), np.flatnonzero(known), time[known]) if known.any() else np.zeros(n)
    step = np.diff(clock, prepend=clock[0])
    step[standing & (step <= max_gap + RESOLUTION)] = 0.0
    return np.asarray(np.cumsum(np.maximum(step, 0.0)))


def _is(reasons: Labels, reason: str) -> NDArray[np.bool_]:
    code = reasons.names.index(reason) if reason in reasons.names else -2
    return np.asarray(reasons.codes == code)
