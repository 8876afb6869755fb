"""Channels found in the topics of a bag without rover.toml, and the wheels that they belong to."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from typing import TYPE_CHECKING

from terrain_cli.telemetry.channel_sources import Feed
from terrain_cli.telemetry.plan import standard_messages
from terrain_cli.telemetry.wheel_names import match_name
from terrain_cli.vocabulary import units
from terrain_cli.vocabulary.channels import CHANNELS, LABEL, identify

if TYPE_CHECKING:
    from collections.abc import Collection, Iterable, Mapping, Sequence

    from formats import Field, Stream
    from terrain_cli.telemetry.channel_sources import Plan

#: Rank of what is called as a channel is: above what a standard message is taken to mean.
NAMED = -1
#: Members of single-valued messages that only say that there is a value.
_VALUE = ({"data"}, {"value"})
#: Channels that every wheel has of its own, so that several of one kind tell the wheels.
OF_WHEELS = (
    *("torque", "motor_current", "load", "sinkage", "entry_angle", "angular_velocity"),
    "motor_temperature",
)


@dataclass(frozen=True, slots=True)
class TopicCandidate:
    """A feed found without being asked for."""

    feed: Feed
    #: Names that might tell its wheel: the parts of the topic, or the name beside a list.
    places: tuple[str, ...]


def find(stream: Stream) -> tuple[list[TopicCandidate], str | None]:
    """Find the channels that one topic carries, and the field, if any, that names the wheel."""
    fields = [f for f in stream.fields if not f.name.startswith("header.")]
    if stream.type == standard_messages.JOINT_STATE:
        return _find_joints(stream), None
    if {f.name for f in fields} in _VALUE:
        return _find_by_topic(stream, fields[0]), None
    if standard_messages.is_standard(stream.type):
        return _find_by_type(stream), None
    return _find_by_field(stream, fields)


def _places(stream: Stream) -> tuple[str, ...]:
    return tuple(part for part in stream.topic.split("/") if part)


def _find_joints(stream: Stream) -> list[TopicCandidate]:
    velocity = next((field for field in stream.fields if field.name == "velocity"), None)
    return [joint_speed(stream.topic, name) for name in (velocity.elements if velocity else ())]


def joint_speed(topic: str, joint: str) -> TopicCandidate:
    """Return the speed of a joint in a JointState."""
    feed = Feed(
        channel="angular_velocity",
        topic=topic,
        fields=(f"velocity[{joint}]",),
        unit=units.si("angular speed"),
    )
    return TopicCandidate(feed, (joint,))


def _find_by_topic(stream: Stream, field: Field) -> list[TopicCandidate]:
    """Take the single value of a message for what the topic is called."""
    *places, leaf = _places(stream) or ("",)
    match = identify(leaf, letters=False)
    if match is None or match.channel in {"time", "wheel"} or not _fits(field, match.channel):
        return []
    feed = Feed(channel=match.channel, topic=stream.topic, fields=(field.name,), unit=match.unit, rank=NAMED)
    return [TopicCandidate(feed, tuple(places))]


def _fits(field: Field, channel: str) -> bool:
    """Tell numbers from texts: a label may be either."""
    return field.kind == "number" or (field.kind == "text" and CHANNELS[channel].dimension == LABEL)


def _find_by_type(stream: Stream) -> list[TopicCandidate]:
    found = []
    there = {field.name for field in stream.fields}
    for meaning in standard_messages.meanings(stream.type):
        if not there.issuperset(meaning.fields):
            continue
        symbol = standard_messages.unit_symbol(stream.type, meaning.fields[0])
        unit = None if meaning.combine else units.parse(symbol or "", CHANNELS[meaning.channel].dimension)
        feed = Feed(
            channel=meaning.channel,
            topic=stream.topic,
            fields=meaning.fields,
            unit=unit,
            combine=meaning.combine,
            note=meaning.note,
            rank=meaning.rank,
            of_body=meaning.of_body,
        )
        found.append(TopicCandidate(feed, _places(stream)))
    return found


def _find_by_field(stream: Stream, fields: Sequence[Field]) -> tuple[list[TopicCandidate], str | None]:
    """Take the fields of a message of the user's own for what they are called."""
    found: list[TopicCandidate] = []
    label: str | None = None
    for field in fields:
        # Single letters deep inside are anything's coordinates.
        inside, _, leaf = field.name.rpartition(".")
        match = identify(leaf, letters=not inside)
        if match is None or match.channel == "time":
            continue
        if match.channel == "wheel":
            label = field.name if field.kind == "text" else label
        elif field.kind == "numbers":
            feeds = (
                (
                    Feed(
                        channel=match.channel,
                        topic=stream.topic,
                        fields=(f"{field.name}[{name}]",),
                        unit=match.unit,
                        rank=NAMED,
                    ),
                    name,
                )
                for name in field.elements
            )
            found += [TopicCandidate(feed, (name,)) for feed, name in feeds]
        elif _fits(field, match.channel):
            feed = Feed(
                channel=match.channel, topic=stream.topic, fields=(field.name,), unit=match.unit, rank=NAMED
            )
            found.append(TopicCandidate(feed, _places(stream)))
    return found, label


def wheels_in(candidates: Mapping[str, Sequence[TopicCandidate]], labelled: Collection[str]) -> list[str]:
    """Name the wheels that topics or joints tell apart, by the first channel that has several.

    The messages of topics that are `labelled` name their wheel.
    """
    for channel in OF_WHEELS:
        places = [c.places for c in candidates.get(channel, ()) if c.feed.topic not in labelled]
        if len(places) > 1 and (names := _differing(places)):
            return names
    return []


def _differing(places: Sequence[tuple[str, ...]]) -> list[str]:
    """Return, for each of several paths, the first part in which they all differ."""
    for column in range(min(len(p) for p in places)):
        parts = [p[column] for p in places]
        if len(set(parts)) == len(parts):
            return parts
    return []


def assign(channel: str, found: Sequence[TopicCandidate], others: Iterable[str], plan: Plan) -> None:
    """Give the feeds found for a channel to the wheels they belong to; the others are not wanted.

    What none of several may be preferred for goes to `plan.doubtful`.
    """
    apart = dict.fromkeys(name for name in others if match_name(name, plan.wheels) is None)
    names = [*plan.wheels, *apart]
    # What all have in common, such as the name of the rover, tells no wheel.
    common = Counter(place for candidate in found for place in set(candidate.places))
    shares: dict[str, list[Feed]] = {}
    for candidate in found:
        places = [place for place in candidate.places if len(found) == 1 or common[place] < len(found)]
        named = {name for place in places if (name := match_name(place, names))}
        shares.setdefault(named.pop() if len(named) == 1 else "", []).append(candidate.feed)
    for wheel, feeds in shares.items():
        if wheel and wheel not in plan.wheels:
            continue
        least = min(feed.rank for feed in feeds)
        best = [feed for feed in feeds if feed.rank == least]
        if len(best) == 1:
            (plan.wheels[wheel] if wheel else plan.shared).setdefault(channel, best[0])
        else:
            plan.doubtful.setdefault(wheel, {})[channel] = best
