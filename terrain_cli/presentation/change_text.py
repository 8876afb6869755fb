"""A change of a model in a sentence, as tables for a person, and as JSON; all changes as a table."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import asdict, replace
from typing import Any

from terrain_cli.comparison import Comparison, comparison_criteria
from terrain_cli.comparison.blocks import Interval
from terrain_cli.diagnosis.conclusion import Conclusion
from terrain_cli.diagnosis.diagnosis_outcome import too_few
from terrain_cli.diagnosis.evidence import Evidence
from terrain_cli.improvement import improvement_criteria as criteria
from terrain_cli.improvement import model_history
from terrain_cli.improvement.held_out_gain import held_out_error
from terrain_cli.improvement.improvement_outcome import ChannelChange, Estimated, Shift, Step, Stopped
from terrain_cli.improvement.model_history import Rung
from terrain_cli.presentation import comparison_text
from terrain_cli.presentation.terminal import aligned
from terrain_cli.vocabulary import quantities
from terrain_cli.vocabulary.next_commands import Asked
from terrain_cli.vocabulary.quantities import counted, listed

FORMAT = "terrain-est/model-change/1"
LOOP_FORMAT = "terrain-est/model-loop/1"
_MOST_ROWS = 12  # Rows of a table that a person reads


def verdict(step: Step) -> str:
    """Say what held-out data say of a change, and what became of it."""
    what = f"{listed(step.changed)} {'is' if len(step.changed) == 1 else 'are'}"
    kept = f"{what} {'added in spite of this, as --keep asks' if step.kept else 'not added'}"
    if step.action == "remove":
        return f"{what} removed{', though it pays' if step.costs else ''}: {found(step)}"
    if step.pays and step.confirmation is not None:
        proof = step.confirmation
        where = f"{listed(list(proof.sources))}, which did not choose it"
        if proof.pays:
            return f"{what} added: {found(step)}; confirmed on {where}: {found(proof)}"
        return f"{kept}: {found(step)}, but not confirmed on {where}: {found(proof)}"
    if step.pays:
        return f"{what} {'added' if step.kept else 'worth adding'}: {found(step)}"
    if step.better or (step.fell and step.evidence.overall.high < 1.0):
        return f"{kept}: {found(step)}"
    smaller = step.evidence.overall.value * (1.0 + criteria.LEAST_CHANGE) < 1.0
    uncertain = " significantly" if smaller else ""
    partly = " overall" if step.fell else uncertain
    return f"the held-out error did not fall{partly}: {kept} ({found(step)})"


def tried(step: Step) -> str:
    name = listed(step.changed)
    if step.action == "add":
        return f"{'+' if step.kept else 'not'} {name}: {found(step)}"
    return f"{'−' if step.kept else 'keeps'} {name}, tried without it: {found(step)}"


def doubt(step: Step) -> str:
    """Say what the data do not tell from an effect that the loop keeps, and what would."""
    what = f"these data cannot tell it from {listed(step.rivals, 'or')}"
    if step.next_drive is None:
        return what
    if not step.next_drive.settings:
        return f"{what}: {step.next_drive.manoeuvre}"
    return f"{what}; to tell, {step.next_drive.manoeuvre} (decides in {step.next_drive.power:.0%} of cases)"


def found(step: Step) -> str:
    """Say what became of the held-out error, without a name."""
    held = [
        f"{name} = {value:g} ({step.after.model.parameters[name].meaning})"
        for name, value in step.held.items()
    ]
    form = f", with {listed(held)}" if held else ""
    return f"{'on the stretches kept aside, ' * bool(step.evidence.aside)}{_found(step)}{form}"


def _found(step: Step) -> str:
    if not step.testable:
        return f"{too_few(step.evidence.blocks)} to test an effect"
    if step.evidence.lost > comparison_criteria.UNPREDICTED:
        return f"{step.evidence.lost:.0%} of the samples cannot be predicted any more"
    moved: list[str] = []
    for verb, channels in (("fell", step.fell), ("rose", step.rose)):
        if channels:
            error = "the held-out error " if not moved else ""
            moved.append(f"{error}{verb} in {listed([_moved_error(one) for one in channels])}")
    value, low, high = step.evidence.overall
    ratio = f"× {value:.2f} ({low:.2f} to {high:.2f})"
    if not moved:
        verb = "fell" if step.better else "rose" if step.costs and value > 1.0 else ""
        return (
            f"the held-out error {verb} over all channels, {ratio}, but in no single channel significantly"
            if verb
            else f"in no channel was the change significant and more than {criteria.LEAST_CHANGE:.0%}"
        )
    text = ", and ".join(moved)
    if not step.there:
        joined = "but" if step.fell else "and"
        null = f"its parameters do not differ significantly from their null values (p {step.absent:.2g})"
        return f"{text}, {joined} {null}"
    if step.imitates and step.fell:
        values = listed(
            [f"{p.name} = {quantities.number(p.value)} ± {quantities.number(p.se)}" for p in step.imitates]
        )
        return f"{text}, but only with {values}, which is physically impossible; another effect is missing"
    if step.action == "add" and step.fell and not step.pays and not step.rose:
        text += f", but over all channels the change is not significant: {ratio}"
    return text


def proof(step: Step, ask: str = "--confirm LOG or --keep-aside SHARE") -> str:
    """Say on what a change was judged, and what would be a stricter proof."""
    if step.confirmation is not None:
        return f"proof: another drive, {listed(list(step.confirmation.sources))}"
    if step.evidence.aside:
        some = counted(step.evidence.aside, "sample")
        return f"proof: stretches kept aside, {some} that diagnose with the same --keep-aside does not see"
    same = "proof: on data that may have chosen the effect"
    if step.evidence.too_short:
        return f"{same}: {model_history.same_stretches(step)}"
    return f"{same}; for a stricter proof give {ask}"


def reason(step: Step) -> str:
    """Say why a change is made, for the history of the model."""
    if step.action == "remove":
        return f"asked for; {found(step)}"
    proof = step.confirmation
    if proof is None:
        return found(step) if step.pays else f"--keep; {found(step)}"
    told = "confirmed" if proof.pays else "--keep; not confirmed"
    return f"{found(step)}; {told} on {listed(list(proof.sources))}: {found(proof)}"


def _moved_error(one: ChannelChange) -> str:
    what = quantities.quantity(one.name, one.unit)
    before, after = (quantities.number(v.value * what.factor) for v in (one.before, one.after))
    return f"{what.words} from {before} to {after} {what.unit}"


def document(step: Step, asked: Asked | None = None) -> dict[str, Any]:
    """Return a change as it is written to JSON; `asked` is of the model file, for the next command."""
    return {**_change(step), "conclusion": comparison_text.conclusion_document(_concluded(step, asked))}


def _change(step: Step) -> dict[str, Any]:
    """Return what a change did to the errors, by the keys of docs/model.md, in units of the model file."""
    return {
        "format": FORMAT,
        "action": step.action,
        "changed": list(step.changed),
        "sentence": verdict(step),
        "tested": True,
        "proof": step.proof,
        "proof_because": model_history.same_stretches(step) or None,
        "pays": step.pays if step.action == "add" else not step.costs,
        "kept": step.kept,
        "model": {"before": step.first.model, "after": step.second.model},
        **model_history.measured(step),
        "parameters": [
            asdict(one)
            | {"value": model_history.number(one.value), "se": model_history.number(one.se)}
            | {"remark": one.remark or None}
            for one in step.parameters
        ],
        "absent_p_value": model_history.number(step.absent),
        "imitates": [one.name for one in step.imitates],
        "idle": [one._asdict() for one in step.idle],
        "rivals": list(step.rivals),
        "next_drive": model_history.drive(step.next_drive),
        "confirmation": model_history.confirmation(step),
        "shift": {one.name: _shift(one) for one in step.shifts},
        "unidentifiable": {
            "parameters": list(step.undetermined),
            "segments": [one._asdict() for one in step.lost],
        },
        "alarm": {
            "silent": not step.compared_after.failures,
            "failures_before": _failures(step.first),
            "failures_after": _failures(step.compared_after),
        },
        "warnings": list(dict.fromkeys([*step.first.warnings, *step.second.warnings])),
    }


def _concluded(step: Step, asked: Asked | None) -> Conclusion:
    """Conclude what is known of the model as it is after the decision."""
    now = step.compared_after if step.kept else step.compared_before
    refused = step.changed if step.action == "add" and not step.kept else ()
    found = replace(Evidence.of_comparison(now, refused), unconfirmed=bool(refused) and step.pays)
    return comparison_text.conclusion_of(found, now, asked)


def untested(entry: dict[str, Any]) -> dict[str, Any]:
    """Return a change that was made without data, from `model_history.untested`, as it is written to JSON."""
    done = {"add": "added", "remove": "removed"}[entry["action"]]
    are = "is" if len(entry["changed"]) == 1 else "are"
    return {
        "format": FORMAT,
        "action": entry["action"],
        "changed": entry["changed"],
        "sentence": f"{listed(entry['changed'])} {are} {done}, without a test: no --data was given",
        "tested": False,
        "pays": None,
        "kept": True,
        "model": {"after": {"base": entry["base"], "effects": entry["effects"]}},
    }


def loop(steps: Sequence[Step], end: Stopped, asked: Asked | None = None) -> dict[str, Any]:
    return {
        "format": LOOP_FORMAT,
        "sentence": end.because,
        "silent": end.silent,
        "model": {"base": end.file.model.base, "effects": [effect.id for effect in end.file.model.effects]},
        "steps": [_change(step) for step in steps],
        "conclusion": comparison_text.conclusion_document(
            comparison_text.conclusion_of(end.evidence, end.comparison, asked)
        ),
    }


def _failures(comparison: Comparison) -> list[dict[str, Any]]:
    return [
        {"channel": one.channel, "driver": one.driver or None, "sentence": one.sentence}
        for one in comparison.failures
    ]


def _shift(one: Shift) -> dict[str, Any]:
    place = zip(("source", "wheel", "segment"), one.where or (None, None, None), strict=True)
    return {
        "largest_se": model_history.number(one.largest),
        "median_se": model_history.number(one.median),
        **dict(place),
    }


def text(step: Step, asked: Asked | None = None) -> str:
    """Write a change for a person: the verdict, then what it rests on, then what follows from it."""
    lines = [verdict(step), "", *_errors(step), ""]
    if step.confirmation is not None:
        lines += [f"on {listed(list(step.confirmation.sources))}:", *_errors(step.confirmation), ""]
    if step.parameters:
        lines += [*_parameters(step.parameters), ""]
    lines += [proof(step)] * (step.action == "add")
    lines += [_moved(step), *_open(step), *_idle(step)]
    before, after = len(step.first.failures), len(step.compared_after.failures)
    if before or after:
        lines.append(f"where it fails, {counted(after, 'finding')} (before: {before}){':' * (after > 0)}")
        lines += [f"  {finding.sentence}" for finding in step.compared_after.failures]
    if step.before.model.base != step.after.model.base:
        lines.append(
            "note: the two bases read different channels, so different noise reaches their predictions; "
            f"errors after are given with the noise that reaches the base {step.before.model.base}"
        )
    lines += [f"note: {warning}" for warning in step.second.warnings]
    return "\n".join([*lines, _concluded(step, asked).sentence])


def loop_text(steps: Sequence[Step], end: Stopped, asked: Asked | None = None) -> str:
    """Write where the loop ended for a person, and what it has done to the held-out errors."""
    kept = [step for step in steps if step.kept]
    effects = [effect.id for effect in end.file.model.effects]
    model = " + ".join([end.file.model.base, *effects])
    lines = [f"{end.because}; {model if kept else 'the model is as it was'}"]
    # One that was dropped later is in doubt no more, nor one whose rivals were added too.
    doubted = [step for step in kept if {*step.rivals} - {*effects} and {*step.changed} <= {*effects}]
    lines += [f"kept {listed(step.changed)}; {doubt(step)}" for step in doubted]
    if kept:
        first, last = kept[0], kept[-1]
        after = {one.name: (one.after, one.noise) for one in last.channels}
        if not last.evidence.aside:
            found = end.comparison
            after |= {name: (held_out_error(found, name), one.noise) for name, one in found.channels.items()}
        rows: list[Sequence[str]] = [("held-out rms error", "at first", "95 %", "at last", "95 %", "noise")]
        for one in first.channels:
            error, noise = after[one.name]
            rows.append(_row(one, (one.before, error), noise))
        lines += ["", *aligned(rows), "", proof(first, "--keep-aside SHARE")]
    return "\n".join([*lines, comparison_text.conclusion_of(end.evidence, end.comparison, asked).sentence])


def _errors(step: Step) -> list[str]:
    head = ("held-out rms error", "before", "95 %", "after", "95 %", "change", "95 %", "noise")
    rows = [_row(one, (one.before, one.after, one.difference), one.noise) for one in step.channels]
    ratio = step.evidence.overall
    if len(rows) > 1:
        value, range_ = _cells(ratio, 1.0)
        rows.append(["all, as a ratio", "", "", "", "", f"× {value}", range_, ""])
    return aligned([head, *rows])


def _row(one: ChannelChange, intervals: Sequence[Interval], noise: float) -> list[str]:
    what = quantities.quantity(one.name, one.unit)
    cells = [cell for interval in intervals for cell in _cells(interval, what.factor)]
    return [what.label, *cells, quantities.number(noise * what.factor)]


def _cells(interval: Interval, factor: float) -> tuple[str, str]:
    """Write a value and its interval, in the unit that a factor leads to."""
    value, low, high = (quantities.number(v * factor) for v in interval)
    return value, f"{low} … {high}" if math.isfinite(interval.low) else "–"


def _parameters(parameters: Sequence[Estimated]) -> list[str]:
    sources = len({one.source for one in parameters}) > 1
    rows = [
        (
            one.name,
            quantities.plus_minus(one.value, one.se),
            one.unit,
            f"{one.source} {one.wheel}" if sources else one.wheel,
            one.remark,
        )
        for one in parameters[:_MOST_ROWS]
    ]
    more = len(parameters) - len(rows)
    lines = aligned([("parameter", "value", "unit", "wheel", ""), *rows])
    return lines + [f"and {more} more"] * (more > 0)


def _moved(step: Step) -> str:
    several = len(step.first.wheels) > 1 or any(len(wheel.segments) > 1 for wheel in step.first.wheels)
    parts, unknown = [], []
    for one, symbol in zip(step.shifts, ("c", "φ"), strict=True):
        if one.where is None:
            unknown.append(symbol)
            continue
        _, wheel, segment = one.where
        most = (
            f" at most ({wheel}, segment {segment}), {quantities.number(one.median, 2)} in the median"
            * several
        )
        size = quantities.number(one.largest, 2)
        parts.append(f"{symbol} by {size} standard error{'s' * (size != '1')}{most}")
    known = [f"moved: {'; '.join(parts)}"] if parts else []
    return "; ".join([*known, *([f"how far {listed(unknown)} moved is not known"] if unknown else [])])


def _open(step: Step) -> Iterator[str]:
    if step.undetermined:
        yield f"these data do not determine: {', '.join(step.undetermined)}"
    if step.lost:
        shown = ", ".join(f"{one.wheel} {one.segment} ({one.after})" for one in step.lost[:_MOST_ROWS])
        more = " …" * (len(step.lost) > _MOST_ROWS)
        yield f"c and φ can no longer be separated in {counted(len(step.lost), 'segment')}: {shown}{more}"


def _idle(step: Step) -> Iterator[str]:
    for one in step.idle if step.kept else ():
        yield f"{one.effect} is no longer significant (p {one.p_value:.2g}): try `terrain-est model remove`"


def ladder(rungs: Sequence[Rung]) -> tuple[list[str], list[list[str]]]:
    """Return heading and rows of all changes of a model: a row for each channel of each change."""
    head = ["step", "change", "held-out rms error", "before", "95 %", "after", "95 %", "noise"]
    rows = []
    for rung in rungs:
        first = [str(rung.number), rung.label]
        if not rung.channels:
            rows.append([*first, *[""] * 6])
        for one in rung.channels:
            rows.append([*first, *_row(one, (one.before, one.after), one.noise)])
            first = ["", ""]
    return head, rows


def remarks(rungs: Sequence[Rung]) -> list[str]:
    """Return a line for each change: on what it was tried and judged, and why it was made."""
    return [
        f"{rung.number}  {rung.label}: {'; '.join(filter(None, told))}"
        for rung in rungs
        for told in [[rung.data or "not tested", rung.proof, rung.because]]
        if rung.action
    ]
