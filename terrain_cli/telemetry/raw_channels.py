"""The channels of every wheel as recorded: columns of a table, or topics of a bag brought to one clock."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial

import numpy as np
from numpy.typing import NDArray

from formats import LOG_TIME, STAMP, Batch, Column, Labels
from terrain_cli.errors import ConfigurationError, InputError, nearest
from terrain_cli.telemetry import alignment, own_clocks, raw_columns
from terrain_cli.telemetry.assembly import Request
from terrain_cli.telemetry.mapping import is_table, only_wheel
from terrain_cli.telemetry.wheel_samples import CLOCKS, Feed, Plan, Raw, match_name
from terrain_cli.vocabulary.arrays import Array, Index, median
from terrain_cli.vocabulary.channels import CHANNELS, LABEL
from terrain_cli.vocabulary.quantities import the_wheel

#: Headers whose clocks differ by more than this, in s, do not tell the same time: no message is so late.
LATEST = 60.0


@dataclass(frozen=True, slots=True)
class _Topic:
    """One topic, read: its times in s, its columns, its labels of wheels."""

    time: Array
    table: dict[str, Column]
    wheels: Labels | None


def fields(request: Request) -> dict[str, list[str]]:
    """Name the fields to read of each topic (a table's is ""); channels without a feed are passed over."""
    found: dict[str, set[str]] = {"": set(request.extras)} if is_table(request.layout.source) else {}
    for feed in request.layout.every_feed:
        if feed.channel in request.channels and feed.fields:
            found.setdefault(feed.topic, set()).update(feed.fields)
    labels = request.layout.labels
    return {topic: sorted(names.union(filter(None, [labels.get(topic)]))) for topic, names in found.items()}


def nameless(plan: Plan, table: Mapping[str, Column], rows: slice = slice(None)) -> int:
    """Count those of some rows that name no wheel, after `of_table`."""
    column = table.get(plan.labels.get("", ""))
    return int(np.count_nonzero(column.codes[rows] < 0)) if isinstance(column, Labels) else 0


def passed_over(plan: Plan, count: int) -> list[str]:
    """Say how many rows name no wheel, if any."""
    return [f"{count} rows name no wheel in {plan.labels['']} and are passed over"] if count else []


def of_table(
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
        result.append(_of_rows(request, name, table, rows, extras))
    return result


def _of_rows(
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


def of_topics(
    request: Request,
    tables: Mapping[str, dict[str, Column]],
    choose: Callable[[Labels | None], list[str]],
    clocks: TopicClocks | None = None,
) -> list[Raw]:
    """Part the topics of a bag, the columns named by `fields`, into the wheels that `choose` names."""
    # It is given the wheel labels of the messages, if there are some; `clocks` were told from earlier ones.
    whole, clocks = clocks is None, clocks or topic_clocks(tables)
    times = clocks.times(tables)
    topics = {}
    for topic, table in tables.items():
        label = request.layout.labels.get(topic)
        topics[topic] = _Topic(times[topic], table, raw_columns.as_labels(table[label]) if label else None)
    # The torque's labels name the wheels; other topics may tell of fewer.
    rank = {channel: place for place, channel in enumerate(CLOCKS)}
    ordered = sorted(request.layout.every_feed, key=lambda feed: rank.get(feed.channel, len(CLOCKS)))
    labels = (topics[feed.topic].wheels for feed in ordered if feed.topic in topics)
    result = []
    for name in choose(next((found for found in labels if found is not None), None)):
        raw = _of_messages(request, name, clocks, topics, whole=whole)
        raw.remarks += clocks.remarks
        result.append(raw)
    return result


@dataclass(frozen=True, slots=True)
class TopicClocks:
    """On which clocks the topics of a bag are, told once, so that it holds for what comes later too."""

    origin: float  # Whole seconds that are taken off
    stamped: frozenset[str]  # Topics whose headers tell the time; of the others the log does
    shifted: np.timedelta64  # How far the log's clock is off the headers'
    remarks: tuple[str, ...]
    #: Channel and interval (s) of each wheel whose samples are those of a slower topic.
    slowest: dict[str, tuple[str, float] | None] = field(default_factory=dict)

    def times(self, tables: Mapping[str, Mapping[str, Column]]) -> dict[str, Array]:
        """Return the time of each message of each topic, in s."""
        return {topic: alignment.seconds(self._stamps(topic, tables[topic]), self.origin) for topic in tables}

    def _stamps(self, topic: str, table: Mapping[str, Column]) -> NDArray[np.datetime64]:
        log = np.asarray(np.asarray(table[LOG_TIME]) - self.shifted, dtype="datetime64[ns]")
        if topic not in self.stamped:
            return log
        stamps = raw_columns.header_stamps(table)
        if stamps is None:
            # One that came later has no stamp.
            own = np.asarray(table[STAMP], dtype="datetime64[ns]")
            return np.where(np.isnat(own), log, own)
        return stamps


def topic_clocks(tables: Mapping[str, Mapping[str, Column]]) -> TopicClocks:
    """Put all topics on one clock: the headers' stamps, or the log's where there are none."""
    logged = {topic: np.asarray(table[LOG_TIME]) for topic, table in tables.items()}
    found = {topic: raw_columns.header_stamps(table) for topic, table in tables.items()}
    stamps = {topic: stamp for topic, stamp in found.items() if stamp is not None}
    remarks = []
    lags = {t: median((logged[t] - stamp) / np.timedelta64(1, "s")) for t, stamp in stamps.items()}
    clocks = {topic: alignment.seconds(stamp, 0.0) for topic, stamp in stamps.items()}
    restarted = [topic for topic, clock in clocks.items() if len(alignment.split_clock(clock)[0])]
    if restarted:
        remarks.append(f"the headers' clock of {restarted[0]} begins anew: the times are the log's")
        stamps = {}
    elif stamps and max(lags.values()) - min(lags.values()) > LATEST:
        late, early = max(lags, key=lags.__getitem__), min(lags, key=lags.__getitem__)
        apart = lags[late] - lags[early]
        remarks.append(f"the headers of {late} and {early} are {apart:.0f} s apart: the times are the log's")
        stamps = {}
    # Un-stamped topics have the log's clock only, which a recording played back or a simulation shifts.
    # Messages come late, some topics seconds late, but never early: the least lag is the shift.
    lag = min((lags[topic] for topic in stamps), default=0.0)
    if abs(lag) <= alignment.CLOCK_TOLERANCE:
        lag = 0.0
    elif len(stamps) < len(tables):
        off = f"the log's clock is {lag:+.3f} s off the headers' stamps"
        remarks.append(f"{off}; topics without stamps were shifted by that")
    shifted = np.timedelta64(round(lag * 1e9), "ns")
    begins = [stamps[t][0] if t in stamps else log[0] - shifted for t, log in logged.items() if len(log)]
    firsts = [begin.astype("datetime64[s]").astype(np.int64) for begin in begins]
    return TopicClocks(float(min(firsts, default=0)), frozenset(stamps), shifted, tuple(remarks))


def _of_messages(
    request: Request, name: str, clocks: TopicClocks, topics: Mapping[str, _Topic], *, whole: bool
) -> Raw:
    feeds, max_gap = request.feeds(name), request.rover.max_gap
    raw = Raw(wheel=name, origin=clocks.origin, feeds=feeds)
    series: dict[str, tuple[Array, Array]] = {}
    for channel, feed in feeds.items():
        if not feed.topic or CHANNELS[channel].dimension == LABEL:
            continue
        topic = topics[feed.topic]
        values = feed.si([raw_columns.as_numbers(topic.table[f]) for f in feed.fields])
        # The elements of lists that the wheel reads of the topic, if this feed reads one.
        elements = [f for other in feeds.values() if other.topic == feed.topic for f in other.fields]
        listed = any("[" in f for f in feed.fields)
        rows = _in_order(topic, name, [f for f in elements if listed and "[" in f])
        own = topic.time if rows is None else topic.time[rows]
        series[channel] = own, values if rows is None else values[rows]
    clock = next((channel for channel in (*CLOCKS, *series) if channel in series), None)
    if clock is None:
        return raw
    if name not in clocks.slowest:
        clocks.slowest[name] = own_clocks.slowest({channel: time for channel, (time, _) in series.items()})
    if slowest := clocks.slowest[name]:
        clock, interval = slowest
        # Of a part nobody asks how many.
        count = f"{len(series[clock][0])} " if whole else ""
        raw.remarks.append(
            f"{the_wheel(name)}: topics have rates of their own: {clock} has a value every {interval:.3g} s, "
            f"and its {count}messages are the samples; the others are interpolated there"
        )
    time = series[clock][0]
    # What comes out is the caller's own, whatever wheels share a topic.
    raw.time = time.copy()
    for channel, (own, values) in series.items():
        same = feeds[clock].topic == feeds[channel].topic and np.array_equal(own, time)
        raw.channels[channel] = values.copy() if same else alignment.resample(time, own, values, max_gap)
    for channel, feed in feeds.items():
        if CHANNELS[channel].dimension == LABEL:
            raw.labels[channel] = _latest(raw.time, topics, feed, name)
        elif feed.constant is not None:
            raw.channels[channel] = feed.values(len(raw.time))
    return raw


def _in_order(topic: _Topic, wheel: str, elements: Collection[str]) -> Index | None:
    """Return the messages of one wheel in the order of their times; None if they are all as they are."""
    rows = _rows(topic, wheel)
    if elements:
        # A list without this wheel is another publisher's, and no sample of it.
        there = [~np.isnan(raw_columns.as_numbers(topic.table[f])[rows]) for f in elements]
        rows = rows[np.logical_or.reduce(there)]
    if len(rows) == len(topic.time) and alignment.ascends(topic.time):
        return None
    return rows[np.argsort(topic.time[rows], kind="stable")]


def _rows(topic: _Topic, wheel: str) -> Index:
    if topic.wheels is None:
        return np.arange(len(topic.time))
    label = match_name(wheel, topic.wheels.names)
    return np.flatnonzero(topic.wheels.codes == (topic.wheels.names.index(label) if label else -2))


def _latest(clock: Array, topics: Mapping[str, _Topic], feed: Feed, wheel: str) -> Labels:
    """Return the label last said before each time."""
    if not feed.topic:
        return feed.labels(len(clock))
    topic = topics[feed.topic]
    labels = raw_columns.as_labels(topic.table[feed.fields[0]])
    rows = _rows(topic, wheel)
    rows = rows[np.argsort(topic.time[rows], kind="stable")]
    if len(rows) == 0:
        return Labels(np.full(len(clock), -1, dtype=np.int32), labels.names)
    last = np.searchsorted(topic.time[rows], clock, side="right") - 1
    codes = np.where(last >= 0, labels.codes[rows[np.maximum(last, 0)]], -1)
    return Labels(codes.astype(np.int32), labels.names)


def read_raw(
    request: Request, batches: list[Batch], topics: Mapping[str, dict[str, Column]] | None = None
) -> list[Raw]:
    """Read the channels asked for that have a feed, of the wheels asked for, ordered by name."""
    # `batches` are the columns of a table, `topics` those of a bag, where they were read before.
    plan, choose = request.layout, partial(choose_wheels, request)
    if not is_table(plan.source):
        if topics is None:
            topics = raw_columns.read_topics(plan.source, fields(request))
        return of_topics(request, topics, choose)
    table: dict[str, Column] = {}
    if batches:
        table = raw_columns.whole(batches)
    elif any((names := fields(request)).values()):
        table = raw_columns.read_topics(plan.source, names)[""]
    raws = of_table(request, table, request.extras, choose)
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
