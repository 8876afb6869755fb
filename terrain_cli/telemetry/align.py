"""Clocks: from time columns to seconds, and from topics at unequal rates to one clock."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from terrain_cli.errors import InputError

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Array = NDArray[np.float64]

#: Smallest default for the largest gap across which a channel is interpolated, in s.
LEAST_GAP = 0.5
#: The same, in sampling intervals of the channel: two lost samples make a gap of three, and clocks jitter.
GAP_INTERVALS = 3.5
#: Times are whole microseconds; a gap as long as allowed is not longer.
RESOLUTION = 1e-6
_BEGINNING = 10_000
#: Clocks that differ by more than this, in s, are told apart (recordings played back, simulated time).
CLOCK_TOLERANCE = 0.5


def default_gap(time: Array) -> float:
    """Largest gap, in s, across which a channel sampled at these times is interpolated.

    Parameters
    ----------
    time : ndarray, shape (n,)
        In s, increasing.

    Returns
    -------
    float
        3.5 median intervals, at least 0.5 s: one or two lost samples are bridged, a pause is not.
    """
    if len(time) < 2:
        return LEAST_GAP
    return max(LEAST_GAP, GAP_INTERVALS * float(np.median(np.diff(time))))


def stretch_gap(time: Array, max_gap: float | None = None) -> float:
    """Longest time without a sample, in s, that does not interrupt a drive.

    Parameters
    ----------
    time : ndarray, shape (n,)
        Of its samples, in s.
    max_gap : float, optional
        What rover.toml allows; `default_gap` if not given.

    Returns
    -------
    float
        At least one and a half intervals: no clock is too slow for its own samples.
    """
    known = time[np.isfinite(time)]
    if np.any(known[1:] <= known[:-1]):
        known = np.unique(known)
    if max_gap is None:
        return default_gap(known)
    return max(max_gap, 1.5 * float(np.median(np.diff(known)))) if len(known) > 1 else max_gap


def resample(clock: Array, time: Array, values: Array, max_gap: float | None = None) -> Array:
    """Linear interpolation that refuses to bridge gaps or to extrapolate.

    Parameters
    ----------
    clock : ndarray, shape (n,)
        Times wanted, in s.
    time, values : ndarray, shape (m,)
        The channel's own samples; NaN where it was asked and had no answer.
    max_gap : float, optional
        Largest distance in s between the two samples on either side; `default_gap` if not given.

    Returns
    -------
    ndarray, shape (n,)
        A time that is in `time` gets exactly what was measured then, be it NaN. Others are
        interpolated between numbers, and are NaN outside the channel's time span and inside gaps.
    """
    order = np.argsort(time, kind="stable")
    time, values = time[order], values[order]
    time, values = time[np.isfinite(time)], values[np.isfinite(time)]
    if len(time) == 0:
        return np.full(len(clock), np.nan)
    here = np.clip(np.searchsorted(time, clock, side="left"), 0, len(time) - 1)
    exact, measured = time[here] == clock, values[here]
    time, values = time[~np.isnan(values)], values[~np.isnan(values)]
    if len(time) == 0:
        return np.full(len(clock), np.nan)
    gap = default_gap(time) if max_gap is None else max_gap
    after = np.clip(np.searchsorted(time, clock, side="left"), 0, len(time) - 1)
    before = np.maximum(after - 1, 0)
    inside = (time[before] < clock) & (clock < time[after]) & (time[after] - time[before] <= gap + RESOLUTION)
    with np.errstate(invalid="ignore", divide="ignore"):
        share = (clock - time[before]) / (time[after] - time[before])
        between = values[before] + share * (values[after] - values[before])
    return np.where(exact, measured, np.where(inside, between, np.nan))


def seconds(stamps: NDArray[np.datetime64], origin: float) -> Array:
    """Seconds since `origin` of absolute times, without losing digits.

    Parameters
    ----------
    stamps : ndarray of datetime64[ns], shape (n,)
    origin : float
        Whole seconds since 1970.

    Returns
    -------
    ndarray, shape (n,)
        Rounded to 1 µs: a clock in seconds since 1970 held in a double resolves 0.24 µs, so the
        same log read from a table and from a bag gets the same times only after rounding.
    """
    nanoseconds = stamps.astype("datetime64[ns]").astype(np.int64)
    missing = np.isnat(stamps)
    relative = (nanoseconds - np.int64(origin) * 1_000_000_000) * 1e-9
    return np.where(missing, np.nan, np.round(relative, 6))


def origin_of(times: NDArray[np.float64]) -> float:
    """Whole seconds to subtract from a clock in s so that its fractions keep their digits.

    Parameters
    ----------
    times : ndarray, shape (n,)
        In s.

    Returns
    -------
    float
        0 for a clock that starts near zero.
    """
    finite = np.isfinite(times)
    first = float(times[np.argmax(finite)]) if finite.any() else 0.0
    return float(np.floor(first)) if abs(first) > 1e8 else 0.0


def check_unit_of_time(
    path: str, column: str, time: Array, *, speed: Array | None, radius: float, stated: bool
) -> None:
    """Refuse a clock that is plainly not in seconds.

    Parameters
    ----------
    path, column : str
        For the message.
    time : ndarray, shape (n,)
        As read, taken to be in s.
    speed : ndarray, shape (n,), or None
        Of the wheel centre or of the rim in m/s.
    radius : float
        Wheel radius in m.
    stated : bool
        The header says that they are seconds.

    Raises
    ------
    InputError
        The times lie thousands of years away, or, where no unit is stated, they are whole numbers
        so far apart that the wheel would travel three radii between two samples.
    """
    # The beginning of a clock shows what it counts.
    time, speed = time[:_BEGINNING], None if speed is None else speed[:_BEGINNING]
    finite = time[np.isfinite(time)]
    if len(finite) < 3:
        return
    size = float(np.median(np.abs(finite)))
    step = float(np.median(np.abs(np.diff(finite))))
    known = np.abs(speed[np.isfinite(speed)]) if speed is not None else np.empty(0)
    travel = step * float(np.median(known)) if len(known) else 0.0
    unit = next((unit for limit, unit in ((1e17, "ns"), (1e14, "us"), (1e11, "ms")) if size > limit), "")
    what = f"{finite[0]:.10g} is no time in seconds"
    whole = np.abs(finite - np.round(finite)).max() < RESOLUTION
    if not unit and not stated and step >= 2.0 and whole:
        # At 10 to 1000 Hz a clock in ms has steps of 1 to 100, one in µs up to 1e5, one in ns more.
        unit = "ns" if step > 1e5 else "us" if step > 1e3 else "ms" if travel > 3.0 * radius else ""
        what = f"samples are {step:.10g} apart, which can hardly be seconds"
    if unit:
        raise InputError(
            f"{path}: column {column!r}: {what}",
            hint=f"say the unit in the header ({column}_{unit}), or in rover.toml:\n"
            f'[channels]\ntime = {{ column = "{column}", unit = "{unit}" }}',
        )


def split_clock(
    time: Array, least: int = 10
) -> tuple[NDArray[np.intp], NDArray[np.bool_], NDArray[np.bool_]]:
    """Find where a clock restarts, steps back for a moment, or repeats itself.

    Parameters
    ----------
    time : ndarray, shape (n,)
        In s, in the order of the file; NaN is passed over.
    least : int
        A step back after which the clock runs forward for this many samples, without reaching the
        time before, is a restart; others are samples out of order.

    Returns
    -------
    restarts : ndarray of int
        Indices at which a new clock begins.
    backwards, repeated : ndarray of bool, shape (n,)
        Samples out of order, and samples at the time of the one before.
    """
    index = np.flatnonzero(np.isfinite(time))
    t = time[index]
    astray = np.zeros(len(t), dtype=bool)
    restarts: list[int] = []
    accepted = 0
    for fall in (np.flatnonzero(np.diff(t) < 0) + 1).tolist():
        if fall < accepted:
            continue
        accepted = _resumes(t, fall, least)
        astray[fall:accepted] = True
        if accepted < len(t) and t[accepted] <= t[fall - 1]:
            before = np.arange(max(0, fall - least), fall)
            before = before[~astray[before]]
            later = t[before] > t[accepted]
            if later.all():
                restarts.append(int(index[accepted]))
            else:
                # The clock leapt ahead for a moment, and is now where it should be.
                astray[before[len(before) - np.argmin(later[::-1]) :]] = True
    kept = index[~astray]
    backwards, repeated = np.zeros(len(time), dtype=bool), np.zeros(len(time), dtype=bool)
    backwards[index[astray]] = True
    repeated[kept[1:][np.diff(time[kept]) == 0]] = True
    return np.array(restarts, dtype=np.intp), backwards, repeated


def _resumes(t: Array, fall: int, least: int) -> int:
    """Return where a clock that fell back is ahead again, or runs forward from an earlier time."""
    top = t[fall - 1]
    for j in range(fall, len(t)):
        ahead = t[j : j + least]
        forward = len(ahead) == least and ahead.max() <= top and np.sum(np.diff(ahead) < 0) < least / 2
        if ahead[0] > top or forward:
            return j
    return len(t)
