"""The lines of rover.toml that would supply what is missing; what only the user knows stands as "…"."""

from __future__ import annotations

from typing import TYPE_CHECKING

from terrain_cli.telemetry.channel_sources import match_name
from terrain_cli.telemetry.plan import topic_discovery
from terrain_cli.telemetry.plan.derivable_channels import NOWHERE
from terrain_cli.telemetry.plan.mapping import is_table
from terrain_cli.telemetry.plan.topic_discovery import OF_WHEELS
from terrain_cli.toml import toml_text
from terrain_cli.vocabulary import units
from terrain_cli.vocabulary.channels import CHANNELS, stated_unit

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from formats import Stream
    from terrain_cli.telemetry.channel_sources import Feed, Plan
    from terrain_cli.telemetry.plan.derivable_channels import Lack

#: More names than this help nobody.
MOST = 8


def because(plan: Plan, wheel: str, lack: Lack) -> str:
    """Say why something is missing: nothing gives it, or too much does."""
    doubts = plan.doubts(wheel)
    for channel in (lack.what, *lack.ask):
        if channel in doubts:
            places = ", ".join(feed.place for feed in doubts[channel][:MOST])
            return f"{channel} could be any of {places}"
    return lack.because


def reasons(plan: Plan, wheel: str, lacks: Sequence[Lack]) -> list[str]:
    """Say in a few words why channels are missing; those of which the data say nothing in one."""
    told = [(lack.what, because(plan, wheel, lack)) for lack in lacks]
    silent = [what for what, text in told if text.startswith(NOWHERE)]
    loud = [f"no {what}: {text}" for what, text in told if not text.startswith(NOWHERE)]
    text = " or ".join(filter(None, (", ".join(silent[:-1]), *silent[-1:])))
    return [f"nothing gives {text}", *loud] if silent else loud


def lines(plan: Plan, lacks: Mapping[str, Sequence[Lack]]) -> str:
    """Write the lines of TOML, each table once, that would supply what is missing of each wheel."""
    tables: dict[str, dict[str, None]] = {}
    for wheel, missing in lacks.items():
        for lack in missing:
            if lack.lines:
                tables.setdefault(lack.lines[0], {}).update(dict.fromkeys(lack.lines[1:]))
            for channel in lack.ask:
                entry = proposals(plan, wheel, channel)
                tables.setdefault(header(plan, wheel, channel), {}).update(dict.fromkeys(entry))
    # The wheel and its soil first, as a rover file has them.
    order = sorted(tables, key=lambda table: table not in {"[wheel]", "[soil]"})
    text = [line for table in order for line in (table, *tables[table])]
    if is_table(plan.source) and "[channels]" in tables and plan.extras:
        text.append(f"# the columns that are left: {_some(plan.extras, 3 * MOST)}")
    return "\n".join(text)


def proposals(plan: Plan, wheel: str, channel: str) -> list[str]:
    """Write the lines that would supply a channel, alternatives as comments."""
    return _column(plan, channel) if is_table(plan.source) else _topic(plan, wheel, channel)


def header(plan: Plan, wheel: str, channel: str) -> str:
    """Name the table of rover.toml in which a channel of a wheel stands."""
    own = len(plan.wheels) > 1 and wheel in plan.wheels and channel in OF_WHEELS
    return f"[wheels.{toml_text.key(wheel)}.channels]" if own else "[channels]"


def entry(feed: Feed, unit: str, scale: float = 1.0) -> str:
    """Write the line that reads a channel in another unit from where it is read now.

    The unit is that which what was read in SI units is in instead, and `scale` leads to it.
    """
    symbol, scale = _in(feed, unit, scale)
    keys = [place(feed) if feed.constant is None else f"constant = {toml_text.value(feed.constant)}"]
    keys.append(f"unit = {toml_text.value(symbol)}")
    keys += [f"scale = {toml_text.value(feed.scale * scale)}"] * (feed.scale * scale != 1.0)
    keys += [f"offset = {toml_text.value(feed.offset * scale)}"] * (feed.offset != 0.0)
    return f"{feed.channel} = {{ {', '.join(keys)} }}"


def meant(feed: Feed, unit: str, scale: float = 1.0) -> str:
    """Name the unit that `entry` writes, as a person would."""
    symbol, scale = _in(feed, unit, scale)
    if symbol == "kgf":
        # A balance shows the mass.
        return {1.0: "kg", 1e-3: "g"}.get(scale, f"{scale:g} kg")
    return symbol if scale == 1.0 else f"{scale:g} {symbol}"


def _in(feed: Feed, unit: str, scale: float) -> tuple[str, float]:
    """Apply a unit to what is converted already: metres taken for mm are in m."""
    dimension = CHANNELS[feed.channel].dimension
    other, own = units.parse(unit, dimension), feed.unit
    if other is None or own is None or own.factor == 1.0:
        return unit, scale
    factor = own.factor * other.factor
    for symbol in units.symbols(dimension):
        known = units.parse(symbol, dimension)
        if known and abs(known.factor / factor - 1.0) < 1e-9:
            return symbol, scale
    return own.symbol, scale * other.factor


def _some(names: Sequence[str], most: int = MOST) -> str:
    return ", ".join(names[:most]) + ", …" * (len(names) > most)


def _one_of(names: Sequence[str]) -> str:
    return f"  # one of: {_some(names)}" if names else ""


def _column(plan: Plan, channel: str) -> list[str]:
    dimension = CHANNELS[channel].dimension
    fitting = [name for name in plan.extras if stated_unit(name, dimension)]
    symbol = units.si(dimension).symbol
    return [f'{channel} = {{ column = "…", unit = "{symbol}" }}{_one_of(fitting)}']


def _topic(plan: Plan, wheel: str, channel: str) -> list[str]:
    symbol = units.si(CHANNELS[channel].dimension).symbol
    doubts = plan.doubts(wheel).get(channel)
    if doubts:
        first, *others = [place(feed) for feed in doubts]
        return [f"{channel} = {{ {first} }}  # or {', or '.join(others[:MOST])}"]
    streams = plan.source.streams()
    joints = [
        (stream.topic, names)
        for stream in (streams if channel == "torque" else ())
        if stream.type == topic_discovery.JOINT_STATE
        and (names := next((f.elements for f in stream.fields if f.name == "effort"), ()))
    ]
    # Of several topics of joints that which has the one called as the wheel.
    for topic, names in sorted(joints, key=lambda one: match_name(wheel, one[1]) is None)[:1]:
        joint = match_name(wheel, names) or (names[0] if len(names) == 1 else "…")
        which = f"index = {joint}" if joint.isdigit() else f'name = "{joint}"'
        where = f'topic = "{topic}", field = "effort", {which}'
        return [
            f'torque = {{ {where}, unit = "N m" }}{_one_of(names) if joint == "…" else ""}',
            f'# motor_current = {{ {where}, unit = "A" }}  # instead, if that is what effort is here',
        ]
    free = [stream.topic for stream in streams if _is_value(stream) and not _used(plan, stream.topic)]
    if free:
        return [f'{channel} = {{ topic = "…", field = "data", unit = "{symbol}" }}{_one_of(free)}']
    fitting = _one_of(list(_fitting(plan, CHANNELS[channel].dimension)))
    return [f'{channel} = {{ topic = "…", field = "…", unit = "{symbol}" }}{fitting}']


def _fitting(plan: Plan, dimension: str) -> Iterator[str]:
    """Yield the topics that are not used with their fields of one number, which may be of a dimension."""
    for stream in plan.source.streams():
        for field in stream.fields if not _used(plan, stream.topic) else ():
            symbol = topic_discovery.unit_symbol(stream.type, field.name)
            known = units.parse(symbol, dimension) if symbol else not topic_discovery.is_standard(stream.type)
            if field.kind == "number" and known and not field.name.startswith("header."):
                yield f"{stream.topic} {field.name}"


def place(feed: Feed) -> str:
    """Write the keys that say where a channel is read."""
    if not feed.topic:
        return f"column = {toml_text.value(feed.fields[0])}"
    text = f"topic = {toml_text.value(feed.topic)}"
    if feed.combine is None:
        name, _, element = feed.fields[0].partition("[")
        text += f", field = {toml_text.value(name)}"
        if element:
            number = element[:-1].isdigit()
            text += f", index = {element[:-1]}" if number else f", name = {toml_text.value(element[:-1])}"
    return text


def _is_value(stream: Stream) -> bool:
    return [f.name for f in stream.fields if f.kind == "number" and "header." not in f.name] == ["data"]


def _used(plan: Plan, topic: str) -> bool:
    return any(feed.topic == topic for feed in plan.every_feed)
