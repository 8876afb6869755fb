"""Telemetry: from files to the samples of each wheel, on the clock of its torque, in SI units."""

from collections.abc import Collection, Iterator
from dataclasses import replace
from typing import Any

import numpy as np

import formats
from formats import Batch, Source
from formats.recovery import Notice
from terrain_cli.errors import InputError, nearest
from terrain_cli.rover import Rover
from terrain_cli.telemetry import effect_inputs, raw_channels, raw_columns, rover_advice
from terrain_cli.telemetry.assembly import Request, assemble, check
from terrain_cli.telemetry.long_logs import PartReader, excerpt, in_parts
from terrain_cli.telemetry.mapping import is_table, plan
from terrain_cli.telemetry.raw_channels import read_raw
from terrain_cli.telemetry.usable_samples import Condition
from terrain_cli.telemetry.wheel_samples import NEEDED, Geometry, Plan, Samples
from terrain_cli.vocabulary.channels import CHANNELS
from terrain_cli.vocabulary.quantities import PREDICTED

__all__ = ["Condition", "Geometry", "Samples", "part_reader", "read", "read_parts", "read_source"]


def read(path: str, rover: Rover, *, salvage: bool = False, **options: Any) -> list[Samples]:
    """Read the samples of every wheel of a log (a file, a folder that is one, "-"); see `read_source`."""
    return read_source(formats.open_source(path, salvage=salvage), rover, **options)


def read_source(source: Source, rover: Rover, *, most: int | None = None, **asked: Any) -> list[Samples]:
    """Read the samples of some wheels (all if none is named) of an opened source, ordered by name.

    `effects` are those of the whole model instead of the line: their channels are read too, and the drawbar
    pull, and samples of a skidding wheel are kept. What those `beside` them use is read where it is there.
    To be `compared` with a model, samples may lack torque, and have every channel and further numeric column,
    as something that residuals may follow. `kept` are such columns that are read in any case, named in lower
    case.

    Of a table of more than `most` rows, and of a bag of more samples, only unbroken pieces are kept that are
    spread over it (`excerpt`). A table is then never in memory as a whole.
    """
    request = _request(source, rover, **asked)
    batches = _begun(request, most)
    parts = _whole(request, batches) if isinstance(batches, list) else in_parts(request, batches)
    if most is None or (isinstance(parts, list) and sum(map(len, parts)) <= most):
        return _some(request, list(parts))
    return _some(request, excerpt(most // 2, parts))


def read_parts(source: Source, rover: Rover, rows: int, **asked: Any) -> list[Samples] | Iterator[Samples]:
    """Read a table of more than some rows in parts, for the line y = c + x tan φ; anything else whole."""
    request = _request(source, rover, **asked)
    timed = any(feed.channel == "time" for feed in request.layout.every_feed)
    # Steady test points belong together by their labels, wherever they stand.
    batches = _begun(request, rows if timed else None)
    if isinstance(batches, list):
        return _some(request, _whole(request, batches))
    return in_parts(request, batches)


def part_reader(source: Source, rover: Rover, **asked: Any) -> PartReader:
    """Return what makes samples of rows or messages as they arrive; InputError where a row has no clock."""
    request = _request(source, rover, **asked)
    if is_table(source) and not any(feed.channel == "time" for feed in request.layout.every_feed):
        what = "no column is the time of a row, without which nothing can be followed"
        hint = "name one in its header (time, or stamp_ns), or in rover.toml under [channels]"
        raise InputError(f"{source.label}: {what}", hint=hint)
    return PartReader(request, evident=False)


def _request(source: Source, rover: Rover, *, kept: Collection[str] = (), **asked: Any) -> Request:
    layout = plan(source, rover)
    if layout.no_time:
        raise layout.no_time
    request = Request(layout=layout, rover=rover, **asked)
    extras, names = _condition_columns(layout, request.where) if request.where else ([], set())
    wanted = {*rover_advice.SOURCES, *names}
    if request.effects is not None:
        channels, further = effect_inputs.read([*request.effects, *request.beside])
        wanted |= {"drawbar_pull", *channels}
        extras = sorted({*extras, *further.intersection(layout.extras)})
    if request.compared:
        wanted |= CHANNELS.keys()
        extras = sorted({*extras, *layout.extras})
    extras = sorted({*extras, *(name for name in layout.extras if name.strip().casefold() in kept)})
    return replace(request, channels=frozenset(wanted), extras=tuple(extras))


def _begun(request: Request, rows: int | None) -> list[Batch] | Iterator[Batch]:
    """Begin to read a table of which not more than some rows may be held; nothing of a bag."""
    if rows is None or not is_table(request.layout.source):
        return []
    return raw_columns.begin(request.layout.source, raw_channels.fields(request)[""], rows)


def _whole(request: Request, batches: list[Batch]) -> list[Samples]:
    raws = read_raw(request, batches)
    for raw in raws if request.compared else ():
        # A model would predict it, but it was not measured.
        for name in raw.channels.keys() & set(PREDICTED):
            if not np.isfinite(raw.channels[name]).any():
                del raw.channels[name]
                told = f"{name}: {raw.feeds[name]} holds no number: taken as not measured"
                raw.remarks.append(Notice(told))
    check(request, raws)
    result = []
    while raws:
        result.append(assemble(request, raws.pop(0), request.layout.extras))
    return result


def _some(request: Request, result: list[Samples]) -> list[Samples]:
    """Return samples, of which there must be some."""
    if not any(map(len, result)):
        where = f" where {request.where.text}" if request.where else ""
        raise InputError(f"{request.layout.source.path}: there are no samples{where}")
    return result


def _condition_columns(layout: Plan, where: Condition) -> tuple[list[str], set[str]]:
    """Split what a condition reads into columns of the file and channels."""
    headers = {f.name for f in layout.source.streams()[0].fields} if is_table(layout.source) else set[str]()
    columns = where.names & headers
    always = (*NEEDED, *([] if is_table(layout.source) else ["time"]))
    known = {feed.channel for feed in layout.every_feed}.union(always, headers)
    for name in sorted(where.names - known):
        what = f"--where: there is no column {name}{nearest(name, known)}"
        raise InputError(f"{layout.source.path}: {what}", hint=f"there are {', '.join(sorted(known))}")
    return sorted(columns), where.names - columns
