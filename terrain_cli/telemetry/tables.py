"""The channels of each wheel of a table: CSV and Parquet."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from formats import LOG_TIME, Labels
from terrain_cli.telemetry import own_clocks, raw_columns
from terrain_cli.telemetry.channel_sources import match_name
from terrain_cli.telemetry.wheel_samples import Raw
from terrain_cli.vocabulary.channels import CHANNELS, LABEL

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Mapping, Sequence

    from numpy.typing import NDArray

    from formats import Batch, Column
    from terrain_cli.telemetry.channel_sources import Feed, Plan

    Array = NDArray[np.float64]


def fields(plan: Plan, wanted: Collection[str], extras: Sequence[str]) -> list[str]:
    """Name the columns to read for some channels; those without a feed are passed over."""
    label = plan.labels.get("")
    names = {name for feed in plan.every_feed if feed.channel in wanted for name in feed.fields}
    return sorted(names.union(extras, [label] if label else []))


def read(
    plan: Plan,
    wanted: Collection[str],
    extras: Sequence[str],
    choose: Callable[[Labels | None], list[str]],
    max_gap: float | None,
    batches: list[Batch] | None = None,
) -> list[Raw]:
    """Read the wheels of a table; `choose` names them, from the column of wheel labels if there is one.

    `batches` are the columns `fields`, where they were read before.
    """
    names = fields(plan, wanted, extras)
    table: dict[str, Column] = {}
    if batches:
        table = raw_columns.whole(batches)
    elif names:
        table = raw_columns.read_whole(plan.source, "", names)
    raws = wheels(plan, table, wanted, extras, choose)
    for raw in raws:
        clocks = own_clocks.find(raw)
        if clocks:
            interpolated = clocks.bring(raw, max_gap)
            raw.remarks.append(clocks.told(raw.wheel, len(raw), int(interpolated.sum())))
        raw.remarks += passed_over(plan, nameless(plan, table))
    return raws


def nameless(plan: Plan, table: Mapping[str, Column], rows: slice = slice(None)) -> int:
    """Count those of some rows that name no wheel, after `wheels`."""
    column = table.get(plan.labels.get("", ""))
    return int(np.count_nonzero(column.codes[rows] < 0)) if isinstance(column, Labels) else 0


def passed_over(plan: Plan, count: int) -> list[str]:
    """Say how many rows name no wheel, if any."""
    return [f"{count} rows name no wheel in {plan.labels['']} and are passed over"] if count else []


def wheels(
    plan: Plan,
    table: dict[str, Column],
    wanted: Collection[str],
    extras: Sequence[str],
    choose: Callable[[Labels | None], list[str]],
) -> list[Raw]:
    """Sort the columns of a table, or of part of it, by wheel and channel; those of wheels become labels."""
    table.pop(LOG_TIME, None)
    label = plan.labels.get("")
    named = raw_columns.as_labels(table[label]) if label else None
    if label and named:
        table[label] = named
    result = []
    for name in choose(named):
        key = match_name(name, plan.wheels) or name
        feeds = {c: feed for c, feed in plan.feeds(key).items() if c in wanted}
        rows = None
        if named is not None and not np.all(named.codes == named.codes[0]):
            rows = np.flatnonzero(named.codes == named.names.index(name))
        result.append(_wheel(plan.source.path, name, feeds, table, rows, extras))
    return result


def _wheel(
    path: str,
    name: str,
    feeds: dict[str, Feed],
    table: dict[str, Column],
    rows: NDArray[np.intp] | None,
    extras: Sequence[str],
) -> Raw:
    def column(header: str) -> Column:
        return table[header] if rows is None else raw_columns.take(table[header], rows)

    n = len(next(iter(table.values()))) if table and rows is None else 0 if rows is None else len(rows)
    raw = Raw(
        wheel=name,
        origin=0.0,
        time=None,
        channels={},
        labels={},
        extras={extra: column(extra) for extra in extras},
        feeds=feeds,
    )
    for channel, feed in feeds.items():
        if channel == "time":
            raw.origin, raw.time = _time(path, feed, [column(f) for f in feed.fields])
        elif CHANNELS[channel].dimension == LABEL:
            raw.labels[channel] = (
                raw_columns.as_labels(column(feed.fields[0])) if feed.constant is None else feed.labels(n)
            )
        elif feed.constant is None:
            raw.channels[channel] = feed.si([raw_columns.as_numbers(column(f)) for f in feed.fields])
        else:
            raw.channels[channel] = feed.values(n)
    return raw


def _time(path: str, feed: Feed, several: list[Column]) -> tuple[float, Array]:
    """Return the origin of a clock and the seconds since."""
    column, exact = several[0], feed.scale == 1.0 and feed.offset == 0.0
    whole = not isinstance(column, Labels) and column.dtype.kind in "iu"
    if exact and whole and feed.unit and feed.unit.symbol == "ns":
        column = np.asarray(column, "datetime64[ns]")
    return raw_columns.as_clock(
        path, feed.fields[0], column, lambda: feed.si([raw_columns.as_numbers(one) for one in several])
    )
