"""The channels of each wheel of a table: CSV and Parquet."""

from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from formats import LOG_TIME, Labels
from terrain_cli.channels import CHANNELS, LABEL
from terrain_cli.errors import InputError
from terrain_cli.telemetry import align, columns
from terrain_cli.telemetry.feeds import CLOCKS
from terrain_cli.telemetry.names import match_name
from terrain_cli.telemetry.samples import Raw

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Mapping, Sequence

    from numpy.typing import NDArray

    from formats import Batch, Column
    from terrain_cli.telemetry.feeds import Feed, Plan

    Array = NDArray[np.float64]

#: A column filled in fewer of the torque's rows than this share was sampled on a clock of its own:
#: of two regular clocks that meet, the slower fills every second row at the most.
OWN_CLOCK = 0.6


def fields(plan: Plan, wanted: Collection[str], extras: Sequence[str]) -> list[str]:
    """Name the columns to read.

    Parameters
    ----------
    plan : Plan
    wanted : collection of str
        Channels; those without a feed are passed over.
    extras : sequence of str
        Further columns.

    Returns
    -------
    list of str
    """
    label = plan.labels.get("")
    every = [feed for feeds in (plan.shared, *plan.wheels.values()) for feed in feeds.values()]
    names = {name for feed in every if feed.channel in wanted for name in feed.fields}
    return sorted(names.union(extras, [label] if label else []))


def read(
    plan: Plan,
    wanted: Collection[str],
    extras: Sequence[str],
    choose: Callable[[Labels | None], list[str]],
    max_gap: float | None,
    batches: list[Batch] | None = None,
) -> list[Raw]:
    """Read the wheels of a table.

    Parameters
    ----------
    plan : Plan
    wanted : collection of str
        Channels; those without a feed are passed over.
    extras : sequence of str
        Further columns.
    choose : callable
        Names the wheels to read, from the column of wheel labels if there is one.
    max_gap : float or None
        As for `align.resample`.
    batches : list of dict, optional
        The `fields`, where they were read before.

    Returns
    -------
    list of Raw
        In the order of `choose`.
    """
    names = fields(plan, wanted, extras)
    table: dict[str, Column] = {}
    if batches:
        table = columns.whole(batches)
    elif names:
        table = columns.read_whole(plan.source, "", names)
    raws = wheels(plan, table, wanted, extras, choose)
    for raw in raws:
        if has_own_clocks(raw):
            on_one_clock(raw, max_gap)
            raw.remarks.append(own_clocks(raw, f"the {len(raw)} rows"))
        raw.remarks += passed_over(plan, nameless(plan, table))
    return raws


def nameless(plan: Plan, table: Mapping[str, Column], rows: slice = slice(None)) -> int:
    """Count the rows that name no wheel.

    Parameters
    ----------
    plan : Plan
    table : mapping
        After `wheels`.
    rows : slice
        Those that count.

    Returns
    -------
    int
    """
    column = table.get(plan.labels.get("", ""))
    return int(np.count_nonzero(column.codes[rows] < 0)) if isinstance(column, Labels) else 0


def passed_over(plan: Plan, count: int) -> list[str]:
    """Say how many rows name no wheel, if any.

    Parameters
    ----------
    plan : Plan
    count : int

    Returns
    -------
    list of str
    """
    return [f"{count} rows name no wheel in {plan.labels['']} and are passed over"] if count else []


def wheels(
    plan: Plan,
    table: dict[str, Column],
    wanted: Collection[str],
    extras: Sequence[str],
    choose: Callable[[Labels | None], list[str]],
) -> list[Raw]:
    """Sort the columns of a table, or of part of it, by wheel and channel.

    Parameters
    ----------
    plan : Plan
    table : dict of str to ndarray or Labels
        The columns `fields`; its column of wheels is replaced by labels.
    wanted, extras, choose
        As for `read`.

    Returns
    -------
    list of Raw
        In the order of `choose`.
    """
    table.pop(LOG_TIME, None)
    label = plan.labels.get("")
    named = columns.as_labels(table[label]) if label else None
    if label and named:
        table[label] = named
    result = []
    for name in choose(named):
        key = match_name(name, plan.wheels) or name
        feeds = {c: feed for c, feed in plan.feeds(key).items() if c in wanted}
        rows = None
        if named is not None and not np.all(named.codes == named.codes[0]):
            rows = np.flatnonzero(named.codes == named.names.index(name))
        result.append(_wheel(plan.source.path, name, feeds, table, rows, extras))
    return result


def _wheel(
    path: str,
    name: str,
    feeds: dict[str, Feed],
    table: dict[str, Column],
    rows: NDArray[np.intp] | None,
    extras: Sequence[str],
) -> Raw:
    def column(header: str) -> Column:
        return table[header] if rows is None else columns.take(table[header], rows)

    n = len(next(iter(table.values()))) if table and rows is None else 0 if rows is None else len(rows)
    raw = Raw(name, 0.0, None, {}, {}, {extra: column(extra) for extra in extras}, feeds)
    for channel, feed in feeds.items():
        if channel == "time":
            raw.origin, raw.time = _time(path, feed, column(feed.fields[0]))
        elif CHANNELS[channel].dimension == LABEL:
            raw.labels[channel] = (
                columns.as_labels(column(feed.fields[0])) if feed.constant is None else feed.labels(n)
            )
        elif feed.constant is None:
            raw.channels[channel] = feed.si([columns.as_numbers(column(f)) for f in feed.fields])
        else:
            raw.channels[channel] = feed.values(n)
    return raw


def _time(path: str, feed: Feed, column: Column) -> tuple[float, Array]:
    """Return the origin of a clock and the seconds since."""
    if isinstance(column, Labels):
        raise InputError(
            f"{path}: column {feed.fields[0]!r} holds texts that are no times, such as {column.names[0]!r}",
            hint="times are seconds, or ISO 8601 such as 2026-11-21T08:00:00Z",
        )
    exact = feed.scale == 1.0 and feed.offset == 0.0
    if exact and column.dtype.kind in "iu" and feed.unit and feed.unit.symbol == "ns":
        column = column.astype("datetime64[ns]")
    if column.dtype.kind == "M":
        known = column[~np.isnat(column)]
        origin = float(known[0].astype("datetime64[s]").astype(np.int64)) if len(known) else 0.0
        return origin, align.seconds(column, origin)
    values = feed.si([column])
    origin = align.origin_of(values)
    return origin, np.round(values - origin, 6) if origin else values


def has_own_clocks(raw: Raw) -> bool:
    """Tell whether the columns of a wheel were sampled on clocks of their own.

    Such a table has a row for every time at which anything was measured, and most cells empty.

    Parameters
    ----------
    raw : Raw

    Returns
    -------
    bool
    """
    clock = _clock(raw)
    if clock is None:
        return False
    base = ~np.isnan(raw.channels[clock])
    count = np.count_nonzero(base)
    least = OWN_CLOCK * count
    known = (~np.isnan(values) for values in raw.channels.values())
    sparse = any(np.any(there) and np.count_nonzero(there & base) < least for there in known)
    return bool(count and (sparse or count < OWN_CLOCK * len(raw)))


def _clock(raw: Raw) -> str | None:
    return None if raw.time is None else next((c for c in CLOCKS if c in raw.channels), None)


def on_one_clock(raw: Raw, max_gap: float | None) -> None:
    """Bring columns sampled on clocks of their own to the rows of the torque, in place.

    Parameters
    ----------
    raw : Raw
        One that `has_own_clocks`, or a part of it.
    max_gap : float or None
        As for `align.resample`.
    """
    clock = _clock(raw)
    if clock is None or raw.time is None:
        return
    known = {name: ~np.isnan(values) for name, values in raw.channels.items()}
    base = np.flatnonzero(known[clock])
    time, channels, bounds = raw.time, raw.channels, _pieces(raw)
    raw.select(base)
    for channel, there in known.items():
        if not there[base].all():
            # Not across the bounds: in the next piece the clock may begin anew.
            raw.channels[channel] = np.concatenate(
                [
                    align.resample(
                        time[(rows := slice(a, b))][known[clock][rows]],
                        time[rows][there[rows]],
                        channels[channel][rows][there[rows]],
                        max_gap,
                    )
                    for a, b in pairwise(bounds)
                ]
            )


def own_clocks(raw: Raw, rows: str) -> str:
    """Say that the columns of a wheel had clocks of their own.

    Parameters
    ----------
    raw : Raw
    rows : str
        Those that are left, in words.

    Returns
    -------
    str
    """
    return (
        f"wheel {raw.wheel}: columns are filled on clocks of their own; "
        f"brought to {rows} that have {_clock(raw)}"
    )


def _pieces(raw: Raw) -> list[int]:
    """Return where runs and restarts of the clock bound the rows."""
    assert raw.time is not None  # noqa: S101 - only called where there is a clock
    restarts = align.split_clock(raw.time)[0]
    bounds = {0, len(raw.time), *restarts.tolist()}
    if "run" in raw.labels:
        codes = raw.labels["run"].codes
        known = np.flatnonzero(codes >= 0)
        bounds.update(known[1:][np.diff(codes[known]) != 0].tolist())
    return sorted(bounds)
