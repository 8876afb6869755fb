"""Where results go, by the ending of a file: tables and layers, or messages of ROS 2; some may grow."""

from __future__ import annotations

import io
import re
import sys
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self, TextIO

import numpy as np

import formats
from formats.output.common_forms import is_wgs84, normalise, parse, projjson
from formats.output.text_writer import write_text
from formats.output.whole_files import explained
from terrain_cli.errors import InputError, UsageError
from terrain_cli.presentation import segment_table

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

    from numpy.typing import NDArray

    from formats.output.bag_writer import GrowingBag, Topic
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
_GROWING = ("csv", "geojsonl", "geojsons", "mcap")  # What can be read while it grows
#: Columns that tell whether a row is of a segment that is open, or of one that was told before.
OPEN, AGAIN = "open", "again"


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
    return "mcap" if Path(path).suffix.lower() == ".mcap" else formats.output_kind(path, ".mcap")


class GrowingTable:
    """The table of segments, in a file or on the standard output ("-")."""

    def __init__(self, destination: str, crs: str | None, marks: Sequence[str] = ()) -> None:
        """Check the name; the last columns are `marks`, of which each row has some or none."""
        kind = result_kind(destination)
        if kind not in _GROWING:
            hint = f"with --follow write {', '.join(f'.{one}' for one in _GROWING)}"
            raise UsageError(f"-o {destination}: a table that grows cannot be .{kind}", hint=hint)
        self._destination, self._kind, self._crs, self._marks = destination, kind, crs, marks
        self._stack = ExitStack()
        self._stream: TextIO | None = None
        self._bag: GrowingBag | None = None
        self._wheels: dict[str, None] = {}
        self._begun = False

    def __enter__(self) -> Self:
        with explained(self._destination):
            if self._destination == "-":
                self._stream = sys.stdout
            elif self._kind == "mcap":
                from formats.output.bag_writer import GrowingBag

                self._bag = self._stack.enter_context(GrowingBag(self._destination))
            else:
                opened = open(self._destination, "w", encoding="utf-8", newline="")  # noqa: PTH123
                self._stream = self._stack.enter_context(opened)
        return self

    def __exit__(self, *_: object) -> None:
        self._stack.close()

    def add(self, row: segment_table.Table, mark: str = "") -> None:
        """Write a row, so that whoever reads has it."""
        crs = segment_table.reference_system(row, self._crs)
        row = {**row, **{one: ["true" if one == mark else "false"] for one in self._marks}}
        if self._bag:
            self._bag.add(topics(row, crs, self._wheels))
            self._wheels |= dict.fromkeys(row["wheel"])
            return
        text = io.StringIO()
        write_text(normalise(row), text, self._kind, crs)
        # The names of the columns stand there once.
        again = self._kind == "csv" and self._begun
        assert self._stream is not None  # noqa: S101 - entered
        with explained(self._destination):
            self._stream.write(text.getvalue().partition("\n")[2] if again else text.getvalue())
            self._stream.flush()
        self._begun = True


def readable(row: segment_table.Table) -> str:
    """Say one row in a line, for a person."""

    def number(name: str, digits: int) -> str:
        value = float(np.asarray(row[name], dtype=float)[0])
        return "–" if np.isnan(value) else f"{value:.{digits}f}"

    return (
        f"{row['wheel'][0]}  segment {int(row['segment'][0])}  {number('t_start_s', 1)} to "
        f"{number('t_end_s', 1)} s  {int(row['n_samples'][0])} samples  c {number('c_kPa', 2)} ± "
        f"{number('c_se_kPa', 2)} kPa  φ {number('phi_deg', 1)} ± {number('phi_se_deg', 1)}°  "
        f"strength {number('strength_kPa', 2)} ± {number('strength_se_kPa', 2)} kPa  "
        f"{row['status'][0]} ({row['method'][0]})"
    )
