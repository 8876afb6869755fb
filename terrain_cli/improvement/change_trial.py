"""Models on the same windows and blocks: before and after a change, and those to choose from."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import cache, partial
from typing import Any, NamedTuple, Self

import numpy as np

from terrain_cli import models, processes
from terrain_cli.comparison import Comparison, Difference, comparison_criteria, distributions
from terrain_cli.comparison.compare import needed_segments, of_fitted, on_few_soils
from terrain_cli.comparison.comparison_outcome import Soils, WheelComparison, segment_soils, with_refused
from terrain_cli.comparison.fitted_wheel import FittedWheel
from terrain_cli.comparison.two_models import between_soils, paired_soils
from terrain_cli.diagnosis import alarm, diagnosis_criteria, several_soils
from terrain_cli.effects import Effect
from terrain_cli.estimation.estimators import EstimateRequest, FitSettings, estimate_beside
from terrain_cli.estimation.wheel_fit.unknowns import EFFECT_SCALES
from terrain_cli.improvement import improvement_criteria as criteria
from terrain_cli.improvement.held_out_gain import weigh
from terrain_cli.improvement.improvement_outcome import Action, Estimated, Idle, Lost, Shift, Step
from terrain_cli.mechanics.effect import Parameter
from terrain_cli.models import ModelFile
from terrain_cli.telemetry.long_logs import notes
from terrain_cli.vocabulary.quantities import listed
from terrain_cli.windows import joined_inputs
from terrain_cli.windows.cut_windows import Windows
from terrain_cli.windows.joined_inputs import which_wheel, with_inputs

Place = tuple[str, str, int]  # Source, wheel and number of a segment


class _OnSoils(NamedTuple):
    """A model that was fitted to the soils which it needs."""

    wheels: Sequence[Windows]  # As they were cut
    file: ModelFile
    missing: Sequence[Effect]  # Effects that it does not have
    fitted: Sequence[FittedWheel]
    told: Sequence[str]  # What has to be said about it

    @classmethod
    def of(cls, wheels: Sequence[Windows], file: ModelFile, progress: Callable[[str], None]) -> Self:
        settings = FitSettings.of(wheels, file)
        missing = alarm.missing_effects(file)
        further = tuple(dict.fromkeys(name for effect in missing for name in effect.reads))
        known = with_inputs(wheels, [*file.model.effects, *missing])
        several, told = on_few_soils(known, file.model, settings, further=further, progress=progress)
        return cls(wheels, file, missing, several, told)

    def on_needed(self, **options: Any) -> tuple[Self, Comparison]:
        """Compare it on the soils that it needs, which may be more; options are those of `compared`."""
        found = self.compared(**options)
        fitted, steps, _ = several_soils.on_more(found, self.fitted, self.file, self.missing)
        if not steps:
            return self, found
        more = self._replace(fitted=fitted, told=[*self.told, *steps])
        return more, more.compared(**options)

    def compared(self, soils: EstimateRequest | None = None, *, seed: int, **options: Any) -> Comparison:
        """Compare it with what was measured; options are those of `of_fitted`."""
        wheels, file, missing, fitted, told = self
        found = of_fitted(fitted, seed=seed, warnings=told, **options)
        return replace(
            with_refused(found, file, wheels),
            soils=soils or EstimateRequest(wheels=wheels, file=file, needed=needed_segments),
            scores=cache(partial(alarm.score, found, fitted, file, missing, seed)),
        )


def compared(
    wheels: Sequence[Windows],
    file: ModelFile,
    *,
    like: Comparison | None = None,
    findings: bool = True,
    soils: EstimateRequest | None = None,
    seed: int = 0,
    progress: Callable[[str], None] = lambda _: None,
) -> Comparison:
    """Compare a model file with windows of wheels of one rover, on the blocks of `like`.

    Options are as for `of_fitted`. What was not read of the inputs is among the warnings.
    """
    own = _OnSoils.of(wheels, file, progress)
    options: dict[str, Any] = {"soils": soils, "like": like, "seed": seed, "progress": progress}
    found = own.on_needed(**options)[1] if findings else own.compared(findings=False, **options)
    return replace(found, warnings=[*notes([windows.samples for windows in wheels]), *found.warnings])


def tried(
    wheels: Sequence[Windows],
    action: Action,
    changed: Sequence[str],
    before: ModelFile,
    after: ModelFile,
    *,
    first: Comparison | None = None,
    soils: EstimateRequest | None = None,
    seed: int = 0,
    progress: Callable[[str], None] = lambda _: None,
    beside: bool = False,
) -> Step:
    """Fit a model without a change, if `first` is not that, and with it; compare both on blocks left out.

    The segments are estimated in this process, or in one `beside` it; `soils` are those without the change,
    where a trial before has asked for them.
    """
    # An effect has one value for a wheel, in all of its inputs.
    effects = [effect for file in (before, after) for effect in file.model.effects]
    parts, wheels = wheels, joined_inputs.by_wheel(wheels, effects)
    # c and φ are those of the segments, however many soils the two models are compared on.
    every = partial(EstimateRequest, wheels=wheels, needed=needed_segments)
    asked = [soils or every(file=before), every(file=after)]
    answer = estimate_beside(asked) if beside else lambda: None

    def telling(what: str) -> Callable[[str], None]:
        return lambda step: progress(f"{what}: {step}")

    def both(some: Sequence[Windows], first: Comparison | None, *, more: bool) -> list[Comparison]:
        """Return both on the same blocks, then both on their own, as `compare` has them.

        With `more` on as many soils as each needs.
        """
        told, new = telling("before"), telling("after")

        def on(file: ModelFile, tell: Callable[[str], None]) -> tuple[_OnSoils, Comparison]:
            own = _OnSoils.of(some, file, tell)
            known: dict[str, Any] = {"seed": seed, "progress": tell}
            return own.on_needed(**known) if more else (own, own.compared(**known))

        old = cache(lambda: on(before, told))
        own = old()[1] if first is None else first
        fitted, changed = on(after, new)
        if own.blocks < comparison_criteria.FEWEST_BLOCKS and changed.blocks > own.blocks:
            # What is missing is remembered longer than noise: the better model tells how long that is.
            return [old()[0].compared(like=changed, seed=seed, progress=told), changed, own, changed]
        wheels_of_both = zip(own.wheels, changed.wheels, strict=True)
        if not changed.failures and all(np.array_equal(a.blocks, b.blocks) for a, b in wheels_of_both):
            return [own, changed, own, changed]
        second = fitted.compared(like=own, findings=False, seed=seed, progress=new)
        # Where it fails is told on its own blocks, which may be shorter.
        return [own, replace(second, failures=changed.failures), own, changed]

    first, second, compared_before, compared_after = both(wheels, first, more=True)
    progress("one soil or several")
    windows, told = _needed_soils(action, first, second, compared_after, before, after)
    if told:
        first, second, *_ = both(windows, None, more=False)
    remarks = [*notes([windows.samples for windows in parts]), *second.warnings, *told]
    answer()
    first = replace(first, soils=asked[0])
    second = replace(second, warnings=remarks, soils=asked[1])
    pairs = paired_soils(first, second)
    differences = between_soils(pairs)
    with_it, file = (second, after) if action == "add" else (first, before)
    places = _places(parts, [one.segments for one, _ in pairs])
    channels, evidence = weigh(first, second, compared_after)
    open_before = _open(first)
    return Step(
        action=action,
        changed=tuple(changed),
        before=before,
        after=after,
        first=first,
        second=second,
        compared_before=compared_before,
        compared_after=compared_after,
        channels=channels,
        evidence=evidence,
        parameters=list(_parameters(second, after, changed)),
        shifts=[_shift(name, differences, places) for name in ("c", "phi")],
        undetermined=tuple(name for name, n in _open(second).items() if n > open_before.get(name, 0)),
        lost=list(_lost(pairs, places)),
        sources=tuple(dict.fromkeys(windows.samples.source for windows in parts)),
        absent=_absent(with_it, file, changed),
        imitates=tuple(_imitating(with_it, file, changed)),
        idle=tuple(_idle(first, second, before, after, changed)),
    )


def _needed_soils(
    action: Action,
    first: Comparison,
    second: Comparison,
    own: Comparison,
    before: ModelFile,
    after: ModelFile,
) -> tuple[Sequence[Windows], list[str]]:
    """Return the soils that the model with an effect needs, and what is said of them if they are others.

    Without an effect, new soils can stand for it: then it would seem to be worth nothing.
    """
    ratio = weigh(first, second, own)[1].overall
    with_it, without, file, plain = first, second, before, after
    if action == "add":
        with_it, without, file, plain = second, first, after, before
    # As a change is judged: less is none, however sure.
    differs = not ratio.low <= 1.0 <= ratio.high and abs(ratio.value - 1.0) > criteria.LEAST_CHANGE
    pays = differs and (ratio.value < 1.0) == (action == "add")
    new = [one for one in file.model.effects if one not in plain.model.effects]
    windows, told = [wheel.windows for wheel in with_it.wheels], list[str]()
    if len(new) == 1 and not pays and any(len(one) > 1 for one in windows):
        windows, told = several_soils.enough_with(with_it, new[0], plain)
    if not told and new and not differs and with_it.soil_count < without.soil_count:
        # With fewer soils it predicts as well: what it is worth shows on these.
        told = [several_soils.enough(new, with_it.soil_count)]
    return windows, told


def _places(parts: Sequence[Windows], wheels: Sequence[Windows]) -> list[Place]:
    """Return where each segment of joined inputs begins: input, wheel, and its number there."""
    places: list[Place] = []
    for wheel in wheels:
        own = [one for one in parts if which_wheel(one.samples) == which_wheel(wheel.samples)]
        firsts = np.concatenate([[0], np.cumsum([len(one.rows) for one in own])])
        for start in wheel.bounds[:-1]:
            part = int(np.searchsorted(firsts, start, side="right")) - 1
            segment = int(np.searchsorted(own[part].bounds, start - firsts[part], side="right"))
            places.append((own[part].samples.source, wheel.samples.wheel, segment))
    return places


def _parameters(comparison: Comparison, file: ModelFile, changed: Sequence[str]) -> Iterator[Estimated]:
    """Return the parameters of some effects as `estimate` has them, and k where it was assumed."""
    for wheel, (_, soil, common) in zip(comparison.wheels, segment_soils(comparison), strict=True):
        names = [name for name in common.values if name.partition(".")[0] in changed]
        found = {name: (common.values[name], common.errors[name]) for name in names}
        if models.MODULUS in changed and "shear_modulus" in common.open_samples:
            usual = (float(np.nanmedian(one)) for one in (soil.shear_modulus, soil.shear_modulus_se))
            found["shear_modulus"] = (next(usual), next(usual))
        for name, known in found.items():
            yield _estimated(wheel, file, (name,), *known, determined=common.determined(name))


def _estimated(
    wheel: WheelComparison,
    file: ModelFile,
    names: Sequence[str],
    value: float,
    se: float,
    *,
    determined: bool = True,
) -> Estimated:
    """Return a parameter, or the sum of several, in the unit of the model file."""
    factor = file.factor(names[0])
    own = wheel.fit.model.parameters.get(names[0]) if len(names) == 1 else None
    sums = [(effect, one) for effect in file.model.effects for one in effect.sums if len(names) > 1]
    rates = {f"{effect.id}.{name}": f" × {of}" for effect, one in sums for name, of in one.rates.items()}
    empirical = any(names[0].startswith(f"{effect.id}.") for effect in file.model.effects if effect.empirical)
    return Estimated(
        source=wheel.source,
        wheel=wheel.wheel,
        name=" + ".join(f"{name}{rates.get(name, '')}" for name in names),
        unit=file.units[names[0]],
        value=value / factor,
        se=se / factor,
        determined=determined,
        remark=remark(
            own and own.under(*wheel.fit.under), value, determined=determined, has_usual_size=not empirical
        ),
    )


def remark(own: Parameter | None, value: float, *, determined: bool, has_usual_size: bool = True) -> str:
    """Say why a value, SI, is to be doubted; `own` is its parameter of an effect, under this wheel."""
    if own is not None and own.at_bound(value):
        return "at its bound"
    if not determined:
        return "left open by the data"
    usual = abs(value - own.null) / own.scale if own is not None else 0.0
    return f"{usual:.0f} times its usual size" if has_usual_size and usual > EFFECT_SCALES else ""


def _imitating(comparison: Comparison, file: ModelFile, changed: Sequence[str]) -> Iterator[Estimated]:
    """Return the parameters of some effects that are where nature has none, or their sums."""
    every = file.model.effects
    limited = comparison.limited([soils.common for soils in segment_soils(comparison)])
    for effect in (one for one in every if not one.made_up_by(every)):
        found = effect.imitations(limited, criteria.DOUBTED, diagnosis_criteria.DRAFT_LEFT)
        for place, names, value, error in found if effect.id in changed else ():
            yield _estimated(comparison.wheels[place], file, names, value, error)


def _absent(comparison: Comparison, file: ModelFile, changed: Sequence[str]) -> float:
    """Return the p-value of some effects being absent; NaN where none is estimated, or one held elsewhere."""
    held = {name: own.null for name, own in file.model.parameters.items() if name in file.fixed}
    if any(name.partition(".")[0] in changed and file.fixed[name] != null for name, null in held.items()):
        return np.nan
    squares, count = 0.0, 0
    # On the soils that are judged: where somebody asked for cuts, each soil may stand for an effect.
    for wheel in comparison.wheels:
        fit, known = wheel.fit, wheel.fit.model.parameters
        error = np.sqrt(np.diagonal(fit.shared_covariance))
        chosen = [
            k
            for k, name in enumerate(fit.shared)
            if name.partition(".")[0] in changed
            and name in known
            and not known[name].shape
            and error[k] > 0.0
        ]
        values = list(fit.shared.items())
        away = np.array([values[k][1] - known[values[k][0]].null for k in chosen]) / error[chosen]
        related = fit.shared_covariance[np.ix_(chosen, chosen)] / np.outer(error[chosen], error[chosen])
        squares += float(away @ np.linalg.pinv(related, hermitian=True) @ away) if chosen else 0.0
        count += len(chosen)
    return distributions.chi_squared_tail(squares, count) if count else np.nan


def _idle(
    first: Comparison, second: Comparison, before: ModelFile, after: ModelFile, changed: Sequence[str]
) -> Iterator[Idle]:
    """Return the effects that are there without a change, and may as well be absent with it."""
    for effect in after.model.effects:
        if effect.id in changed or effect not in before.model.effects:
            continue
        was, now = _absent(first, before, [effect.id]), _absent(second, after, [effect.id])
        if was <= diagnosis_criteria.LEVEL < now:
            yield Idle(effect.id, now)


def _shift(name: str, differences: Sequence[Difference], places: Sequence[Place]) -> Shift:
    moved = [one for one in differences if one.where is not None and one.name == name]
    sizes = np.array([abs(one.difference) / one.se if one.se > 0.0 else np.nan for one in moved])
    known = np.flatnonzero(np.isfinite(sizes))
    if len(known) == 0:
        return Shift(name, np.nan, np.nan, None)
    largest = known[np.argmax(sizes[known])]
    return Shift(name, float(sizes[largest]), float(np.median(sizes[known])), places[largest])


def _open(comparison: Comparison) -> dict[str, int]:
    """Count the samples in whose segment the data leave a parameter open."""
    model, counts = comparison.wheels[0].model, dict[str, int]()
    for soils in segment_soils(comparison):
        for name, count in soils.common.open_samples.items():
            if name in (*model.soil, *model.parameters):
                counts[name] = counts.get(name, 0) + count
    return counts


def _lost(soils: Sequence[tuple[Soils, Soils]], places: Sequence[Place]) -> Iterator[Lost]:
    both = [
        pair for old, new in soils for pair in zip(old.estimates.status, new.estimates.status, strict=True)
    ]
    for place, (was, now) in zip(places, both, strict=True):
        if was == "ok" != now:
            yield Lost(*place, str(was), str(now))


class Alternative(NamedTuple):
    """A model that a reader may choose to look at."""

    label: str
    comparison: Comparison
    own: bool = False  # Whether it is the model that was asked for


def alternatives(
    wheels: Sequence[Windows],
    file: ModelFile,
    own: Comparison,
    *,
    candidates: int,
    seed: int = 0,
    progress: Callable[[str], None] = lambda _: None,
) -> list[Alternative]:
    """Fit a model effect by effect, on the blocks of `own`, and with each further one that scores name.

    Of these it is not looked for where they fail.
    """
    modulus = wheels[0].samples.geometry.shear_modulus
    ids = [effect.id for effect in file.model.effects]
    others = [
        (_named(file, ids[:count]), models.removed(file, ids[count:], modulus).file)
        for count in range(len(ids))
    ]
    scores = own.scores() if own.scores else None
    missing = scores.effects[:candidates] if scores and scores.raised else ()
    others += [(f"+ {name}", models.added(file, [name], modulus).file) for name in missing]
    # Scores hold what cannot be sent to another process, and are asked for of the model itself alone.
    shown = partial(_alternative, wheels, replace(own, scores=None), seed)
    found = processes.each(shown, others, lambda one: progress(one[0]))
    return [*found[: len(ids)], Alternative(_named(file, ids), own, own=True), *found[len(ids) :]]


def _alternative(
    wheels: Sequence[Windows], like: Comparison, seed: int, model: tuple[str, ModelFile]
) -> Alternative:
    label, file = model
    found = compared(wheels, file, like=like, findings=False, seed=seed)
    return Alternative(label, replace(found, scores=None))


def _named(file: ModelFile, ids: Sequence[str]) -> str:
    return f"{file.model.base}{f' with {listed(ids)}' if ids else ''}"
