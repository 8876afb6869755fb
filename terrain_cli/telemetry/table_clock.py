"""Which column of a table is its time, and whether a table without one can hold steady test points."""

import re
from collections.abc import Collection, Generator, Mapping, Sequence
from contextlib import closing
from typing import NamedTuple, cast

import numpy as np

from formats import Batch, Column, Labels, Source
from formats.recovery import Notice
from terrain_cli.errors import InputError
from terrain_cli.telemetry.raw_columns import as_labels, as_numbers, take
from terrain_cli.telemetry.wheel_samples import Feed, Plan
from terrain_cli.vocabulary import toml_files
from terrain_cli.vocabulary.channels import CHANNELS, TimeName, stated_unit, time_names

_ROWS = 65_536  # Rows that are looked at
#: A column rises if it does so at this share of its steps: sweeps of up to 20 points fall back more often.
_RISING = 0.95
#: The rows of so many wheels may share a time, where no column names the wheel. Rovers have up to 8.
_WHEELS = 8
_FEW = 10  # So many rows are in rising order by chance in one of 10! tables
#: Steady points are set by hand. A table of so many, each beyond the one before in a column that does not
#: just count them, is a log. Judged: a published table of 189 points (Pavlov 2022) has no such column.
_MANY = 100
_TIME_OF_DAY = re.compile(r"(.*[T ])?\d{1,2}:\d\d(:\d\d)?([.,]\d+)?\s*\S{0,6}")
_OFFERED = 3  # Columns that are offered at the most


class _Rise(NamedTuple):
    """How many steps a column makes from row to row of a wheel; shares of them that go up and down."""

    steps: int
    up: float
    down: float
    counts: bool


def settle(plan: Plan, pairs: Sequence[TimeName]) -> None:
    """Give the plan of a table without `time` a feed for it, a remark, or the error that it needs one."""
    # `pairs` are its columns of whole seconds and fractions.
    source, known = plan.source, plan.shared.get("time")
    used = {name for feed in plan.every_feed for name in feed.fields} | set(plan.labels.values())
    unused = [f.name for f in source.streams()[0].fields if f.name not in used]
    halves = {header for pair in pairs for header in pair.headers}
    names = time_names(header for header in unused if header not in halves)
    if known and not (pairs or names):
        return
    label = plan.labels.get("")
    table = _beginning(source, [*unused, *(known.fields if known else ()), *([label] if label else [])])
    wheels = as_labels(table[label]) if label else None
    if known and _filled(table[known.fields[0]]):
        return
    for group in (pairs, names):
        found = [name for name in group if _is_clock(name, table, wheels)]
        if len(found) > 1:
            first = found[0].headers[0]
            several = " and ".join(repr(name.headers[0]) for name in found)
            hint = f"choose one in rover.toml: [channels] {_entry(first, table[first])}"
            raise InputError(f"{source.path}: columns {several} can all be time", hint=hint)
        if found:
            plan.shared["time"] = _feed(found[0])
            return
    if not known:
        _doubt(plan, {header: table[header] for header in unused}, wheels)


def _beginning(source: Source, headers: Collection[str]) -> Mapping[str, Column]:
    if not headers:
        return {}
    with closing(cast("Generator[Batch]", source.read("", list(headers), _ROWS))) as batches:
        return next(batches, dict.fromkeys(headers, np.empty(0)))


def _filled(column: Column) -> bool:
    if isinstance(column, Labels):
        return bool(np.any(column.codes >= 0))
    return bool(np.any(~np.isnat(column) if column.dtype.kind == "M" else ~np.isnan(column)))


def _is_clock(name: TimeName, table: Mapping[str, Column], wheels: Labels | None) -> bool:
    """Tell whether columns that are called a time may be one."""
    columns = [table[header] for header in name.headers]
    if any(isinstance(column, Labels) for column in columns):
        # Whoever reads it says that these texts are no times.
        return all(_are_times_of_day(column) for column in columns)
    if len(columns) > 1 and np.nanmax(as_numbers(columns[1]) * name.unit.factor, initial=0.0) >= 1.0:
        return False
    steps, up, down, _ = _rise(columns[0], wheels, whole=len(columns) > 1)
    # It hardly falls, as what is called a time must not; one row has nothing to rise from.
    rises = not steps or (up >= _RISING * (up + down) and up * _WHEELS >= 1.0)
    return rises and _filled(columns[0])


def _are_times_of_day(column: Column) -> bool:
    if not isinstance(column, Labels) or not column.names:
        return False
    return all(_TIME_OF_DAY.fullmatch(text) for text in column.names[:_FEW])


def _rise(column: Column, wheels: Labels | None, *, whole: bool = False) -> _Rise:
    """Say how a column goes on within each wheel; of `whole` seconds steps without a change do not count."""
    steps = [np.empty(0)]
    for code in np.unique(wheels.codes) if wheels else (0,):
        values = take(column, wheels.codes == code) if wheels else column
        assert not isinstance(values, Labels)  # noqa: S101 - texts neither rise nor fall
        if values.dtype.kind == "M":
            steps.append(np.diff(values[~np.isnat(values)].astype(np.int64)).astype(float))
        else:
            steps.append(np.diff(values[np.isfinite(values)]).astype(float))
    every = np.concatenate(steps)
    every = every[every != 0.0] if whole else every
    n = max(len(every), 1)
    counts = np.count_nonzero(every == 1.0) >= _RISING * n
    return _Rise(len(every), np.count_nonzero(every > 0) / n, np.count_nonzero(every < 0) / n, bool(counts))


def _feed(name: TimeName) -> Feed:
    if len(name.headers) == 1:
        return Feed(channel="time", fields=name.headers, unit=name.unit, note="recognised by its name")
    factor = name.unit.factor
    return Feed(
        channel="time",
        fields=name.headers,
        unit=CHANNELS["time"].unit,
        combine=lambda seconds, beyond: seconds + beyond * factor,
        note="whole seconds, and what is beyond them",
    )


def _doubt(plan: Plan, table: Mapping[str, Column], wheels: Labels | None) -> None:
    """Say that rows are taken for steady test points, or that they can hardly be some."""
    sure: list[str] = []
    rising: list[str] = []
    for header, column in table.items():
        stated = stated_unit(header, "time")
        if isinstance(column, Labels):
            few = np.count_nonzero(column.codes >= 0) < _FEW
            if not few and len(column.names) >= _RISING * len(column) and _are_times_of_day(column):
                sure.append(header)
            continue
        if stated_unit(header) and not stated:
            continue
        goes, is_time = _rise(column, wheels), column.dtype.kind == "M"
        if goes.steps >= _FEW and goes.up >= _RISING:
            clear = is_time or stated or (goes.steps >= _MANY and not goes.counts)
            (sure if clear else rising).append(header)
        elif (is_time and goes.up > 0.0) or (goes.down == 0.0 and round(goes.up * goes.steps) >= _FEW):
            # In whole seconds it does not rise at every row, and never falls.
            rising.append(header)
    shown = ", ".join(map(repr, (sure or rising)[:_OFFERED]))
    entries = [_entry(header, table[header]) for header in (sure or rising)[:_OFFERED]]
    if sure:
        rise = "rises" if len(sure) == 1 else "rise"
        what = f"no column is known as a time, but {shown} {rise} from row to row as a clock does"
        hint = "add to rover.toml:\n[channels]\n" + "\n# or ".join(entries)
        hint += "\n# or, if the rows are test points all the same: steady = true in [sampling]"
        text = f"{plan.source.path}: {what}: these are hardly steady test points"
        plan.no_time = InputError(text, hint=hint)
        return
    text = "no column is known as a time: each row is taken for a steady test point"
    if rising:
        text += f"; if {shown} is the time: [channels] {entries[0]} in rover.toml"
    plan.source.remarks.append(Notice(text))


def _entry(header: str, column: Column) -> str:
    """Write the row of rover.toml that makes a column the time."""
    if isinstance(column, Labels):
        return f"# {header!r} holds texts: write them as seconds, or in ISO 8601 as 2026-11-21T08:00:00Z"
    unit = stated_unit(header, "time")
    symbol = None if column.dtype.kind == "M" else unit.symbol if unit else "…"
    return f"time = {toml_files.value({'column': header, 'unit': symbol})}"
