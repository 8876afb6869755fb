"""[[history]] of a model file: the entry of each change, and all of them read as a ladder of errors."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from datetime import UTC, datetime
from typing import Any

from terrain_cli.comparison import Comparison
from terrain_cli.comparison.blocks import Interval
from terrain_cli.comparison.comparison_outcome import UNITS
from terrain_cli.diagnosis.diagnosis_outcome import NextDrive
from terrain_cli.improvement.improvement_outcome import Action, ChannelChange, Estimated, Step
from terrain_cli.models import ModelFile
from terrain_cli.version import __version__
from terrain_cli.vocabulary.quantities import listed

_SIGNS = {"add": "+", "remove": "−"}
#: What an entry says of the error of a channel, each with its interval.
_INTERVALS = ("heldout_before", "heldout_after", "difference")


@dataclass(frozen=True, kw_only=True)
class Rung:
    """One change of a model, as its file remembers it."""

    number: int  # From 1
    action: str  # "add", "remove", or empty where the entry is of another hand
    label: str  # What changed: "+ slip-sinkage"
    because: str = ""  # Why it was made
    proof: str = ""  # Why the stretches that may have named it judged it too; empty where others did
    data: str = ""  # On what it was tried, for a person; empty if it was not
    channels: list[ChannelChange] = field(default_factory=list)  # Empty if it was not tried


def rungs(history: Sequence[Mapping[str, Any]]) -> list[Rung]:
    """Read the changes of a model file from its history, what another hand wrote as far as it is known."""
    made = [entry for entry in history if entry.get("kept") is not False]
    return [_rung(number, entry) for number, entry in enumerate(made, 1)]


def refusals(history: Sequence[Mapping[str, Any]]) -> list[str]:
    """Return a line for each try in the history of a model file that did not pay."""
    return [
        f"not {listed([*map(str, entry['changed'])])}: {_data(entry.get('data'))}; {entry.get('because', '')}"
        for entry in history
        if entry.get("kept") is False and entry.get("changed")
    ]


def channels(ladder: Sequence[Rung]) -> list[str]:
    """Return the channels of which a ladder knows an error, in the order in which they are shown."""
    known = {one.name for rung in ladder for one in rung.channels}
    return [name for name in UNITS if name in known]


def _rung(number: int, entry: Mapping[str, Any]) -> Rung:
    action = entry.get("action", "")
    changed = entry.get("changed")
    if action not in _SIGNS or not isinstance(changed, list) or not changed:
        told = ", ".join(f"{key} {value}" for key, value in entry.items())
        return Rung(number=number, action="", label=told)
    found, same = entry.get("channels", {}), entry.get("proof_because")
    table = found if isinstance(found, dict) else {}
    return Rung(
        number=number,
        action=action,
        label=f"{_SIGNS[action]} {listed([str(name) for name in changed])}",
        because=str(entry.get("because", "")),
        proof=f"judged on the same stretches: {same}" if same else "",
        data=_data(entry.get("data")),
        channels=[_channel(name, table[name]) for name in UNITS if isinstance(table.get(name), dict)],
    )


def _data(found: Any) -> str:
    if not isinstance(found, dict):
        return ""
    sources = found.get("sources", [])
    named = [str(source) for source in sources] if isinstance(sources, list) else []
    where = ", ".join(named[:2]) + f" and {len(named) - 2} more" * (len(named) > 2)
    return f"{found.get('samples', '?')} samples of {where or 'unknown sources'}"


def _channel(name: str, found: Mapping[str, Any]) -> ChannelChange:
    before, after, change = (_interval(found.get(key), found.get(f"{key}_interval")) for key in _INTERVALS)
    return ChannelChange(
        name=name,
        unit=UNITS[name],
        before=before,
        after=after,
        noise=_number(found.get("noise")),
        difference=change,
    )


def _interval(value: Any, ends: Any) -> Interval:
    low, high = ends if isinstance(ends, list) and len(ends) == 2 else (None, None)
    return Interval(_number(value), _number(low), _number(high))


def _number(value: Any) -> float:
    return float(value) if isinstance(value, int | float) else math.nan


_DIGITS = 6  # Digits of a number that is kept: far more than its interval has


def untested(action: Action, changed: Sequence[str], after: ModelFile) -> dict[str, Any]:
    """Return the entry of a change that was made without data."""
    return _head(action, changed, after, "no data were given") | {"tested": False}


def entry(step: Step, because: str) -> dict[str, Any]:
    """Return the entry of a change that was tried on data; None, which TOML leaves out, where not known."""
    return _head(step.action, step.changed, step.after, because) | {
        "tested": True,
        "proof": step.proof,
        "proof_because": same_stretches(step) or None,
        **measured(step),
        "parameters": means(step.parameters) or None,
        "failures_before": len(step.first.failures),
        "failures_after": len(step.compared_after.failures),
        "rivals": list(step.rivals) or None,
        "next_drive": drive(step.next_drive),
        "confirmation": confirmation(step),
    }


def refusal(step: Step, because: str) -> dict[str, Any]:
    """Return the entry of an effect that did not pay, so that it is not proposed for the same data again."""
    kept = {"tested": True, "kept": False, "proof": step.proof, "data": data(step)}
    return _head(step.action, step.changed, step.before, because) | kept


def end(file: ModelFile, comparison: Comparison, because: str) -> dict[str, Any]:
    """Return the entry of a loop that found nothing more to add."""
    samples = sum(len(wheel.windows.rows) for wheel in comparison.wheels)
    sources = list(dict.fromkeys(wheel.source for wheel in comparison.wheels))
    kept = {"kept": False, "ended": True, "data": {"sources": sources, "samples": samples}}
    return _head("add", (), file, because) | kept


def same_stretches(step: Step) -> str:
    """Say why an effect was judged on the stretches that may have named it; nothing where it was not."""
    if step.action == "remove" or step.proof != "same data":
        return ""
    return "too short to keep any aside" if step.evidence.too_short else "no others were kept aside"


def confirmation(step: Step) -> dict[str, Any] | None:
    """Return what another drive says of a change; None where none was asked."""
    proof = step.confirmation
    if proof is None:
        return None
    return {"confirmed": proof.pays, **measured(proof)}


def measured(step: Step) -> dict[str, Any]:
    """Return on what a change was tried, and what it did to the held-out errors."""
    return {
        "data": data(step),
        "channels": {one.name: channel(one) for one in step.channels},
        "ratio": number(step.evidence.overall.value),
        "ratio_interval": ends(step.evidence.overall),
    }


def _head(action: Action, changed: Sequence[str], after: ModelFile, because: str) -> dict[str, Any]:
    return {
        "action": action,
        "changed": list(changed),
        "because": because,
        "when": datetime.now(UTC).strftime("%Y-%m-%dT%H:%M:%SZ"),
        "version": __version__,
        "base": after.model.base,
        "effects": list(after.effects),
    }


def data(step: Step) -> dict[str, Any]:
    """Return on what a change was tried."""
    wheels, soils = step.first.wheels, step.first.soils
    # Both models were compared on the soils that they need.
    cut = [wheel.segments for wheel in wheels] if soils is None else soils.wheels
    return {
        "sources": list(step.sources),
        "samples": sum(len(wheel.windows.rows) for wheel in wheels),
        "segments": sum(len(segments) for segments in cut),
        "blocks": step.first.blocks,
        **({"kept_aside": step.evidence.aside} if step.evidence.aside else {}),
    }


def channel(change: ChannelChange) -> dict[str, Any]:
    """Return the held-out error of a channel before and after, in SI."""
    found: dict[str, Any] = {"unit": change.unit}
    for key, one in zip(_INTERVALS, (change.before, change.after, change.difference), strict=True):
        found |= {key: number(one.value), f"{key}_interval": ends(one)}
    return {**found, "noise": number(change.noise)}


def drive(one: NextDrive | None) -> dict[str, Any] | None:
    """Return a drive as it is kept; None if there is none."""
    return None if one is None else {**asdict(one), "pair": list(one.pair)}


def number(value: float) -> float | None:
    """Return a number as it is kept; None if it is not known."""
    return float(f"{value:.{_DIGITS}g}") if math.isfinite(value) else None


def ends(interval: Interval) -> list[float] | None:
    """Return the ends of an interval; None if they are not known."""
    known = math.isfinite(interval.low) and math.isfinite(interval.high)
    return [float(f"{end:.{_DIGITS}g}") for end in (interval.low, interval.high)] if known else None


def means(parameters: Sequence[Estimated]) -> dict[str, dict[str, Any]]:
    """Average every parameter with a known error over the wheels, weighted by what each knows of it."""
    result: dict[str, dict[str, Any]] = {}
    for name in dict.fromkeys(one.name for one in parameters):
        own = [one for one in parameters if one.name == name]
        known = [one for one in own if math.isfinite(one.value) and one.se > 0.0]
        if not known:
            continue
        weights = [one.se**-2.0 for one in known]
        value = sum(w * one.value for w, one in zip(weights, known, strict=True)) / sum(weights)
        result[name] = {
            "value": number(value),
            "se": number(sum(weights) ** -0.5),
            "unit": own[0].unit,
            "wheels": len(known),
            "lowest": number(min(one.value for one in known)) if len(known) > 1 else None,
            "highest": number(max(one.value for one in known)) if len(known) > 1 else None,
        }
    return result
