"""Wrong units, and frozen sensors, found by how channels change together in a drive."""

from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from terrain_cli.telemetry.derive.unit_doubts import BLOCKS, Mend, Suspicion

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from terrain_cli.telemetry.derive.unit_doubts import UnitEvidence

    Array = NDArray[np.float64]

#: Samples of which none differs from the others; and what a person reads off a scale.
STUCK, ROUNDED = 20, ("sinkage", "entry_angle")
#: Share of a drive in which a channel is frozen, that weighs on an estimate. Judged.
LONG = 0.1
#: Change of DP over that of T/r, in a stretch of an eighth of the drive, of at least ten samples, in which
#: they follow each other at the same load. Simulated drives of every soil, manoeuvre and effect of the
#: catalogue, with noise up to 5 %: 0.57 (slip-sinkage) to 1.06. Where they were less alike, noise or soils
#: that change within a stretch made 0.04.
LEAST_PULL, MOST_PULL, ALIKE_PULL, FEWEST = 0.4, 1.2, 0.9, 10
#: What a typical drive has of that.
_PULL = 0.95


def pull(e: UnitEvidence) -> Suspicion | None:
    """Set the changes of the drawbar pull against those of the torque, at the same load.

    Both are the shear stress under the wheel: in a stretch of a drive the pull changes by as much as T/r.
    """
    found = e.columns("drawbar_pull", "torque", "load") if {"drawbar_pull", "time"} <= e.measured else None
    if found is None:
        return None
    force, torque, load = found
    bounds = np.linspace(0, len(force), BLOCKS + 1).astype(int)
    times = [
        _changes(force[a:b], torque[a:b] / e.geometry.radius, load[a:b])
        for a, b in pairwise(bounds)
        if b - a >= FEWEST
    ]
    known = [value for value in times if value is not None]
    if len(known) < max(1.0, BLOCKS / 2):
        return None
    middle = float(np.median(known))
    if LEAST_PULL <= middle <= MOST_PULL:
        return None
    what = (
        f"drawbar_pull changes by {middle:.2g} of what torque over wheel radius changes by, at the same load"
    )
    options = {
        **{Mend("drawbar_pull", unit): 1.0 for unit in ("kgf", "lbf", "kN", "mN")},
        Mend("drawbar_pull", "kgf", 1e-3): 1.0,
        **{Mend("torque", unit): -1.0 for unit in ("lbf ft", "N mm", "N cm", "kN m")},
        Mend("motor_current", "mA"): -1.0,
    }
    there = [mend for mend in options if mend.channel in e.feeds]
    best = min(there, key=lambda m: abs(np.log(abs(middle) * m.factor ** options[m] / _PULL)))
    if middle < 0.0:
        best = Mend("drawbar_pull", "N", -1.0)
    return Suspicion(what, best.channel, best)


def _changes(pull: Array, rim: Array, load: Array) -> float | None:
    """Return the ratio of the changes of two forces that follow each other; None where they do not."""
    with np.errstate(all="ignore"):
        known = np.column_stack([load / np.median(load), np.ones(len(load))])
        parts = np.column_stack([pull, rim])
        if not np.isfinite(known).all():
            return None
        pull, rim = (parts - known @ np.linalg.lstsq(known, parts, rcond=None)[0]).T
        alike = float(pull @ rim / np.sqrt((pull @ pull) * (rim @ rim)))
        return float(np.copysign(np.std(pull) / np.std(rim), alike)) if abs(alike) > ALIKE_PULL else None


def stuck(name: str) -> Callable[[UnitEvidence], Suspicion | None]:
    """Return a check of a channel that must change where slip or load do."""

    def check(e: UnitEvidence) -> Suspicion | None:
        least, greatest = e.ends.get(name, (0.0, 1.0))
        always = least == greatest
        if name not in e.measured or e.count < STUCK or (always and name == "load"):
            return None
        # A sinkage that was rounded to one or two digits may well be the same all the time.
        coarse = name in ROUNDED and len(f"{abs(least):.9g}".replace(".", "").strip("0")) < 3
        for other, changes in (("slip", 0.3 if coarse else 0.1), ("load", 1.5 if coarse else 1.2)):
            columns = e.columns(name, other)
            run = columns and (slice(None) if always else _frozen(columns[0]))
            if not columns or not run or other == name:
                continue
            same, others = columns[0][run], columns[1][run]
            low, high = np.quantile(others, [0.05, 0.95])
            if high - low >= changes if other == "slip" else 0.0 < changes * low <= high:
                share = len(same) / len(columns[0])
                where = "every sample" if always else f"{share:.0%} of the samples, one after another"
                what = f"{name} is {same[0]:.4g} in {where}, while {other} goes from {low:.3g} to {high:.3g}"
                return Suspicion(what, name)
        return None

    return check


def _frozen(values: Array) -> slice | None:
    """Find the longest run of one value in a channel that otherwise changes from sample to sample."""
    bounds = np.flatnonzero(np.concatenate([[True], values[1:] != values[:-1], [True]]))
    lengths = np.diff(bounds)
    longest = int(lengths.argmax())
    length = int(lengths[longest])
    rest = len(values) - length
    # What is rounded, or held until the next value comes, has runs all the time.
    if length < max(STUCK, LONG * len(values)) or rest < STUCK or len(lengths) - 1 < 0.5 * rest:
        return None
    return slice(int(bounds[longest]), int(bounds[longest]) + length)
