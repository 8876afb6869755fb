"""What a model lacks: the method of docs/diagnose-method.md, step by step."""

from collections.abc import Callable, Collection, Sequence
from dataclasses import replace
from typing import Any

from terrain_cli.comparison import comparison_criteria
from terrain_cli.diagnosis import diagnosis_criteria as criteria
from terrain_cli.diagnosis import refits, screening, steps, verdict
from terrain_cli.diagnosis.alarm import missing_effects
from terrain_cli.diagnosis.candidates import as_it_is, of_pair, table_of
from terrain_cli.diagnosis.diagnosed_log import Case, DiagnosedLog, scores, soils
from terrain_cli.diagnosis.diagnosis_outcome import Alarm, Diagnosis, leaves_much
from terrain_cli.diagnosis.refits import Refit
from terrain_cli.diagnosis.screening import Screened
from terrain_cli.effects import Effect
from terrain_cli.models import ModelFile
from terrain_cli.windows.cut_windows import Windows


def diagnose(
    wheels: Sequence[Windows],
    file: ModelFile,
    *,
    effects: Sequence[Effect] | None = None,
    seed: int = 0,
    smallest_share: float | None = None,
    progress: Callable[[str], None] = lambda _: None,
    early: Callable[[Screened], None] = lambda _: None,
) -> Diagnosis:
    """Find out what a model lacks.

    Inputs of the same wheel are joined: what is the wheel's or its sensors' is the same in all of them, soils
    are not. `effects` may be missing; by default those of the catalogue. What takes less than
    `smallest_share` of the root mean square of every channel raises no alarm. `early` gets the scores of all
    effects, long before the refits end. Raises InputError where nothing that the model predicts was measured.
    """
    case = Case(
        file=file,
        effects=missing_effects(file, effects),
        seed=seed,
        progress=progress,
        smallest_share=criteria.SMALLEST_SHARE if smallest_share is None else smallest_share,
    )
    log = soils(case, wheels)
    log = scores(case, log)
    early(log.found)
    base = refits.refit(log.data, None)
    alarm = steps.alarm_of_scores(case, log, base)
    if not alarm.raised:
        return _silent(case, log, base, alarm)
    ranked = steps.ranking(case, log, base)
    alarm = steps.alarm_of_gain(case, ranked, alarm)
    if not alarm.raised:
        return _silent(case, ranked.log, ranked.base, alarm, ranked)
    family = steps.family(case, ranked)
    two = steps.two_at_once(case, ranked, family)
    law, law_alone = steps.outside_the_catalogue(ranked, family, two)
    full = steps.on_full_stresses(case, ranked, two)
    # Where nothing stands, the best effect is told with what it explains.
    nothing = not (law or two.ids or full)
    decision = verdict.decide(
        family=family.ids or tuple(one.id for one, _ in ranked.several[:nothing]),
        earned=family.earned,
        clear=family.clear,
        law_alone=law_alone,
        pair=two.ids,
        pair_is_best=two.is_best,
        on_full_stresses=tuple(one.id for one, _ in full),
    )
    told = bool(two.ids) and decision.together == two.ids
    pair = of_pair(ranked.log, ranked.base, *two.fitted[0]) if told else None
    listed = table_of(ranked.log, ranked.base, ranked.several, decision.family, ranked.first_anew, pair)
    heldout = as_it_is(ranked.log)
    leaves = decision.effect is not None and leaves_much(log.comparison, heldout, listed[0])
    decision = verdict.weighed(decision, listed, leaves=leaves)
    listed = [replace(one, in_family=one.effect in decision.family) for one in listed]
    members = {"family": family.open, "on_full_stresses": full}.get(decision.rivals, [])
    if decision.verdict == "unknown" and law is not None:
        changed: Collection[str] = [law.channel]
    else:
        changed = next((one.laws for one in case.effects if one.id == decision.family[0]), ())
    return _told(
        case,
        ranked.log,
        alarm,
        changed,
        verdict=decision.verdict,
        effect=decision.effect,
        family=decision.family,
        candidates=listed,
        unknown=law if decision.tells_law else None,
        next_drive=steps.next_drives(case, ranked, steps.rivals(decision, members, listed)),
        together=decision.together,
        together_or=two.rivals if told else (),
        pair=pair,
        heldout=heldout,
    )


def _silent(
    case: Case, log: DiagnosedLog, base: Refit, alarm: Alarm, ranked: steps.Ranked | None = None
) -> Diagnosis:
    """Say that nothing shows; of few data, and of effects that are `ranked`, also what they speak for."""
    few = log.data.blocks < comparison_criteria.FEWEST_BLOCKS
    several = ranked.several if ranked else steps.refitted(case, log) if few else []
    candidates = table_of(log, base, several, (), ranked.first_anew if ranked else ())
    heldout = as_it_is(log) if several else {}
    return _told(case, log, alarm, (), verdict="none", candidates=candidates, heldout=heldout)


def _told(case: Case, log: DiagnosedLog, alarm: Alarm, changed: Collection[str], **found: Any) -> Diagnosis:
    """Put together what was found, with the sentence for a person; `changed` is as for `verdict.sentence`."""
    diagnosis = Diagnosis(
        comparison=log.comparison,
        alarm=alarm,
        not_testable=list(log.not_testable),
        warnings=list(log.comparison.warnings),
        unrecorded=screening.unrecorded(case.effects, log.data.wheels),
        soils=sum(len(wheel.windows) for wheel in log.data.wheels),
        **found,
    )
    return replace(diagnosis, sentence=verdict.sentence(diagnosis, log.failures, changed))
