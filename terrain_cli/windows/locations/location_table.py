"""Localisation tables, read: positions, and the clock or the counter by which they are found."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from hashlib import sha256
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

import formats
from terrain_cli.errors import InputError, UsageError
from terrain_cli.telemetry import alignment
from terrain_cli.telemetry.plan.mapping import is_table
from terrain_cli.telemetry.raw_columns import as_labels, as_numbers, read_whole
from terrain_cli.vocabulary.channels import identify, resolve

if TYPE_CHECKING:
    from collections.abc import Collection, Mapping

    from numpy.typing import NDArray

    from formats import Column
    from terrain_cli.vocabulary.units import Unit

    Array = NDArray[np.float64]

#: The rover motion counter of a Mars mission, by the names that PLACES has.
KEYS = ("site", "drive", "pose")
PAIRS = (("longitude", "latitude"), ("x", "y"))
#: Of PLACES: two latitudes of one place, a clock in s that is not since 1970, and whose place it is.
_CENTRIC, _DETIC, _CLOCK, _FRAME = "planetocentric_latitude", "planetodetic_latitude", "sclk", "frame"
#: How the codes of IAU_2015 end that count latitudes from the centre of the body.
_OCENTRIC = ("00", "02")
#: Polar by equatorial radius of the bodies whose latitudes can be turned (IAU 2015).
_FLATTENING = {"499": 3_376_200.0 / 3_396_190.0, "301": 1.0}
_HINT = "positions are longitude and latitude (or planetocentric_latitude), or x and y (easting and northing)"


@dataclass(frozen=True, eq=False)
class Places:
    """A localisation table."""

    path: str
    #: longitude and latitude in deg, x and y in m: one of the pairs, or both; shape (n,).
    position: dict[str, Array]
    #: Those of `KEYS` that it has; shape (n,).
    keys: dict[str, Array]
    #: Whole seconds taken off the clock, and the seconds since, shape (n,).
    time: tuple[float, Array] | None

    @property
    def digest(self) -> str:
        """Stands for all that the table says."""
        clock = {} if self.time is None else {str(self.time[0]): self.time[1]}
        content = sha256()
        for name, values in {**self.position, **self.keys, **clock}.items():
            content.update(f"{name} {len(values)} ".encode())
            content.update(np.ascontiguousarray(values, dtype="<f8").tobytes())
        return content.hexdigest()


def load(path: str, crs: str | None = None) -> Places:
    """Read a localisation table, CSV or Parquet; `crs` is that of its longitudes and latitudes.

    Columns are known by their names: those of the channels time, longitude, latitude, x and y with their
    aliases and units, site, drive and pose, and those of PLACES.
    """
    try:
        known = Path(path).stat()
    except OSError:
        return _load(path, crs, 0, 0)
    return _load(path, crs, known.st_mtime_ns, known.st_size)


@lru_cache(maxsize=4)
def _load(path: str, crs: str | None, _changed: int, _size: int) -> Places:
    """Read a table once for many inputs; again when the file has changed."""
    source = formats.open_source(path)
    if not is_table(source):
        raise InputError(f"{path}: a localisation table is CSV or Parquet", hint=_HINT)
    headers = [field.name for field in source.streams()[0].fields]
    names = {header.strip().casefold(): header for header in headers}
    found = _channels(path, headers)
    latitudes = {name: names[name] for name in (_CENTRIC, _DETIC) if name in names}
    wanted = [header for header, _ in found.values()]
    wanted += [names[name] for name in (*KEYS, _FRAME, _CLOCK) if name in names]
    wanted += latitudes.values()
    columns = read_whole(source, "", sorted(set(wanted)))
    rows = _of_rover(columns, names.get(_FRAME))
    position = {
        channel: _si(columns[header], unit)[rows]
        for channel, (header, unit) in found.items()
        if channel != "time"
    }
    if latitudes and "longitude" in position and "latitude" not in position:
        some = {name: as_numbers(columns[header])[rows] for name, header in latitudes.items()}
        position["latitude"] = _latitude(path, some, crs)
    position = _pairs(position)
    if not position:
        raise InputError(f"{path}: no columns of positions{_there(headers)}", hint=_HINT)
    keys = {name: as_numbers(columns[names[name]])[rows] for name in KEYS if name in names}
    clock = found.get("time", (names.get(_CLOCK, ""), None))
    time = _clock(path, clock[0], columns[clock[0]], clock[1]) if clock[0] else None
    if time is None and not {"site", "drive"} <= keys.keys():
        raise InputError(
            f"{path}: nothing to find positions by{_there(headers)}",
            hint="that is a column time (or sclk), or the columns site and drive, and pose if there is one",
        )
    return Places(path, position, keys, None if time is None else (time[0], time[1][rows]))


def _there(headers: Collection[str]) -> str:
    return f"; there are {', '.join(list(headers)[:20])}"


def _channels(path: str, headers: Collection[str]) -> dict[str, tuple[str, Unit | None]]:
    """Return the header and the unit of each channel that says when or where."""
    ours = {"time", *(name for pair in PAIRS for name in pair)}
    try:
        matches = {header: identify(header) for header in headers}
        some = resolve([header for header, match in matches.items() if match and match.channel in ours])
    except InputError as error:
        raise InputError(f"{path}: {error}", hint="correct the header, or leave out the column") from None
    return {channel: (header, match.unit) for channel, (header, match) in some.channels.items()}


def _si(column: Column, unit: Unit | None) -> Array:
    values = as_numbers(column)
    return values if unit is None else unit.to_si(values)


def _pairs(position: Mapping[str, Array]) -> dict[str, Array]:
    """Keep whole pairs of columns, and of each row whole pairs of numbers."""
    result: dict[str, Array] = {}
    for pair in PAIRS:
        if set(pair) <= position.keys():
            whole = np.isfinite(position[pair[0]]) & np.isfinite(position[pair[1]])
            result |= {name: np.where(whole, position[name], np.nan) for name in pair}
    return result


def _of_rover(columns: Mapping[str, Column], frame: str | None) -> NDArray[np.bool_] | slice:
    """Return the rows that are places of the rover: in PLACES others are origins of sites."""
    if frame is None:
        return slice(None)
    labels = as_labels(columns[frame])
    site = [code for code, name in enumerate(labels.names) if name.strip().casefold() == "site"]
    return ~np.isin(labels.codes, site)


def _clock(path: str, header: str, column: Column, unit: Unit | None) -> tuple[float, Array]:
    """Return the whole seconds taken off a clock, and the seconds since."""
    if isinstance(column, formats.Labels):
        raise InputError(
            f"{path}: column {header!r} holds texts that are no times, such as {column.names[0]!r}",
            hint="times are seconds, or ISO 8601 such as 2026-11-21T08:00:00Z",
        )
    if column.dtype.kind == "M":
        known = column[~np.isnat(column)]
        origin = float(known[0].astype("datetime64[s]").astype(np.int64)) if len(known) else 0.0
        return origin, alignment.seconds(column, origin)
    values = _si(column, unit)
    origin = alignment.origin_of(values)
    return origin, np.round(values - origin, 6) if origin else values


def _latitude(path: str, latitudes: Mapping[str, Array], crs: str | None) -> Array:
    """Return latitudes as a reference system counts them.

    From the centre, φ', or by the plumb line of the ellipsoid, φ: tan φ' = (b/a)² tan φ.
    """
    if crs is None:
        raise UsageError(
            f"{path} has {next(iter(latitudes))}, and without --crs all longitudes are the Earth's",
            hint="say the body: --crs IAU_2015:49900 (Mars), IAU_2015:30100 (Moon)",
        )
    authority, _, code = crs.upper().rpartition(":")
    of_iau = authority.startswith("IAU")
    centric = of_iau and code.endswith(_OCENTRIC)
    wanted = _CENTRIC if centric else _DETIC
    # The other systems of the IAU count longitudes to the west, PLACES counts them to the east.
    if wanted in latitudes and (centric or not of_iau):
        return latitudes[wanted]
    ratio = _FLATTENING.get(code[:3])
    if centric and ratio:
        return np.asarray(np.degrees(np.arctan(ratio**2 * np.tan(np.radians(latitudes[_DETIC])))))
    raise UsageError(
        f"{path}: {' and '.join(latitudes)} do not go with {crs}",
        hint="take a system that is planetocentric, such as IAU_2015:49900, or add a column latitude",
    )
