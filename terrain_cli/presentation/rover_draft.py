"""A rover.toml drafted from what a log holds; what only its user knows is left to fill in."""

from collections.abc import Iterator
from pathlib import Path

from formats import Source
from terrain_cli.errors import TerrainError
from terrain_cli.presentation import inspection
from terrain_cli.presentation.inspection import Holdings
from terrain_cli.presentation.terminal import in_line
from terrain_cli.rover import Rover
from terrain_cli.telemetry import rover_advice, topic_discovery
from terrain_cli.telemetry.mapping import is_table
from terrain_cli.telemetry.wheel_samples import Feed, Raw
from terrain_cli.vocabulary import toml_files
from terrain_cli.vocabulary.channels import CHANNELS, stated_unit

_TEMPLATE = Path(__file__).with_name("rover_draft.txt").read_text("utf-8")
_OWN = """\
# Here what differs from [wheel]: radius, width, grouser_count, grouser_height.
# position = [x, y, z]  # m forward, left and up of one point of the body; {why}
"""
_FOR_LOADS = "only for loads from a [vehicle]"
_IN_TURNS = "needed in turns, where each wheel has its own speed"
_SHARED = "[channels]"
_EFFORT = "effort may be the torque at the wheel, or the current of a [motor]; keep the line that is right"


def draft(source: Source) -> tuple[str, list[str]]:
    """Write the rover file of a log, and say what is left to fill in.

    A line is a comment where only the user can tell what is meant.
    """
    left = ["radius", "width", "shear_modulus"]
    name = "the standard input" if source.path == "-" else in_line(source.path)
    try:
        found = inspection.holdings(source, Rover())
    except TerrainError as error:
        told = f"{error}\n{error.hint}".strip().splitlines()
        told.append("Settle this first. Then terrain-est inspect shows what is read for the other channels.")
        channels = [_SHARED, *(f"# {in_line(line)}" for line in told)]
        left.append("the channels")
    else:
        tables = _tables(found)
        channels = [line for header, lines in tables.items() for line in ("", header, *lines)][1:]
        lacks = [lack for its in found.lacks.values() for lack in its if lack.what in CHANNELS]
        left += ["position of each wheel"] * _turns(found)
        left += dict.fromkeys(channel for lack in lacks for channel in lack.ask or (lack.what,))
    return _TEMPLATE.format(name=name, left=", ".join(left), channels="\n".join(channels)), left


def _turns(found: Holdings) -> bool:
    """Tell whether the speeds of several wheels come from that of the body and its yaw rate."""
    feeds = [raw.feeds for raw in found.raws if "yaw_rate" in raw.feeds]
    return len(feeds) > 1 and any("velocity" in its and its["velocity"].of_body for its in feeds)


def _tables(found: Holdings) -> dict[str, list[str]]:
    """Return the lines of each table of channels, the tables of the wheels after that of all."""
    layout, raws = found.layout, found.raws
    tables: dict[str, list[str]] = {_SHARED: []}
    if column := layout.labels.get(""):
        tables[_SHARED].append(f"wheel = {toml_files.value({'column': column})}")
    own_lines = _OWN.format(why=_IN_TURNS if _turns(found) else _FOR_LOADS).splitlines()
    for raw in raws:
        key = toml_files.key(raw.wheel)
        if len(raws) > 1:
            tables |= {f"[wheels.{key}]": own_lines, f"[wheels.{key}.channels]": []}
        for name in filter(raw.feeds.__contains__, CHANNELS):
            own = len(raws) > 1 and name in layout.wheels.get(raw.wheel, {})
            lines = tables[f"[wheels.{key}.channels]" if own else _SHARED]
            line = _line(found, raw, raw.feeds[name])
            # Of a channel of all wheels each has a range of its own: the first will do.
            if not any(other.startswith(line.partition("  #")[0]) for other in lines):
                lines.append(line)
        for header, lines in [*_asked(found, raw), *_pulls(found, raw)]:
            known = tables.setdefault(header, [])
            known += [line for line in lines if line not in known]
    if is_table(layout.source) and layout.extras:
        tables[_SHARED].append(f"# the columns that are left: {in_line(', '.join(layout.extras))}")
    return {header: lines for header, lines in tables.items() if lines}


def _asked(found: Holdings, raw: Raw) -> Iterator[tuple[str, list[str]]]:
    """Yield the comments that ask for what is missing, each with the table where it stands."""
    for lack in found.lacks[raw.wheel]:
        heading = [_comment(f"{lack.what}: {rover_advice.because(found.layout, raw.wheel, lack)}")]
        for channel in lack.ask:
            proposed = rover_advice.proposals(found.layout, raw.wheel, channel)
            if len(proposed) > 1:
                heading = [f"# {channel}: {_EFFORT}"]
            lines = [*heading, *map(_comment, proposed)]
            if channel == "load":
                lines.append('# load = { constant = …, unit = "N" }  # if it hardly changes')
            yield rover_advice.header(found.layout, raw.wheel, channel), lines
            heading = []
        if lack.what in CHANNELS and not lack.ask:
            yield _SHARED, [*heading, *map(_comment, lack.lines[1:])]


def _pulls(found: Holdings, raw: Raw) -> Iterator[tuple[str, list[str]]]:
    """Yield the comments that show what may be the drawbar pull, which nothing asks for."""
    lines = rover_advice.pulls(found.layout, raw.feeds).values()
    if lines:
        told = ["# keep one of these lines if it is the drawbar pull:", *map(_comment, lines)]
        yield rover_advice.header(found.layout, raw.wheel, "drawbar_pull"), told


def _comment(line: str) -> str:
    return line if line.startswith("#") else f"# {in_line(line)}"


def _line(found: Holdings, raw: Raw, feed: Feed) -> str:
    """Write the line of a channel, with its range and what was taken for granted."""
    entry = inspection.channel(raw, feed.channel)
    remarks = [inspection.spread(feed.channel, entry)]
    if len(feed.fields) > 1 and not feed.topic:
        return f"# {feed.channel}: {in_line(feed.place)}, found without a line here"
    known = feed.unit is None or feed.unit.symbol == "1" or _has_unit(found, feed)
    keys = rover_advice.place(feed)
    if feed.topic and (feed.of_body or feed.combine or not known):
        # Without a field it is read as it was found.
        keys.pop("field", None)
    if feed.unit and known and feed.unit.symbol != "1":
        keys["unit"] = feed.unit.symbol
    if feed.unit and not known:
        remarks.append(f"no unit is stated: taken as {feed.unit.symbol}")
    remarks.append("" if feed.note == "converted" else feed.note)
    told = "; ".join(filter(None, map(in_line, remarks)))
    return f"{feed.channel} = {toml_files.value(keys)}" + f"  # {told}" * bool(told)


def _has_unit(found: Holdings, feed: Feed) -> bool:
    """Tell whether the header, the name of the topic or the type of its messages gives the unit."""
    if feed.stated or feed.combine:
        return True
    types = {stream.topic: stream.type for stream in found.layout.source.streams()}
    name = feed.fields[0]
    if topic_discovery.unit_symbol(types.get(feed.topic, ""), name):
        return True
    leaves = (name.partition("[")[0].rpartition(".")[2], feed.topic.rpartition("/")[2])
    return any(stated_unit(leaf, CHANNELS[feed.channel].dimension) for leaf in leaves)
