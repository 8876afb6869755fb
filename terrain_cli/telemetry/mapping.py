"""Which field of a file feeds which channel of which wheel."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from formats import Field, Source, Stream
from terrain_cli.errors import ConfigurationError, InputError, nearest
from terrain_cli.rover import Rover
from terrain_cli.rover.vehicle import ChannelEntry
from terrain_cli.telemetry import table_clock, topic_discovery
from terrain_cli.telemetry.raw_columns import as_numbers
from terrain_cli.telemetry.wheel_samples import CLOCKS, Feed, Plan, match_name
from terrain_cli.vocabulary import units
from terrain_cli.vocabulary.channels import CHANNELS, identify, resolve, stated_unit, time_pairs, unit_hint
from terrain_cli.vocabulary.quantities import ONLY_WHEEL
from terrain_cli.vocabulary.units import Unit


def is_table(source: Source) -> bool:
    return [stream.topic for stream in source.streams()] == [""]


def plan(source: Source, rover: Rover) -> Plan:
    """Decide what feeds each channel: rover.toml first, then names, then the standard messages."""
    streams = {stream.topic: stream for stream in source.streams()}
    result = Plan(source=source)
    asked = _asked(rover, streams, table=is_table(source), labels=result.labels)
    if is_table(source):
        _plan_table(result, streams[""], asked, steady=rover.steady)
    else:
        _plan_bag(result, streams, asked, rover)
    return result


def _asked(
    rover: Rover, streams: Mapping[str, Stream], *, table: bool, labels: dict[str, str]
) -> dict[str, dict[str, Feed]]:
    """Return the feeds that rover.toml asks for, by wheel ("" where it names none)."""
    asked: dict[str, dict[str, Feed]] = {}
    for wheel, its in (rover.wheels or {"": rover.default}).items():
        feeds = asked.setdefault(wheel, {})
        for channel, entry in its.channels.items():
            if entry.constant is None and (entry.topic is None) != table:
                continue
            feed = _feed(entry, streams, wheel)
            if channel != "wheel":
                feeds[channel] = feed
            elif feed.constant is None:
                labels[feed.topic] = feed.fields[0]
    return asked


def _given(asked: Mapping[str, Mapping[str, Feed]]) -> set[str]:
    """Return the channels that rover.toml gives for every wheel."""
    return set.intersection(*(set(feeds) for feeds in asked.values()))


def _plan_table(result: Plan, stream: Stream, asked: dict[str, dict[str, Feed]], *, steady: bool) -> None:
    chosen = _given(asked) | ({"wheel"} if "" in result.labels else set())
    headers = [f.name for f in stream.fields]
    settled = steady or "time" in headers or any("time" in feeds for feeds in asked.values())
    pairs = [] if settled else time_pairs(headers)
    halves = {header for pair in pairs for header in pair.headers}
    try:
        others = [header for header in headers if header not in halves]
        channels = resolve(others, chosen=chosen | ({"time"} if steady else set()))
    except InputError as error:
        raise InputError(f"{result.source.path}: {error}", hint=error.hint) from None
    for channel, (header, match) in channels.items():
        if channel == "wheel":
            result.labels[""] = header
            continue
        note = "" if match.exact or match.stated else "recognised by its name"
        if match.unit != CHANNELS[channel].unit:
            note = "converted"
        result.shared[channel] = Feed(
            channel=channel, fields=(header,), unit=match.unit, note=note, stated=match.stated
        )
    result.shared |= asked.pop("", {})
    result.wheels = asked
    if not settled:
        table_clock.settle(result, pairs)
    used = {name for feed in result.every_feed for name in feed.fields} | set(result.labels.values())
    kinds = {f.name: f.kind for f in stream.fields}
    result.extras = tuple(name for name, kind in kinds.items() if kind == "number" and name not in used)


def _plan_bag(
    result: Plan, streams: Mapping[str, Stream], asked: dict[str, dict[str, Feed]], rover: Rover
) -> None:
    chosen = _given(asked)
    candidates: dict[str, list[Feed]] = {}
    for topic, stream in streams.items():
        try:
            found, label = topic_discovery.find(stream)
        except InputError as error:
            raise InputError(f"{result.source.path}: {topic}: {error}", hint=error.hint) from None
        if label:
            result.labels.setdefault(topic, label)
        for feed in [*found, *_unheard(result, stream, asked)]:
            candidates.setdefault(feed.channel, []).append(feed)
    there = topic_discovery.wheels_in(candidates, result.labels)
    states = [stream for stream in streams.values() if stream.type == topic_discovery.JOINT_STATE]
    joints = [name for stream in states for field in stream.fields for name in field.elements]
    result.shared = asked.pop("", {})
    topics = (result.shared[name].topic for name in CLOCKS if name in result.shared)
    clock = next(filter(None, topics), None)
    if asked:
        wheels = list(asked)
    elif clock and clock not in result.labels:
        # One torque was asked for: one wheel, whose name helps to choose among the topics.
        wheels = [only_wheel(rover, there)]
    else:
        wheels = there
    result.wheels = {wheel: {} for wheel in wheels}
    others = [*there, *joints] if any(match_name(name, wheels) for name in [*there, *joints]) else []
    for channel, found in candidates.items():
        if channel not in chosen:
            topic_discovery.assign(channel, found, others, result)
    for wheel, feeds in asked.items():
        result.wheels[wheel].update(feeds)


def _unheard(result: Plan, stream: Stream, asked: Mapping[str, Mapping[str, Feed]]) -> list[Feed]:
    """Find the speeds of joints that rover.toml asks for, and that another publisher sends than the first."""
    if stream.type != topic_discovery.JOINT_STATE:
        return []
    feeds = (feed for its in asked.values() for feed in its.values() if feed.topic == stream.topic)
    joints = {name.partition("[")[2].removesuffix("]") for feed in feeds for name in feed.fields}
    heard = {name for field in stream.fields for name in field.elements}
    more = []
    for joint in sorted(joint for joint in joints - heard if not joint.isdigit()):
        speed = topic_discovery.joint_speed(stream.topic, joint)
        begin = next(result.source.read(stream.topic, speed.fields, 1000), None)
        if begin is not None and not np.isnan(as_numbers(begin[speed.fields[0]])).all():
            more.append(speed)
    return more


def only_wheel(rover: Rover, there: Sequence[str] = ()) -> str:
    """Name a wheel that the data do not: as rover.toml calls it, or its joint or topic, or "wheel"."""
    entries = rover.default.channels
    if "wheel" in entries and entries["wheel"].constant is not None:
        return str(entries["wheel"].constant)
    if len(rover.wheels) == 1:
        return next(iter(rover.wheels))
    entry = next((entries[name] for name in CLOCKS if name in entries and entries[name].topic), None)
    if entry is None:
        return ONLY_WHEEL
    parts = (match_name(part, there) for part in (entry.topic or "").split("/"))
    return entry.name or next(filter(None, parts), ONLY_WHEEL)


def _feed(entry: ChannelEntry, streams: Mapping[str, Stream], wheel: str) -> Feed:
    """Turn an entry of rover.toml into a feed, checked against what the file holds."""
    own = CHANNELS[entry.channel].unit
    stated = entry.unit is not None
    given: dict[str, Any] = {"scale": entry.scale, "offset": entry.offset, "asked": True, "stated": stated}
    base = Feed(channel=entry.channel, unit=entry.unit or own, **given)
    if entry.constant is not None:
        return replace(base, constant=entry.constant)
    topic = entry.topic or ""
    if topic not in streams:
        what = f"there is no topic {topic}{nearest(topic, streams)}"
        raise ConfigurationError(f"{entry.place}: {what}", hint=f"it has {', '.join(list(streams)[:20])}")
    stream = streams[topic]
    if topic and entry.field is None and (meant := _meant(entry, stream, wheel)):
        return replace(meant, unit=entry.unit or meant.unit, **given)
    fields = {f.name: f for f in stream.fields}
    name = (entry.field if topic else entry.column) or (next(iter(fields)) if len(fields) == 1 else "")
    if name not in fields:
        what = f"topic {topic} has no field" if topic else "there is no column"
        what = f"{what} {name!r}{nearest(name, fields)}" if name else "add field = …"
        raise ConfigurationError(f"{entry.place}: {what}", hint=f"it has {', '.join(list(fields)[:20])}")
    path = _element(entry, fields[name], wheel)
    if own is None or entry.unit:
        return replace(base, topic=topic, fields=(path,))
    unit = _unit(entry, stream.type, name, topic)
    if unit is None and topic:
        what = f"the unit of {topic} {name} is not known"
        raise ConfigurationError(f"{entry.place}: {what}", hint=f"add unit = …; {unit_hint(entry.channel)}")
    note = "" if unit or own.symbol == "1" else f"no unit is stated: taken as {own.symbol}"
    return replace(base, topic=topic, fields=(path,), unit=unit or own, note=note)


def _meant(entry: ChannelEntry, stream: Stream, wheel: str) -> Feed | None:
    """Return the one feed of a topic that carries a channel, where rover.toml names no field."""
    found = [feed for feed in topic_discovery.find(stream)[0] if feed.channel == entry.channel]
    name = entry.name or wheel
    if len(found) > 1 and name:
        places = {place: feed for feed in found for place in feed.places}
        match = match_name(name, places)
        found = [places[match]] if match else []
    return found[0] if len(found) == 1 else None


def _unit(entry: ChannelEntry, message_type: str, name: str, topic: str) -> Unit | None:
    """Return the unit that the type of a message or the name of a field, topic or column fixes."""
    channel, dimension = entry.channel, CHANNELS[entry.channel].dimension
    symbol = topic_discovery.unit_symbol(message_type, name)
    if symbol:
        unit = units.parse(symbol, dimension)
        if unit is None:
            what = f"{topic} {name} is in {symbol}, which {channel} cannot be"
            raise ConfigurationError(f"{entry.place}: {what}", hint=unit_hint(channel))
        return unit
    for text in (name.rpartition(".")[2], topic.rpartition("/")[2] if name in {"data", "value"} else ""):
        if not text:
            continue
        stated = stated_unit(text, dimension)
        if stated:
            return stated
        try:
            match = identify(text, letters=False)
        except InputError as error:
            raise ConfigurationError(f"{entry.place}: {error}", hint="add unit = …") from None
        if match and match.channel == channel:
            return match.unit
    return None


def _element(entry: ChannelEntry, target: Field, wheel: str) -> str:
    """Return the path of a field, with the element of a list that is meant."""
    if target.kind not in {"numbers", "texts"}:
        return target.name
    if entry.index is not None:
        return f"{target.name}[{entry.index}]"
    name = entry.name or (match_name(wheel, target.elements) if wheel else None)
    if name is None and len(target.elements) == 1:
        name = target.elements[0]
    if name is None:
        raise ConfigurationError(
            f"{entry.place}: {target.name} is a list" + " with nothing in it" * (not target.elements),
            hint=f"add name = … or index = …; it has {', '.join(target.elements[:20]) or 'no element'}",
        )
    return f"{target.name}[{name}]"
