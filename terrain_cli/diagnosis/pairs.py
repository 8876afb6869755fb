"""Two effects that are missing together, of which neither alone explains what is seen.

Step by step the first effect added is the one that imitates both best, which need not be one of them.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import partial

from terrain_cli import effects as catalogues
from terrain_cli import processes
from terrain_cli.diagnosis import diagnosis_criteria as criteria
from terrain_cli.diagnosis import refit_ranking, refits, screening
from terrain_cli.diagnosis.diagnosed_log import DiagnosedLog
from terrain_cli.diagnosis.diagnosis_outcome import Hypothesis
from terrain_cli.diagnosis.refits import Ground, Refit
from terrain_cli.effects import Effect
from terrain_cli.mechanics.wheel_model import Model
from terrain_cli.models import ModelFile, model_change


def best(
    data: Ground,
    log: DiagnosedLog,
    ranked: Sequence[tuple[Hypothesis, Refit]],
    progress: Callable[[str], None],
    name: str,
) -> list[tuple[Hypothesis, Refit]]:
    """Find two effects that together predict held-out blocks better than any alone.

    None that nature could not have, nor one of which an effect is impossible alone, and only in doubt as each
    of the two takes up what the other does. `name` is an effect that leaves little, if any: it is tried with
    any other that promises most.
    """
    alone = {one.id: (one, refit) for one, refit in ranked if one.effects}
    others = [
        one for one in log.hypotheses if one.effects and one.id in log.found.p_values and one.id not in alone
    ]
    promising = screening.promising_pairs(log.found, [*(one for one, _ in alone.values()), *others])
    chosen, rest = promising[: criteria.RIVALS], promising[criteria.RIVALS :]
    chosen += [pair for pair in rest if name in (one.id for one in pair)][: criteria.RIVALS]
    fitted = []
    for first, second in chosen:
        pair = _both(data, first, second)
        if pair is None:
            continue
        progress(f"fitting with {first.id} and {second.id}")
        # What explains little alone was not fitted; beside another it may explain what is left.
        for one in (first, second):
            if one.id not in alone:
                alone[one.id] = one, refits.refit(data, one)
        after = [alone[one.id][1] for one in (first, second)]
        refit = refits.refit(data, pair, after=after)
        hidden = any(
            refit_ranking.imitates(data, *alone[one.id])
            and refit_ranking.imitates(data, one, refit, errors=0.0)
            for one in (first, second)
        )
        if not hidden and not refit_ranking.doubt(data, pair, refit):
            fitted.append((pair, refit))
    return sorted(fitted, key=lambda one: float(one[1].loss.sum()))


@dataclass(frozen=True, kw_only=True)
class Two:
    """Two effects that belong together, and all pairs that were fitted, the best first."""

    ids: tuple[str, ...] = ()
    is_best: bool = False  # They explain more than a name that is clear does with any other, beyond chance
    rivals: tuple[tuple[str, ...], ...] = ()  # Other pairs that take nearly as much off what one alone leaves
    fitted: list[tuple[Hypothesis, Refit]] = field(default_factory=list)


def two_of(fitted: list[tuple[Hypothesis, Refit]], others: Sequence[Refit], name: str) -> Two:
    """Return two effects that explain more than anything else, if a name that is clear is none of them.

    An effect that imitates two others well leaves little, but those two leave less. One that leaves little
    because it is there, though not in the form of the catalogue or not alone, goes best with another.
    """
    if not fitted or name in _ids(fitted[0][0]):
        return Two(fitted=fitted)
    pair, refit = fitted[0]
    if not all(refit_ranking.beats(refit, one) for one in others):
        return Two(fitted=fitted)
    is_best = all(refit_ranking.beats(refit, one) for other, one in fitted if name in _ids(other))
    # A law is never quite that of the catalogue: what is nearly as good may be the truth.
    gained = min(float((one.loss - refit.loss).sum()) for one in others)
    near = [(other, float((one.loss - refit.loss).sum())) for other, one in fitted[1:]]
    rivals = tuple(_ids(other) for other, left in near if left < criteria.SMALL_REST * gained)
    return Two(ids=_ids(pair), is_best=is_best, rivals=rivals, fitted=fitted)


def _ids(pair: Hypothesis) -> tuple[str, ...]:
    return tuple(effect.id for effect in pair.effects)


def on_full_stresses(
    data: Ground, file: ModelFile, effects: Sequence[Effect], base: Refit, progress: Callable[[str], None]
) -> list[tuple[Hypothesis, Refit]]:
    """Find the effects that predict held-out blocks best once the stresses are no longer linearised.

    What the base linear gets wrong, some effect imitates, and hides another one behind it. Those as good as
    the best come first, and of these the ones that did not run to the end of what they can be; none that
    nature could not have.
    """
    modulus = data.wheels[0].windows.samples.geometry.shear_modulus
    full = model_change.with_stresses(file, modulus)
    several = [
        replace(one, fixed={**full.fixed, **one.fixed}, priors={**full.priors, **one.priors})
        for one in screening.hypotheses(full, data.wheels, effects)[0]
        if one.effects
    ]
    tried = processes.each(
        partial(refits.refit, data, after=[base]),
        several,
        lambda one: progress(f"fitting with {base.id} and {one.id}"),
    )
    good = [pair for pair in zip(several, tried, strict=True) if not refit_ranking.imitates(data, *pair)]
    if not good:
        return []
    good.sort(key=lambda pair: float(pair[1].loss.sum()))
    best = good[0][1]
    return sorted(
        good, key=lambda pair: (not refit_ranking.as_good(pair[1], best), pair[1].at_bound(pair[0]))
    )


def _both(data: Ground, first: Hypothesis, second: Hypothesis) -> Hypothesis | None:
    model = data.wheels[0].model
    if catalogues.conflict(first.model, second.effects[0]):
        return None
    effects = (*first.effects, *second.effects)
    return Hypothesis(
        id=f"{first.id} and {second.id}",
        title=f"{first.title}; {second.title}",
        model=Model(model.base, (*model.effects, *effects)),
        fixed={**first.fixed, **second.fixed},
        priors={**first.priors, **second.priors},
        effects=effects,
    )
