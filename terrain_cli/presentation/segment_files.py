"""Where results go, by the ending of a file: tables and layers, or messages for what reads MCAP of ROS 2."""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

import formats
from formats.output.common_forms import is_wgs84, normalise, parse, projjson
from terrain_cli.errors import InputError, UsageError

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

    from numpy.typing import NDArray

    from formats.output.bag_writer import Topic
    from terrain_cli.presentation.segment_table import Table
    from terrain_cli.vocabulary.arrays import Array, Index, Mask

SEGMENT = "terrain_est_msgs/msg/Segment"
FIX = "sensor_msgs/msg/NavSatFix"
#: In the topic, or of no use in a message.
_LEFT_OUT = ("wheel", "WKT")
_ENDS = ("t_start_s", "t_end_s")
#: Layer → columns by which QGIS can colour it, the first unless asked for another.
STYLES = {
    "segments": ("strength_at_stress_kPa", "strength_kPa", "c_kPa", "phi_deg"),
    "samples": ("slip", "sinkage_m", "load_N", "torque_Nm"),
}


def topics(table: Table, crs: str | None = None, before: Iterable[str] = ()) -> list[Topic]:
    """Turn segments into messages: two for each, at its start and at its end, so that plots show steps.

    Each wheel has a topic ``/terrain/<wheel>/estimate``, and ``/terrain/<wheel>/fix`` where longitude and
    latitude are known; `crs` is the frame of the fixes. Fields are the columns in lower case, as ROS 2 wants
    them. Wheels that came `before` keep their names. InputError if a segment has no time, or is before 1970.
    """
    from formats.output.bag_writer import Topic

    stamps = _stamps(table)
    columns = {
        name: ["" if text is None else text for text in column] if column.dtype == object else column
        for name, column in normalise(table).items()
        if name not in _LEFT_OUT
    }
    kinds = {
        name: "string" if isinstance(column, list) else column.dtype.name for name, column in columns.items()
    }
    definition = "\n".join(
        ["# One end of a segment of terrain.", "std_msgs/Header header", "bool end"]
        + [f"{kind} {name.lower()}" for name, kind in kinds.items()]
    )
    wheels = np.array(table["wheel"], dtype=str)
    result = []
    names = _names(dict.fromkeys([*before, *wheels.tolist()]))
    for wheel in dict.fromkeys(wheels.tolist()):
        name = names[wheel]
        rows, ends, times = _by_time(stamps, np.flatnonzero(wheels == wheel))
        fields: dict[str, Any] = {n.lower(): np.array(column)[rows] for n, column in columns.items()}
        fields |= {"end": ends.astype(bool), "header.frame_id": wheel}
        result.append(Topic(f"/terrain/{name}/estimate", SEGMENT, times, fields, definition))
        known, places = _places(table, rows, ends)
        if crs is not None and known.any():
            fix = {"header.frame_id": crs, "altitude": np.nan}
            fix |= {"longitude": places[known, 0], "latitude": places[known, 1]}
            result.append(Topic(f"/terrain/{name}/fix", FIX, times[known], fix))
    return result


def _stamps(table: Table) -> NDArray[np.int64]:
    """Return the times of both ends of each segment, in ns since 1970 or since the log's own zero."""
    seconds = np.stack([np.asarray(table[name], dtype=float) for name in _ENDS])
    unknown = int(np.sum(~np.isfinite(seconds).all(axis=0)))
    if unknown:
        raise InputError(
            f"{unknown} of {seconds.shape[1]} segments have no time, which every message needs",
            hint="write another format than .mcap",
        )
    if seconds.size and seconds.min() < 0.0:
        raise InputError(
            f"segments begin at {seconds.min():g} s, and messages only at 0 or later",
            hint="write another format than .mcap",
        )
    # A clock in s since 1970 resolves 0.24 µs.
    return np.asarray(np.round(seconds * 1e6), dtype=np.int64) * 1000


def _names(wheels: Sequence[str] | Mapping[str, Any]) -> dict[str, str]:
    """Return a name that a topic may have for each wheel, no two alike."""
    names: dict[str, str] = {}
    for wheel in wheels:
        name = re.sub(r"\W+", "_", wheel, flags=re.ASCII).strip("_")
        name = name if name[:1].isalpha() else f"wheel_{name}".rstrip("_")
        count = 1
        while name in names.values():
            count += 1
            name = f"{name.removesuffix(f'_{count - 1}')}_{count}"
        names[wheel] = name
    return names


def _by_time(stamps: NDArray[np.int64], rows: Index) -> tuple[Index, Index, NDArray[np.int64]]:
    """Return the row, the end (0 first, 1 last) and the time of each message, by time."""
    both = np.repeat(rows, 2)
    ends = np.tile([0, 1], len(rows))
    times = stamps[ends, both]
    order = np.argsort(times, kind="stable")
    return both[order], ends[order], times[order]


def _places(table: Table, rows: Index, ends: Index) -> tuple[Mask, Array]:
    """Return which messages have a longitude and latitude, and these."""
    places = np.full((len(rows), 2), np.nan)
    for message, (row, end) in enumerate(zip(rows.tolist(), ends.tolist(), strict=True)):
        shape = parse(table["WKT"][row])
        if shape is not None:
            places[message] = shape.points[-1 if end else 0][:2]
    return np.isfinite(places).all(axis=1), places


def check(output: str | None, samples: str | None = None, crs: str | None = None) -> None:
    """Check before the work whether its results can be written, by the endings and the reference system."""
    kinds = {result_kind(path) for path in (output, samples) if path}
    if not crs:
        return
    try:
        formats.check_crs(crs)
        if "parquet" in kinds:
            projjson(crs)
    except formats.FormatError as error:
        raise UsageError(f"--crs {error}", hint=error.hint) from None


def write(
    table: Table, output: str | None, crs: str | None, samples: tuple[Table, str] | None = None
) -> None:
    """Write samples if there are any, and segments last: what reads them may stop early. None is nothing."""
    both = samples is not None and output is not None and together(output, samples[1])
    if samples and not both:
        formats.write_table(samples[0], samples[1], crs=crs, layer="samples", graduated=STYLES)
    if output is None:
        return
    if result_kind(output) == "mcap":
        from formats.output.bag_writer import write_bag

        write_bag(topics(table, crs), output, "mcap")
        return
    layers = {"samples": samples[0]} if samples and both else None
    formats.write_table(table, output, crs=crs, layers=layers, graduated=STYLES)


def together(output: str, samples: str) -> bool:
    """Tell whether segments and samples go into one file, as two layers."""
    return Path(output).resolve() == Path(samples).resolve() and result_kind(output) == "gpkg"


def remark(output: str | None, crs: str | None) -> str:
    """Say what a person must know to read a file as it is meant; nothing if there is nothing to say."""
    if not output or not result_kind(output).startswith("geojson") or result_kind(output) == "geojson":
        return ""
    if crs and is_wgs84(crs):
        return ""
    system = f"-a_srs {crs}" if crs else "-a_srs NONE, for x and y of a site frame"
    return f"{output}: GDAL takes every sequence of GeoJSON for WGS 84; add {system}"


def result_kind(path: str) -> str:
    """Tell from its name how results are written."""
    return "mcap" if Path(path).suffix.lower() == ".mcap" else formats.output_kind(path)
