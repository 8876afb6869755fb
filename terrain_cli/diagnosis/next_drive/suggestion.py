"""The drive that tells the effects of a family apart, and how surely it will."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations
from typing import TYPE_CHECKING

import numpy as np

from terrain_cli.comparison.comparison_outcome import UNITS
from terrain_cli.diagnosis import diagnosis_criteria as criteria
from terrain_cli.diagnosis.diagnosis_outcome import NextDrive
from terrain_cli.diagnosis.next_drive import manoeuvres
from terrain_cli.diagnosis.next_drive.power import PowerLog, Side, margins

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from terrain_cli.diagnosis.diagnosis_outcome import Hypothesis
    from terrain_cli.diagnosis.next_drive.manoeuvres import Manoeuvre
    from terrain_cli.diagnosis.refits import Ground, Refit

    Array = NDArray[np.float64]

#: s that a manoeuvre lasts.
SECONDS = 60.0
#: How a sensor is checked without any soil, by what it shows.
_CHECKS = {
    "load": "calibrate the load cell with known weights",
    "sinkage": "check the sinkage sensor on firm ground",
    "drawbar_pull": "calibrate the drawbar pull sensor with known weights",
    "slip": "measure the distance of ten turns on firm ground",
    "torque": "calibrate the torque with a known brake",
}


def suggest(
    data: Ground,
    pairs: Sequence[tuple[Hypothesis, Refit]],
    *,
    most: int = 3,
    seconds: float = SECONDS,
) -> list[NextDrive]:
    """Find the drive that tells the best of a family, which comes first, from each of the others.

    Of several wheels, the one with most samples drives. Where no drive tells, it says so and what does, with
    the power of the drive that tells most, and without settings. Drives that vary a channel which the log
    lacks are left out: neither effect reads it.
    """
    if len(pairs) < 2 or most < 1:
        return []
    wheel = int(np.argmax([np.count_nonzero(part.use) for part in data.data]))
    part = data.data[wheel]
    if not part.use.any() or "slip" not in part.inputs:
        return []
    ground = PowerLog(data, wheel, pairs[0][1])
    sides = [Side(ground, hypothesis, refit.solutions[wheel]) for hypothesis, refit in pairs[: most + 1]]
    at = manoeuvres.Conditions.of(part)
    channels = set(part.inputs) | set(part.measured)
    known = [one for one in manoeuvres.library(at, seconds) if one.possible(channels)]
    table = np.array([margins(ground, sides, one.drive(at)) for one in known])
    every = [_Pair(sides[a], sides[b], _both(table, a, b)) for a, b in combinations(range(len(sides)), 2)]
    whole = np.mean([np.minimum(pair.worst, criteria.SURE_OF_BENT_LAWS) for pair in every], axis=0)
    found = [_best(pair, known, whole) for pair in every if pair.one is sides[0]]
    # What is driven first had better settle more than its own pair.
    return [drive for drive, _ in sorted(found, key=lambda one: -one[1])]


def _both(table: Array, a: int, b: int) -> Array:
    """Return the margins of a pair, either of them being the truth, shape (drives, any)."""
    return np.concatenate([table[:, a, b], table[:, b, a]], axis=1)


@dataclass(frozen=True)
class _Pair:
    """Two of a family, and the margins by which each drive tells them apart, shape (drives, any)."""

    one: Side
    other: Side
    margins: Array

    @property
    def worst(self) -> Array:
        return np.asarray(self.margins.min(axis=1))

    @property
    def power(self) -> Array:
        """How often each drive leads to the right one of the two, at most `criteria.MOST_POWER`."""
        from scipy.special import ndtr

        return np.asarray(np.minimum(ndtr(self.margins).mean(axis=1), criteria.MOST_POWER))


def _best(pair: _Pair, known: Sequence[Manoeuvre], whole: Array) -> tuple[NextDrive, float]:
    """Choose the drive for a pair, and return how much it settles of the whole family."""
    names, power = (pair.one.hypothesis.id, pair.other.hypothesis.id), pair.power
    best = float(power.max())
    if best < criteria.LEAST_POWER:
        return NextDrive(names, _unsettled(pair.one.hypothesis, pair.other.hypothesis, best), best), 0.0
    follows = manoeuvres.drivers({*_reads(pair.one), *_reads(pair.other)})

    def plainness(place: int) -> tuple[bool, bool, int]:
        # What an effect follows by its own law is the plainest question to ask.
        own = known[place].varies & follows
        return not own - {"speed"}, not own, place

    able = np.flatnonzero(power >= max(best - criteria.SAME_POWER, criteria.LEAST_POWER))
    sure = min(float(pair.worst[able].max()), criteria.SURE_OF_BENT_LAWS)
    level = able[pair.worst[able] >= sure - criteria.SAME_MARGIN]
    most = float(whole[level].max())
    chosen = min((int(p) for p in level if whole[p] >= most - criteria.SAME_MARGIN), key=plainness)
    drive = NextDrive(names, known[chosen].text, float(power[chosen]), known[chosen].part)
    return drive, float(whole[chosen])


def _reads(side: Side) -> set[str]:
    # Every drive has a load and a slip: that a law reads them says nothing of what it follows.
    return {name for effect in side.hypothesis.effects for name in effect.reads} - {"load", "slip", *UNITS}


def _unsettled(one: Hypothesis, other: Hypothesis, best: float) -> str:
    said = []
    for effect in (*one.effects, *other.effects):
        checks = [_CHECKS[name] for name in effect.laws if name in _CHECKS and effect.kind == "sensor"]
        said += checks or ([effect.settled_by] if effect.settled_by else [])
    sensors = [text for text in said if text in _CHECKS.values()]
    what = " or ".join(dict.fromkeys(sensors or said))
    ending = f": {what}" if sensors else (f"; what may: {what}" if what else "")
    return f"no drive tells them apart for sure (the best in {best:.0%} of all cases){ending}"
