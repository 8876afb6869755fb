"""p values: how often chance alone gives such scores, such a gain, such an order of points, such a rest."""

from collections.abc import Callable, Mapping, Sequence
from functools import cache
from itertools import product

import numpy as np

from terrain_cli import effects as catalogues
from terrain_cli.comparison import Comparison, distributions
from terrain_cli.comparison.blocks import DRAWS, error, max_test
from terrain_cli.comparison.compare import pooled_noise
from terrain_cli.comparison.comparison_outcome import UNITS, EffectScores
from terrain_cli.comparison.fitted_wheel import FittedWheel
from terrain_cli.comparison.residual_noise import Between, between
from terrain_cli.diagnosis import diagnosis_criteria as criteria
from terrain_cli.diagnosis import drafted_laws, effect_sizes, refits, screening, several_soils, signatures
from terrain_cli.diagnosis.diagnosis_outcome import Hypothesis, above_noise, over_noise
from terrain_cli.diagnosis.refits import Ground, Refit
from terrain_cli.diagnosis.screening import Screened
from terrain_cli.effects import Effect
from terrain_cli.models import ModelFile
from terrain_cli.vocabulary.arrays import Array, Index

#: s: times before and after a sample at which a residual that follows what was predicted is told.
_SPANS = (0.1, 0.2, 0.4, 0.8, 1.6)
_FEW = 8  # Blocks of which all choices of signs are tried


def of_gain(gain: Array) -> float:
    """Return how often chance gives such a gain on held-out blocks (Student's t).

    Of a few blocks one can gain so much that their mean is doubtful, though all of them gain: there it also
    counts how many of all choices of their signs give as much (Fisher 1935, The Design of Experiments). The
    gain, by block, is the loss of one model less that of another; of a single block the answer is 1.
    """
    size = error(gain)
    if not np.isfinite(size) or size <= 0.0:
        return 1.0
    of_mean = float(distributions.student_tail(gain.sum() / size, len(gain) - 1.0))
    if len(gain) >= _FEW:
        return of_mean
    signs = np.array(list(product((-1.0, 1.0), repeat=len(gain))))
    return min(of_mean, float(np.mean(signs @ gain >= gain.sum() * (1.0 - 1e-9))))


def of_gain_in_most(gain: Array) -> float:
    """Return how often chance gives such a gain on held-out blocks, in the mean or in most of them.

    Where one block has nearly all of a gain, its mean is not known; but chance hardly gains in nearly all
    blocks, weighed alike beyond the median.
    """
    usual = float(np.median(np.abs(gain)))
    return min(of_gain(gain), of_gain(gain / (usual + np.abs(gain)))) if usual > 0.0 else of_gain(gain)


def at_level(gain: Array) -> float:
    """Return how often chance gives such a gain, as a p-value that counts against the level of scores."""
    return of_gain_in_most(gain) / criteria.GAINED * criteria.LEVEL


def of_unscored(
    wheels: Sequence[FittedWheel],
    block: Sequence[Index],
    hypotheses: Sequence[Hypothesis],
    ground: Callable[[], Ground],
) -> tuple[float, Hypothesis | None]:
    """Return how often chance gives what hypotheses gain that no score tells of, and the best of these.

    `ground` returns the data with the base fitted; without any such hypothesis it is not called.
    """
    late = _late(wheels, block) < criteria.GAINED
    # Of a law that can be written in several ways the first form tells enough.
    unscored = [one for one in hypotheses if not one.scored and (late or not one.effects)]
    forms = [form for one in unscored for form in (one.forms[:1] if one.effects else one.forms)]
    if not forms:
        return 1.0, None
    data = ground()
    base = refits.refit(data, None)
    told = [(of_gain_in_most(base.loss - refits.refit(data, form).loss), form) for form in forms]
    p_value, best = min(told, key=lambda one: one[0])
    return min(len(forms) * p_value, 1.0), best


def _late(wheels: Sequence[FittedWheel], block: Sequence[Index]) -> float:
    """Return how often chance lets a residual follow what was predicted before it other than what after it.

    A late channel does. Noise does not, however long it lasts, nor noise of a load that is in the prediction
    too: these are the same with the time reversed.
    """
    p_values = []
    for wheel, own in zip(wheels, block, strict=True):
        for (name, residual), lead in product(wheel.residuals.items(), _SPANS):
            step = round(lead * wheel.second)
            before, after = slice(None, -2 * step), slice(2 * step, None)
            near = wheel.group[before] == wheel.group[after] if step else np.zeros(0, dtype=bool)
            if not near.any():
                continue
            change = wheel.predicted[name][before] - wheel.predicted[name][after]
            follows = np.nan_to_num(residual[step:-step] * change)[near]
            _, place = np.unique(own[step:-step][near], return_inverse=True)
            sums = np.asarray(np.bincount(place, follows), dtype=float)
            p_values.append(2.0 * min(of_gain_in_most(sums), of_gain_in_most(-sums)))
    return min((len(p_values) * one for one in p_values), default=1.0)


def shares(data: Ground, base: Refit, one: Refit) -> dict[str, float]:
    """Return what a model takes off the held-out error over the channel's size, both rms, by channel."""
    found = {}
    for name, before in base.heldout.items():
        used = [{key: column[part.use] for key, column in part.measured.items()} for part in data.data]
        size = _size(used, name)
        taken = max(before**2 - one.heldout.get(name, before) ** 2, 0.0) ** 0.5
        found[name] = taken / size if size > 0.0 else np.nan
    return found


def printed_shares(
    wheels: Sequence[FittedWheel], fitted: Sequence[FittedWheel], block: Sequence[Index]
) -> dict[str, float]:
    """Return the same of the errors that every verb prints; 0 if all of them together do not fall.

    Nothing where no noise is known: a few steady points tell no error of each channel.
    """
    known = {name: pooled_noise(wheels, name) for name in UNITS if any(name in w.measured for w in wheels)}
    if not np.isfinite([*known.values()]).any():
        return {}
    before, after = (refits.held_out_errors(some, block, known) for some in (wheels, fitted))
    taken = {name: error**2 - after.get(name, error) ** 2 for name, error in before.items()}
    if not sum(taken[name] / error**2 for name, error in before.items()) > 0.0:
        return dict.fromkeys(taken, 0.0)
    return {name: max(taken[name], 0.0) ** 0.5 / _size([w.measured for w in wheels], name) for name in taken}


def _size(measured: Sequence[Mapping[str, Array]], name: str) -> float:
    """Return the root mean square of a channel."""
    return float(np.sqrt(np.nanmean(np.concatenate([one[name] for one in measured if name in one]) ** 2)))


def of_order(data: Ground, seed: int) -> float:
    """Return how often steady points in another order would leave as smooth a residual.

    A score needs some ten blocks to stand out; six points that rise from slip to slip are no chance either,
    as noise would be the same in whatever order they are put. Told is the wheel that is least likely; 1 where
    none was measured at steady points.
    """
    least = 1.0
    for wheel, part, rows, solution in zip(data.wheels, data.data, data.rows, data.base, strict=True):
        known = np.flatnonzero(part.seen.any(axis=1))
        if wheel.ordered or not 0 < len(known) < criteria.POINTS_ENOUGH:
            continue
        places = between(part.window[known], wheel.run_under[rows][known])
        if len(places.middle):
            least = min(least, of_points(solution.residual[known], places, seed))
    return least


def of_points(left: Array, places: Between, seed: int) -> float:
    """Return how often points in another order would leave as smooth a residual in some channel.

    The measure is the ratio of squared steps to the variance of von Neumann (1941, Annals of Mathematical
    Statistics 12, 367). All channels of a point move together, as noise of its load or slip is in all of
    them. Points, the rows of `left`, are mixed within their lines.
    """
    count = np.bincount(places.line)
    middle = np.stack([np.bincount(places.line, column) / count for column in left.T], axis=1)
    left = left - middle[places.line]
    size = np.maximum((left**2).sum(axis=0), 1e-300)
    key = np.random.default_rng(seed).random((len(left), DRAWS))
    order = np.argsort(places.line, kind="stable")
    mixed = np.empty((len(left), DRAWS, left.shape[1]))
    mixed[order] = left[np.lexsort((key, np.broadcast_to(places.line[:, None], key.shape)), axis=0)]
    here, drawn = (((places.off(one) ** 2).sum(axis=0) / size).min(axis=-1) for one in (left, mixed))
    return float((1.0 + np.count_nonzero(drawn <= here * (1.0 + 1e-9))) / (1.0 + DRAWS))


def follows(data: Ground, one: Refit, seed: int) -> tuple[float, float]:
    """Test what is left against every driver: the p-value, and what the strongest takes off the squares."""
    tables, shrunk, most = [], 1.0, 0.0
    for index, solution in enumerate(one.solutions):
        part, wheel, rows = data.data[index], data.wheels[index], data.rows[index]
        # Measured sinkage has its own noise in common with what is left of it.
        columns = drafted_laws.followed(wheel, {**one.predicted[index], **part.inputs}, rows)
        if not columns:
            continue
        shapes = np.stack([np.ones(len(part.use)), *columns], axis=1)
        names, nothing = part.white.channels, np.zeros_like(shapes)
        white = [
            part.white({name: shapes if name == channel else nothing for name in names}, part.seen)
            for channel in names
        ]
        every, block = np.concatenate(white, axis=2), data.block[index]
        found, _ = signatures.scores(
            solution.residual, solution.design, every, part.window, block, data.blocks
        )
        gains = found.total**2 / np.maximum(np.diag(found.cross), 1e-300)
        stands = found.surviving > criteria.REST_SURVIVES
        most = max(most, float(np.where(stands, gains, 0.0).max(initial=0.0)))
        tables.append(np.where(stands, found.blocks, 0.0))
        shrunk = min(shrunk, found.shrunk)
    if not tables:
        return 1.0, 0.0
    found_p = max_test(np.concatenate(tables, axis=1), shrunk=shrunk, seed=seed).p_values
    return float(found_p.min(initial=1.0)), most


def of_sizes(
    found: Screened, wheels: Sequence[FittedWheel], one: Hypothesis, least: float, seed: int
) -> float:
    """Return how often chance lets the size of an effect in the model follow a driver as it does.

    The right effect has one size; that of one that imitates it changes with what the right one follows.
    `found` has the scores of other effects on the `wheels`, which have this one. The answer is 1 where no
    driver takes off `least` of the squares.
    """
    tables: list[signatures.Scores] = []
    for part, wheel in zip(found.columns, wheels, strict=True):
        known, count = part.evidence, len(part.short.blocks)
        units = drafted_laws.followed(wheel, known.channels, part.rows)
        fitted = enumerate((*wheel.soil, *wheel.common))
        places = [j for j, name in fitted if name in one.parameters and not one.parameters[name].shape]
        if not units or not places or not wheel.ordered:
            continue
        slopes = known.soil[:, :, places, None] * np.stack(units, axis=1)[:, None, None, :]
        columns = slopes.reshape(*slopes.shape[:2], -1)
        whole, shown = signatures.scores(
            known.residual, known.soil, columns, part.window, np.zeros_like(part.window), 1
        )
        stands = np.flatnonzero(whole.surviving > criteria.REST_SURVIVES)
        gains = whole.total**2 / np.maximum(np.diag(whole.cross), 1e-300)
        if gains[stands].max(initial=0.0) < least:
            continue
        # Sizes that vary leave what lasts no longer than noise, or blocks have to be longer.
        left = known._replace(residual=known.residual - shown[:, :, stands] @ whole.fit(stands)[0])
        columns = columns[:, :, stands]
        rest, _ = signatures.of_short_blocks(wheel, part.rows, left, columns, part.short_block, count)
        several = signatures.of_short_blocks(wheel, part.rows, known, columns, part.short_block, count)
        longer = signatures.in_longer_blocks(several[0], rest.blocks)
        tables += [longer] if longer else several
    every = [np.ones(table.blocks.shape[1], dtype=bool) for table in tables]
    tests = signatures.test(tables, every, seed=seed) if tables else []
    return min((float(p_values.min(initial=1.0)) for _, p_values in tests), default=1.0)


def missing_effects(file: ModelFile, effects: Sequence[Effect] | None = None) -> list[Effect]:
    """Return the effects, by default those of the catalogue, that a model does not have."""
    there = {effect.id for effect in file.model.effects}
    every = catalogues.catalogue().values() if effects is None else effects
    return [effect for effect in every if effect.id not in there]


def score(
    comparison: Comparison,
    wheels: Sequence[FittedWheel],
    file: ModelFile,
    effects: Sequence[Effect],
    seed: int,
) -> EffectScores:
    """Score effects that a model lacks, as it was fitted and compared.

    As in a diagnosis, chance must give neither the largest score nor a gain on held-out blocks, and the
    effect must be large enough. Where the errors are those of noise, it is fitted for that: then only what it
    gains, or would on fewer soils, tells whether anything is missing.
    """
    block = [one.blocks for one in comparison.wheels]
    close = not above_noise(over_noise(comparison))
    hypotheses, _ = screening.hypotheses(file, wheels, effects)
    scored = [one for one in hypotheses if one.effects]
    unrecorded = screening.unrecorded(effects, wheels)
    if 1 + max(int(one.max(initial=-1)) for one in block) < criteria.BLOCKS_OF_ALARM or not scored:
        return EffectScores(p_value=1.0, raised=False, unrecorded=unrecorded)
    instead = None
    ground = cache(lambda: refits.ground(wheels, block, several_soils.MOST_SAMPLES))
    if any(wheel.one_soil for wheel in wheels):
        scored, _ = screening.on_changing_soil(scored)
        if close:
            *_, stands = several_soils.on_fewer(ground(), block, hypotheses, lambda _: None)
            instead = stands.what if stands else None
    found = screening.screen(wheels, block, scored, seed)
    order = sorted(found.p_values, key=lambda name: -found.explained[name])
    p_value = of_scores(found, order[0]) if order else 1.0
    lowest = min(found.p_values.values(), default=1.0)
    first = next((one for one in scored if one.id in order[:1]), None)
    if first and found.lasting and lowest < criteria.LEVEL and screening.follows_passes(first):
        _, changes = several_soils.scored_once_fitted(ground(), block, scored, first, seed)
        if changes:
            return score(comparison, wheels, file, [one for one in effects if one.id != first.id], seed)
    if first and lowest < criteria.LEVEL and (close or p_value >= criteria.LEVEL):
        # To first order the gain may be doubtful where it is not: as a diagnosis has it, once fitted.
        of_gain, first = of_fitted_gain(ground(), first)
        p_value = max(lowest, of_gain)
    if p_value >= criteria.LEVEL:
        testable = [one for one in scored if one.id in found.p_values]
        of_late, late = of_unscored(wheels, block, testable, ground)
        if late and of_late < criteria.LEVEL:
            p_value, first = of_late, late
            order.insert(0, order.pop(order.index(late.id)))
    raised, settles = p_value < criteria.LEVEL, False
    idle = False
    if first and raised and (close or comparison.doubted):
        fitted = [refits.fitted_anew(wheel, first) for wheel in wheels]
        share = max(printed_shares(wheels, fitted, block).values(), default=1.0)
        raised, idle = not close or share >= criteria.SMALLEST_SHARE, close and share == 0.0
        settles = effect_sizes.settles_pull(fitted, first)
    return EffectScores(
        p_value=p_value,
        raised=raised,
        effects=tuple(order),
        unrecorded=unrecorded,
        instead=instead,
        settles=raised and settles,
        idle=idle,
    )


def of_fitted_gain(ground: Ground, first: Hypothesis) -> tuple[float, Hypothesis]:
    """Return how often chance gives what an effect gains once fitted, and its form that gains most.

    One form may gain where another loses: a filter where the wheel has a filter, and no pure delay.
    """
    told = []
    for form in first.forms:
        data = refits.with_noise_of(ground, refits.refit(ground, form))
        told.append((at_level(refits.refit(data, None).loss - refits.refit(data, form).loss), form))
    p_value, best = min(told, key=lambda one: one[0])
    return min(len(told) * p_value, 1.0), best


def of_scores(found: Screened, first: str) -> float:
    """Return how often chance gives such scores, and to the first effect such a gain on held-out blocks."""
    return max(min(found.p_values.values()), at_level(found.held_out_gain(first)))
