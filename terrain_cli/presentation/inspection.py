"""What a log holds, what would be used of it, and what rover.toml would have to say for the rest."""

import shlex
from collections.abc import Collection, Mapping, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

import formats
from formats import Column, Source, Stream
from formats.content import FILE_KINDS
from terrain_cli.errors import InputError, TerrainError
from terrain_cli.presentation.terminal import aligned
from terrain_cli.rover import Rover
from terrain_cli.rover.vehicle import FILE_NAME
from terrain_cli.telemetry import raw_channels, rover_advice, topic_discovery
from terrain_cli.telemetry.alignment import seconds
from terrain_cli.telemetry.assembly import Request, assemble, lacking, wheel_of
from terrain_cli.telemetry.mapping import is_table, plan
from terrain_cli.telemetry.raw_channels import read_raw
from terrain_cli.telemetry.raw_columns import read_topics, stamps
from terrain_cli.telemetry.wheel_samples import Plan, Raw
from terrain_cli.vocabulary.arrays import Array
from terrain_cli.vocabulary.channels import CHANNELS
from terrain_cli.vocabulary.quantities import counted

FORMAT = "terrain-est/inspection/1"
#: Positions need more digits than measurements.
_FORMATS = dict.fromkeys(("longitude", "latitude"), ".6f") | dict.fromkeys(
    ("time", "x", "y", "elevation"), ".2f"
)
_EPOCH = 1e8  # Larger times are seconds since 1970
_LAST = 253_402_300_799  # The end of the year 9999, after which dates have no common way to be written; s
_WIDTH = 100  # A line of names longer than this is broken


def inspect(
    path: str, rover: Rover, *, wheels: Collection[str] = (), salvage: bool = False
) -> dict[str, Any]:
    """Look into one input, ready for JSON; the problem stands where its channels cannot be told."""
    source = formats.open_source(path, salvage=salvage)
    document: dict[str, Any] = {
        "source": source.path,
        "kind": source.kind,
        "rover": formats.shown(str(rover.path)) if rover.path else None,
        "streams": [_stream(stream, None) for stream in source.streams()],
        "wheels": [],
        "extras": [],
        "rover_toml": "",
        "problem": None,
    }
    try:
        document |= _understood(source, rover, wheels)
    except (formats.FormatError, TerrainError) as error:
        document["problem"] = {"error": str(error), "hint": error.hint, "exit_code": error.exit_code}
    return document | {
        "rows_skipped": getattr(source, "skipped", 0),
        "salvage": source.recovery.document() if source.recovery else None,
        "remarks": source.remarks,
    }


class Holdings(NamedTuple):
    """What a log holds, and of each wheel what is missing."""

    layout: Plan
    # The columns of the topics that were read; none of a table
    tables: Mapping[str, dict[str, Column]] | None
    raws: list[Raw]
    lacks: dict[str, list[rover_advice.Lack]]


def holdings(source: Source, rover: Rover, wheels: Collection[str] = ()) -> Holdings:
    """Find the channels of every wheel of a log; what is missing is no error."""
    layout = plan(source, rover)
    request = Request(layout=layout, rover=rover, wheels=wheels)
    tables = None if is_table(source) else read_topics(source, raw_channels.fields(request))
    raws = read_raw(request, [], tables)
    clock = layout.no_time
    doubts = (
        [rover_advice.Lack("time", str(clock), lines=tuple(clock.hint.splitlines()[1:]))] if clock else []
    )
    lacks = {raw.wheel: [*doubts, *lacking(raw, rover)] for raw in raws}
    return Holdings(layout, tables, raws, lacks)


def _understood(source: Source, rover: Rover, wheels: Collection[str]) -> dict[str, Any]:
    layout, tables, raws, lacks = holdings(source, rover, wheels)
    used = {feed.topic for raw in raws for feed in raw.feeds.values() if feed.topic}
    found = [_wheel(source, layout, raw, rover, lacks[raw.wheel]) for raw in raws]
    other = filter(None, dict.fromkeys(wheel.pop("rover_toml", "") for wheel in found))
    clocks = {topic: stamps(table) for topic, table in (tables or {}).items() if topic in used}
    streams = [_stream(stream, clocks.get(stream.topic)) for stream in source.streams()]
    if is_table(source) and streams[0]["records"] is None:
        first = streams[0]["fields"][0]["name"]
        streams[0]["records"] = sum(len(batch[first]) for batch in source.read("", [first]))
    return {
        "streams": streams,
        "wheels": found,
        "extras": list(layout.extras),
        "rover_toml": "\n".join(other) or rover_advice.lines(layout, lacks),
    }


def _stream(stream: Stream, clock: NDArray[np.datetime64] | None) -> dict[str, Any]:
    entry: dict[str, Any] = {"topic": stream.topic, "type": stream.type, "records": stream.count}
    if clock is not None:
        entry |= _rate(seconds(clock, 0.0))
    elif stream.count and stream.start is not None and stream.end is not None and stream.end > stream.start:
        span = (stream.end - stream.start) * 1e-9
        entry |= {"duration_s": span, "rate_Hz": (stream.count - 1) / span}
    entry["fields"] = [
        {"name": f.name, "kind": f.kind} | ({"elements": list(f.elements)} if f.elements else {})
        for f in stream.fields
    ]
    return entry


def _rate(time: Array) -> dict[str, Any]:
    steps = np.diff(np.sort(time[np.isfinite(time)]))
    if len(steps) == 0 or steps.sum() == 0.0:
        return {}
    median = float(np.median(steps))
    return {
        "duration_s": float(steps.sum()),
        "rate_Hz": 1.0 / median if median > 0.0 else None,
        "largest_gap_s": float(steps.max()),
    }


def _wheel(
    source: Source, layout: Plan, raw: Raw, rover: Rover, lacks: Sequence[rover_advice.Lack]
) -> dict[str, Any]:
    derived, _ = rover_advice.routes(raw.channels, wheel_of(raw, rover), rover)
    entry: dict[str, Any] = {"wheel": raw.wheel, "samples": len(raw)}
    if raw.time is not None:
        known = raw.time[np.isfinite(raw.time)]
        entry |= _rate(known) | ({"start_s": float(known.min()) + raw.origin} if len(known) else {})
    entry["channels"] = {name: channel(raw, name) for name in CHANNELS if name in raw.feeds}
    entry["derived"] = derived
    entry["undecided"] = {
        channel: [feed.place for feed in feeds] for channel, feeds in layout.doubts(raw.wheel).items()
    }
    entry["missing"] = [
        {"what": lack.what, "because": rover_advice.because(layout, raw.wheel, lack)} for lack in lacks
    ]
    pull = rover_advice.pull(layout, raw.wheel, raw.feeds)
    entry["remarks"] = [*raw.remarks, *pull]
    if lacks:
        return entry
    try:
        judged = assemble(Request(layout=layout, rover=rover, effects=()), raw)
    except InputError as error:
        # A unit is wrong: that of the clock, unless it says of which channel.
        entry["missing"] = [{"what": getattr(error, "channel", "time"), "because": str(error)}]
        entry["rover_toml"] = error.hint.partition("\n")[2]
        return entry
    # What is doubtful shows only once it was judged.
    entry["remarks"] = [*judged.remarks[len(source.remarks) :], *pull]
    entry |= {"used": len(judged.usable), "set_aside": judged.reasons()}
    entry["stretches"] = len(np.unique(judged.stretch[judged.usable]))
    if judged.distance is not None and len(judged):
        entry["distance_m"] = float(judged.distance[-1])
    return entry


def channel(raw: Raw, name: str) -> dict[str, Any]:
    """Say where a channel comes from, and how far it reaches."""
    feed, unit = raw.feeds[name], CHANNELS[name].unit
    entry: dict[str, Any] = {"from": str(feed), "unit": unit.symbol if unit else None}
    if name in raw.labels:
        labels = raw.labels[name]
        used = np.unique(labels.codes)
        entry["values"] = [labels.names[code] for code in used if code >= 0]
        entry["missing"] = int(np.count_nonzero(labels.codes < 0))
        return entry
    values = raw.time + raw.origin if name == "time" and raw.time is not None else raw.channels[name]
    finite = values[np.isfinite(values)]
    if len(finite):
        # Not −0, which an angle turned round may be.
        entry["range"] = [float(finite.min()) + 0.0, float(finite.max()) + 0.0]
    entry["missing"] = len(values) - len(finite)
    return entry


def text(document: dict[str, Any], *, verbose: bool = False) -> str:
    """Write an inspection for a person; `verbose` lists every field of the messages that come with ROS."""
    starts = [wheel["start_s"] for wheel in document["wheels"] if wheel.get("start_s", 0.0) > _EPOCH]
    began = f", from {_moment(min(starts))}" if starts else ""
    lines = [f"{document['source']}: {FILE_KINDS[document['kind']].title}{_size(document)}{began}"]
    lines += [f"  {remark}" for remark in document["remarks"]]
    topics = [stream for stream in document["streams"] if stream["topic"]]
    if topics:
        header = ("topic", "type", "messages", "rate", "largest gap")
        lines += ["", *aligned([header, *map(_topic, topics)], "  ")]
    for stream in document["streams"]:
        known = stream["topic"] and topic_discovery.is_standard(stream["type"]) and not document["problem"]
        if verbose or not known:
            lines += ["", *_fields(stream)]
    for wheel in document["wheels"]:
        lines += ["", *_wheel_text(wheel)]
    if document["extras"]:
        lines += ["", *_wrapped("further columns, kept as they are: ", document["extras"])]
    lines += _missing_text(document)
    if document["rover"] is None and document["source"] != "-":
        log = Path(document["source"])
        target = shlex.quote(str(log.parent / FILE_NAME))
        lines += ["", f"draft a rover.toml: terrain-est init {shlex.quote(str(log))} -o {target}"]
    return "\n".join(lines)


def _size(document: dict[str, Any]) -> str:
    streams = document["streams"]
    if not streams:
        return ", no topics"
    if any(stream["topic"] for stream in streams):
        return f", {counted(len(streams), 'topic')}"
    skipped, rows = document["rows_skipped"], streams[0]["records"]
    if rows is None:
        return ""
    return f", {rows} rows" + f" and {skipped} that do not fit its header" * bool(skipped)


def _topic(stream: dict[str, Any]) -> tuple[str, ...]:
    rate, gap = stream.get("rate_Hz"), stream.get("largest_gap_s")
    return (
        stream["topic"],
        stream["type"],
        "?" if stream["records"] is None else str(stream["records"]),
        f"{rate:.1f} Hz" if rate else "",
        f"{gap:.2f} s" if gap else "",
    )


def _fields(stream: dict[str, Any]) -> list[str]:
    names = []
    for field in stream["fields"]:
        kind = "" if field["kind"] == "number" else f" ({field['kind']})"
        names.append(field["name"] + (f"[{', '.join(field['elements'])}]" if "elements" in field else kind))
    return _wrapped(f"{stream['topic'] or 'columns'}: ", names)


def _wrapped(title: str, names: Sequence[str]) -> list[str]:
    lines = [title]
    for k, name in enumerate(names):
        piece = name + ", " * (k < len(names) - 1)
        if len(lines[-1]) + len(piece) > _WIDTH and lines[-1].strip():
            lines.append("  ")
        lines[-1] += piece
    return [line.rstrip() for line in lines]


def _wheel_text(wheel: dict[str, Any]) -> list[str]:
    used = f"{wheel['used']} of {wheel['samples']}" if "used" in wheel else f"{wheel['samples']}"
    parts = [f"wheel {wheel['wheel']}: {used} samples" + " can be used" * ("used" in wheel)]
    if wheel.get("rate_Hz"):
        parts.append(f"{wheel['rate_Hz']:.1f} Hz over {wheel['duration_s']:.1f} s")
    if wheel.get("distance_m"):
        parts.append(f"{wheel['distance_m']:.2f} m")
    if wheel.get("stretches", 1) > 1:
        parts.append(f"{wheel['stretches']} stretches, largest gap {wheel['largest_gap_s']:.2f} s")
    lines = [", ".join(parts)]
    if wheel["channels"] or wheel["derived"]:
        rows = [("channel", "range", "missing", "from")]
        for name, entry in wheel["channels"].items():
            rows.append((name, spread(name, entry), str(entry["missing"] or ""), entry["from"]))
        rows += [(name, "", "", f"derived from {how}") for name, how in wheel["derived"].items()]
        lines += aligned(rows, "  ")
    lines += [f"  set aside: {count} · {reason}" for reason, count in wheel.get("set_aside", {}).items()]
    lines += [f"  {remark}" for remark in wheel["remarks"]]
    lines += [
        f"  not used: {channel}, which could be any of {', '.join(places)}"
        for channel, places in wheel["undecided"].items()
        if not any(f"{channel} could" in lack["because"] for lack in wheel["missing"])
    ]
    return lines


def _missing_text(document: dict[str, Any]) -> list[str]:
    """Say each thing that is missing once, and the lines that would supply it."""
    lacks: dict[tuple[str, str], list[str]] = {}
    for wheel in document["wheels"]:
        for lack in wheel["missing"]:
            lacks.setdefault((lack["what"], lack["because"]), []).append(wheel["wheel"])
    if not lacks:
        return []
    rows = [
        (what, because + f" (wheel {', '.join(wheels)})" * (len(wheels) < len(document["wheels"])))
        for (what, because), wheels in lacks.items()
    ]
    lines = ["", "missing for an estimate:", *aligned(rows, "  ")]
    if document["rover_toml"]:
        file = document["rover"] or "a file rover.toml beside the log"
        lines += ["", f"write into {file}, and fill in each …:", ""]
        lines += [f"    {line}".rstrip() for line in document["rover_toml"].splitlines()]
    return lines


def spread(name: str, entry: dict[str, Any]) -> str:
    """Write how far a channel reaches, from its entry (`channel`)."""
    if "range" not in entry:
        return ", ".join(entry.get("values", []))
    if name == "time" and entry["range"][0] > _EPOCH:
        return " … ".join(map(_moment, entry["range"]))
    ends = (f"{end:{_FORMATS.get(name, '.4g')}}" for end in entry["range"])
    unit = f" {entry['unit']}" if entry["unit"] != "1" else ""
    return " … ".join(dict.fromkeys(ends)) + unit


def _moment(time: float) -> str:
    if time > _LAST:
        return f"{time:.4g} s"
    return datetime.fromtimestamp(time, UTC).strftime("%Y-%m-%d %H:%M:%S UTC")
