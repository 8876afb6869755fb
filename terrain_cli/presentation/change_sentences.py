"""A change of a model in one sentence."""

from __future__ import annotations

from typing import TYPE_CHECKING

from terrain_cli.comparison import comparison_criteria
from terrain_cli.improvement import improvement_criteria as criteria
from terrain_cli.vocabulary import quantities
from terrain_cli.vocabulary.quantities import counted, listed

if TYPE_CHECKING:
    from collections.abc import Sequence

    from terrain_cli.improvement.improvement_outcome import Action, ChannelChange, Step


def verdict(step: Step) -> str:
    """Say what held-out data say of a change, and what became of it."""
    what = listed(step.changed)
    if step.action == "remove":
        return f"{what} {_is(step)} removed{', though it pays' if step.costs else ''}: {found(step)}"
    if step.pays and step.confirmation is not None:
        proof = step.confirmation
        where = f"{listed(list(proof.sources))}, which did not choose it"
        if proof.pays:
            return f"{what} {_is(step)} added: {found(step)}; confirmed on {where}: {found(proof)}"
        kept = "added all the same, as --keep asks" if step.kept else "not added"
        return f"{what} {_is(step)} {kept}: {found(step)}, but not confirmed on {where}: {found(proof)}"
    if step.pays:
        done = "added" if step.kept else "worth adding"
        return f"{what} {_is(step)} {done}: {found(step)}"
    kept = "added all the same, as --keep asks" if step.kept else "not added"
    if step.better:
        return f"{what} {_is(step)} {kept}: {found(step)}"
    uncertain = " significantly" if step.evidence.overall.value < criteria.PLAIN else ""
    partly = " on the whole" if step.fell else uncertain
    return f"the held-out error did not fall{partly}: {what} {_is(step)} {kept} ({found(step)})"


def untested(action: Action, changed: Sequence[str]) -> str:
    """Say that a change was made without data."""
    done = {"add": "added", "remove": "removed"}[action]
    are = "is" if len(changed) == 1 else "are"
    return f"{listed(changed)} {are} {done}, without a test: no --data was given"


def tried(step: Step) -> str:
    """Say what the loop tried, and whether it stays."""
    name = listed(step.changed)
    if step.action == "add":
        return f"{'+' if step.kept else 'not'} {name}: {found(step)}"
    return f"{'−' if step.kept else 'keeps'} {name}, tried without it: {found(step)}"


def doubt(step: Step) -> str:
    """Say what the data do not tell from an effect that the loop keeps, and what would."""
    what = f"these data do not tell it from {listed(step.rivals)}"
    if step.next_drive is None:
        return what
    power = f" (power {step.next_drive.power:.0%})" if step.next_drive.settings else ""
    return f"{what}: {step.next_drive.manoeuvre}{power}"


def found(step: Step) -> str:
    """Say what became of the held-out error, without a name."""
    if not step.testable:
        n = step.evidence.blocks
        return f"only {counted(n, 'independent stretch', 'es')} of data: nothing can be told from chance"
    if step.evidence.lost > comparison_criteria.UNPREDICTED:
        return f"{step.evidence.lost:.0%} of the samples cannot be predicted any more"
    moved: list[str] = []
    for verb, channels in (("fell", step.fell), ("rose", step.rose)):
        if channels:
            error = "the held-out error " if not moved else ""
            moved.append(f"{error}{verb} in {listed([_moved(one) for one in channels])}")
    value, low, high = step.evidence.overall
    ratio = f"× {value:.2f} ({low:.2f} to {high:.2f})"
    if not moved:
        return (
            f"the held-out error fell over all channels, {ratio}, though in none alone significantly"
            if step.better
            else f"in no channel did it change significantly and by more than {criteria.LEAST_CHANGE:.0%}"
        )
    text = ", but ".join(moved)
    if not step.there:
        joined = "but" if step.fell else "and"
        return f"{text}, {joined} its parameters may as well be null (p {step.absent:.2g})"
    if step.imitates:
        values = listed(
            [f"{p.name} = {quantities.number(p.value)} ± {quantities.number(p.se)}" for p in step.imitates]
        )
        return f"{text}, but with {values}, which is physically impossible; another effect is missing"
    if step.action == "add" and step.fell and not step.pays and not step.rose:
        text += f", but over all channels that may be chance: {ratio}"
    return text


def reason(step: Step) -> str:
    """Say why an effect is added, for the history of the model."""
    proof = step.confirmation
    if proof is None:
        return found(step) if step.pays else f"--keep; {found(step)}"
    told = "confirmed" if proof.pays else "--keep; not confirmed"
    return f"{found(step)}; {told} on {listed(list(proof.sources))}: {found(proof)}"


def _moved(one: ChannelChange) -> str:
    what = quantities.quantity(one.name, one.unit)
    before, after = (quantities.number(v.value * what.factor) for v in (one.before, one.after))
    return f"{what.words} from {before} to {after} {what.unit}"


def _is(step: Step) -> str:
    return "is" if len(step.changed) == 1 else "are"
