"""How many soils a log has: fewer where an effect explains them, more where nothing else explains it.

Windows are cut where the line y = c + x tan φ changes. A second pass, a warming motor or a lag look like
such a change to whoever cuts first; and a soil can change though its strength hardly does: its stiffness
steps, which shows in sinkage, and in all that follows from it. Either is weighed on held-out blocks.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from terrain_cli.comparison import Comparison, smoothed_fit
from terrain_cli.comparison.compare import fit_wheels
from terrain_cli.comparison.comparison_outcome import place_of
from terrain_cli.comparison.fitted_wheel import FittedWheel
from terrain_cli.comparison.smoothed_fit import Solution
from terrain_cli.diagnosis import diagnosis_criteria as criteria
from terrain_cli.diagnosis import outside_catalogue, refit_ranking, refits, screening
from terrain_cli.diagnosis.diagnosis_outcome import Hypothesis, above_noise, over_noise
from terrain_cli.diagnosis.refits import Ground, Refit
from terrain_cli.diagnosis.screening import Screened
from terrain_cli.effects import Effect
from terrain_cli.estimation.estimators import FitSettings
from terrain_cli.estimation.wheel_fit.normal_equations import explained
from terrain_cli.models import ModelFile
from terrain_cli.vocabulary.arrays import Array, Index
from terrain_cli.vocabulary.quantities import counted, listed
from terrain_cli.windows.cut_windows import Windows

MOST_SAMPLES = 3_000  # Samples of all wheels that are fitted
_WILD = 10.0  # Bounds of a residual, in deviations of the noise


class Instead(NamedTuple):
    """What on fewer soils predicts as well as several."""

    what: str  # An effect, or a law; empty where the soil alone does
    as_good: bool = True  # It does beyond doubt; else it takes off most of what several soils do


def on_fewer(
    cut: Ground, block: Sequence[Index], hypotheses: Sequence[Hypothesis], progress: Callable[[str], None]
) -> tuple[Ground, list[Index], Instead | None]:
    """Take one soil for each terrain if, with some effect or none, it predicts as well as several.

    Also returned is that effect, if several are not needed.
    """
    wheels, blocks = [], []
    for wheel, own in zip(cut.wheels, block, strict=True):
        joined, order = wheel.one_soil or (wheel, slice(None))
        wheels.append(joined)
        blocks.append(own[order])
    if all(one is other for one, other in zip(wheels, cut.wheels, strict=True)):
        return cut, list(block), None
    one = refits.ground(wheels, blocks, MOST_SAMPLES, cut)
    stands = _stands_for_soils(one, blocks, cut, hypotheses, progress)
    return (cut, list(block), None) if stands is None else (one, blocks, stands)


def on_more(
    found: Comparison,
    wheels: Sequence[FittedWheel],
    file: ModelFile,
    effects: Sequence[Effect],
    progress: Callable[[str], None] = lambda _: None,
) -> tuple[list[FittedWheel], list[str], Ground | None]:
    """Take another soil, told where, from a sample on if a model misses and no effect predicts as well.

    Also returned is the base on these wheels, where that had to be fitted for it.
    """
    misses = found.failures or above_noise(over_noise(found))
    if not misses or found.blocks < criteria.BLOCKS_OF_ALARM:
        return list(wheels), [], None
    progress("one soil or several")
    block = [one.blocks for one in found.wheels]
    data = refits.ground(wheels, block, MOST_SAMPLES)
    steps = _with_steps(data, block)
    if steps is None:
        return data.wheels, [], data
    hypotheses, _ = screening.hypotheses(file, wheels, effects)
    if _stands_for_soils(data, block, steps[0], hypotheses, progress) is not None:
        return data.wheels, [], data
    return steps[0].wheels, steps[1], None


def scored_once_fitted(
    data: Ground, block: Sequence[Index], hypotheses: Sequence[Hypothesis], first: Hypothesis, seed: int
) -> tuple[Screened, bool]:
    """Score effects by what the first leaves once fitted, and tell whether the soil changes along the drive.

    What a large effect leaves to first order lasts, as a soil that varies does. What still lasts beside a
    pass is such a soil, which a few passes follow by chance.
    """
    better = refits.on_wheels(data, first, refits.refit(data, first))
    found = screening.screen(data.wheels, block, hypotheses, seed, better)
    return found, found.lasting and screening.follows_passes(first)


def enough_with(
    comparison: Comparison, effect: Effect, without: ModelFile
) -> tuple[list[Windows], list[str]]:
    """Return the windows of a comparison, on fewer soils if an effect, which a model lacks, stands for them.

    Also returned is what has to be said about it.
    """
    windows = [wheel.windows for wheel in comparison.wheels]
    block = [wheel.blocks for wheel in comparison.wheels]
    settings = FitSettings.of(windows, without)
    fitted, _ = fit_wheels(windows, without.model, settings, further={*effect.reads})
    hypotheses, _ = screening.hypotheses(without, fitted, [effect])
    cut = refits.ground(fitted, block, MOST_SAMPLES)
    fewer, _, stands = on_fewer(cut, block, hypotheses, lambda _: None)
    if stands is None:
        return windows, []
    needed = [wheel.windows for wheel in fewer.wheels]
    return needed, [enough([effect], sum(map(len, needed)))]


def enough(effects: Sequence[Effect], count: int) -> str:
    """Say on how many soils two models are compared, of which one has some effects."""
    soils = counted(count, "soil")
    needed = "are enough" if count > 1 else "is enough"
    return (
        f"with {listed([one.id for one in effects])}, {soils} {needed}; both models are compared on {soils}"
    )


def _with_steps(data: Ground, block: Sequence[Index]) -> tuple[Ground, list[str]] | None:
    """Cut windows where the soil steps, and say where each further soil begins; None if it does not."""
    found, steps = data, list[tuple[int, int]]()
    plain = before = refits.refit(data, None)
    for _ in range(criteria.MOST_STEPS):
        places = [_best(found, index) for index in range(len(found.wheels))]
        index = int(np.argmax([gain for gain, _ in places]))
        if not places[index][0] > 0.0:
            break
        place = places[index][1]
        # Most steps are none, and to fit wheels as `compare` does takes far longer.
        if not refit_ranking.beats(refits.refit(_split(found, index, place), None), before):
            break
        sample = int(found.rows[index][place])
        wheels = [_cut(w, sample) if k == index else w for k, w in enumerate(found.wheels)]
        cut = refits.ground(wheels, block, MOST_SAMPLES, data)
        after = refits.refit(cut, None)
        if not refit_ranking.beats(after, before):
            break
        found, before = cut, after
        steps.append((index, sample))
    if not steps or not _share(data, plain, before) > criteria.STEPS_SHARE:
        return None
    return found, [_where(found.wheels[index], sample) for index, sample in sorted(steps)]


def _stands_for_soils(
    one: Ground,
    block: Sequence[Index],
    cut: Ground,
    hypotheses: Sequence[Hypothesis],
    progress: Callable[[str], None],
) -> Instead | None:
    """Return what on fewer soils predicts as well as several; None where nothing does."""
    plain, several = refits.refit(one, None), refits.refit(cut, None)
    if refit_ranking.as_good(plain, several):
        return Instead("")
    gap = float((plain.loss - several.loss).sum())
    for hypothesis in screening.promising(one.wheels, block, hypotheses)[: criteria.RIVALS]:
        progress(f"fewer soils and {hypothesis.id}")
        found = refits.refit(one, hypothesis)
        taken = float((plain.loss - found.loss).sum())
        if not refit_ranking.as_good(found, several) and taken <= criteria.STANDS_FOR_SOILS * gap:
            continue
        # What else is missing an effect takes off as well: soils beside it must not be worth much more.
        both = refits.refit(cut, hypothesis)
        if taken > criteria.STANDS_FOR_SOILS * float((plain.loss - both.loss).sum()):
            return Instead(hypothesis.id, as_good=refit_ranking.as_good(found, several))
    fewer = sum(part.windows for part in cut.data) - sum(part.windows for part in one.data)
    many = fewer >= criteria.SOILS_OF_A_LAW
    if many or refits.misses(cut, several):
        # Nor may what is in no catalogue pass for soils. Few resemble any drift: it has to predict better.
        drafted = outside_catalogue.best(one, plain, progress)[:1]
        suits = refit_ranking.as_good if many else refit_ranking.beats
        if any(suits(law.refit, several) and (many or not law.like_soils(one)) for law in drafted):
            return Instead(f"a law ({drafted[0].draft.in_words()})")
    return None


def _share(data: Ground, plain: Refit, better: Refit) -> float:
    """Return which part of what a model leaves beyond the noise another one takes off."""
    noise = sum(int(part.seen.sum()) for part in data.data)
    return float((plain.loss - better.loss).sum()) / max(float(plain.loss.sum()) - noise, 1e-300)


def _best(data: Ground, index: int) -> tuple[float, int]:
    """Return what the best step under a wheel takes off the sum of squares to first order, and its place."""
    wheel, solution, part = data.wheels[index], data.base[index], data.data[index]
    # Of samples that are in the order of terrains, or in none, no place is before another.
    if not wheel.ordered or np.any(np.diff(wheel.windows.rows) <= 0):
        return 0.0, 0
    best, place = 0.0, 0
    for window in range(part.windows):
        rows = np.flatnonzero(part.window == window)
        if len(rows) < 2 * criteria.SOIL_SAMPLES:
            continue
        gain = _gains(solution, rows)
        at = int(np.argmax(gain))
        if gain[at] > best:
            best, place = float(gain[at]), int(rows[criteria.SOIL_SAMPLES + at])
    return best, place


def _gains(solution: Solution, rows: Index) -> Array:
    """Return what soils of their own before and from each sample take off, some way from either end.

    In units of the noise's variance, less what chance takes off as often as not for each parameter.
    """
    q = solution.t.shape[1]
    design = solution.design[rows][..., :q]
    residual = np.clip(solution.residual[rows], -_WILD, _WILD)
    square = np.cumsum(np.einsum("ncp,ncq->npq", design, design), axis=0)
    product = np.cumsum(np.einsum("ncp,nc->np", design, residual), axis=0)

    inner, prior = slice(criteria.SOIL_SAMPLES - 1, len(rows) - criteria.SOIL_SAMPLES), np.eye(q)
    first = explained(square[inner] + prior, product[inner])
    second = explained(square[-1] - square[inner] + prior, product[-1] - product[inner])
    return np.asarray(first + second - explained(square[-1] + prior, product[-1]) - q)


def _split(data: Ground, index: int, place: int) -> Ground:
    """Fit the base of one wheel with one more soil, from a fitted sample on."""
    wheel, part, base = data.wheels[index], data.data[index], data.base[index]
    window = int(part.window[place])
    later = (part.window > window) | ((part.window == window) & (np.arange(len(part.window)) >= place))
    part = replace(part, window=part.window + later, windows=part.windows + 1)
    t = np.insert(base.t, window + 1, base.t[window], axis=0)
    begun = ((t, base.common), (None, base.common))
    solution = smoothed_fit.search(wheel.model, base.unknowns, part, begun)
    datas, solutions = list(data.data), list(data.base)
    datas[index], solutions[index] = part, solution
    return replace(data, data=datas, base=solutions)


def _cut(wheel: FittedWheel, sample: int) -> FittedWheel:
    """Fit the model of a wheel with one more soil, from a usable sample on."""
    windows = wheel.windows
    window = int(wheel.window[sample])
    return FittedWheel(
        replace(windows, bounds=np.insert(windows.bounds, window + 1, sample)),
        wheel.model,
        wheel.settings,
        wheel.segment,
        wheel.further,
    )


def _where(wheel: FittedWheel, sample: int) -> str:
    samples = wheel.windows.samples
    return f"{samples}: the soil changes at {place_of(samples, int(wheel.windows.rows[sample]))}"
