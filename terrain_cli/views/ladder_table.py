"""The ladder of errors as a table: what each change of a model did."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from terrain_cli.presentation import change_text
from terrain_cli.vocabulary import quantities

if TYPE_CHECKING:
    from collections.abc import Sequence

    from terrain_cli.improvement.improvement_outcome import ChannelChange
    from terrain_cli.improvement.model_history import Rung


def table(ladder: Sequence[Rung]) -> tuple[list[str], list[list[str]]]:
    """Return heading and rows: a row for each channel of each change."""
    head = ["step", "change", "held-out rms error", "before", "95 %", "after", "95 %", "noise"]
    rows = []
    for rung in ladder:
        lines = [_cells(one) for one in rung.channels] or [["", "", "", "", "", ""]]
        for index, cells in enumerate(lines):
            rows.append([*([str(rung.number), rung.label] if index == 0 else ["", ""]), *cells])
    return head, rows


def _cells(one: ChannelChange) -> list[str]:
    what = quantities.quantity(one.name, one.unit)
    return [
        what.label,
        *change_text.cells(one.before, what.factor),
        *change_text.cells(one.after, what.factor),
        quantities.number(one.noise * what.factor),
    ]


def remarks(ladder: Sequence[Rung]) -> list[str]:
    """Return a line for each change: on what it was tried and judged, and why it was made."""
    return [
        f"{rung.number}  {rung.label}: {'; '.join(filter(None, told))}"
        for rung in ladder
        for told in [[rung.data or "not tested", rung.proof, rung.because]]
        if rung.action
    ]


def top(known: Sequence[tuple[Rung, ChannelChange]]) -> float:
    """Return where the axis of a channel's errors ends: a very wide interval would hide the values."""
    intervals = [interval for _, one in known for interval in (one.before, one.after)]
    values = [v.value for v in intervals if math.isfinite(v.value)] + [
        one.noise for _, one in known if math.isfinite(one.noise)
    ]
    highest = max(values, default=1.0)
    ends = [v.high for v in intervals if math.isfinite(v.high)]
    return 1.08 * min(max([highest, *ends]), 2.0 * highest)


def measured(ladder: Sequence[Rung], name: str) -> list[tuple[Rung, ChannelChange]]:
    """Return the changes in which the error of a channel is known, with what it was."""
    return [(rung, one) for rung in ladder for one in rung.channels if one.name == name]
