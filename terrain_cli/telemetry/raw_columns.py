"""Raw columns of a source, whole: batches joined, labels merged, times made seconds."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from itertools import chain

import numpy as np
from numpy.typing import NDArray

from formats import LOG_TIME, STAMP, Batch, Column, Labels, Source
from terrain_cli.errors import InputError
from terrain_cli.processes import most_held
from terrain_cli.telemetry import alignment
from terrain_cli.vocabulary.arrays import Array, Index, Mask

_SOON = np.timedelta64(10, "s")  # How soon after a clock's zero its first stamps come
#: Rows read at once of a table that may be too long to be held: half as many more take 50 MB more.
_AT_ONCE = 65_536
#: The Sun has 2e30 kg and an electron 1e-30 kg: nothing on a rover is larger or smaller in any unit, and the
#: squares and products of what is between are numbers of this machine.
_LARGEST, _SMALLEST = 1e30, 1e-30


def join(columns: Sequence[Column]) -> Column:
    """Join the pieces of one column: what is text in one piece is text in all, as labels in their order."""
    arrays = [column for column in columns if not isinstance(column, Labels)]
    if len(arrays) == len(columns):
        return np.concatenate(arrays) if len(arrays) > 1 else arrays[0]
    names: dict[str, int] = {}
    codes = []
    for part in map(as_labels, columns):
        new = np.array([names.setdefault(name, len(names)) for name in part.names] + [-1], dtype=np.int32)
        codes.append(new[part.codes])
    return Labels(np.concatenate(codes), tuple(names))


def as_labels(column: Column) -> Labels:
    """Return a column as labels as they appear: whole numbers lose their ".0", days their midnight."""
    if isinstance(column, Labels):
        return column
    known = ~np.isnat(column) if column.dtype.kind == "M" else ~np.isnan(column)
    values, first, inverse = np.unique(column[known], return_index=True, return_inverse=True)
    order = np.argsort(first, kind="stable")
    codes = np.full(len(column), -1, dtype=np.int32)
    codes[known] = np.argsort(order, kind="stable")[inverse]
    return Labels(codes, tuple(_text(value) for value in values[order]))


def _text(value: np.generic) -> str:
    if isinstance(value, np.datetime64):
        return str(value.astype("datetime64[s]")).removesuffix("T00:00:00")
    number = value.item()
    return str(int(number)) if float(number).is_integer() else repr(float(number))


def as_numbers(column: Column) -> Array:
    """Return a column as numbers, none larger or smaller than what may be; texts and times become NaN."""
    if isinstance(column, Labels):
        return _measurable(np.array([*(_number(name) for name in column.names), np.nan]))[column.codes]
    if column.dtype.kind == "M":
        return np.full(len(column), np.nan)
    return _measurable(column.astype(np.float64, copy=False))


def _measurable(values: Array) -> Array:
    size = np.abs(values)
    large, small = (size > _LARGEST) & (size < np.inf), (size < _SMALLEST) & (size > 0.0)
    # Nearly always there is nothing of the kind.
    if not (large | small).any():
        return values
    return np.where(large, np.copysign(_LARGEST, values), np.where(small, 0.0, values))


def _number(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        return float("nan")


def take(column: Column, rows: Index | Mask | slice) -> Column:
    return column.take(rows) if isinstance(column, Labels) else column[rows]


def read_topics(source: Source, fields: Mapping[str, Sequence[str]]) -> dict[str, dict[str, Column]]:
    """Read the named columns of some topics (a table's is "") in one pass; InputError where too much."""
    batches: dict[str, list[Batch]] = {topic: [] for topic in fields}
    size, most = 0, most_held()
    for topic, batch in source.read_together(fields):
        batches[topic].append(batch)
        size += sum((c.codes if isinstance(c, Labels) else c).nbytes for c in batch.values())
        if size > most:
            what = f"too long to be read whole: there is memory for {most:,} bytes of columns"
            hint = 'split it, or leave out what needs every sample ("Long logs" in docs/conventions.md)'
            raise InputError(f"{source.path}: {what}", hint=hint)
    return {topic: whole(found) if found else empty(fields[topic]) for topic, found in batches.items()}


def empty(fields: Sequence[str]) -> dict[str, Column]:
    columns: dict[str, Column] = {name: np.empty(0) for name in fields}
    return columns | {name: np.empty(0, "datetime64[ns]") for name in (LOG_TIME, STAMP)}


def whole(batches: list[Batch]) -> dict[str, Column]:
    """Join batches, one at least, which are emptied."""
    # One column at a time, so that never more than one is held twice.
    return {name: join([batch.pop(name) for batch in batches]) for name in list(batches[0])}


def as_clock(path: str, header: str, column: Column, seconds: Callable[[], Array]) -> tuple[float, Array]:
    """Return the whole seconds taken off a clock, and those since, which `seconds` reads of numbers."""
    if isinstance(column, Labels):
        what = f"column {header!r} holds texts that are no times, such as {column.names[0]!r}"
        hint = "times are seconds, or ISO 8601 such as 2026-11-21T08:00:00Z"
        raise InputError(f"{path}: {what}", hint=hint)
    if column.dtype.kind == "M":
        known = column[~np.isnat(column)]
        origin = float(known[0].astype("datetime64[s]").astype(np.int64)) if len(known) else 0.0
        return origin, alignment.seconds(column, origin)
    values = seconds()
    origin = alignment.origin_of(values)
    return origin, np.round(values - origin, 6) if origin else values


def begin(source: Source, fields: Sequence[str], rows: int) -> list[Batch] | Iterator[Batch]:
    """Read a table; where it has more than some rows, no more than these are read before the others."""
    batches, count = iter(source.read("", fields, _AT_ONCE) if fields else ()), 0
    first: list[Batch] = []
    for batch in batches:
        first.append(batch)
        count += len(next(iter(batch.values())))
        if count > rows:
            # None is held longer than it is needed.
            return chain((first.pop(0) for _ in range(len(first))), batches)
    return first


def header_stamps(columns: Mapping[str, Column]) -> NDArray[np.datetime64] | None:
    """Return the stamps of a topic's headers, if every message has one."""
    # A stamp of zero is none, unless the others follow it within seconds: a simulated clock starts there.
    stamp = np.array(columns[STAMP])
    missing = np.isnat(stamp)
    zero = np.datetime64(0, "ns")
    if missing.any() and not missing.all():
        first = int(np.argmin(missing))
        if missing.sum() == first and stamp[first] - zero < _SOON:
            stamp[:first] = zero
            missing[:first] = False
    return None if missing.any() or not len(stamp) else stamp


def stamps(columns: Mapping[str, Column]) -> NDArray[np.datetime64]:
    """Return the headers' stamps of a topic if every message has one, else the times of the log."""
    stamp = header_stamps(columns)
    return np.asarray(columns[LOG_TIME]) if stamp is None else stamp
