"""The history of a model file as a ladder of errors."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from terrain_cli.comparison.comparison_outcome import UNITS
from terrain_cli.improvement.improvement_outcome import ChannelChange, Interval
from terrain_cli.vocabulary.english import listed

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

_SIGNS = {"add": "+", "remove": "−"}


@dataclass(frozen=True, kw_only=True)
class Rung:
    """One change of a model, as its file remembers it."""

    number: int  # From 1
    action: str  # "add", "remove", or empty where the entry is of another hand
    label: str  # What changed: "+ slip-sinkage"
    because: str  # Why it was made
    data: str  # On what it was tried, for a person; empty if it was not
    channels: list[ChannelChange]  # Empty if it was not tried


def rungs(history: Sequence[Mapping[str, Any]]) -> list[Rung]:
    """Read the history of a model file; what another hand wrote there is shown as far as it is known."""
    return [_rung(number, entry) for number, entry in enumerate(history, 1)]


def channels(ladder: Sequence[Rung]) -> list[str]:
    """Return the channels of which a ladder knows an error, in the order in which they are shown."""
    known = {one.name for rung in ladder for one in rung.channels}
    return [name for name in UNITS if name in known]


def _rung(number: int, entry: Mapping[str, Any]) -> Rung:
    action = entry.get("action", "")
    changed = entry.get("changed")
    if action not in _SIGNS or not isinstance(changed, list) or not changed:
        return Rung(
            number=number,
            action="",
            label=", ".join(f"{key} {value}" for key, value in entry.items()),
            because="",
            data="",
            channels=[],
        )
    found = entry.get("channels", {})
    table = found if isinstance(found, dict) else {}
    return Rung(
        number=number,
        action=action,
        label=f"{_SIGNS[action]} {listed([str(name) for name in changed])}",
        because=str(entry.get("because", "")),
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
    before, after, change = (
        _interval(found.get(key), found.get(f"{key}_interval"))
        for key in ("heldout_before", "heldout_after", "difference")
    )
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
