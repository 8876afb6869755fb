"""Localisation tables: where the rover was, by clock or by site, drive and pose.

Such a table comes from whoever localises the rover: a total station, motion capture, or the PLACES
archive of a Mars mission (PDS bundles msl_places and mars2020_rover_places). Nothing is
extrapolated, and no sample is placed where the table says two things.
"""

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from hashlib import sha256
from typing import NamedTuple

import numpy as np

import formats
from formats import Column
from terrain_cli.errors import InputError, UsageError
from terrain_cli.telemetry import Samples, alignment
from terrain_cli.telemetry.mapping import is_table
from terrain_cli.telemetry.raw_columns import as_clock, as_labels, as_numbers, read_topics
from terrain_cli.vocabulary.arrays import Array, Mask
from terrain_cli.vocabulary.channels import identify, resolve
from terrain_cli.vocabulary.quantities import the_wheel
from terrain_cli.vocabulary.units import Unit

#: The rover motion counter of a Mars mission, by the names that PLACES has.
KEYS = ("site", "drive", "pose")
PAIRS = (("longitude", "latitude"), ("x", "y"))
#: Of PLACES: two latitudes of one place, a clock in s that is not since 1970, and whose place it is.
_CENTRIC, _DETIC, _CLOCK, _FRAME = "planetocentric_latitude", "planetodetic_latitude", "sclk", "frame"
_OCENTRIC = ("00", "02")  # How the codes of IAU_2015 end that count latitudes from the centre of the body
#: Polar by equatorial radius of the bodies whose latitudes can be turned (IAU 2015).
_FLATTENING = {"499": 3_376_200.0 / 3_396_190.0, "301": 1.0}
_HINT = "positions are longitude and latitude (or planetocentric_latitude), or x and y (easting and northing)"
_ANY_POSE = -1.0  # The pose of an entry for a whole drive; the table of Mars 2020 has no others
#: Longest time in s between two entries of a clock: in more a rover goes elsewhere than straight on.
LONGEST_GAP = 300.0


@dataclass(frozen=True, eq=False)
class Places:
    path: str
    #: longitude and latitude in deg, x and y in m: one of the pairs, or both; shape (n,).
    position: dict[str, Array]
    keys: dict[str, Array]  # Those of `KEYS` that it has; shape (n,)
    time: tuple[float, Array] | None  # Whole seconds taken off the clock, and the seconds since, shape (n,)

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
    """Read a localisation table, CSV or Parquet; `crs` is that of its longitudes and latitudes."""
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
    columns = read_topics(source, {"": sorted(set(wanted))})[""]
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
    time = None
    if clock[0]:
        column = columns[clock[0]]
        time = as_clock(path, clock[0], column, lambda: _si(column, clock[1]))
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
    return {channel: (header, match.unit) for channel, (header, match) in some.items()}


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


def _of_rover(columns: Mapping[str, Column], frame: str | None) -> Mask | slice:
    """Return the rows that are places of the rover: in PLACES others are origins of sites."""
    if frame is None:
        return slice(None)
    labels = as_labels(columns[frame])
    site = [code for code, name in enumerate(labels.names) if name.strip().casefold() == "site"]
    return ~np.isin(labels.codes, site)


def _latitude(path: str, latitudes: Mapping[str, Array], crs: str | None) -> Array:
    """Return latitudes from the centre, φ', or by the plumb line, φ, as asked: tan φ' = (b/a)² tan φ."""
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


class Placed(NamedTuple):
    """What became of the samples of a wheel."""

    by: str  # "clock", or the columns that were compared
    #: Samples with a position, without one in the table, and with several.
    placed: int
    missed: int
    ambiguous: int

    def __str__(self) -> str:
        total = self.placed + self.missed + self.ambiguous
        text = f"{self.placed} of {total} samples placed by {self.by}"
        if self.missed:
            where = "outside the table or in its gaps" if self.by == "clock" else "not in the table"
            text += f"; {self.missed} are {where}"
        if self.ambiguous:
            text += f"; {self.ambiguous} have more than one place there"
        return text


def locate(samples: Samples, places: Places) -> Placed:
    """Give samples the positions of a table, NaN where it tells none; InputError if nothing is in common."""
    counter = {name.casefold(): values for name, values in samples.drivers.items() if name.casefold() in KEYS}
    common = [name for name in KEYS if name in places.keys and name in counter]
    if {"site", "drive"} <= set(common):
        by = f"{', '.join(common[:-1])} and {common[-1]}"
        position, ambiguous = _by_key(places, {name: counter[name] for name in common}, len(samples))
    elif samples.time is not None and places.time is not None:
        by = "clock"
        origin, time = places.time
        position, ambiguous = _by_clock(places.position, time + (origin - samples.origin), samples.time)
    else:
        raise _nothing_common(samples, places, counter)
    found = np.logical_or.reduce([np.isfinite(values) for values in position.values()])
    placed = Placed(by, int(found.sum()), int(np.sum(~found & ~ambiguous)), int(np.sum(ambiguous & ~found)))
    samples.channels = {**samples.channels, **position}
    samples.origins |= dict.fromkeys(position, f"{places.path}, by {by}")
    samples.remarks.append(f"{the_wheel(samples.wheel)}: {placed}")
    return placed


def _nothing_common(samples: Samples, places: Places, counter: Collection[str]) -> InputError:
    def has(clock: bool, names: Collection[str]) -> str:
        return " and ".join([*(["a clock"] * clock), *names]) or "neither a clock nor site and drive"

    return InputError(
        f"{samples.source}: {places.path} gives no place for it: that has "
        f"{has(places.time is not None, places.keys)}, the log {has(samples.time is not None, counter)}",
        hint="both need a time, or columns site and drive",
    )


def _by_key(places: Places, counter: Mapping[str, Array], n: int) -> tuple[dict[str, Array], Mask]:
    """Look up site, drive and pose; where a table has no such pose, its entry for the whole drive."""
    import pandas as pd

    pair, table = ["site", "drive"], pd.DataFrame(places.keys | places.position)
    whole = table[table["pose"] == _ANY_POSE] if "pose" in table else table[:0]
    # Without poses in the log an entry for the whole drive is what it asks for, and else all of them.
    searches = [([*counter], table), (pair, whole)] if "pose" in counter else [(pair, whole), (pair, table)]
    asked = pd.DataFrame(dict(counter))
    position = {name: np.full(n, np.nan) for name in places.position}
    ambiguous, open_ = np.zeros(n, dtype=bool), np.ones(n, dtype=bool)
    for keys, entries in searches:
        # NaN equals no key, not even another NaN, except to pandas.
        known = np.isfinite(entries[keys].to_numpy()).all(axis=1)
        distinct = entries[known].drop_duplicates([*keys, *position])
        distinct["several"] = distinct.duplicated(keys, keep=False)
        where = np.flatnonzero(open_)
        found = asked.iloc[where].merge(distinct.drop_duplicates(keys), how="left", on=keys)
        there, several = found["several"].notna().to_numpy(), found["several"].eq(True).to_numpy()
        for name, values in position.items():
            values[where[there & ~several]] = found[name].to_numpy()[there & ~several]
        ambiguous[where[several]] = True
        open_[where[there]] = False
    return position, ambiguous


def _by_clock(position: Mapping[str, Array], time: Array, clock: Array) -> tuple[dict[str, Array], Mask]:
    """Interpolate between entries no further apart than `alignment.default_gap`, or `LONGEST_GAP`."""
    order = np.argsort(time, kind="stable")
    order = order[np.isfinite(time[order])]
    result: dict[str, Array] = {}
    doubtful = np.zeros(len(clock), dtype=bool)
    for pair in (pair for pair in PAIRS if pair[0] in position):
        rows = order[np.isfinite(position[pair[0]][order])]
        distinct, first, inverse = np.unique(time[rows], return_index=True, return_inverse=True)
        columns = [position[name][rows] for name in pair]
        double = np.zeros(len(distinct), dtype=bool)
        for values in columns:
            double[inverse[values != values[first][inverse]]] = True
        near = _beside(double, distinct, clock)
        gap = min(alignment.default_gap(distinct), LONGEST_GAP)
        for name, values in zip(pair, columns, strict=True):
            # Across ±180° the shorter way round.
            straight = np.unwrap(values[first], period=360.0) if name == "longitude" else values[first]
            here = alignment.resample(clock, distinct, straight, gap)
            doubtful |= near & np.isfinite(here)
            result[name] = np.where(near, np.nan, here)
    if "longitude" in result:
        result["longitude"] = _as_the_table(result["longitude"], position["longitude"])
    return result, doubtful


def _beside(double: Mask, time: Array, clock: Array) -> Mask:
    """Tell which times lie at, or next to, a time for which a table has two places."""
    if not double.any():
        return np.zeros(len(clock), dtype=bool)
    after = np.clip(np.searchsorted(time, clock, side="left"), 0, len(time) - 1)
    exact = time[after] == clock
    return np.asarray(double[after] | ~exact & double[np.maximum(after - 1, 0)])


def _as_the_table(longitude: Array, given: Array) -> Array:
    """Bring longitudes into the turn that a table counts them in: from −180° or from 0°."""
    low = -180.0 if np.nanmin(given, initial=0.0) < 0.0 else 0.0
    inside = (longitude >= low) & (longitude <= low + 360.0) | np.isnan(longitude)
    return np.where(inside, longitude, (longitude - low) % 360.0 + low)
