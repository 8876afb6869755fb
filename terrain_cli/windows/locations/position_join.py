"""Samples and a localisation table: by the counter of site, drive and pose, or by clock."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from terrain_cli.errors import InputError
from terrain_cli.telemetry import alignment
from terrain_cli.windows.locations.location_table import KEYS, PAIRS

if TYPE_CHECKING:
    from collections.abc import Collection, Mapping

    from numpy.typing import NDArray

    from terrain_cli.telemetry import Samples
    from terrain_cli.windows.locations.location_table import Places

    Array = NDArray[np.float64]

#: The pose of an entry for a whole drive; the table of Mars 2020 has no others.
_ANY_POSE = -1.0
#: Longest time in s between two entries of a clock: in more a rover goes elsewhere than straight on.
LONGEST_GAP = 300.0


class Placed(NamedTuple):
    """What became of the samples of a wheel."""

    #: "clock", or the columns that were compared.
    by: str
    #: Samples with a position, without one in the table, and with several.
    placed: int
    missed: int
    ambiguous: int

    def __str__(self) -> str:
        """Say it in words."""
        total = self.placed + self.missed + self.ambiguous
        text = f"{self.placed} of {total} samples placed by {self.by}"
        if self.missed:
            where = "outside the table or in its gaps" if self.by == "clock" else "not in the table"
            text += f"; {self.missed} are {where}"
        if self.ambiguous:
            text += f"; {self.ambiguous} have more than one place there"
        return text


def locate(samples: Samples, places: Places) -> Placed:
    """Give samples the positions of a localisation table, in place of any of their own.

    They are NaN where the table does not tell; remarks say what became of the samples. InputError where table
    and log have nothing in common to be compared by.
    """
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
    samples.remarks.append(f"wheel {samples.wheel}: {placed}")
    return placed


def _nothing_common(samples: Samples, places: Places, counter: Collection[str]) -> InputError:
    def has(clock: bool, names: Collection[str]) -> str:
        return " and ".join([*(["a clock"] * clock), *names]) or "neither a clock nor site and drive"

    return InputError(
        f"{samples.source}: {places.path} says no place of it: that has "
        f"{has(places.time is not None, places.keys)}, the log {has(samples.time is not None, counter)}",
        hint="both need a time, or columns site and drive",
    )


def _by_key(
    places: Places, counter: Mapping[str, Array], n: int
) -> tuple[dict[str, Array], NDArray[np.bool_]]:
    """Look up site, drive and pose; where a table has no such pose, its entry for the whole drive."""
    pair = ("site", "drive")
    every = np.ones(len(places.keys["site"]), dtype=bool)
    whole = places.keys["pose"] == _ANY_POSE if "pose" in places.keys else ~every
    # Without poses in the log an entry for the whole drive is what it asks for, and else all of them.
    searches = (
        [(tuple(counter), every), (pair, whole)] if "pose" in counter else [(pair, whole), (pair, every)]
    )
    position = {name: np.full(n, np.nan) for name in places.position}
    ambiguous, open_ = np.zeros(n, dtype=bool), np.ones(n, dtype=bool)
    for names, rows in searches:
        table = np.column_stack([places.keys[name][rows] for name in names])
        asked = np.column_stack([counter[name] for name in names])[open_]
        entry, several = _match(table, asked, [values[rows] for values in places.position.values()])
        where = np.flatnonzero(open_)
        for name, values in places.position.items():
            found = (entry >= 0) & ~several
            position[name][where[found]] = values[rows][entry[found]]
        ambiguous[where[several]] = True
        open_[where[entry >= 0]] = False
    return position, ambiguous


def _match(
    table: Array, asked: Array, position: Collection[Array]
) -> tuple[NDArray[np.intp], NDArray[np.bool_]]:
    """Return the first row of a table for each key, −1 without one, and whether others contradict it."""
    # A counter stands still for many samples.
    new = np.concatenate(
        [np.ones(min(len(asked), 1), dtype=bool), np.any(np.diff(asked, axis=0) != 0.0, axis=1)]
    )
    stretch, asked = np.cumsum(new) - 1, asked[new]
    _, ids = np.unique(np.concatenate([table, asked]), axis=0, return_inverse=True)
    ids = ids.reshape(-1)
    of_table, of_asked = ids[: len(table)], ids[len(table) :]
    count = int(ids.max()) + 1 if len(ids) else 0
    first = np.full(count, -1, dtype=np.intp)
    # Backwards, so that the first row of each key is written last.
    first[of_table[::-1]] = np.arange(len(table))[::-1]
    contradicted = np.zeros(count, dtype=bool)
    for values in position:
        other = ~((values == values[first[of_table]]) | np.isnan(values) & np.isnan(values[first[of_table]]))
        contradicted[of_table[other]] = True
    # NaN equals no key, not even another NaN, except to numpy.unique.
    known = np.isfinite(asked).all(axis=1)
    entry = np.where(known, first[of_asked], -1)
    return entry[stretch], (contradicted[of_asked] & (entry >= 0))[stretch]


def _by_clock(
    position: Mapping[str, Array], time: Array, clock: Array
) -> tuple[dict[str, Array], NDArray[np.bool_]]:
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


def _beside(double: NDArray[np.bool_], time: Array, clock: Array) -> NDArray[np.bool_]:
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
