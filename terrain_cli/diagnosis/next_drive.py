"""The drive that tells the effects of a family apart, and how surely it will.

Both of two effects are fitted to the log at hand. Each in turn is taken for the truth: what a manoeuvre
would show then is forecast, and the other one is fitted to log and manoeuvre together, to first order. What
it cannot imitate there, in units of the noise, is the distance between the two (optimal discrimination,
Atkinson & Fedorov 1975, Biometrika 62(1), 57–70). A law is never exactly that of the catalogue: the same is
done with the truth bent as in `refit_ranking`, which neither of the two can imitate.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from statistics import NormalDist

import numpy as np
from numpy.typing import NDArray

from terrain_cli.comparison import distributions, smoothed_model
from terrain_cli.comparison.blocks import error
from terrain_cli.comparison.comparison_outcome import UNITS
from terrain_cli.comparison.smoothed_fit import Solution
from terrain_cli.comparison.smoothed_model import SmoothedData
from terrain_cli.diagnosis import diagnosis_criteria as criteria
from terrain_cli.diagnosis import manoeuvres
from terrain_cli.diagnosis.diagnosis_outcome import Hypothesis, NextDrive
from terrain_cli.diagnosis.manoeuvres import Manoeuvre
from terrain_cli.diagnosis.refit_ranking import FORMS, absent, bent
from terrain_cli.diagnosis.refits import Ground, Refit
from terrain_cli.estimation.wheel_fit.normal_equations import explained, widened
from terrain_cli.mechanics import past, rates
from terrain_cli.mechanics.past import SUFFIX
from terrain_cli.telemetry.effect_inputs import RUT, sources
from terrain_cli.vocabulary.arrays import Array

_ROUNDS = 3  # Rounds until what is measured and what is predicted from it agree
_REACH = 2  # Neighbours on either side of a sample from which a rate is taken: 0.2 s
_STEP = 4  # Samples of a manoeuvre of which one is forecast


class PowerLog:
    """The log at hand: one wheel of it, and how much less its samples tell than independent ones."""

    def __init__(self, data: Ground, wheel: int, best: Refit) -> None:
        self.part = data.data[wheel]
        residual = np.clip(best.residuals[wheel], -smoothed_model.BEND, smoothed_model.BEND)
        seen = residual != 0.0
        square = max(float((residual**2).sum() / max(np.count_nonzero(seen), 1)), 1.0)
        sums = np.zeros((data.blocks, residual.shape[1]))
        np.add.at(sums, data.block[wheel], residual)
        # Var Σ r over a block is that of n independent values times the samples that say the same.
        between = float((sums**2).sum() / max(np.count_nonzero(seen), 1))
        self.inflation = max(between, square)
        samples = data.wheels[wheel].windows.samples
        self.new_inflation = self.inflation
        if samples.time is not None:
            time = samples.time[data.wheels[wheel].windows.rows[data.rows[wheel]]]
            steps = np.diff(time)
            steps = steps[np.isfinite(steps) & (steps > 0.0)]
            step = float(np.median(steps)) if len(steps) else 1.0 / manoeuvres.RATE
            self.new_inflation = max(self.inflation * step * manoeuvres.RATE, square)
        counts = np.bincount(self.part.window[self.part.use], minlength=self.part.windows)
        self.window = int(np.argmax(counts))  # The soil of the new drive: that on which most was driven


@dataclass(frozen=True)
class Shown:
    """What a model predicts of some samples, in units of the noise."""

    # predicted, effect: shape (n, c): `effect` is the part of it that goes with the effect
    predicted: Array
    effect: Array
    known: NDArray[np.bool_]  # shape (n,)
    sinkage: Array  # shape (n,): in m; of no samples where it is not measured
    slopes: Array  # shape (n, c, p): by all unknowns; of no samples where that was not asked for


class Side:
    """One of the two, fitted to the log."""

    def __init__(self, ground: PowerLog, hypothesis: Hypothesis, solution: Solution) -> None:
        self.hypothesis, self.solution = hypothesis, solution
        part = ground.part
        self.soil = solution.t.shape[1]
        self.old = self.shown(part)
        self.lost = ~self.old.known
        wide = widened(solution.design, self.soil, part.window, part.windows)
        self.design = wide / np.sqrt(ground.inflation)
        flat = self.design.reshape(-1, self.design.shape[2])
        #: Of the unknowns counted in deviations of their priors, hence the unit matrix.
        self.information = flat.T @ flat + np.eye(flat.shape[1])

    def shown(self, part: SmoothedData, *, sloped: bool = False) -> Shown:
        """Predict with the effect and without it, and, if asked to, differentiate that by all unknowns."""
        solution, sought = self.solution, self.solution.unknowns
        names = [u.name for u in (*sought.local, *sought.shared)] if sloped else []
        numbers = solution.of_samples(part.window)
        predicted, known, sinkage, tables = self._white(part, numbers, names)
        without, there = predicted, known
        if self.hypothesis.parameters:
            without, there, _, _ = self._white(part, absent(self.hypothesis, numbers), [])
        slopes = np.zeros((0, 0, 0))
        if sloped:
            scale = sought.slopes(solution.t, solution.common)[part.window]
            white = part.white({name: table * scale for name, table in tables.items()}, part.seen)
            slopes = widened(white, self.soil, part.window, part.windows)
        return Shown(predicted, (predicted - without) * (known & there)[:, None], known, sinkage, slopes)

    def _white(
        self, part: SmoothedData, numbers: Mapping[str, Array], names: Sequence[str]
    ) -> tuple[Array, NDArray[np.bool_], Array, dict[str, Array]]:
        model, order = self.solution.model, smoothed_model.ORDER
        found, tables = smoothed_model.forecast(model, part, numbers, names, order=order)
        known: NDArray[np.bool_] = np.logical_and.reduce([np.isfinite(column) for column in found.values()])
        white = part.white({name: np.nan_to_num(column) for name, column in found.items()}, part.seen)
        return white, known, found.get("sinkage", np.zeros(0)), tables


def margins(ground: PowerLog, sides: Sequence[Side], course: Mapping[str, Array]) -> Array:
    """Return by how many deviations a drive leads to the right one of two.

    With d the distances by which the new drive takes the wrong and the right one from what is shown, in
    deviations of the noise, the difference of their squares is normal with a deviation of at most twice the
    sum of d, so that the right one is nearer with a probability of Φ((d_wrong − d_right)/2): here is that
    half difference. Shape (k, k, forms): of the truth, the wrong one, and the forms of the truth. Minus
    infinity where the drive cannot be driven.
    """
    count = len(sides)
    found = np.full((count, count, len(FORMS)), -np.inf)
    views: _Views | None = None
    for row, truth in enumerate(sides):
        if views is None or views.coupled:
            views = _views(ground, truth, sides, course)
        if views is None:
            return np.full_like(found, -np.inf)
        old, new = (
            np.stack([shown.predicted + bent(shown.effect, form, truth.old.effect) for form in FORMS])
            for shown in (truth.old, views.shown[truth])
        )
        for column, wrong in enumerate(sides):
            weight = views.weight(truth, wrong)
            if row == column or weight is None:
                continue
            usable = ~(truth.lost | wrong.lost)[:, None]
            away = [
                _apart(
                    ground,
                    side,
                    usable * (old - side.old.predicted),
                    weight * (new - views.shown[side].predicted),
                    weight[:, :, None] * views.shown[side].slopes,
                )
                for side in (wrong, truth)
            ]
            found[row, column] = 0.5 * (away[0] - away[1])
    return found


def _apart(ground: PowerLog, side: Side, old_gap: Array, new_gap: Array, design: Array) -> Array:
    """Return by how much a new drive takes a model, fitted to old and new, from what is shown, shape (k,).

    Gaps are of shape (k, n, c), and `design` is (n, c, p).
    """
    old, new = old_gap / np.sqrt(ground.inflation), new_gap / np.sqrt(ground.new_inflation)
    table = (design / np.sqrt(ground.new_inflation)).reshape(-1, design.shape[2])
    before = old.reshape(len(old), -1) @ side.design.reshape(-1, design.shape[2])
    after = before + new.reshape(len(new), -1) @ table
    cost = explained(side.information, before)
    both = explained(side.information + table.T @ table, after)
    return np.asarray(np.sqrt(np.maximum((new**2).sum(axis=(1, 2)) + cost - both, 0.0)))


@dataclass(frozen=True)
class _Views:
    """What the models of a family make of a drive."""

    # Whether what is measured, and so what they make of it, depends on which of them is the truth
    coupled: bool
    shown: dict[Side, Shown]
    step: int  # Samples for which each one stands

    def weight(self, one: Side, other: Side) -> Array | None:
        """Return the weight of every sample, shape (n, 1); None where the two have no answer."""
        known = self.shown[one].known & self.shown[other].known
        return np.sqrt(self.step) * known[:, None] if np.mean(known) >= criteria.FORECAST else None


def _views(
    ground: PowerLog, truth: Side, sides: Sequence[Side], course: Mapping[str, Array]
) -> _Views | None:
    """Forecast a drive with every model; None if one of them would be stuck."""
    reads = {name for side in sides for effect in side.solution.model.effects for name in effect.reads}
    # A sinkage from which a model predicts is the drive's own.
    there = reads & ground.part.inputs.keys() - {"sinkage"}
    coupled = [name for name in there if sources(name)[0] in UNITS]
    remembers = any(side.solution.model.remembers for side in sides)
    # Where no rate of what is shown is needed, few samples tell as much as many.
    step = 1 if coupled or remembers else _STEP
    new = _measured(ground, truth, course, coupled, step)
    if remembers:
        new = _remembering(truth, new, course)
    shown = {side: side.shown(new, sloped=True) for side in sides}
    deepest = max(float(np.nanmax(one.sinkage, initial=0.0)) for one in shown.values())
    if deepest > criteria.STUCK * new.geometry.radius:
        return None
    return _Views(bool(coupled) or remembers, shown, step)


def _measured(
    ground: PowerLog, truth: Side, course: Mapping[str, Array], coupled: Sequence[str], step: int
) -> SmoothedData:
    """Return what would be measured, were one model the truth, as far as models read it."""
    part, n = ground.part, len(course["time"])
    stretch = np.zeros(n, dtype=np.intp)

    def column(name: str) -> Array:
        of = name.removesuffix("_rate")
        if name in coupled:
            return np.zeros(n)
        if name == "wheel_angle":
            return rates.wheel_angle(course["time"], stretch, course["angular_velocity"])
        if name in course:
            return course[name]
        if of != name and of in course:
            return rates.rate(course["time"], stretch, course[of], reach=_REACH)
        return np.full(n, np.nanmedian(part.inputs[name][part.use]))

    inputs = {name: column(name)[::step] for name in part.inputs if not name.endswith(SUFFIX)}
    count = len(inputs["slip"])
    new = replace(
        part,
        inputs=inputs,
        measured={name: np.zeros(count) for name in part.white.channels},
        use=np.ones(count, dtype=bool),
        window=np.full(count, ground.window),
    )
    numbers = truth.solution.of_samples(new.window)
    for _ in range(_ROUNDS if coupled else 0):
        found, _ = smoothed_model.forecast(truth.solution.model, new, numbers, order=smoothed_model.ORDER)
        for name in coupled:
            shown = found.get(sources(name)[0], np.zeros(n))
            if name == RUT:
                radius, velocity = part.geometry.radius, course["velocity"]
                inputs[name] = rates.rut_slope(course["time"], stretch, shown, velocity, radius=radius)
            elif name in UNITS:
                inputs[name] = shown
            else:
                inputs[name] = rates.rate(course["time"], stretch, shown, reach=_REACH)
    return new


def _remembering(truth: Side, new: SmoothedData, course: Mapping[str, Array]) -> SmoothedData:
    """Add what a model predicts along a drive, without what it has late."""
    numbers = truth.solution.of_samples(new.window)
    found, _ = smoothed_model.forecast(truth.solution.model, new, numbers, order=smoothed_model.ORDER)
    one = np.zeros(len(course["time"]), dtype=np.intp)
    return replace(
        new, inputs={**new.inputs, **past.along(course["time"], one, course.get("velocity"), found)}
    )


SECONDS = 60.0  # s that a manoeuvre lasts


def suggest(data: Ground, family: Sequence[tuple[Hypothesis, Refit]]) -> list[NextDrive]:
    """Find the drive that tells the best of a family, which comes first, from each of the others.

    Of several wheels, the one with most samples drives. Where no drive tells, it says so and what does, with
    the power of the drive that tells most, and without settings. Drives that vary a channel which the log
    lacks are left out: neither effect reads it.
    """
    if len(family) < 2:
        return []
    wheel = int(np.argmax([np.count_nonzero(part.use) for part in data.data]))
    part = data.data[wheel]
    if not part.use.any() or "slip" not in part.inputs:
        return []
    ground = PowerLog(data, wheel, family[0][1])
    sides = [Side(ground, hypothesis, refit.solutions[wheel]) for hypothesis, refit in family]
    at = manoeuvres.Conditions.of(part)
    channels = set(part.inputs) | set(part.measured)
    known = [one for one in manoeuvres.library(at, SECONDS) if one.possible(channels)]
    courses = [one.drive(at) for one in known]
    table = np.array([margins(ground, sides, course) for course in courses])
    again = np.array([driven(one, course, part) for one, course in zip(known, courses, strict=True)])
    # Of a pair either may be the truth.
    pairs = {
        (a, b): _Pair(sides[a], sides[b], np.concatenate([table[:, a, b], table[:, b, a]], axis=1))
        for a, b in combinations(range(len(sides)), 2)
    }
    settled = np.ones((len(known), len(sides), len(sides)))
    for (a, b), pair in pairs.items():
        settled[:, a, b], settled[:, b, a] = pair.settled
    # Whichever is the truth is known once all others are ruled out, or its sensor was checked.
    likely = _likely([refit for _, refit in family])
    alone = settled.min(axis=2) @ likely
    checked = likely * [bool(manoeuvres.checks(one.effects)) for one, _ in family]
    others = range(1, len(sides))
    found = [_best(pairs[0, b], known, again, alone, max(checked[0], checked[b])) for b in others]
    return [drive for drive, _ in sorted(found, key=lambda one: -one[1])]


def _likely(refits: Sequence[Refit]) -> Array:
    """Return how likely each of a family is, as far as it predicts no worse than the first: shares of 1."""
    gaps = [one.loss - refits[0].loss for one in refits]
    away = np.array([gap.sum() / np.hypot(error(gap), criteria.LEAST_GAIN) for gap in gaps])
    weights = distributions.normal_tail(away)
    return np.asarray(weights / weights.sum())


@dataclass(frozen=True)
class _Pair:
    """Two of a family, and the margins by which each drive tells them apart, shape (drives, 2 forms).

    Of the forms of the one, then of the other.
    """

    one: Side
    other: Side
    margins: Array

    @property
    def worst(self) -> Array:
        return np.asarray(self.margins.min(axis=1))

    @property
    def settled(self) -> Array:
        """How often each drive settles which it is, where it is the one or the other, shape (2, drives).

        The right one has to come out ahead by so much that the wrong one, in whichever form of its law, would
        be taken for it in no more than `criteria.RULED_OUT` of the cases, as in `refit_ranking`.
        """
        rare = NormalDist().inv_cdf(1.0 - criteria.RULED_OUT)
        sides = np.split(self.margins, 2, axis=1)
        ahead = [np.maximum(rare - wrong.min(axis=1, keepdims=True), 0.0) for wrong in reversed(sides)]
        tails = [distributions.normal_tail(least - right) for least, right in zip(ahead, sides, strict=True)]
        return np.asarray(np.mean(tails, axis=2))

    @property
    def power(self) -> Array:
        """How often each drive settles which of the two it is, at most `criteria.MOST_POWER`."""
        return np.asarray(np.minimum(self.settled.mean(axis=0), criteria.MOST_POWER))


def driven(one: Manoeuvre, course: Mapping[str, Array], part: SmoothedData) -> bool:
    """Tell whether all that a drive varies was varied as far in the log at hand."""
    for name in one.varies:
        channel = "velocity" if name == "speed" else name
        there = part.inputs.get(channel, np.zeros(0))
        if channel not in course or not np.isfinite(there).any():
            return False
        # Most of it: ends that were just missed are no other drive.
        low, high = np.quantile(course[channel], (0.1, 0.9))
        if low < np.nanmin(there) or high > np.nanmax(there):
            return False
    return bool(one.varies)


def _best(
    pair: _Pair, known: Sequence[Manoeuvre], again: NDArray[np.bool_], alone: Array, checked: float = 0.0
) -> tuple[NextDrive, float]:
    """Choose the drive for a pair, and return how often it leaves one of the whole family (`alone`).

    Where none settles the pair, the check of a sensor may do so, that often (`checked`). Of those of the
    same power, those like the log at hand (`again`) come last.
    """
    names, power = (pair.one.hypothesis.id, pair.other.hypothesis.id), pair.power
    best = float(power.max())
    if best < criteria.LEAST_POWER:
        return _unsettled(pair.one.hypothesis, pair.other.hypothesis, best), checked
    follows = manoeuvres.drivers({*_reads(pair.one), *_reads(pair.other)})

    def plainness(place: int) -> tuple[bool, bool, int]:
        # What an effect follows by its own law is the plainest question to ask.
        own = known[place].varies & follows
        return not own - {"speed"}, not own, place

    able = np.flatnonzero(power >= max(best - criteria.SAME_POWER, criteria.LEAST_POWER))
    able = able[~again[able]] if not again[able].all() else able
    able = able[alone[able] >= alone[able].max() - criteria.SAME_POWER]
    sure = min(float(pair.worst[able].max()), criteria.SURE_OF_BENT_LAWS)
    chosen = min((int(p) for p in able if pair.worst[p] >= sure - criteria.SAME_MARGIN), key=plainness)
    drive = NextDrive(names, known[chosen].text, float(power[chosen]), known[chosen].part)
    return drive, float(alone[chosen])


def _reads(side: Side) -> set[str]:
    # Every drive has a load and a slip: that a law reads them says nothing of what it follows.
    return {name for effect in side.hypothesis.effects for name in effect.reads} - {"load", "slip", *UNITS}


def _unsettled(one: Hypothesis, other: Hypothesis, best: float) -> NextDrive:
    effects = (*one.effects, *other.effects)
    sensors = manoeuvres.checks(effects)
    said = [e.settled_by for e in effects if e.settled_by and not manoeuvres.checks([e])]
    check, what = " or ".join(dict.fromkeys(sensors)), "; or ".join(dict.fromkeys(said))
    ending = f": {check}" if check else (f"; what may help: {what}" if what else "")
    told = f"no drive tells them apart reliably (the best one in {best:.0%} of cases){ending}"
    return NextDrive((one.id, other.id), told, best, check=check)
