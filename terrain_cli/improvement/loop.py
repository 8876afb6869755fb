"""The whole loop: name what is missing, add it, keep it if it pays, until the alarm is silent."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any

from terrain_cli import models
from terrain_cli.comparison import Comparison, kept_aside
from terrain_cli.diagnosis.diagnosis_outcome import Diagnosis, NextDrive, UnknownEffect
from terrain_cli.diagnosis.evidence import Evidence
from terrain_cli.estimation.estimators import EstimateRequest
from terrain_cli.improvement import improvement_criteria as criteria
from terrain_cli.improvement.change_trial import tried
from terrain_cli.improvement.improvement_outcome import Action, Step, Stopped
from terrain_cli.models import Changed, ModelFile
from terrain_cli.vocabulary.quantities import listed
from terrain_cli.windows.cut_windows import Windows


def until_quiet(
    wheels: Sequence[Windows],
    file: ModelFile,
    *,
    diagnose: Callable[[Sequence[Windows], ModelFile], Diagnosis],
    draft: Callable[[UnknownEffect], str] | None = None,
    paths: Mapping[str, str] | None = None,
    seed: int = 0,
    progress: Callable[[str], None] = lambda _: None,
    beside: bool = False,
) -> Iterator[Step | Stopped]:
    """Add what is missing, effect by effect, and keep only what pays on held-out data.

    Each round asks for a diagnosis of the model as it has become, tries two effects that explain it together,
    the effect named, or those that the data cannot tell apart from the best one on, and keeps the first of
    these whose held-out error falls. That proves nothing against the others, which may pay too: the step
    names them, and the drive that would tell. When the alarm is silent, or nothing pays, every effect that
    was added is taken out again by way of trial, and stays out unless the held-out error rises. `draft`
    writes the file of an effect for what no candidate explains; without it the loop ends there. Paths begin
    in the folder of the model file; `beside` is that of `tried`. Yields every change that was tried, and at
    last where it ended.
    """
    modulus = wheels[0].samples.geometry.shear_modulus
    named = dict(paths or {})
    added: list[str] = []
    every = all(one.samples.aside is None for one in wheels)
    soils: EstimateRequest | None = None  # Of the model as it has become

    def attempt(
        action: Action, names: Sequence[str], current: ModelFile, first: Comparison | None
    ) -> tuple[Step, ModelFile]:
        nonlocal soils
        change = (models.added if action == "add" else models.removed)(current, names, modulus)
        step = tried_in_forms(
            wheels,
            action,
            change,
            current,
            first=first,
            soils=soils,
            seed=seed,
            progress=lambda what: progress(f"{action} {' '.join(names)}: {what}"),
            beside=beside,
        )
        kept = step.pays if action == "add" else not step.costs
        soils = (step.second if kept else step.first).soils
        return replace(step, kept=kept), step.after if kept else current

    silent, because = False, ""
    found: Diagnosis | None = None
    last: Step | None = None
    refused: tuple[str, ...] = ()
    while len(added) < criteria.MOST_EFFECTS:
        progress("diagnosis")
        found = diagnose(kept_aside.seen(wheels), file)
        silent = not found.alarm.raised
        choices, because = _candidates(found, draft)
        if not choices:
            break
        for names in choices:
            first = found.comparison if every else None
            step, file = attempt("add", [named.get(name, name) for name in names], file, first)
            if step.kept:
                rivals, drive = _rivals(found, names)
                step = replace(step, rivals=rivals, next_drive=drive)
            yield step
            if step.kept:
                added += step.changed
                last = step
                break
        else:
            several = listed([" with ".join(names) for names in choices])
            because = f"held-out data support no further effect; tried: {several}"
            refused = tuple(dict.fromkeys(name for names in choices for name in names))
            break
    else:
        because, found = f"stopped after {criteria.MOST_EFFECTS} effects", None
    effects = [name for name in added if name not in models.ASSUMPTIONS]
    removed: list[str] = []
    # One that was added alone has just been tried.
    for name in effects if len(added) > 1 else ():
        step, file = attempt("remove", [name], file, None)
        yield step
        if step.kept:
            removed.append(name)
            last = step
    if removed:
        found = diagnose(kept_aside.seen(wheels), file)
        again = silent and found.alarm.raised
        because = f"without {listed(removed)} the data show a missing effect again" if again else because
    yield _stopped(file, found, last, because, refused)


def tried_in_forms(
    wheels: Sequence[Windows], action: Action, change: Changed, before: ModelFile, **options: Any
) -> Step:
    """Try a change of a model in each form of its effects, as `tried` does; return what predicts best."""
    steps: list[Step] = []
    for file in models.in_forms(change):
        steps.append(tried(wheels, action, change.ids, before, file, **options))
        options |= {"first": steps[0].compared_before, "soils": steps[0].first.soils}
    return min(steps, key=lambda step: (not step.pays, step.evidence.overall.value))


def _stopped(
    file: ModelFile, found: Diagnosis | None, last: Step | None, because: str, refused: tuple[str, ...]
) -> Stopped:
    """Say where the loop ended, by the diagnosis of the model as it is, if there is one."""
    if found is None:
        assert last is not None  # noqa: S101 - what changed the model
        now = last.compared_after
        return Stopped(file, False, because, Evidence.of_comparison(now), now)
    evidence = Evidence.of_diagnosis(found, refused=refused)
    return Stopped(file, not found.alarm.raised, because, evidence, found.comparison)


def _rivals(found: Diagnosis, names: Sequence[str]) -> tuple[tuple[str, ...], NextDrive | None]:
    """Return what the data do not tell from an effect of a family, and the drive that would."""
    if len(names) != 1 or names[0] not in found.family:
        return (), None
    doubted = {one.effect for one in found.candidates if one.doubt}
    rivals = tuple(name for name in found.family if name not in names and name not in doubted)
    # Drives are sought for the best of the family; the first settles most of it.
    own = [one for one in found.next_drive if names[0] in one.pair and not doubted & {*one.pair}]
    own = own or found.next_drive
    return rivals, own[0] if rivals and own else None


def _candidates(
    found: Diagnosis, draft: Callable[[UnknownEffect], str] | None
) -> tuple[list[tuple[str, ...]], str]:
    """Return what is to be tried, alone or together, the best first; or nothing, and why."""
    choices, because = _proposed(found, draft)
    before = found.comparison.refused
    left = [names for names in choices if names not in before.effects]
    if choices and not left:
        because = f"held-out data support no further effect; tried before: {listed(list(before.names))}"
    return left, because


def _proposed(
    found: Diagnosis, draft: Callable[[UnknownEffect], str] | None
) -> tuple[list[tuple[str, ...]], str]:
    """Return what a diagnosis proposes; or nothing, and why."""
    if not found.alarm.raised:
        evidence = Evidence.of_diagnosis(found)
        likely: list[tuple[str, ...]] = []
        if evidence.closest and evidence.misses:
            # Held-out data can judge what may be chance.
            likely = [(evidence.closest,)]
        further, left = ("further ", "what is left") if evidence.effects else ("", "the misfit")
        why = "the data show no missing effect"
        if evidence.misses or evidence.tracked:
            why = f"no {further}effect explains {left}"
        elif evidence.impossible:
            why = f"the fitted soil is physically impossible, and no {further}effect explains it"
        return likely, why
    both = [found.together] if found.together else []
    if found.together[:1] == (models.STRESSES,):
        # The others of the family are behind the stresses, and some need them.
        both = [(models.STRESSES, name) for name in found.family[1:]]
        return [*both, (models.STRESSES,)], ""
    choices = [*both, *((name,) for name in dict.fromkeys([*filter(None, [found.effect]), *found.family]))]
    if choices:
        return choices, ""
    if found.unknown is None:
        return [], "something is missing, but no effect can be named"
    if draft is None:
        sentence = found.unknown.sentence.rstrip(".")
        return [], f"{sentence[:1].lower()}{sentence[1:]}; --draft FILE.toml adds this law"
    return [(draft(found.unknown),)], ""
