"""Clocks: from time columns to seconds, and from topics at unequal rates to one clock."""

import numpy as np
from numpy.typing import NDArray

from terrain_cli.errors import InputError
from terrain_cli.vocabulary.arrays import Array, Index, Mask, median

LEAST_GAP = 0.5  # Smallest default for the largest gap across which a channel is interpolated, in s
#: The same, in sampling intervals of the channel: two lost samples make a gap of three, and clocks jitter.
GAP_INTERVALS = 3.5
#: A gap so rare among samples lost at random cuts a drive: two in the longest log that is held as a whole.
_RARE = 1e-6
#: Times are whole microseconds; a gap as long as allowed is not longer.
RESOLUTION = 1e-6
_BEGINNING = 10_000
FEW_TIMES = 3  # Fewer times do not tell what a clock counts
#: Clocks that differ by more than this, in s, are told apart (recordings played back, simulated time).
CLOCK_TOLERANCE = 0.5
_LEAST = 10  # Samples for which a clock has to run forward after it restarts


def default_gap(time: Array) -> float:
    """Largest gap (s) across which a channel sampled at these times is interpolated: a pause is not."""
    if len(time) < 2:
        return LEAST_GAP
    return max(LEAST_GAP, GAP_INTERVALS * median(np.diff(time)))


def stretch_gap(time: Array, max_gap: float | None = None) -> float:
    """Longest time without a sample, in s, that does not interrupt a drive."""
    # Where samples are lost at random, what the share that is lost makes of one gap in a million; at least
    # one and a half intervals: no clock is too slow for its own samples.
    known = np.unique(time[np.isfinite(time)])
    if max_gap is None:
        steps = np.diff(known)
        usual = median(steps) if len(steps) else 0.0
        # Each gap counts once, however long; two standard errors less, so that a few pauses are no share.
        gaps = np.count_nonzero(steps > 1.5 * usual)
        share = (gaps - 2.0 * np.sqrt(gaps)) / max(len(steps), 1)
        lost = usual * np.log(_RARE) / np.log(share) if share > 0.0 else 0.0
        return max(LEAST_GAP, GAP_INTERVALS * usual, float(lost))
    return max(max_gap, 1.5 * median(np.diff(known))) if len(known) > 1 else max_gap


def resample(clock: Array, time: Array, values: Array, max_gap: float | None = None) -> Array:
    """Linear interpolation at the times of a clock (s) that refuses to bridge gaps or to extrapolate.

    A time that is in `time` gets exactly what was measured then, be it NaN. Others are interpolated between
    numbers, and are NaN outside the channel's time span and between two samples further apart than `max_gap`
    (s; `default_gap` if not given).
    """
    if not ascends(time):
        order = np.argsort(time, kind="stable")
        order = order[np.isfinite(time[order])]
        time, values = time[order], values[order]
    known = ~np.isnan(values)
    if not known.all():
        here = np.clip(np.searchsorted(time, clock), 0, len(time) - 1)
        without = resample(clock, time[known], values[known], max_gap)
        return np.where(time[here] == clock, values[here], without)
    if not len(time):
        return np.full(len(clock), np.nan)
    gap = default_gap(time) if max_gap is None else max_gap
    after = np.minimum(np.searchsorted(time, clock), len(time) - 1)
    before = np.maximum(after - 1, 0)
    start, end, following = time[before], time[after], values[after]
    inside = (start < clock) & (clock < end) & (end - start <= gap + RESOLUTION)
    with np.errstate(invalid="ignore", divide="ignore"):
        share = np.where(inside, (clock - start) / (end - start), np.nan)
        between = values[before] + share * (following - values[before])
    return np.where(end == clock, following, between)


def ascends(time: Array) -> bool:
    """Tell whether every time is a number, and none is earlier than the one before."""
    return bool(np.isfinite(time).all() and (time[1:] >= time[:-1]).all())


def seconds(stamps: NDArray[np.datetime64], origin: float) -> Array:
    """Seconds since `origin`, whole seconds since 1970, of absolute times: rounded to 1 µs."""
    # A double of seconds since 1970 resolves 0.24 µs: only so a table and a bag have the same times.
    nanoseconds = stamps.astype("datetime64[ns]").astype(np.int64)
    missing = np.isnat(stamps)
    relative = (nanoseconds - np.int64(origin) * 1_000_000_000) * 1e-9
    return np.where(missing, np.nan, np.round(relative, 6))


def origin_of(times: Array) -> float:
    """Whole seconds to subtract from a clock so that its fractions keep their digits, or 0."""
    finite = np.isfinite(times)
    first = float(times[np.argmax(finite)]) if finite.any() else 0.0
    return float(np.floor(first)) if abs(first) > 1e8 else 0.0


def check_unit_of_time(
    path: str, column: str, time: Array, *, speed: Array | None, radius: float, stated: bool
) -> None:
    """Refuse a clock that is plainly not in seconds.

    The times lie thousands of years away, or less than a microsecond apart, or they are whole numbers, of no
    `stated` unit, so far apart that the wheel would travel three radii between two samples.
    """
    # The beginning of a clock shows what it counts.
    time, speed = time[:_BEGINNING], None if speed is None else speed[:_BEGINNING]
    finite = time[np.isfinite(time)]
    if len(finite) < FEW_TIMES:
        return
    size = float(np.median(np.abs(finite)))
    step = float(np.median(np.abs(np.diff(finite))))
    known = np.abs(speed[np.isfinite(speed)]) if speed is not None else np.empty(0)
    travel = step * float(np.median(known)) if len(known) else 0.0
    unit = next((unit for limit, unit in ((1e17, "ns"), (1e14, "us"), (1e11, "ms")) if size > limit), "")
    what = f"{finite[0]:.10g} is no time in seconds"
    if 0.0 < step < RESOLUTION:
        # No bus of a rover carries so many samples.
        unit, what = "…", f"samples are {step:.3g} s apart, which no log has"
    whole = np.abs(finite - np.round(finite)).max() < RESOLUTION
    if not unit and not stated and step >= 2.0 and whole:
        # At 10 to 1000 Hz a clock in ms has steps of 1 to 100, one in µs up to 1e5, one in ns more.
        unit = "ns" if step > 1e5 else "us" if step > 1e3 else "ms" if travel > 3.0 * radius else ""
        what = f"samples are {step:.10g} apart, which can hardly be seconds"
    if unit:
        header = "" if unit == "…" else f"the header ({column}_{unit}), or in "
        entry = f'time = {{ column = "{column}", unit = "{unit}" }}'
        hint = f"say the unit in {header}rover.toml:\n[channels]\n{entry}"
        raise InputError(f"{path}: column {column!r}: {what}", hint=hint)


def split_clock(time: Array) -> tuple[Index, Mask, Mask]:
    """Find where a clock (s) begins anew, which samples are out of order, and which repeat a time."""
    # A restart is a step back after which it runs forward for `_LEAST` samples, all before that time.
    backwards, repeated = np.zeros(len(time), dtype=bool), np.zeros(len(time), dtype=bool)
    if np.isfinite(time).all() and (time[1:] > time[:-1]).all():
        return np.array([], dtype=np.intp), backwards, repeated
    index = np.flatnonzero(np.isfinite(time))
    t = time[index]
    astray = np.zeros(len(t), dtype=bool)
    restarts: list[int] = []
    accepted = 0
    for fall in (np.flatnonzero(np.diff(t) < 0) + 1).tolist():
        if fall < accepted:
            continue
        accepted = _resumes(t, fall)
        astray[fall:accepted] = True
        if accepted < len(t) and t[accepted] <= t[fall - 1]:
            before = np.arange(max(0, fall - _LEAST), fall)
            before = before[~astray[before]]
            later = t[before] > t[accepted]
            if later.all():
                restarts.append(int(index[accepted]))
            else:
                # The clock leapt ahead for a moment, and is now where it should be.
                astray[before[len(before) - np.argmin(later[::-1]) :]] = True
    kept = index[~astray]
    backwards[index[astray]] = True
    repeated[kept[1:][np.diff(time[kept]) == 0]] = True
    return np.array(restarts, dtype=np.intp), backwards, repeated


def _resumes(t: Array, fall: int) -> int:
    """Return where a clock that fell back is ahead again, or runs forward from an earlier time."""
    top = t[fall - 1]
    for j in range(fall, len(t)):
        ahead = t[j : j + _LEAST]
        forward = len(ahead) == _LEAST and ahead.max() <= top and np.sum(np.diff(ahead) < 0) < _LEAST / 2
        if ahead[0] > top or forward:
            return j
    return len(t)
