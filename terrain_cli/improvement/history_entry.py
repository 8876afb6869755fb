"""An entry of [[history]]: the record of a change in its model file."""

from __future__ import annotations

import math
from dataclasses import asdict
from datetime import UTC, datetime
from typing import TYPE_CHECKING, Any

from terrain_cli.version import __version__

if TYPE_CHECKING:
    from collections.abc import Sequence

    from terrain_cli.diagnosis.diagnosis_outcome import NextDrive
    from terrain_cli.improvement.improvement_outcome import Action, ChannelChange, Estimated, Interval, Step
    from terrain_cli.models import ModelFile

#: Digits of a number that is kept: far more than its interval has.
_DIGITS = 6


def untested(action: Action, changed: Sequence[str], after: ModelFile) -> dict[str, Any]:
    """Return the entry of a change that was made without data.

    Parameters
    ----------
    action : {"add", "remove"}
    """
    return _head(action, changed, after, "no data were given") | {"tested": False}


def entry(step: Step, because: str) -> dict[str, Any]:
    """Return the entry of a change that was tried on data.

    Parameters
    ----------
    because : str
        Why it was made.

    Returns
    -------
    dict
        None where not known, which TOML leaves out.
    """
    return _head(step.action, step.changed, step.after, because) | {
        "tested": True,
        "data": data(step),
        "channels": {one.name: channel(one) for one in step.channels},
        "ratio": number(step.evidence.overall.value),
        "ratio_interval": ends(step.evidence.overall),
        "parameters": means(step.parameters) or None,
        "failures_before": len(step.first.failures),
        "failures_after": len(step.second.failures),
        "rivals": list(step.rivals) or None,
        "next_drive": drive(step.next_drive),
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
    }


def channel(change: ChannelChange) -> dict[str, Any]:
    """Return the held-out error of a channel before and after, in SI."""
    return {
        "unit": change.unit,
        "heldout_before": number(change.before.value),
        "heldout_before_interval": ends(change.before),
        "heldout_after": number(change.after.value),
        "heldout_after_interval": ends(change.after),
        "difference": number(change.difference.value),
        "difference_interval": ends(change.difference),
        "noise": number(change.noise),
    }


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
    """Average every parameter over the wheels, weighted by what each knows of it.

    Returns
    -------
    dict of str to dict
        By name; none whose errors are not known.
    """
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
