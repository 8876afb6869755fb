"""The power of a drive to tell two effects apart.

Both effects are fitted to the log at hand. Each in turn is taken for the truth: what a manoeuvre would
show then is forecast, and the other one is fitted to log and manoeuvre together, to first order. What it
cannot imitate there, in units of the noise, is the distance between the two (optimal discrimination,
Atkinson & Fedorov 1975, Biometrika 62(1), 57–70). A law is never exactly that of the catalogue: the same is
done with the truth bent as in `rivals`, which neither of the two can imitate.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from terrain_cli.comparison import smoothed_model
from terrain_cli.comparison.comparison_outcome import UNITS
from terrain_cli.diagnosis import diagnosis_criteria as criteria
from terrain_cli.diagnosis.next_drive import manoeuvres
from terrain_cli.diagnosis.rivals import FORMS, bent
from terrain_cli.estimation.wheel_fit.normal_equations import explained, widened
from terrain_cli.mechanics import rates

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray

    from terrain_cli.comparison.smoothed_fit import Solution
    from terrain_cli.comparison.smoothed_model import SmoothedData
    from terrain_cli.diagnosis.diagnosis_outcome import Hypothesis
    from terrain_cli.diagnosis.refits import Ground, Refit

    Array = NDArray[np.float64]

#: Rounds until what is measured and what is predicted from it agree.
_ROUNDS = 3
#: Neighbours on either side of a sample from which a rate is taken: 0.2 s.
_REACH = 2
#: Samples of a manoeuvre of which one is forecast.
_STEP = 4


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
        #: The soil of the new drive: that on which most was driven.
        self.window = int(np.argmax(counts))


@dataclass(frozen=True)
class Shown:
    """What a model predicts of some samples, in units of the noise."""

    # predicted, effect: shape (n, c): `effect` is the part of it that goes with the effect
    predicted: Array
    effect: Array
    known: NDArray[np.bool_]  # shape (n,)
    sinkage: Array  # shape (n,): in m; of no samples where it is not measured


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

    def shown(self, part: SmoothedData) -> Shown:
        """Predict with the effect, and without it."""
        numbers = self.solution.of_samples(part.window)
        predicted, known, sinkage = self._white(part, numbers)
        own = self.hypothesis.parameters
        if not own:
            return Shown(predicted, np.zeros_like(predicted), known, sinkage)
        absent = {name: np.full_like(v, own[name].null) if name in own else v for name, v in numbers.items()}
        without, there, _ = self._white(part, absent)
        return Shown(predicted, (predicted - without) * (known & there)[:, None], known, sinkage)

    def _white(
        self, part: SmoothedData, numbers: Mapping[str, Array]
    ) -> tuple[Array, NDArray[np.bool_], Array]:
        found, _ = smoothed_model.forecast(self.solution.model, part, numbers, order=smoothed_model.ORDER)
        known: NDArray[np.bool_] = np.logical_and.reduce([np.isfinite(column) for column in found.values()])
        white = part.white({name: np.nan_to_num(column) for name, column in found.items()}, part.seen)
        return white, known, found.get("sinkage", np.zeros(0))

    def slopes(self, part: SmoothedData) -> Array:
        """Differentiate what is predicted by all unknowns, in units of the noise."""
        solution = self.solution
        sought = solution.unknowns
        names = [u.name for u in (*sought.local, *sought.shared)]
        numbers = solution.of_samples(part.window)
        _, tables = smoothed_model.forecast(solution.model, part, numbers, names, order=smoothed_model.ORDER)
        scale = np.ones((len(part.window), len(names)))
        for column, unknown in enumerate(sought.local):
            scale[:, column] = unknown.slope(solution.t[:, column])[part.window]
        for column, unknown in enumerate(sought.shared):
            scale[:, self.soil + column] = unknown.slope(np.asarray(solution.common[column]))
        white = part.white({name: table * scale for name, table in tables.items()}, part.seen)
        return widened(white, self.soil, part.window, part.windows)


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
        for column, wrong in enumerate(sides):
            weight = views.weight(truth, wrong)
            if row == column or weight is None:
                continue
            usable = ~(truth.lost | wrong.lost)[:, None]
            for place, form in enumerate(FORMS):
                old, new = (
                    shown.predicted + bent(shown.effect, form, truth.old.effect)
                    for shown in (truth.old, views.shown[truth])
                )
                away = [
                    _apart(
                        ground,
                        side,
                        usable * (old - side.old.predicted),
                        weight * (new - views.shown[side].predicted),
                        weight[:, :, None] * views.slopes[side],
                    )
                    for side in (wrong, truth)
                ]
                found[row, column, place] = 0.5 * (away[0] - away[1])
    return found


def _apart(ground: PowerLog, side: Side, old_gap: Array, new_gap: Array, design: Array) -> float:
    """Return by how much a new drive takes a model, fitted to old and new, from what is shown."""
    old, new = old_gap / np.sqrt(ground.inflation), new_gap / np.sqrt(ground.new_inflation)
    table = (design / np.sqrt(ground.new_inflation)).reshape(-1, design.shape[2])
    before = side.design.reshape(-1, design.shape[2]).T @ old.ravel()
    after = before + table.T @ new.ravel()
    cost = explained(side.information, before)
    both = explained(side.information + table.T @ table, after)
    return float(np.sqrt(max((new**2).sum() + cost - both, 0.0)))


@dataclass(frozen=True)
class _Views:
    """What the models of a family make of a drive."""

    # Whether what is measured, and so what they make of it, depends on which of them is the truth
    coupled: bool
    shown: dict[Side, Shown]
    slopes: dict[Side, Array]  # shape (n, c, p)
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
    coupled = [name for name in there if name.removesuffix("_rate") in UNITS]
    # Where no rate of what is shown is needed, few samples tell as much as many.
    step = 1 if coupled else _STEP
    new = _measured(ground, truth, course, coupled, step)
    shown = {side: side.shown(new) for side in sides}
    deepest = max(float(np.nanmax(one.sinkage, initial=0.0)) for one in shown.values())
    if deepest > criteria.STUCK * new.geometry.radius:
        return None
    return _Views(bool(coupled), shown, {side: side.slopes(new) for side in sides}, step)


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

    inputs = {name: column(name)[::step] for name in part.inputs}
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
            shown = found.get(name.removesuffix("_rate"), np.zeros(n))
            inputs[name] = (
                shown if name in UNITS else rates.rate(course["time"], stretch, shown, reach=_REACH)
            )
    return new
