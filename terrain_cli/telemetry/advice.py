"""The lines of rover.toml that would supply what is missing; what only the user knows stands as "…"."""

from __future__ import annotations

from typing import TYPE_CHECKING

from terrain_cli import toml_text, units
from terrain_cli.channels import CHANNELS, stated_unit
from terrain_cli.telemetry import messages
from terrain_cli.telemetry.complete import NOWHERE
from terrain_cli.telemetry.discovery import OF_WHEELS
from terrain_cli.telemetry.mapping import is_table
from terrain_cli.telemetry.names import match_name

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from formats import Stream
    from terrain_cli.telemetry.complete import Lack
    from terrain_cli.telemetry.feeds import Feed, Plan

#: More names than this help nobody.
MOST = 8


def because(plan: Plan, wheel: str, lack: Lack) -> str:
    """Say why something is missing: nothing gives it, or too much does.

    Parameters
    ----------
    plan : Plan
    wheel : str
    lack : Lack

    Returns
    -------
    str
    """
    doubts = plan.doubts(wheel)
    for channel in (lack.what, *lack.ask):
        if channel in doubts:
            places = ", ".join(feed.place for feed in doubts[channel][:MOST])
            return f"{channel} could be any of {places}"
    return lack.because


def reasons(plan: Plan, wheel: str, lacks: Sequence[Lack]) -> list[str]:
    """Say in a few words why channels are missing.

    Parameters
    ----------
    plan : Plan
    wheel : str
    lacks : sequence of Lack

    Returns
    -------
    list of str
        Channels of which the data say nothing stand together in one.
    """
    told = [(lack.what, because(plan, wheel, lack)) for lack in lacks]
    silent = [what for what, text in told if text.startswith(NOWHERE)]
    loud = [f"no {what}: {text}" for what, text in told if not text.startswith(NOWHERE)]
    text = " or ".join(filter(None, (", ".join(silent[:-1]), *silent[-1:])))
    return [f"nothing gives {text}", *loud] if silent else loud


def lines(plan: Plan, lacks: Mapping[str, Sequence[Lack]]) -> str:
    """Write the lines that would supply what is missing.

    Parameters
    ----------
    plan : Plan
    lacks : mapping of str to sequence of Lack
        By wheel.

    Returns
    -------
    str
        TOML, each table once.
    """
    tables: dict[str, dict[str, None]] = {}
    for wheel, missing in lacks.items():
        several = len(plan.wheels) > 1 and wheel in plan.wheels
        for lack in missing:
            if lack.lines:
                tables.setdefault(lack.lines[0], {}).update(dict.fromkeys(lack.lines[1:]))
            for channel in lack.ask:
                own = several and channel in OF_WHEELS
                header = f"[wheels.{toml_text.key(wheel)}.channels]" if own else "[channels]"
                entry = _column(plan, channel) if is_table(plan.source) else _topic(plan, wheel, channel)
                tables.setdefault(header, {}).update(dict.fromkeys(entry))
    # The wheel and its soil first, as a rover file has them.
    order = sorted(tables, key=lambda header: header not in {"[wheel]", "[soil]"})
    text = [line for header in order for line in (header, *tables[header])]
    if is_table(plan.source) and "[channels]" in tables and plan.extras:
        text.append(f"# the columns that are left: {_some(plan.extras, 3 * MOST)}")
    return "\n".join(text)


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
        first, *others = [_place(feed) for feed in doubts]
        return [f"{channel} = {{ {first} }}  # or {', or '.join(others[:MOST])}"]
    streams = plan.source.streams()
    joints = (
        [stream for stream in streams if stream.type == messages.JOINT_STATE] if channel == "torque" else []
    )
    for stream in joints:
        names = next((f.elements for f in stream.fields if f.name == "effort"), ())
        if names:
            joint = match_name(wheel, names) or (names[0] if len(names) == 1 else "…")
            place = f'topic = "{stream.topic}", field = "effort", name = "{joint}"'
            return [
                f'torque = {{ {place}, unit = "N m" }}{_one_of(names) if joint == "…" else ""}',
                f'# motor_current = {{ {place}, unit = "A" }}  # instead, if that is what effort is here',
            ]
    free = [stream.topic for stream in streams if _is_value(stream) and not _used(plan, stream.topic)]
    return [f'{channel} = {{ topic = "…", field = "data", unit = "{symbol}" }}{_one_of(free)}']


def _place(feed: Feed) -> str:
    text = f'topic = "{feed.topic}"'
    if feed.combine is None:
        name, _, element = feed.fields[0].partition("[")
        text += f', field = "{name}"' + f', name = "{element[:-1]}"' * bool(element)
    return text


def _is_value(stream: Stream) -> bool:
    return [f.name for f in stream.fields if f.kind == "number" and "header." not in f.name] == ["data"]


def _used(plan: Plan, topic: str) -> bool:
    feeds = (*plan.shared.values(), *(feed for its in plan.wheels.values() for feed in its.values()))
    return any(feed.topic == topic for feed in feeds)
