"""Channels found in the topics of a bag without rover.toml, and the wheels that they belong to.

Units and axes (x forward, y left, z up) of standard messages are those of REP 103. What a message leaves open
is not guessed: `effort` may be a torque or a current, a TwistStamped may hold what was commanded.
"""

import re
import tomllib
from collections import Counter
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from formats import Field, Stream
from terrain_cli.telemetry.wheel_samples import Feed, Plan, match_name
from terrain_cli.vocabulary import units
from terrain_cli.vocabulary.arrays import Array
from terrain_cli.vocabulary.channels import CHANNELS, LABEL, Match, identify

JOINT_STATE = "sensor_msgs/msg/JointState"
_STANDARD = re.compile(
    r"(std|sensor|geometry|nav|diagnostic|tf2|rosgraph|rcl_interfaces|visualization)_msgs/msg/"
)
_MESSAGES = tomllib.loads(Path(__file__).with_name("standard_messages.toml").read_text("utf-8"))
_UNITS: list[tuple[str, str, str]] = _MESSAGES["units"]["of"]
NAMED = -1  # Rank of what is called as a channel is: above what a standard message is taken to mean
_VALUE = ({"data"}, {"value"})  # Members of single-valued messages that only say that there is a value
#: Channels that every wheel has of its own, so that several of one kind tell the wheels.
OF_WHEELS = (
    *("torque", "motor_current", "load", "sinkage", "entry_angle", "angular_velocity"),
    "motor_temperature",
)


def pitch(x: Array, y: Array, z: Array, w: Array) -> Array:
    """Pitch (rad) of a unit quaternion, positive nose up (REP 103's rotation about y: nose down)."""
    return -np.arcsin(np.clip(2.0 * (w * y - z * x), -1.0, 1.0))


def roll(x: Array, y: Array, z: Array, w: Array) -> Array:
    """Roll (rad) of a unit quaternion, positive left side up."""
    return np.arctan2(2.0 * (w * x + y * z), 1.0 - 2.0 * (x**2 + y**2))


#: The channels that standard messages carry; their topics are those of a bag.
MEANINGS: dict[str, tuple[Feed, ...]] = {
    kind: tuple(
        Feed(
            channel=channel,
            combine={"pitch": pitch, "roll": roll}.get(channel),
            **{**entry, "fields": tuple(entry["fields"])},
        )
        for channel, entry in meanings.items()
    )
    for kind, meanings in _MESSAGES["meanings"].items()
}


def is_standard(message_type: str) -> bool:
    """Tell whether a type belongs to the packages that come with ROS."""
    return _STANDARD.match(message_type) is not None


def unit_symbol(message_type: str, field: str) -> str | None:
    """Return the unit that a standard message fixes for a field, unless its definition leaves it open."""
    if not is_standard(message_type):
        return None
    name = message_type.rpartition("/")[2]
    bare = field.partition("[")[0]
    for types, fields, symbol in _UNITS:
        if re.fullmatch(types, name) and re.fullmatch(fields, bare):
            return symbol
    return None


def find(stream: Stream) -> tuple[list[Feed], str | None]:
    """Find the channels that one topic carries, and the field, if any, that names the wheel."""
    fields = [f for f in stream.fields if not f.name.startswith("header.")]
    if stream.type == JOINT_STATE:
        joints = next((field.elements for field in stream.fields if field.name == "velocity"), ())
        return [joint_speed(stream.topic, name) for name in joints], None
    if {f.name for f in fields} in _VALUE:
        return _find_by_topic(stream, fields[0]), None
    if is_standard(stream.type):
        return _find_by_type(stream), None
    return _find_by_field(stream, fields)


def _places(stream: Stream) -> tuple[str, ...]:
    return tuple(part for part in stream.topic.split("/") if part)


def joint_speed(topic: str, joint: str) -> Feed:
    unit, fields = units.si("angular speed"), (f"velocity[{joint}]",)
    return Feed(channel="angular_velocity", topic=topic, fields=fields, unit=unit, places=(joint,))


def _find_by_topic(stream: Stream, field: Field) -> list[Feed]:
    """Take the single value of a message for what the topic is called."""
    *places, leaf = _places(stream) or ("",)
    match = identify(leaf, letters=False)
    if match is None or match.channel in {"time", "wheel"} or not _fits(field, match.channel):
        return []
    return [_named(stream, match, field.name, tuple(places))]


def _named(stream: Stream, match: Match, path: str, places: tuple[str, ...]) -> Feed:
    channel, unit = match.channel, match.unit
    return Feed(channel=channel, topic=stream.topic, fields=(path,), unit=unit, rank=NAMED, places=places)


def _fits(field: Field, channel: str) -> bool:
    """Tell numbers from texts: a label may be either."""
    return field.kind == "number" or (field.kind == "text" and CHANNELS[channel].dimension == LABEL)


def _find_by_type(stream: Stream) -> list[Feed]:
    found = []
    there = {field.name for field in stream.fields}
    for meaning in MEANINGS.get(stream.type, ()):
        if not there.issuperset(meaning.fields):
            continue
        symbol = unit_symbol(stream.type, meaning.fields[0])
        unit = None if meaning.combine else units.parse(symbol or "", CHANNELS[meaning.channel].dimension)
        found.append(replace(meaning, topic=stream.topic, unit=unit, places=_places(stream)))
    return found


def _find_by_field(stream: Stream, fields: Sequence[Field]) -> tuple[list[Feed], str | None]:
    """Take the fields of a message of the user's own for what they are called."""
    found: list[Feed] = []
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
            found += [_named(stream, match, f"{field.name}[{name}]", (name,)) for name in field.elements]
        elif _fits(field, match.channel):
            found.append(_named(stream, match, field.name, _places(stream)))
    return found, label


def wheels_in(candidates: Mapping[str, Sequence[Feed]], labelled: Collection[str]) -> list[str]:
    """Name the wheels that topics or joints tell apart, by the first channel of several, none `labelled`."""
    for channel in OF_WHEELS:
        places = [feed.places for feed in candidates.get(channel, ()) if feed.topic not in labelled]
        for parts in zip(*places, strict=False) if len(places) > 1 else ():
            # The first in which they all differ.
            if len(set(parts)) == len(parts):
                return list(parts)
    return []


def assign(channel: str, found: Sequence[Feed], others: Iterable[str], plan: Plan) -> None:
    """Give the feeds found for a channel to their wheels, or to `plan.doubtful`; drop those of `others`."""
    apart = dict.fromkeys(name for name in others if match_name(name, plan.wheels) is None)
    names = [*plan.wheels, *apart]
    # What all have in common, such as the name of the rover, tells no wheel.
    common = Counter(place for feed in found for place in set(feed.places))
    shares: dict[str, list[Feed]] = {}
    for feed in found:
        places = [place for place in feed.places if len(found) == 1 or common[place] < len(found)]
        named = {name for place in places if (name := match_name(place, names))}
        shares.setdefault(named.pop() if len(named) == 1 else "", []).append(feed)
    for wheel, feeds in shares.items():
        if wheel and wheel not in plan.wheels:
            continue
        least = min(feed.rank for feed in feeds)
        best = [feed for feed in feeds if feed.rank == least]
        if len(best) == 1:
            (plan.wheels[wheel] if wheel else plan.shared).setdefault(channel, best[0])
        else:
            plan.doubtful.setdefault(wheel, {})[channel] = best
