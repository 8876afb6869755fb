"""How many soils a log has: fewer where an effect explains them, more where nothing else explains it.

Windows are cut where the line y = c + x tan φ changes. A second pass, a warming motor or a lag look like
such a change to whoever cuts first; and a soil can change though its strength hardly does: its stiffness
steps, which shows in sinkage, and in all that follows from it. Either is weighed on held-out blocks.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from terrain_cli.comparison import smoothed_fit
from terrain_cli.comparison.compare import fit_wheels
from terrain_cli.comparison.fitted_wheel import FittedWheel
from terrain_cli.diagnosis import diagnosis_criteria as criteria
from terrain_cli.diagnosis import outside_catalogue, refit_ranking, refits, screening
from terrain_cli.estimation.estimators import FitSettings
from terrain_cli.estimation.wheel_fit.normal_equations import explained
from terrain_cli.vocabulary.quantities import counted, the_wheel

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from terrain_cli.comparison import Comparison
    from terrain_cli.comparison.smoothed_fit import Solution
    from terrain_cli.diagnosis.diagnosis_outcome import Hypothesis
    from terrain_cli.diagnosis.refits import Ground, Refit
    from terrain_cli.effects import Effect
    from terrain_cli.models import ModelFile
    from terrain_cli.vocabulary.arrays import Array, Index
    from terrain_cli.windows.cut_windows import Windows


#: Samples of all wheels that are fitted.
MOST_SAMPLES = 3_000
#: Bounds of a residual, in deviations of the noise.
_WILD = 10.0


def on_fewer(
    cut: Ground, block: Sequence[Index], hypotheses: Sequence[Hypothesis], progress: Callable[[str], None]
) -> tuple[Ground, list[Index]]:
    """Take one soil for each terrain if, with some effect or none, it predicts as well as several."""
    wheels, blocks = [], []
    for wheel, own in zip(cut.wheels, block, strict=True):
        joined, order = wheel.one_soil or (wheel, slice(None))
        wheels.append(joined)
        blocks.append(own[order])
    if all(one is other for one, other in zip(wheels, cut.wheels, strict=True)):
        return cut, list(block)
    one = refits.ground(wheels, blocks, MOST_SAMPLES, cut)
    if _stand_for_soils(one, blocks, cut, hypotheses, progress):
        return one, blocks
    return cut, list(block)


def on_more(
    data: Ground, block: Sequence[Index], hypotheses: Sequence[Hypothesis], progress: Callable[[str], None]
) -> tuple[Ground, list[str]]:
    """Take another soil, told where, from a sample on if that predicts better than any effect on the same."""
    if data.blocks < criteria.BLOCKS_OF_ALARM:
        return data, []
    found = _with_steps(data, block)
    if found is None or _stand_for_soils(data, block, found[0], hypotheses, progress):
        return data, []
    return found[0], found[2]


def as_needed(
    comparison: Comparison,
    file: ModelFile,
    *,
    without: ModelFile | None = None,
    effects: Sequence[Effect] = (),
) -> tuple[list[Windows], list[str]]:
    """Return the windows of a comparison on the soils that a model needs, and what has to be said about it.

    `without` is the model before it got one of the effects: where that stands for soils, there are fewer.
    """
    windows = [wheel.windows for wheel in comparison.wheels]
    block = [wheel.blocks for wheel in comparison.wheels]
    if without is not None and len(effects) == 1 and any(len(one) > 1 for one in windows):
        cut = _ground(windows, block, without, effects)
        hypotheses, _ = screening.hypotheses(without, cut.wheels, effects)
        fewer, _ = on_fewer(cut, block, hypotheses, lambda _: None)
        if any(len(a.windows) < len(b.windows) for a, b in zip(fewer.wheels, cut.wheels, strict=True)):
            soils = sum(len(wheel.windows) for wheel in fewer.wheels)
            enough = counted(soils, "soil")
            told = f"with {effects[0].id}, {enough} will do: both models are compared on {enough}"
            return [wheel.windows for wheel in fewer.wheels], [told]
    if not comparison.failures:
        return windows, []
    found = _with_steps(_ground(windows, block, file), block)
    return ([wheel.windows for wheel in found[0].wheels], found[2]) if found else (windows, [])


def _ground(
    windows: Sequence[Windows], block: Sequence[Index], file: ModelFile, effects: Sequence[Effect] = ()
) -> Ground:
    settings = FitSettings.of(windows, file)
    further = {name for effect in effects for name in effect.reads}
    return refits.ground(fit_wheels(windows, file.model, settings, further=further)[0], block, MOST_SAMPLES)


def _with_steps(data: Ground, block: Sequence[Index]) -> tuple[Ground, Refit, list[str]] | None:
    """Cut windows where the soil steps; with the base on more soils, and where each of them begins."""
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
    return found, before, [_where(found.wheels[index], sample) for index, sample in sorted(steps)]


def _stand_for_soils(
    one: Ground,
    block: Sequence[Index],
    cut: Ground,
    hypotheses: Sequence[Hypothesis],
    progress: Callable[[str], None],
) -> bool:
    """Tell whether fewer soils, with some effect or none, predict as well as several."""
    plain, several = refits.refit(one, None), refits.refit(cut, None)
    if refit_ranking.as_good(plain, several):
        return True
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
            return True
    fewer = sum(part.windows for part in cut.data) - sum(part.windows for part in one.data)
    if fewer >= criteria.SOILS_OF_A_LAW:
        # Nor may what is in no catalogue pass for soils.
        drafted = outside_catalogue.best(one, plain, progress)
        return bool(drafted) and refit_ranking.as_good(drafted[0].refit, several)
    return False


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
        further=wheel.further,
    )


def _where(wheel: FittedWheel, sample: int) -> str:
    samples, row = wheel.windows.samples, int(wheel.windows.rows[sample])
    when = f"{samples.time[row] - samples.time[0]:.4g} s" if samples.time is not None else f"row {row + 1}"
    distance = samples.distance
    driven = f" ({distance[row]:.3g} m)" if distance is not None and np.isfinite(distance[row]) else ""
    return f"{samples.source}: {the_wheel(samples.wheel)}: the soil changes at {when}{driven}"
