"""What a model lacks: alarm, ranking, family, and what is in no catalogue."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from terrain_cli import effects as catalogues
from terrain_cli import fitting, models, parallel
from terrain_cli.comparison import blocks, soils
from terrain_cli.comparison.compare import ENOUGH_RUNS, fit_wheels, of_fitted
from terrain_cli.comparison.findings import Residuals
from terrain_cli.comparison.wheel import Settings
from terrain_cli.diagnosis import (
    candidates,
    chance,
    joining,
    leftover,
    merits,
    next_drive,
    pairs,
    refits,
    rivals,
    screening,
    sentences,
    several_soils,
    unknowns,
)
from terrain_cli.diagnosis.parts import Alarm, Diagnosis
from terrain_cli.english import counted
from terrain_cli.telemetry.excerpt import notes

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from numpy.typing import NDArray

    from terrain_cli.comparison import Comparison, Finding
    from terrain_cli.comparison.wheel import Wheel
    from terrain_cli.diagnosis.parts import Hypothesis, NotTestable, Verdict
    from terrain_cli.diagnosis.refits import Ground, Refit
    from terrain_cli.diagnosis.screening import Screened
    from terrain_cli.effects import Effect
    from terrain_cli.models import ModelFile
    from terrain_cli.windows import Windows

    Array = NDArray[np.float64]
    Index = NDArray[np.intp]

#: The alarm is raised where chance gives a score as strong in fewer cases than the first, and a gain on
#: held-out blocks as large in fewer than the second. What acts in a few blocks alone gains there alone: no
#: test of the mean finds that sure, however large it is.
LEVEL, _GAINED = 0.01, 0.03
#: The latter for steady test points, whose scores are beyond chance too often: six of six that gain do so
#: in one case of 64.
_GAINED_STEADY = 0.016
#: Candidates that are weighed against one another.
_RIVALS = 8
#: A candidate that takes less than this part of what the best takes off the loss is no rival.
_WORTH = 0.3
#: Blocks are not joined to fewer than these, nor for less of a correlation between neighbours; and fewer do
#: not earn a single name.
_FEWEST, _UNRELATED = 8, 0.2
#: Part of what an effect explains that may be left to follow the drive.
_SMALL = 0.05
#: Part of the best one's gain with which an effect within its bounds comes before it.
_CREDIBLE = 0.7


def diagnose(
    wheels: Sequence[Windows],
    file: ModelFile,
    *,
    effects: Sequence[Effect] | None = None,
    seed: int = 0,
    progress: Callable[[str], None] = lambda _: None,
    early: Callable[[Screened], None] = lambda _: None,
) -> Diagnosis:
    """Find out what a model lacks.

    Parameters
    ----------
    wheels : sequence of Windows
        With usable samples, read for a comparison. Inputs of the same wheel are joined: what is the
        wheel's or its sensors' is the same in all of them, soils are not.
    file : ModelFile
    effects : sequence of Effect, optional
        That may be missing; the catalogue if not given.
    seed : int
        Of all that is drawn.
    progress : callable
        Called with the name of each step before it begins.
    early : callable
        Called with the scores of all effects as soon as they are known, long before the refits end.

    Returns
    -------
    Diagnosis

    Raises
    ------
    InputError
        Nothing that the model predicts was measured.
    """
    every = list(catalogues.catalogue().values() if effects is None else effects)
    there = {effect.id for effect in file.model.effects}
    every = [effect for effect in every if effect.id not in there]
    read = notes([windows.samples for windows in wheels])
    joined = joining.by_wheel(wheels, every)
    held, priors, noise = fitting.assumed(joined, file)
    settings = Settings(held, priors, [name for name in file.shared if name not in held], noise)
    further = tuple(dict.fromkeys(name for effect in every for name in effect.reads))
    fitted, warnings = fit_wheels(joined, file.model, settings, further=further, progress=progress)
    few, joined_soils = soils.as_few_as_predict(fitted, progress)
    comparison = of_fitted(few, seed=seed, warnings=[*read, *warnings, *joined_soils], progress=progress)
    block = [one.blocks for one in comparison.wheels]
    hypotheses, not_testable = screening.hypotheses(file, few, every)
    cut = refits.ground(few, block, several_soils.MOST_SAMPLES)
    progress("one soil or several")
    chosen, own = several_soils.on_fewer(cut, block, hypotheses, progress)
    chosen, steps = several_soils.on_more(chosen, own, hypotheses, progress)
    if any(wheel.one_soil for wheel in chosen.wheels):
        hypotheses, alike = screening.on_changing_soil(hypotheses)
        not_testable = [*not_testable, *alike]
    progress("scoring every effect")
    comparison = replace(comparison, warnings=[*comparison.warnings, *steps])
    found, chosen, own = _screened(chosen, own, comparison, hypotheses, seed)
    early(found)
    not_testable = [*not_testable, *found.not_testable]
    failures = list(comparison.failures)
    if any(one is not other for one, other in zip(chosen.wheels, few, strict=True)):
        failures = _findings(chosen.wheels, own, comparison, seed)
    state = _State(chosen, found, failures, file, every, seed, progress)
    return state.diagnosis(comparison, hypotheses, not_testable)


def _screened(
    chosen: Ground,
    block: list[Index],
    comparison: Comparison,
    hypotheses: Sequence[Hypothesis],
    seed: int,
) -> tuple[Screened, Ground, list[Index]]:
    """Score every effect, on blocks so long that what one soil for all leaves in them is unrelated."""
    found = screening.screen(chosen.wheels, block, hypotheses, seed)
    if all(one.fit is wheel.fit for one, wheel in zip(comparison.wheels, chosen.wheels, strict=True)):
        return found, chosen, block
    count = len(found.blocks)
    runs = [wheel.windows.samples.labels.get("run") for wheel in chosen.wheels]
    if any(label is not None and len(label.names) >= ENOUGH_RUNS for label in runs):
        return found, chosen, block
    label = blocks.merged(
        found.blocks, np.zeros(count, dtype=np.intp), fewest=min(_FEWEST, count), independent=_UNRELATED
    )
    if int(label.max(initial=0)) + 1 == count:
        return found, chosen, block
    merged = [label[one] for one in block]
    ground = replace(
        chosen,
        block=[label[one] for one in chosen.block],
        data=[replace(part, blocks=int(label.max()) + 1) for part in chosen.data],
    )
    return screening.screen(ground.wheels, merged, hypotheses, seed), ground, merged


def _findings(
    wheels: Sequence[Wheel], block: Sequence[Index], comparison: Comparison, seed: int
) -> list[Finding]:
    """Search the residuals on other soils for findings."""
    levels = {name: errors.noise for name, errors in comparison.channels.items()}
    scale = {
        name: float(
            np.sqrt(
                np.nanmean(np.concatenate([w.residuals[name] for w in wheels if name in w.residuals]) ** 2)
            )
        )
        for name in levels
        if any(name in wheel.residuals for wheel in wheels)
    }
    scale = {name: size for name, size in scale.items() if size > 0.0}
    return Residuals(wheels, block, scale).findings(levels, seed) if scale else []


class _State:
    """A diagnosis on its way."""

    def __init__(
        self,
        data: Ground,
        found: Screened,
        failures: Sequence[Finding],
        file: ModelFile,
        effects: Sequence[Effect],
        seed: int,
        progress: Callable[[str], None],
    ) -> None:
        self.data, self.found, self.failures, self.seed, self.progress = data, found, failures, seed, progress
        self.file, self.effects = file, effects
        self.base = refits.refit(data, None)

    def diagnosis(
        self,
        comparison: Comparison,
        hypotheses: Sequence[Hypothesis],
        not_testable: Sequence[NotTestable],
    ) -> Diagnosis:
        """Go from scores to a verdict."""
        p_value = min([1.0, *self.found.p_values.values(), *(one.p_value for one in self.failures)])
        p_value = min(p_value, self._of_assumptions(hypotheses), chance.of_order(self.data, self.seed))
        if self.data.blocks < screening.FEWEST_BLOCKS or p_value >= LEVEL:
            silent = Alarm(
                False, 1.0 if self.data.blocks < screening.FEWEST_BLOCKS else p_value, LEVEL, 0.0, 0.0
            )
            return self._silent(comparison, silent, hypotheses, not_testable)
        ranked = self._refits(hypotheses)
        draft = unknowns.best(self.data, self.base, self.progress)
        ranked, draft = self._weighed_anew(ranked, draft)
        best = ranked[0][1] if ranked else self.base
        gains = [self.base.loss - one.loss for one in (best, *(d.refit for d in draft[:1]))]
        gain = max(gains, key=lambda g: float(g.sum()))
        gained = _GAINED if any(wheel.ordered for wheel in self.data.wheels) else _GAINED_STEADY
        p_value = max(p_value, chance.of_gain(gain) * LEVEL / gained)
        alarm = Alarm(p_value < LEVEL, p_value, LEVEL, float(gain.sum()), merits.error(gain))
        if not alarm.raised:
            return self._silent(comparison, alarm, hypotheses, not_testable)
        taken = float((self.base.loss - best.loss).sum())
        near = [
            pair for pair in ranked[:_RIVALS] if float((self.base.loss - pair[1].loss).sum()) > _WORTH * taken
        ]
        members, earned, clear, whole = self._judged(near, draft, taken)
        family = tuple(one.id for one, _ in members)
        unknown, alone = unknowns.verdict(self.base, best, draft, family)
        name = family[0] if clear else ""
        # Where a draft stands alone, it has beaten the best effect: nothing is clear then.
        two = [] if whole else pairs.best(self.data, self.found, ranked, self.progress, name)
        others = [one.refit for one in draft[:1]]
        together, sure = pairs.told(two, [best, *others], name)
        if together:
            unknown, alone, earned = None, False, False
            if name:
                family = together if sure else tuple(dict.fromkeys((*together, *family)))
                members = []
            family = family or together
        full = self._on_full_stresses(ranked, [*others, *(one for _, one in two[:1])])
        if full:
            together = (models.STRESSES, full[0][0].id)
            unknown, alone, earned, members = None, False, False, full
            family = (models.STRESSES, *(one.id for one, _ in full))
        verdict: Verdict = "unknown" if alone else ("effect" if earned else "family")
        if alone:
            family = ()
        drives = []
        if len(members) > 1 and not alone:
            self.progress("looking for the drive that would settle it")
            drives = next_drive.suggest(self.data, members)
        diagnosis = Diagnosis(
            comparison,
            alarm,
            verdict,
            family[0] if earned and not alone else None,
            family,
            candidates.listed(self.data, self.base, self.found, ranked, hypotheses, family),
            unknown,
            drives,
            list(not_testable),
            list(comparison.warnings),
            "",
            together,
            refits.fitted_errors(self.data, self.base),
            self.base.heldout,
        )
        laws = {one.id: one.laws for one in self.effects}
        changed = [unknown.channel] if alone and unknown else laws.get(family[0], ())
        return replace(diagnosis, sentence=sentences.verdict(diagnosis, self.failures, changed))

    def _judged(
        self, near: list[tuple[Hypothesis, Refit]], draft: Sequence[unknowns.Tried], taken: float
    ) -> tuple[list[tuple[Hypothesis, Refit]], bool, bool, bool]:
        """Tell the best ones apart.

        Returns
        -------
        list of (Hypothesis, Refit)
            Those that cannot be told from the best, the best first.
        earned, clear, whole : bool
            The best has earned a single name; it leaves little, if anything; it leaves nothing.
        """
        if taken <= 0.0 or not near:
            return [], False, False, False
        self.progress("telling the best ones apart")
        judged = rivals.judge(self.data, [one for _, one in near], [one for one, _ in near], self.seed)
        # A name that leaves something unexplained is not the whole story, and perhaps none of it.
        of_rest, left = leftover.follows(self.data, near[0][1], self.seed)
        clear = (of_rest >= LEVEL and left < taken) or left < _SMALL * taken
        # Nor is it where a law that nobody thought of predicts better.
        clear = clear and not unknowns.beats(draft, near[0][1])
        # Nor where it stands for something that nature does not have.
        clear = clear and not merits.imitates(self.data, *near[0])
        earned = judged.earned and clear and self.data.blocks >= _FEWEST
        return [near[place] for place in judged.family], earned, clear, clear and of_rest >= LEVEL

    def _on_full_stresses(
        self, ranked: list[tuple[Hypothesis, Refit]], further: Sequence[Refit]
    ) -> list[tuple[Hypothesis, Refit]]:
        """Return the effects that go with the stresses of the full model, the best first.

        Together they predict better than any effect alone, and as well as all else: that the stresses of
        the base linear are not those under a wheel is known.
        """
        stresses = next((refit for one, refit in ranked if one.id == models.STRESSES), None)
        if stresses is None or ranked[0][0].id == models.STRESSES:
            return []
        tried = pairs.on_full_stresses(self.data, self.file, self.effects, stresses, self.progress)
        if not tried:
            return []
        first = tried[0][1]
        better = all(merits.beats(first, one) for one in (ranked[0][1], stresses))
        if not better or not all(merits.as_good(first, one) for one in further):
            return []
        return [(one, refit) for one, refit in tried if merits.as_good(refit, first)]

    def _weighed_anew(
        self, ranked: list[tuple[Hypothesis, Refit]], drafted: list[unknowns.Tried]
    ) -> tuple[list[tuple[Hypothesis, Refit]], list[unknowns.Tried]]:
        """Take what the best of all models leaves for the noise, and fit the best again.

        From neighbouring samples alone, noise that lasts would be taken for too small.
        """
        several = [one for _, one in ranked[:1]] + [one.refit for one in drafted[:1]]
        if not several:
            return ranked, drafted
        best = min(several, key=lambda one: float(one.loss.sum()))
        self.data = refits.with_noise_of(self.data, best)
        self.base = refits.refit(self.data, None)
        again = parallel.each(partial(_again, self.data), ranked[: _RIVALS + 2])
        again = _plainest_first(
            self._credible_first(sorted(again, key=lambda pair: float(pair[1].loss.sum())))
        )
        rest = [(one, refits.weighed(self.data, refit)) for one, refit in ranked[_RIVALS + 2 :]]
        return again + rest, [
            replace(one, refit=refits.refit(self.data, one.hypothesis, one.extra, one.refit.solutions))
            for one in drafted[:2]
        ]

    def _of_assumptions(self, hypotheses: Sequence[Hypothesis]) -> float:
        """How often chance gives the gain of lifting what the base assumes: it has no signature to score."""
        assumed = [one for one in hypotheses if not one.effects]
        gains = [self.base.loss - refits.refit(self.data, form).loss for one in assumed for form in one.forms]
        return min((len(gains) * chance.of_gain(gain) for gain in gains), default=1.0)

    def _credible_first(self, ranked: list[tuple[Hypothesis, Refit]]) -> list[tuple[Hypothesis, Refit]]:
        """Put an effect that ran to what cannot be behind those that explain nearly as much without."""
        if not ranked:
            return ranked
        least = _CREDIBLE * float((self.base.loss - ranked[0][1].loss).sum())
        good = [
            pair
            for pair in ranked
            if not merits.incredible(self.data, *pair)
            and float((self.base.loss - pair[1].loss).sum()) >= least
        ]
        return good + [pair for pair in ranked if pair not in good]

    def _silent(
        self,
        comparison: Comparison,
        alarm: Alarm,
        hypotheses: Sequence[Hypothesis],
        not_testable: Sequence[NotTestable],
    ) -> Diagnosis:
        # Few data prove nothing, but a person may want to know what they speak for.
        ranked = self._refits(hypotheses) if self.data.blocks < _FEWEST else []
        diagnosis = Diagnosis(
            comparison,
            alarm,
            "none",
            None,
            (),
            candidates.listed(self.data, self.base, self.found, ranked, hypotheses, ()),
            None,
            [],
            list(not_testable),
            [*comparison.warnings, *self._few()],
            "",
            fitted=refits.fitted_errors(self.data, self.base),
            heldout=self.base.heldout,
        )
        return replace(diagnosis, sentence=sentences.verdict(diagnosis, self.failures))

    def _few(self) -> list[str]:
        if self.data.blocks >= screening.FEWEST_BLOCKS:
            return []
        data = counted(self.data.blocks, "independent stretch", "es")
        return [f"only {data} of data: nothing can be told from chance"]

    def _refits(self, hypotheses: Sequence[Hypothesis]) -> list[tuple[Hypothesis, Refit]]:
        """Fit every testable hypothesis in the form of its law that predicts best, the best first."""
        testable = [one for one in hypotheses if one.id in self.found.p_values]

        def before(one: Hypothesis) -> None:
            self.progress(f"fitting with {one.id} ({testable.index(one) + 1} of {len(testable)})")

        pairs = parallel.each(partial(_best_form, self.data), testable, before)
        return sorted(pairs, key=lambda pair: float(pair[1].loss.sum()))


def _best_form(data: Ground, one: Hypothesis) -> tuple[Hypothesis, Refit]:
    """Fit a hypothesis in the form of its law that predicts best."""
    plain, *others = [(form, refits.refit(data, form)) for form in one.forms]
    # Another form stands for the effect only where it fits by what the effect can be.
    forms = [plain, *(pair for pair in others if not merits.incredible(data, *pair))]
    return min(forms, key=lambda pair: float(pair[1].loss.sum()))


def _again(data: Ground, pair: tuple[Hypothesis, Refit]) -> tuple[Hypothesis, Refit]:
    """Fit a hypothesis from where it was fitted."""
    one, before = pair
    return one, refits.over_shapes(data, one, refits.refit(data, one, begun=before.solutions))


def _plainest_first(ranked: list[tuple[Hypothesis, Refit]]) -> list[tuple[Hypothesis, Refit]]:
    """Put in front, of those that predict as well as the first, the one with fewest parameters."""
    if not ranked:
        return ranked
    good = [pair for pair in ranked if merits.as_good(pair[1], ranked[0][1])]
    first = min(good, key=lambda pair: pair[0].free)
    return [first, *(pair for pair in ranked if pair is not first)]
