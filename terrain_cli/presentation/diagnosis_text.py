"""A diagnosis as JSON, and as a sentence and tables for a person."""

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from terrain_cli.comparison import comparison_criteria, kept_aside
from terrain_cli.diagnosis import diagnosis_criteria
from terrain_cli.diagnosis.conclusion import Conclusion
from terrain_cli.diagnosis.diagnosis_outcome import Candidate, Diagnosis, over_noise
from terrain_cli.diagnosis.evidence import Evidence
from terrain_cli.diagnosis.screening import Screened
from terrain_cli.diagnosis.verdict import sizes_text
from terrain_cli.improvement import model_history
from terrain_cli.presentation import comparison_text
from terrain_cli.presentation.terminal import aligned
from terrain_cli.vocabulary.next_commands import Asked
from terrain_cli.vocabulary.quantities import entries, known, listed, quantity, short

FORMAT = "terrain-est/diagnosis/1"
_ALARM = ("raised", "p_value", "level", "gain", "gain_se", "cause", "channel", "share", "smallest_share")
_UNKNOWN = ("channel", "driver", "form", "explained", "sentence", "alternatives")
_LEGEND = (
    "explains: share of the squared error beyond the noise; "
    "survives: share of the effect's signature that no change of soil imitates"
)
_SHOWN = 8  # Candidates that a person reads
_EARLY = 5  # Effects whose scores one reads while the fits go on


def document(diagnosis: Diagnosis, asked: Asked | None = None, draft: str = "") -> dict[str, Any]:
    """Return a diagnosis as it is written to JSON; `draft` is the file of its law, if that was written."""
    comparison = diagnosis.comparison
    aside = kept_aside.number(wheel.samples for wheel in comparison.wheels)
    return {
        "format": FORMAT,
        "model": comparison.model,
        "data": {**comparison_text.data_document(comparison), **({"kept_aside": aside} if aside else {})},
        "channels": {
            name: entries(errors, "unit", "rmse", "heldout_rmse", "noise")
            for name, errors in comparison.channels.items()
        },
        "alarm": entries(diagnosis.alarm, *_ALARM),
        **entries(diagnosis, "verdict", "effect", "family", "together", "together_or"),
        "together_heldout_rmse": _errors_of(diagnosis.pair, comparison.channels) if diagnosis.pair else None,
        "candidates": [
            {**_candidate(one, comparison.channels), "ranked_by": ranked}
            for one, ranked in zip(diagnosis.candidates, ranked_by(diagnosis.candidates), strict=True)
        ],
        "unknown": entries(diagnosis.unknown, *_UNKNOWN) if diagnosis.unknown else None,
        "next_drive": [model_history.drive(one) for one in diagnosis.next_drive],
        "not_testable": [one._asdict() for one in diagnosis.not_testable],
        **entries(diagnosis, "warnings", "sentence"),
        "conclusion": comparison_text.conclusion_document(_concluded(diagnosis, asked, draft)),
    }


def _concluded(diagnosis: Diagnosis, asked: Asked | None, draft: str) -> Conclusion:
    evidence = Evidence.of_diagnosis(diagnosis, draft)
    return comparison_text.conclusion_of(evidence, diagnosis.comparison, asked)


def _errors_of(one: Candidate, channels: Iterable[str]) -> dict[str, float | None]:
    return {name: known(one.heldout.get(name, math.nan)) for name in channels}


def _candidate(one: Candidate, channels: Iterable[str]) -> dict[str, Any]:
    return {
        **entries(one, "effect", "title", "score", "p_value", "explained", "surviving"),
        "heldout_rmse": _errors_of(one, channels),
        "heldout_loss": known(one.loss),
        "heldout_loss_se": known(one.loss_se),
        **entries(one, "refitted", "in_family", "doubt"),
        "parameters": {
            name: {
                "value": known(size.value),
                "se": known(size.se),
                "unit": size.unit,
                "wheels": {name: {"value": value, "se": known(se)} for name, value, se in size.wheels},
            }
            for name, size in one.sizes.items()
        },
    }


def ranked_by(candidates: Sequence[Candidate]) -> list[str]:
    """Say what gives each candidate its place: its loss, or what overrules that.

    "score" where it was not fitted; of a first one, where the next has less loss, "errors" if its printed
    errors are clearly lower, else "plainer", as it has fewer parameters; "behind" where candidates with more
    loss come before it.
    """
    fitted = [one for one in candidates if one.refitted]
    overruled = len(fitted) > 1 and fitted[1].loss < fitted[0].loss and not fitted[1].doubt
    lower = overruled and fitted[0].explained - fitted[1].explained >= diagnosis_criteria.DRAFT_LEFT
    found, most = [], -math.inf
    for one in candidates:
        if not one.refitted:
            found.append("score")
        elif overruled and one is fitted[0]:
            found.append("errors" if lower else "plainer")
        else:
            found.append("behind" if one.loss < most else "loss")
            most = max(most, one.loss)
    return found


def leads(candidates: Sequence[Candidate]) -> bool:
    """Tell whether the first stands before all others, which it does not where only others are marked."""
    return not any(one.in_family for one in candidates[1:]) or candidates[0].in_family


def order(candidates: Sequence[Candidate], together: Sequence[str] = ()) -> list[str]:
    """Say in which order several candidates stand, and what is marked."""
    told = []
    if any(one.in_family for one in candidates[1:]):
        why = "named in the first line" if together else "these data cannot tell them from the best"
        best = "the best, then " * leads(candidates)
        told.append(f"order: {best}those marked * ({why}), then the others")
    if len(candidates) > 1 and candidates[0].in_family and ranked_by(candidates)[0] == "plainer":
        first, second = candidates[:2]
        told.append(
            f"{second.effect} is not significantly better than {first.effect}, but has more parameters"
        )
    return told


def text(diagnosis: Diagnosis, asked: Asked | None = None, draft: str = "") -> str:
    """Write a diagnosis for a person: one sentence, then what it rests on, then what follows from it."""
    alarm = diagnosis.alarm
    chance = f"p {alarm.p_value:.4f}" if alarm.p_value >= 0.0001 else "p < 0.0001"
    state = "raised" if alarm.raised else "silent"
    idle = f": {alarm.cause} predicts best, but lowers no held-out error" * alarm.idle
    lines = [diagnosis.sentence, "", f"alarm: {state} ({chance}, level {alarm.level:g}){idle}"]
    fitted = [one for one in diagnosis.candidates if one.refitted]
    # As the column says, which is about the errors beside it, not about the loss of the ranking.
    leading = fitted[:1] if leads(fitted) else []
    rest = sorted(fitted[len(leading) :], key=lambda one: (not one.in_family, -one.explained))
    shown = [*([diagnosis.pair] if diagnosis.pair else []), *[*leading, *rest][:_SHOWN]]
    if shown:
        soils = "; same soils: those of the rows below" * bool(diagnosis.heldout)
        lines += ["", *_table(diagnosis, shown), *order(fitted, diagnosis.together), f"{_LEGEND}{soils}"]
    lines += _drives(diagnosis)
    if diagnosis.not_testable:
        lines += ["", "not testable on these data:"]
        reasons: dict[str, list[str]] = {}
        for one in diagnosis.not_testable:
            reasons.setdefault(one.because, []).append(one.effect)
        lines += [f"  {', '.join(names)}: {because}" for because, names in reasons.items()]
    lines += [f"note: {warning}" for warning in diagnosis.warnings]
    lines += ["", _concluded(diagnosis, asked, draft).sentence]
    return "\n".join(lines)


def _drives(diagnosis: Diagnosis) -> list[str]:
    """Write each drive once, with all pairs that it tells apart."""
    effects = {one.effect for one in diagnosis.candidates}
    pairs: dict[tuple[str, str], list[str]] = {}
    for drive in diagnosis.next_drive:
        first, second = drive.pair
        power = f" (decides in {drive.power:.0%} of cases)" * bool(drive.settings)
        # The first sentence says which.
        drafted = diagnosis.unknown is not None and second not in effects
        rival = "that error of a sensor" if drafted else second
        pairs.setdefault((drive.manoeuvre, first), []).append(f"{rival}{power}")
    told = []
    for (manoeuvre, first), others in pairs.items():
        told += ["", f"to tell {first} from {listed(others, 'or')}: {manoeuvre}"]
    return told


def early(found: Screened) -> str:
    """Write the strongest scores for a person who waits for the refits."""
    known = sorted(
        (name for name, t in found.scores.items() if t > 0.0), key=lambda name: -found.scores[name]
    )
    shown = known[:_EARLY]
    width = max(map(len, shown), default=0)
    lines = [f"  {name:{width}}  {found.scores[name]:5.1f}  p {found.p_values[name]:.4f}" for name in shown]
    if not lines:
        return "first scores: none, no effect can be tested on these data"
    head = f"first scores of {len(known)} effects, in standard errors, before any fit:"
    return "\n".join([head, *lines])


def _table(diagnosis: Diagnosis, shown: list[Candidate]) -> list[str]:
    own = diagnosis.comparison.channels
    channels = {name: quantity(name, errors.unit) for name, errors in own.items()}
    head = ["effect", "explains", "survives", *(f"{one.words} [{one.unit}]" for one in channels.values())]
    head += ["parameters"]

    def errors(held_out: Mapping[str, float]) -> list[str]:
        return [short(held_out.get(name, math.nan) * one.factor) for name, one in channels.items()]

    # Of errors that are those of noise a share says nothing.
    noise = all(one <= comparison_criteria.ABOVE_NOISE for one in over_noise(diagnosis.comparison).values())
    misfit = diagnosis.alarm.raised or bool(diagnosis.heldout) or not noise
    base = ["(as it is)", "", "", *errors({name: one.heldout_rmse for name, one in own.items()}), ""]
    rows = [
        [
            f"{'* ' if one.in_family else '  '}{one.effect}",
            f"{one.explained:.0%}" if misfit and math.isfinite(one.explained) else "–",
            f"{one.surviving:.0%}" if math.isfinite(one.surviving) else "",
            *errors(one.heldout),
            f"{sizes_text(one)} ({one.doubt})" if one.doubt else sizes_text(one),
        ]
        for one in shown
    ]
    table = [head, ["  " + base[0], *base[1:]]]
    if diagnosis.heldout:
        table.append(["  (as it is, same soils)", "", "", *errors(diagnosis.heldout), ""])
    return ["held-out error with each effect:", *aligned([*table, *rows])]
