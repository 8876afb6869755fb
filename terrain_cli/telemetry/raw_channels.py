"""The channels of every wheel as they were recorded, from the columns of a table or the topics of a bag."""

from collections.abc import Callable, Mapping, Sequence
from functools import partial

import numpy as np

from formats import LOG_TIME, Batch, Column, Labels
from terrain_cli.errors import ConfigurationError, InputError, nearest
from terrain_cli.telemetry import bags, own_clocks, raw_columns
from terrain_cli.telemetry.assembly import Request
from terrain_cli.telemetry.mapping import is_table, only_wheel
from terrain_cli.telemetry.raw_columns import read_topics
from terrain_cli.telemetry.wheel_samples import CLOCKS, Feed, Plan, Raw, match_name
from terrain_cli.vocabulary.arrays import Array, Index
from terrain_cli.vocabulary.channels import CHANNELS, LABEL


def fields(request: Request) -> list[str]:
    """Name the columns to read; channels without a feed are passed over."""
    label = request.layout.labels.get("")
    feeds = (feed for feed in request.layout.every_feed if feed.channel in request.channels)
    names = {name for feed in feeds for name in feed.fields}
    return sorted(names.union(request.extras, [label] if label else []))


def nameless(plan: Plan, table: Mapping[str, Column], rows: slice = slice(None)) -> int:
    """Count those of some rows that name no wheel, after `wheels`."""
    column = table.get(plan.labels.get("", ""))
    return int(np.count_nonzero(column.codes[rows] < 0)) if isinstance(column, Labels) else 0


def passed_over(plan: Plan, count: int) -> list[str]:
    """Say how many rows name no wheel, if any."""
    return [f"{count} rows name no wheel in {plan.labels['']} and are passed over"] if count else []


def wheels(
    request: Request,
    table: dict[str, Column],
    extras: Sequence[str],
    choose: Callable[[Labels | None], list[str]],
) -> list[Raw]:
    """Sort the columns of a table, or of part of it, by wheel and channel; those of wheels become labels."""
    table.pop(LOG_TIME, None)
    label = request.layout.labels.get("")
    named = raw_columns.as_labels(table[label]) if label else None
    if label and named:
        table[label] = named
    result = []
    for name in choose(named):
        rows: Index | slice = slice(None)
        if named is not None and not np.all(named.codes == named.codes[0]):
            rows = np.flatnonzero(named.codes == named.names.index(name))
        result.append(_wheel(request, name, table, rows, extras))
    return result


def _wheel(
    request: Request, name: str, table: dict[str, Column], rows: Index | slice, extras: Sequence[str]
) -> Raw:
    def column(header: str) -> Column:
        return raw_columns.take(table[header], rows)

    n = len(column(next(iter(table)))) if table else 0
    feeds, path = request.feeds(name), request.layout.source.path
    raw = Raw(wheel=name, extras={extra: column(extra) for extra in extras}, feeds=feeds)
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


def read_raw(
    request: Request, batches: list[Batch], topics: Mapping[str, dict[str, Column]] | None = None
) -> list[Raw]:
    """Read the channels asked for that have a feed, of the wheels asked for, ordered by name."""
    # `batches` are the columns of a table, `topics` those of a bag, where they were read before.
    plan, choose = request.layout, partial(choose_wheels, request)
    if not is_table(plan.source):
        if topics is None:
            topics = read_topics(plan.source, bags.fields(request))
        return bags.wheels(request, topics, choose)
    names = fields(request)
    table: dict[str, Column] = {}
    if batches:
        table = raw_columns.whole(batches)
    elif names:
        table = read_topics(plan.source, {"": names})[""]
    raws = wheels(request, table, request.extras, choose)
    for raw in raws:
        clocks = own_clocks.find(raw)
        if clocks:
            interpolated = clocks.bring(raw, request.rover.max_gap)
            raw.remarks.append(clocks.told(raw.wheel, len(raw), int(interpolated.sum())))
        raw.remarks += passed_over(plan, nameless(plan, table))
    return raws


def choose_wheels(request: Request, labels: Labels | None) -> list[str]:
    """Name the wheels to read: labels of a column, those of rover.toml, or the only one."""
    plan, path = request.layout, request.layout.source.path
    if labels is None:
        there = sorted(plan.wheels) or [only_wheel(request.rover)]
    else:
        there = labels_there(labels)
        if not there:
            raise InputError(f"{path}: the column of wheels is empty", hint="fill it in, or leave it out")
    for name in request.wheels:
        # To the letter: left is not front-left.
        if name not in there:
            meant = match_name(name, there)
            near = f"; did you mean {meant}?" if meant else nearest(name, there)
            raise InputError(f"{path}: there is no wheel {name}{near}", hint=f"it has {', '.join(there)}")
    chosen = [name for name in there if not request.wheels or name in request.wheels]
    clocks = [next((feeds[c] for c in CLOCKS if c in feeds), None) for feeds in map(plan.feeds, chosen)]
    if labels is None and len(chosen) > 1 and clocks[0] and clocks.count(clocks[0]) == len(clocks):
        raise ConfigurationError(
            f"{path}: {clocks[0].place} is given once for {len(chosen)} wheels: {', '.join(chosen)}",
            hint="choose one with --wheel NAME, or give each its own in rover.toml: [wheels.NAME.channels]",
        )
    return chosen


def labels_there(labels: Labels) -> list[str]:
    there = np.bincount(labels.codes[labels.codes >= 0], minlength=1)
    return sorted(labels.names[code] for code in np.flatnonzero(there).tolist())
