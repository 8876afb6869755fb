"""What a model predicts along whole stretches, and what a sensor shows of it that is late.

A law sees one sample at a time, and some of the samples only; what is shown late depends on the samples
before. So a law is given the whole series of its channel as the model predicts it without the lag. Taken
from the prediction, a lag has no noise of what was measured in it, and none is made larger.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from copy import copy
from typing import Any, Literal

import numpy as np
from numpy.polynomial.polynomial import polyval

from terrain_cli.mechanics.dual import chain, slopes, value
from terrain_cli.mechanics.rates import level, wheel_angle
from terrain_cli.vocabulary.arrays import Array, Index

#: Step in time constants up to which a series is taken, right to 1e-12: 4! / (4 + j)! of its powers j.
_SHORT, _SERIES = 0.5, [24.0 / math.factorial(4 + power) for power in range(10)]
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

    def of(self, values: Array) -> PredictedSeries:
        """Return another series of the same samples, in the order of time."""
        other = copy(self)
        other.values, other.kept, other.reach = values, {}, {}
        other.curves = {
            name: _curve(clock, self.first, self.last, values) for name, clock in self.clocks.items()
        }
        return other

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
            shown, *derivatives = self._shown(clock, delay, constant, sloped=sloped)
            self.kept[key] = tuple(part[self.back] for part in (shown - self.values, *derivatives))
        return self.kept[key]

    def _shown(self, name: str, delay: float, constant: float, *, sloped: bool) -> list[Array]:
        """Return what is shown, and its derivatives by delay and constant."""
        before = self._before(name, delay)
        by_delay = [self._by_delay(name, delay)] if sloped else []
        if not constant:
            return [before, *by_delay, *by_delay]
        clock, first, last, way = self.clocks[name], self.first, self.last, slice(None)
        if constant < 0.0:
            # Ahead of what is true, to which it comes at the end.
            n, way = len(clock) - 1, slice(None, None, -1)
            clock, first, last = clock[-1:] - clock[way], n - last[way], n - first[way]
        own, true = _Filter(clock, first, abs(constant)), before[way]
        unchanged = constant > 0.0 and not delay
        curve = self.curves[name][0] if unchanged else _curve(clock, first, last, true)[0]
        parts = [own.shown(curve, true)]
        for slope in (one[way] for one in by_delay):
            parts.append(own.shown(_curve(clock, first, last, slope)[0], slope))
            parts.append(math.copysign(1.0, constant) * own.slope(curve, parts[0]))
        return [part[way] for part in parts]

    def _before(self, name: str, delay: float) -> Array:
        """Return what was true a delay before each sample, within its stretch."""
        if not delay:
            return self.values
        begin, end, step, part = self._between(name, delay)
        along = polyval(part, self.curves[name][0][:, end], tensor=False)
        return np.where(step > 0.0, along, self.values[begin])

    def _by_delay(self, name: str, delay: float) -> Array:
        """Return the slope of the same by the delay."""
        clock, (curve, steep) = self.clocks[name], self.curves[name]
        at = clock - delay
        # At an end of a stretch, the mean of both sides.
        inside = 0.5 * (np.sign(at - clock[self.first]) + np.sign(clock[self.last] - at))
        if delay:
            begin, end, step, part = self._between(name, delay)
            along = polyval(part, curve[1:, end] * [[1.0], [2.0], [3.0]], tensor=False)
            steep = np.divide(along, step, out=steep[begin], where=step > 0.0)
        return -steep * np.maximum(inside, 0.0)

    def _between(self, name: str, delay: float) -> tuple[Index, Index, Array, Array]:
        """Return between which samples lies what was there a delay before each; step and share of the way.

        Beyond the ends of a stretch, and where a wheel stands, there is no step.
        """
        clock = self.clocks[name]
        at = clock - delay
        begin = np.clip(np.searchsorted(clock, at, side="right") - 1, self.first, self.last)
        end = np.minimum(begin + 1, self.last)
        within = (at > clock[self.first]) & (at < clock[self.last])
        step = np.where(within, clock[end] - clock[begin], 0.0)
        return begin, end, step, np.divide(at - clock[begin], step, out=np.zeros(len(at)), where=step > 0.0)


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


class _Filter:
    """Lets what is shown follow what is true: constant · d(shown)/d(clock) = true − shown, settled at first.

    Exact for the curve through the samples.
    """

    def __init__(self, clock: Array, first: Index, constant: float) -> None:
        self.constant, self.begins = constant, first == np.arange(len(clock))
        self.step = np.diff(clock, prepend=clock[:1]) / constant
        self.shares = _shares(self.step)
        kept = np.exp(-self.step)
        kept[self.begins] = 0.0
        #: What is left at each sample of the one before it, of the one two before it, four …
        self.kept = [kept]
        while 2 ** len(self.kept) < len(clock) and kept.max() > _FORGOTTEN:
            reach = 2 ** (len(self.kept) - 1)
            kept = np.concatenate([kept[:reach], kept[reach:] * kept[:-reach]])
            self.kept.append(kept)

    def shown(self, curve: Array, true: Array) -> Array:
        """Return what is shown of what is true, with the curve through it."""
        return self._followed(np.where(self.begins, true, np.einsum("kn,kn->n", curve, self.shares)))

    def slope(self, curve: Array, shown: Array) -> Array:
        """Return the slope of what is shown by the constant."""
        # Of ∫ step · exp(step (u − 1)) uᵏ du, by the step: 1 − (1 + k/step) · that.
        change = (self.step + np.arange(4.0)[:, None]) * self.shares - self.step
        new = np.einsum("kn,kn->n", curve, change)
        new[1:] += (self.kept[0] * self.step)[1:] * shown[:-1]
        return self._followed(np.where(self.begins, 0.0, new / self.constant))

    def _followed(self, new: Array) -> Array:
        """Add to what is new at each sample what is left of all before it, twice as many with every turn."""
        for turn, kept in enumerate(self.kept):
            reach = 2**turn
            new[reach:] += kept[reach:] * new[:-reach]
        return new


def _shares(step: Array) -> Array:
    """Return what each power of the share of a step, in time constants, adds to a filter: (4, n)."""
    # ∫ step · exp(step (u − 1)) uᵏ du from 0 to 1 is 1 − k/step · that of k − 1: upwards for long steps, and
    # for short ones downwards from a series, so that nothing cancels.
    found = np.empty((4, len(step)))
    found[3] = 0.25 * step * polyval(-step, _SERIES)
    for power in range(3, 0, -1):
        found[power - 1] = (1.0 - found[power]) * step / power
    long = np.flatnonzero(step > _SHORT)
    found[0, long] = -np.expm1(-step[long])
    for power in range(1, 4):
        found[power, long] = 1.0 - power / step[long] * found[power - 1, long]
    return found


class Past:
    """The series of a channel as some samples see it; taking some of these takes the whole series along.

    `place` is which sample of the series each of them is, or between which. By a lag it changes as the
    `steady` series does: that has no noise of the sample itself, which a residual has too.
    """

    def __init__(
        self, series: PredictedSeries, place: Index | Array, steady: PredictedSeries | None = None
    ) -> None:
        self.series, self.place, self.steady = series, place, steady or series

    def __getitem__(self, rows: Any) -> Past:
        return Past(self.series, self.place[rows], self.steady)

    def of(self, values: Array) -> Past:
        """Return another series as these samples see it, in the order of time."""
        return Past(self.series.of(values), self.place, self.steady)

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
        lags = [np.asarray(value(number), dtype=float) for number in (delay, constant)]
        found = np.zeros((3 if sloped else 1, len(self.place)))
        each: list[tuple[Any, Any]] = [([lag.flat[0] if lag.size else 0.0 for lag in lags], slice(None))]
        if not all(np.isfinite(lag).all() for lag in lags):
            # Where a search is lost, beyond all numbers: no two of them are equal.
            found[:], each = np.nan, []
        elif any(np.any(lag != lag.flat[0]) for lag in lags if lag.size):
            pairs = np.stack(np.broadcast_arrays(*lags, self.place)[:2], axis=-1)
            unique, which = np.unique(pairs, axis=0, return_inverse=True)
            each = [(pair, np.flatnonzero(which.ravel() == k)) for k, pair in enumerate(unique)]
        for (one, other), rows in each:
            if one or other or sloped:
                parts = self.series.change(clock, float(one), float(other), sloped=sloped)
                if sloped:
                    parts = parts[:1] + self.steady.change(clock, float(one), float(other), sloped=True)[1:]
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
    steady: Mapping[str, Array] | None = None,
) -> dict[str, Any]:
    """Return what laws call the past of predicted channels, of all samples of a wheel; time in s.

    Derivatives by a lag are of what is `steady`, by default of the same.
    """
    order = np.lexsort((time, stretch))
    clocks, place = _clocks(time, stretch, velocity, order), np.arange(len(time))

    def series(values: Array) -> PredictedSeries:
        return PredictedSeries(clocks, stretch, values)

    return {
        f"{name}{SUFFIX}": Past(series(one), place, series(steady[name]) if steady else None)
        for name, one in predicted.items()
    }


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


def smooth(time: Array, stretch: Index, values: Array) -> Array:
    """Return a channel without its noise, as far as its neighbours tell it."""
    order = np.lexsort((time, stretch))
    found = np.empty(len(values))
    found[order] = level(time[order], stretch[order], values[order])
    return np.where(np.isfinite(found), found, values)
