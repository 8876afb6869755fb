"""Screening before any refit: whether the data can show each candidate, its score and its p value."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import combinations, product
from typing import Any

import numpy as np

from terrain_cli import effects as catalogues
from terrain_cli.comparison.comparison_outcome import UNITS
from terrain_cli.comparison.fitted_wheel import FittedWheel
from terrain_cli.diagnosis import diagnosis_criteria as criteria
from terrain_cli.diagnosis import signatures
from terrain_cli.diagnosis.diagnosis_outcome import Hypothesis, NotTestable, Size
from terrain_cli.diagnosis.signatures import Scores
from terrain_cli.effects import Effect
from terrain_cli.estimation.wheel_fit.normal_equations import products
from terrain_cli.mechanics.wheel_model import Model
from terrain_cli.models import ModelFile, model_change
from terrain_cli.telemetry import effect_inputs
from terrain_cli.telemetry.effect_inputs import CONSTANTS, sources
from terrain_cli.vocabulary.arrays import Array, Index

DRIVEN_BEFORE = "pass_number"  # Channel that tells one part of a drive from another, as a change of soil does
MOST_SAMPLES = 6_000  # Samples of all wheels that are scored, evenly thinned
_PRECISION = 5.0**-2.0  # Precision of the prior about the null: it is five typical sizes wide


@dataclass(kw_only=True)
class Screened:
    """What the scores say of each hypothesis."""

    # scores, p_values, surviving, explained: of those that can be tested
    scores: dict[str, float] = field(default_factory=dict)
    p_values: dict[str, float] = field(default_factory=dict)
    surviving: dict[str, float] = field(default_factory=dict)
    explained: dict[str, float] = field(default_factory=dict)
    sizes: dict[str, dict[str, Size]] = field(default_factory=dict)  # To first order
    not_testable: list[NotTestable] = field(default_factory=list)
    # shape (blocks, m): scores of all columns that can be tested, of what the strongest effect leaves
    blocks: Array = field(default_factory=lambda: np.zeros((0, 0)))
    columns: list[_Columns] = field(default_factory=list)
    lasting: bool = False  # What the strongest effect leaves lasts for longer than short blocks

    def held_out_gain(self, effect: str) -> Array:
        """Return what an effect, fitted to the others, takes off the squares of each (to first order)."""
        return np.asarray(sum(part.held_out_gain(effect) for part in self.columns))


def hypotheses(
    file: ModelFile, wheels: Sequence[FittedWheel], effects: Sequence[Effect]
) -> tuple[list[Hypothesis], list[NotTestable]]:
    """List what a model may lack; and effects whose channels are missing or which the base cannot have."""
    found: list[Hypothesis] = []
    lacking: list[NotTestable] = []
    available = [_available(wheel) for wheel in wheels]
    for effect in effects:
        reason = catalogues.conflict(file.model, effect) or _missing(effect, wheels)
        if reason:
            lacking.append(NotTestable(effect.id, reason))
            continue
        model = Model(file.model.base, (*file.model.effects, effect))
        held = {effect.qualified(p): p.null for p in effect.parameters if p.idle(available)}
        found.append(Hypothesis(id=effect.id, title=effect.title, model=model, fixed=held, effects=(effect,)))
    modulus = wheels[0].windows.samples.geometry.shear_modulus
    made = model_change.made_by(file, modulus)
    for assumption in made:
        ways = [model_change.lifted(file, assumption.id, modulus)]
        if assumption.id == model_change.STRESSES and len(made) > 1:
            ways.append(model_change.with_stresses(file, modulus))
        one, *others = [
            Hypothesis(
                id=assumption.id,
                title=assumption.title,
                model=way.model,
                fixed=dict(way.fixed),
                priors=dict(way.priors),
            )
            for way in ways
        ]
        found.append(replace(one, others=tuple(others)))
    return found, lacking


def _available(wheel: FittedWheel) -> dict[str, Any]:
    geometry, time = wheel.windows.samples.geometry, wheel.windows.samples.time
    constants = {name: getattr(geometry, name) for name in ("grouser_count", "grouser_height")}
    there = {name: value for name, value in constants.items() if value}
    return {**wheel.channels, **there, **({} if time is None else {"time": time})}


def unrecorded(effects: Sequence[Effect], wheels: Sequence[FittedWheel]) -> tuple[str, ...]:
    """Name what was not recorded, and without which some of the effects cannot be tested: what can be."""
    lacking: dict[str, None] = {}
    for effect, wheel in product(effects, wheels):
        there = _available(wheel)
        lacks = effect_inputs.missing(effect, there)
        for missing in lacks if "time" not in lacks else ():
            for name in (missing,) if missing in effect.needs else effect.any_of:
                of = sources(name)
                # Steady test points have no rates, and nothing late.
                recordable = "time" not in of or "time" in there
                lacking |= dict.fromkeys(one for one in of if recordable and one not in there)
    return tuple(name for name in lacking if name not in CONSTANTS)


def _missing(effect: Effect, wheels: Sequence[FittedWheel]) -> str:
    lacking = {name for wheel in wheels for name in effect_inputs.missing(effect, _available(wheel))}
    # What is computed of neighbouring samples is not there where these are too few.
    lacking |= {name for wheel in wheels for name in {*effect.needs} - _available(wheel).keys()}
    measured = {name for wheel in wheels for name in wheel.measured}
    if lacking:
        return f"needs {' and '.join(sorted(lacking))}"
    only = UNITS.keys() & effect.laws.keys()
    if only and len(only) == len(effect.laws) and not only & measured:
        return f"shows only in {' and '.join(sorted(only))}, which is not measured".replace("_", " ")
    return ""


def follows_passes(one: Hypothesis) -> bool:
    """Tell whether an effect follows how often the track was driven before."""
    return any(DRIVEN_BEFORE in effect.reads for effect in one.effects)


def on_changing_soil(every: Sequence[Hypothesis]) -> tuple[list[Hypothesis], list[NotTestable]]:
    """Take out what cannot be told from a soil that changes along the drive.

    Where segments of unknown soils are kept, or what a pass leaves lasts, the soil changes within some of
    them too; a few passes follow that by chance.
    """
    passes = [one for one in every if follows_passes(one)]
    because = (
        "the soil changes along this drive, and a pass cannot be told from that: drive the same track twice"
    )
    return [one for one in every if one not in passes], [NotTestable(one.id, because) for one in passes]


def screen(
    wheels: Sequence[FittedWheel],
    block: Sequence[Index],
    hypotheses: Sequence[Hypothesis],
    seed: int,
    better: Sequence[FittedWheel] = (),
) -> Screened:
    """Score every hypothesis, in blocks as long as what the strongest leaves, once fitted in `better`."""
    parts = _columns(wheels, block, hypotheses)
    found = Screened(columns=parts)
    gains = {one.id: sum(part.explained(one.id) for part in parts) for one in hypotheses}
    left = [part.left_by(max(gains, key=lambda name: gains[name], default="")) for part in parts]
    found.blocks = np.concatenate([part.beyond(one) for part, one in zip(parts, left, strict=True)], axis=1)
    rest = [part.left_in(one) for part, one in zip(parts, better, strict=True)] if better else left
    longer = [part.in_longer_blocks(one) for part, one in zip(parts, rest, strict=True)]
    found.lasting = any(one is not None for one in longer)
    # Of drives alone: each steady point is a stretch of its own.
    even = [
        part.testable & (wheel.ordered and other is None)
        for part, wheel, other in zip(parts, wheels, longer, strict=True)
    ]
    found_of = signatures.test(
        [*(other or part.short for part, other in zip(parts, longer, strict=True)), *(p.even for p in parts)],
        [*(part.testable for part in parts), *even],
        seed=seed,
    )
    tests = [
        (np.where(np.abs(t_even) > np.abs(t), t_even, t), np.minimum(p, p_even))
        for (t, p), (t_even, p_even) in zip(found_of[: len(parts)], found_of[len(parts) :], strict=True)
    ]
    few = [
        place
        for place, (wheel, own) in enumerate(zip(wheels, block, strict=True))
        if not wheel.ordered and len(np.unique(own)) == len(wheel) < criteria.POINTS_ENOUGH
    ]
    of_points = signatures.test_of_points(
        [(parts[place].evidence, parts[place].window) for place in few],
        [parts[place].left * parts[place].testable for place in few],
        seed=seed,
    )
    for place, tested in zip(few, of_points, strict=True):
        tests[place] = tested
    for one in hypotheses:
        if not one.effects:
            _assumed(found, one)
            continue
        reasons = [part.reason(one.id) for part in parts]
        if all(reasons):
            found.not_testable.append(NotTestable(one.id, reasons[0]))
            continue
        _add(found, one, parts, tests)
    return found


def promising(
    wheels: Sequence[FittedWheel], block: Sequence[Index], hypotheses: Sequence[Hypothesis]
) -> list[Hypothesis]:
    """Order hypotheses that may explain something; assumptions, of which it is not known, first."""
    parts = _columns(wheels, block, hypotheses)
    gains = {
        one.id: sum(part.explained(one.id) for part in parts) if one.effects else np.inf for one in hypotheses
    }
    return sorted((one for one in hypotheses if gains[one.id] > 0.0), key=lambda one: -gains[one.id])


def promising_pairs(found: Screened, hypotheses: Sequence[Hypothesis]) -> list[tuple[Hypothesis, Hypothesis]]:
    """Order pairs of effects by what they explain together to first order."""
    gains = [
        (sum(part.explained(one.id, other.id) for part in found.columns), (one, other))
        for one, other in combinations(hypotheses, 2)
    ]
    return [pair for gain, pair in sorted(gains, key=lambda one: -one[0]) if gain > 0.0]


def _columns(
    wheels: Sequence[FittedWheel], block: Sequence[Index], hypotheses: Sequence[Hypothesis]
) -> list[_Columns]:
    step = max(1, -(-sum(len(wheel) for wheel in wheels) // MOST_SAMPLES))
    blocks = 1 + max(int(one.max(initial=-1)) for one in block)
    return [_Columns(wheel, own, blocks, hypotheses, step) for wheel, own in zip(wheels, block, strict=True)]


def _assumed(found: Screened, one: Hypothesis) -> None:
    """Let an assumption of the base through to the refits, where it is judged by its held-out error."""
    found.scores[one.id] = np.nan
    found.p_values[one.id] = 1.0
    found.surviving[one.id] = 1.0
    found.explained[one.id] = 0.0
    found.sizes[one.id] = {}


@dataclass(frozen=True)
class _Group:
    id: str
    names: tuple[str, ...]
    columns: Index


class _Columns:
    """The signatures of all hypotheses in one wheel, in units of the noise, and their scores."""

    def __init__(
        self, wheel: FittedWheel, block: Index, blocks: int, hypotheses: Sequence[Hypothesis], step: int
    ) -> None:
        self.rows = rows = np.arange(0, len(wheel), step)
        self.under = wheel.under
        known = signatures.evidence(wheel, rows)
        self.noise_known = bool(np.isfinite([*wheel.levels.values()]).all())
        names = known.white.channels
        self.evidence = known
        effects = [effect for one in hypotheses for effect in one.effects]
        self.groups: list[_Group] = []
        tables = [np.zeros((len(rows), len(names), 0))]
        start = 0
        for signature in signatures.of_effects(wheel, effects, known.channels, rows):
            count = len(signature.names)
            self.groups.append(_Group(signature.effect.id, signature.names, np.arange(start, start + count)))
            start += count
            tables.append(known.whitened(signature.tables, count))
        columns = np.concatenate(tables, axis=2)
        self.block, self.window = block[rows], wheel.window[rows]
        self.scores, self.left = signatures.scores(
            known.residual, known.soil, columns, self.window, self.block, blocks
        )
        power = np.sqrt(np.maximum(np.diag(self.scores.cross), 0.0)) * np.sqrt(step)
        self.short_block, count = signatures.short_blocks(wheel, rows, self.block, blocks)
        self.short, self.even = signatures.of_short_blocks(
            wheel, rows, known, columns, self.short_block, count
        )
        self.without_memory = signatures.without_memory(wheel, rows)
        self.testable = (self.scores.surviving > criteria.SIGNATURE_SURVIVES) & (
            3.0 * power > criteria.TESTABLE
        )
        self.raw = np.abs(columns).max(axis=(0, 1)) > 1e-9 if columns.size else np.zeros(0, dtype=bool)

    def beyond(self, left: Array) -> Array:
        """Return the scores of the columns that can be tested in what an effect has left, by block."""
        shown = self.left[:, :, self.testable]
        return products(shown, left[..., None], self.block, len(self.scores.blocks))[..., 0]

    def left_by(self, effect: str) -> Array:
        """Return what an effect leaves of the residual, to first order."""
        columns = self.best_shape(effect)
        if not len(columns):
            return self.evidence.residual
        return np.asarray(
            self.evidence.residual - self.left[:, :, columns] @ self.scores.fit(columns, _PRECISION)[0]
        )

    def left_in(self, wheel: FittedWheel) -> Array:
        """Return what another model of the wheel leaves, in the same units."""
        white, known = self.evidence.white, self.evidence.known
        return white(
            {name: np.nan_to_num(wheel.residuals[name][self.rows]) for name in white.channels}, known
        )

    def in_longer_blocks(self, left: Array) -> Scores | None:
        """Score in longer blocks, if the scores of what an effect has left are related; else None.

        The scores of an effect that is missing are related themselves.
        """
        if self.short_block is self.block:
            return None
        own, count = self.without_memory, int(self.short_block.max(initial=-1)) + 1
        shown, rest = own(self.left[:, :, self.testable]), own(left)
        found = products(shown, rest[..., None], self.short_block, count)[..., 0]
        return signatures.in_longer_blocks(self.short, found)

    def shapes(self, effect: str) -> list[Index]:
        """Return the columns of an effect that can be tested, of each shape that has any."""
        own = (g.columns[self.testable[g.columns]] for g in self.groups if g.id == effect)
        return [columns for columns in own if len(columns)]

    def explained(self, *effects: str) -> float:
        """Return what effects take off the sum of squares together, to first order."""
        every = map(np.concatenate, product(*map(self.shapes, effects)))
        return max((self.scores.fit(columns, _PRECISION)[2] for columns in every), default=0.0)

    def best_shape(self, effect: str) -> Index:
        """Return the columns of an effect in the shape that explains most; none where it cannot be tested."""
        nothing = np.zeros(0, dtype=np.intp)
        return max(
            self.shapes(effect), key=lambda some: self.scores.fit(some, _PRECISION)[2], default=nothing
        )

    def held_out_gain(self, effect: str) -> Array:
        """Return by block what an effect gains there, fitted to the other blocks of this wheel."""
        score = self.scores.blocks
        columns = self.best_shape(effect)
        if not len(columns):
            return np.zeros(len(score))
        shown, score = self.left[:, :, columns], score[:, columns]
        own_cross = products(shown, shown, self.block, len(score))
        cross = own_cross.sum(axis=0) - own_cross + _PRECISION * np.eye(len(columns))
        change = np.linalg.solve(cross, (score.sum(axis=0) - score)[..., None])[..., 0]
        return np.asarray(
            2.0 * (change * score).sum(axis=1) - np.einsum("bp,bpq,bq->b", change, own_cross, change)
        )

    def reason(self, effect: str) -> str:
        """Say why these data tell nothing of an effect; nothing if they do."""
        groups = [group.columns for group in self.groups if group.id == effect]
        columns = np.concatenate(groups) if groups else np.zeros(0, dtype=int)
        if len(columns) == 0:
            return "changes nothing that was measured"
        if self.testable[columns].any():
            return ""
        if not self.raw[columns].any():
            return "no influence in these data"
        if not (self.scores.surviving[columns] > criteria.SIGNATURE_SURVIVES).any():
            return "a change of soil looks the same in these data"
        if not self.noise_known:
            return "the noise of these data is not known"
        return "smaller than the noise of these data, even at three times its typical size"


def _add(
    found: Screened, one: Hypothesis, parts: Sequence[_Columns], tests: Sequence[tuple[Array, Array]]
) -> None:
    """Collect what all wheels say of one effect; of several shapes of it, of the one that explains most."""
    explained = 0.0
    score, p_value, surviving = 0.0, 1.0, 0.0
    sizes: dict[str, Size] = {}
    for part, (t, p_values) in zip(parts, tests, strict=True):
        if not (shapes := part.shapes(one.id)):
            continue
        every, use = np.concatenate(shapes), part.best_shape(one.id)
        score = max(score, float(np.abs(t[every]).max()))
        p_value = min(p_value, float(p_values[every].min()))
        change, covariance, gain = part.scores.fit(use, _PRECISION)
        explained += gain
        surviving = max(surviving, float(part.scores.surviving[use].max()))
        names = {place: name for g in part.groups for place, name in zip(g.columns, g.names, strict=True)}
        for column, moved, variance in zip(use, change, np.diag(covariance), strict=True):
            parameter = one.model.parameters[names[column]].under(*part.under)
            sizes[parameter.name] = Size(
                (parameter.null + moved * parameter.scale) / parameter.factor,
                float(np.sqrt(variance)) * parameter.scale / parameter.factor,
                parameter.unit,
            )
    found.scores[one.id], found.p_values[one.id] = score, p_value
    found.surviving[one.id], found.explained[one.id], found.sizes[one.id] = surviving, explained, sizes
