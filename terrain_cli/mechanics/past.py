"""What a model predicts along whole stretches, and what a sensor shows of it that is late.

A law sees one sample at a time, and some of the samples only; what is shown late depends on the samples
before. So a law is given the whole series of its channel as the model predicts it without the lag. Taken
from the prediction, a lag has no noise of what was measured in it, and none is made larger.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, Literal

import numpy as np
from numpy.polynomial.polynomial import polyval

from terrain_cli.mechanics.dual import chain, slopes, value
from terrain_cli.mechanics.rates import level, wheel_angle
from terrain_cli.vocabulary.arrays import Array, Index

_SHARE = 1e-6  # Share by which a time constant is changed to differentiate by it
_SHORT, _TERMS = 0.5, 12  # Step in time constants below which a series has so many terms: right to 1e-12
_FORGOTTEN = 1e-12  # Share of a sample that is nothing any more
_KEPT = 64  # Lags of which what is shown is kept
SUFFIX = "_past"  # What a law calls the past of a channel


class PredictedSeries:
    """A predicted channel along whole stretches, of which the samples may come in any order."""

    def __init__(self, clocks: Mapping[str, Array], stretch: Index, values: Array) -> None:
        self.order = np.lexsort((clocks["time"], stretch))
        self.back = np.argsort(self.order)
        own, n = stretch[self.order], len(stretch)
        begins = np.flatnonzero(np.concatenate([[True], own[1:] != own[:-1]])[:n])
        lengths = np.diff(np.append(begins, n))
        self.first, self.last = np.repeat(begins, lengths), np.repeat(begins + lengths - 1, lengths)
        self.clocks = {name: self._one_clock(clock[self.order]) for name, clock in clocks.items()}
        known = np.isfinite(values)
        if known.any() and not known.all():
            time = self.clocks["time"][self.back]
            along = np.flatnonzero(known)[np.argsort(time[known])]
            values = np.where(known, values, np.interp(time, time[along], values[along]))
        self.values = np.nan_to_num(values[self.order])
        ends = self.first, self.last
        self.curves = {name: _curve(clock, *ends, self.values) for name, clock in self.clocks.items()}
        self.kept: dict[tuple[str, float, float, bool], tuple[Array, ...]] = {}
        #: Of each clock, how far before or after a sample the farthest lies that was asked for.
        self.reach: dict[str, float] = {}

    def _one_clock(self, clock: Array) -> Array:
        """Let the stretches follow one another."""
        risen = clock - clock[self.first]
        whole = risen[self.last] + 1.0
        begins = np.unique(self.first)
        start = np.concatenate([[0.0], np.cumsum(whole[begins])[:-1]]) if len(begins) else np.zeros(0)
        return np.asarray(risen + np.repeat(start, np.diff(np.append(begins, len(clock)))))

    def step(self, clock: str) -> float:
        """Return the usual step of a clock from one sample to the next; 0 where it is not known."""
        step = np.diff(self.clocks.get(clock, np.zeros(0)))
        return float(np.median(step[step > 0.0])) if np.any(step > 0.0) else 0.0

    def change(self, clock: str, delay: float, constant: float, *, sloped: bool) -> tuple[Array, ...]:
        """Return by how much what is shown is off what is true, and its derivatives by delay and constant."""
        key = clock, delay, constant, sloped
        if key not in self.kept:
            if len(self.kept) >= _KEPT:
                self.kept.clear()
            far = abs(delay) - abs(constant) * math.log(_FORGOTTEN)
            self.reach[clock] = max(far, self.reach.get(clock, 0.0))
            before, by_delay = self._before(clock, delay)
            found = self._filtered(clock, before, constant)
            parts = [found - self.values]
            if sloped:
                by_delay = self._filtered(clock, by_delay, constant)
                by_constant = by_delay
                if constant:
                    nearby = self._filtered(clock, before, constant * (1.0 + _SHARE))
                    by_constant = (nearby - found) / (constant * _SHARE)
                parts += [by_delay, by_constant]
            self.kept[key] = tuple(part[self.back] for part in parts)
        return self.kept[key]

    def _before(self, name: str, delay: float) -> tuple[Array, Array]:
        """Return what was true a delay before each sample, within its stretch, and its slope by the delay."""
        clock, (curve, slope) = self.clocks[name], self.curves[name]
        at, low, high = clock - delay, clock[self.first], clock[self.last]
        true, steep = self.values, slope
        if delay:
            begin = np.clip(np.searchsorted(clock, at, side="right") - 1, self.first, self.last)
            end = np.minimum(begin + 1, self.last)
            step = np.where((at > low) & (at < high), clock[end] - clock[begin], 0.0)
            moves = step > 0.0
            part = np.divide(at - clock[begin], step, out=np.zeros(len(at)), where=moves)
            cubic = curve[:, end]
            true = np.where(moves, polyval(part, cubic, tensor=False), self.values[begin])
            along = polyval(part, cubic[1:] * [[1.0], [2.0], [3.0]], tensor=False)
            steep = np.where(moves, np.divide(along, step, out=np.zeros(len(at)), where=moves), slope[begin])
        # At an end of a stretch, the mean of both sides.
        inside = 0.5 * (np.sign(at - low) + np.sign(high - at))
        return true, -steep * np.maximum(inside, 0.0)

    def _filtered(self, name: str, true: Array, constant: float) -> Array:
        clock = self.clocks[name]
        if constant > 0.0:
            return _filtered(clock, self.first, self.last, true, constant)
        if constant < 0.0:
            # Ahead of what is true, to which it comes at the end.
            n = len(clock) - 1
            back = clock[-1:] - clock[::-1], n - self.last[::-1], n - self.first[::-1]
            return _filtered(*back, true[::-1], -constant)[::-1]
        return true


def _curve(clock: Array, first: Index, last: Index, values: Array) -> tuple[Array, Array]:
    """Return the curve from the sample before each to that one, and its slope at each.

    The curve is in powers of the share of the way, (4, n). Its slope is that of the parabola through the
    neighbours (Catmull & Rom 1974). Of straight lines from sample to sample a place between two has less
    noise than both: every channel would seem to be late or early by a little.
    """
    here = np.arange(len(values))
    inner = here > first
    step = np.where(inner, np.diff(clock, prepend=clock[:1]), 0.0)
    rise = np.where(inner, np.diff(values, prepend=values[:1]), 0.0)
    steep = np.divide(rise, step, out=np.zeros(len(step)), where=step > 0.0)
    # At an end of a stretch there is one side alone.
    after, ahead = (np.where(here < last, np.roll(one, -1), 0.0) for one in (step, steep))
    whole = step + after
    slope = np.divide(steep * after + ahead * step, whole, out=np.zeros(len(step)), where=whole > 0.0)
    slope = np.where(inner & (here < last), slope, np.where(inner, steep, ahead))
    before, end = step * np.roll(slope, 1), step * slope
    start = np.where(inner, np.roll(values, 1), values)
    return np.array([start, before, 3.0 * rise - 2.0 * before - end, before + end - 2.0 * rise]), slope


def _filtered(clock: Array, first: Index, last: Index, true: Array, constant: float) -> Array:
    """Let what is shown follow what is true: constant · d(shown)/d(clock) = true − shown, settled at first.

    Exact for the curve through the samples.
    """
    step = np.diff(clock, prepend=clock[:1]) / constant
    kept = np.exp(-step)
    found: Array = np.sum(_curve(clock, first, last, true)[0] * _shares(step), axis=0)
    begins = first == np.arange(len(true))
    found[begins], kept[begins] = true[begins], 0.0
    # Twice as many samples before each one are taken in with every turn.
    reach = 1
    while reach < len(found) and kept.max() > _FORGOTTEN:
        found[reach:] += kept[reach:] * found[:-reach]
        kept[reach:] *= kept[:-reach]
        reach *= 2
    return found


def _shares(step: Array) -> Array:
    """Return what each power of the share of a step, in time constants, adds to a filter: (4, n)."""
    # ∫ step · exp(step (u − 1)) uᵏ du from 0 to 1: by parts, or for short steps as a series.
    long = np.empty((4, len(step)))
    long[0] = -np.expm1(-step)
    safe = np.maximum(step, _SHORT)
    for power in range(1, 4):
        long[power] = 1.0 - power / safe * long[power - 1]
    powers = np.arange(4)[:, None]
    term = step / (powers + 1.0)
    short = term.copy()
    for m in range(1, _TERMS):
        term = -term * step / (powers + m + 1.0)
        short += term
    return np.where(step > _SHORT, long, short)


class Past:
    """The series of a channel as some samples see it; taking some of these takes the whole series along.

    `place` is which sample of the series each of them is, or between which.
    """

    def __init__(self, series: PredictedSeries, place: Index | Array) -> None:
        self.series, self.place = series, place

    def __getitem__(self, rows: Any) -> Past:
        return Past(self.series, self.place[rows])

    @property
    def shape(self) -> tuple[int, ...]:
        return self.place.shape

    @property
    def size(self) -> int:
        return self.place.size

    @property
    def predicted(self) -> Array:
        """What is true, of each of these samples."""
        return self._here(self.series.values[self.series.back], slice(None))

    def change(self, delay: Any, constant: Any, clock: Literal["time", "way"] = "time") -> Any:
        """Return by how much what is shown is off what is true where it is late, with its derivatives.

        A delay and then a first-order filter: numbers, or one of each sample. Nothing where the clock, which
        is the time or the way driven, is not known.
        """
        if clock not in self.series.clocks:
            return 0.0
        sloped = bool(slopes(delay) or slopes(constant))
        pairs = np.stack(np.broadcast_arrays(value(delay), value(constant), self.place)[:2], axis=-1)
        found = np.zeros((3 if sloped else 1, len(self.place)))
        each: list[tuple[Any, Any]]
        if len(pairs) and np.all(pairs == pairs[0]):
            each = [(pairs[0], slice(None))]
        else:
            unique, which = np.unique(pairs, axis=0, return_inverse=True)
            each = [(pair, np.flatnonzero(which.ravel() == k)) for k, pair in enumerate(unique)]
        for (one, other), rows in each:
            if one or other or sloped:
                parts = self.series.change(clock, float(one), float(other), sloped=sloped)
                found[:, rows] = [self._here(part, rows) for part in parts]
        return chain(found[0], [(found[1], delay), (found[2], constant)]) if sloped else found[0]

    def _here(self, whole: Array, rows: Any) -> Array:
        place = self.place[rows]
        if place.dtype.kind == "i":
            return np.asarray(whole[place])
        return np.asarray(np.interp(place, np.arange(len(whole)), whole))


def along(
    time: Array,
    stretch: Index,
    velocity: Array | None,
    predicted: Mapping[str, Array],
    measured: Mapping[str, Array] | None = None,
) -> dict[str, Any]:
    """Return what laws call the past of predicted channels, of all samples of a wheel; time in s.

    Noise of the inputs is in a prediction too, and less of it where this is shifted or filtered, so that any
    lag would seem to help. It is taken off, unless what is `measured` changes from sample to sample as well.
    """
    order = np.lexsort((time, stretch))
    if measured is not None and not _rough(stretch[order], order, predicted, measured):
        predicted = {name: _smooth(time, stretch, order, one) for name, one in predicted.items()}
    clocks, place = _clocks(time, stretch, velocity, order), np.arange(len(time))
    series = {name: PredictedSeries(clocks, stretch, one) for name, one in predicted.items()}
    return {f"{name}{SUFFIX}": Past(one, place) for name, one in series.items()}


def _clocks(time: Array, stretch: Index, velocity: Array | None, order: Index) -> dict[str, Array]:
    """Return the time and, where a speed is known, the way driven."""
    clocks = {"time": time}
    if velocity is not None and np.isfinite(velocity).any():
        clocks["way"] = np.empty(len(time))
        pace = np.abs(velocity[order])
        known = np.flatnonzero(np.isfinite(pace))
        pace = np.interp(np.arange(len(pace)), known, pace[known])
        clocks["way"][order] = wheel_angle(time[order], stretch[order], pace)
    return clocks


def reaches(channels: Mapping[str, Any]) -> dict[str, float]:
    """Return, of each clock, how far from a sample the farthest lies that laws have asked these for."""
    found: dict[str, float] = {}
    for column in channels.values():
        for clock, reach in column.series.reach.items() if isinstance(column, Past) else ():
            found[clock] = max(reach, found.get(clock, 0.0))
    return found


def around(
    time: Array, velocity: Array | None, begin: int, end: int, reach: Mapping[str, float]
) -> tuple[int, int]:
    """Return the first of the samples of one stretch that those from `begin` to `end` need, and their end."""
    clocks = _clocks(time, np.zeros(len(time), dtype=np.intp), velocity, np.arange(len(time)))
    first, last = begin, end
    for clock, far in reach.items():
        column = clocks[clock]
        # The neighbours between which that lies, and those of the rate.
        first = min(first, int(np.searchsorted(column, column[begin] - far)) - 2)
        last = max(last, int(np.searchsorted(column, column[end - 1] + far)) + 3)
    return max(first, 0), min(last, len(time))


def _rough(
    stretch: Index, order: Index, predicted: Mapping[str, Array], measured: Mapping[str, Array]
) -> bool:
    """Tell whether some channel shows more than half of how what is predicted changes between samples."""
    same = stretch[2:] == stretch[:-2]
    for name in predicted.keys() & measured.keys():
        change, shown = (np.diff(one[name][order], 2)[same] for one in (predicted, measured))
        known = np.isfinite(change) & np.isfinite(shown)
        if change[known] @ shown[known] > 0.5 * (change[known] @ change[known]):
            return True
    return False


def _smooth(time: Array, stretch: Index, order: Index, values: Array) -> Array:
    found = np.empty(len(values))
    found[order] = level(time[order], stretch[order], values[order])
    return np.where(np.isfinite(found), found, values)
