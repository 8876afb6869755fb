"""Channels that were sampled on clocks of their own: topics of a bag, columns of a table.

The times of the slowest are the samples, and faster ones are interpolated there: so no value is counted
twice. In a table with a row for every time of anything an empty cell between two ticks of its clock is no
lost value.
"""

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from formats.recovery import Notice
from terrain_cli.telemetry import alignment
from terrain_cli.telemetry.wheel_samples import CLOCKS, Raw
from terrain_cli.vocabulary.arrays import Array, Index, Mask
from terrain_cli.vocabulary.quantities import the_wheel

#: What a sample is made of, and from what it is derived where it is not there itself.
_MADE_OF = {
    "torque": ("motor_current",),
    "drawbar_pull": (),
    "sinkage": ("entry_angle",),
    "load": (),
    "slip": ("angular_velocity", "velocity"),
}
#: A column filled in fewer of the rows than this share may have a slower clock: of two regular clocks
#: that meet, the slower fills every second row at the most.
_SPARSE = 0.6
#: A clock is regular if this share of its steps is within a fifth of their median. Where more than half of
#: the cells are lost at random, a quarter is so near (geometric distribution); 6 of 8 are then by chance in
#: one of 240 tables.
_REGULAR, _NEAR, _STEPS = 2 / 3, 0.2, 8
#: Half way between one interval and two: jitter is bridged, a lost value is not. A slower clock is beyond it.
_INTERVALS = 1.5
#: The same for topics of a bag. Of rough loads interpolated between every second sample of the torque, 95 %
#: intervals of φ covered 94 and 100 of 100; of every third 68 and 78, of every fourth 62 and 75.
_SLOWER = 2.5
#: Rows in which two columns would meet by chance, and the share of them in which columns meet that avoid
#: each other: 1 of 8 is so by chance in 3 of 1000 tables (Poisson distribution).
_MEETINGS, _AVOID = 8, 1 / 8


@dataclass(frozen=True, slots=True)
class OwnClocks:
    slowest: str
    interval: float  # Its usual one, in s
    #: Whether it ticks regularly, so that a lost value shows.
    regular: bool
    intervals: dict[str, float]

    def bring(self, raw: Raw, max_gap: float | None) -> Mask:
        """Bring the channels to the rows of the slowest; tell where one that counts was interpolated."""
        # Gaps no longer than `max_gap` (s) are bridged; a column's own intervals bound them as well.
        assert raw.time is not None  # noqa: S101 - only found where there is a clock
        time, channels, bounds = raw.time, raw.channels, _pieces(raw)
        there = _filled(channels)
        own = [a + self._rows(time[a:b], there[self.slowest][a:b]) for a, b in pairwise(bounds)]
        rows = np.concatenate(own).astype(np.intp)
        raw.select(rows)
        interpolated = np.zeros(len(rows), dtype=bool)
        counted = _measured(raw)
        for name, interval in self.intervals.items():
            if name not in there or there[name][rows].all():
                continue
            gap = _INTERVALS * interval if max_gap is None else min(max_gap, _INTERVALS * interval)
            # Not across the bounds: in the next piece the clock may begin anew.
            pieces = []
            for a, b in pairwise(bounds):
                known = there[name][a:b]
                clock = time[rows[(rows >= a) & (rows < b)]]
                pieces.append(alignment.resample(clock, time[a:b][known], channels[name][a:b][known], gap))
            raw.channels[name] = np.concatenate(pieces)
            if name in counted:
                interpolated |= ~there[name][rows] & ~np.isnan(raw.channels[name])
        return interpolated & there[self.slowest][rows]

    def _rows(self, time: Array, there: Mask) -> Index:
        """Return the rows with a value of the slowest channel, and one for each that was lost."""
        own = np.flatnonzero(there)
        if not self.regular:
            return own
        ticking = own[np.isfinite(time[own])]
        empty = np.flatnonzero(~there & np.isfinite(time))
        if not len(empty):
            return own
        if not len(ticking):
            ticking = empty[:1]
            own = ticking
        # The last tick before each empty row; before the first one they are counted backwards.
        before = np.searchsorted(ticking, empty) - 1
        start = time[ticking[np.maximum(before, 0)]]
        ends = np.append(time[ticking[1:]], np.nan)
        # A value is due at each interval short of the next one that is there, or up to the end of the piece.
        ahead = np.where(before < 0, start - time[empty[0]], time[empty[-1]] - start)
        due = np.floor((ahead + alignment.RESOLUTION) / self.interval)
        inside = (before >= 0) & (before < len(ticking) - 1)
        due = np.where(inside, np.rint((ends[np.maximum(before, 0)] - start) / self.interval) - 1.0, due)
        phase = np.abs(time[empty] - start) / self.interval
        tick = np.rint(phase)
        lost = np.flatnonzero((tick >= 1.0) & (tick <= due))
        nearest = lost[np.argsort(np.abs(phase - tick)[lost], kind="stable")]
        _, first = np.unique(np.stack([before[nearest], tick[nearest]]), axis=1, return_index=True)
        return np.union1d(own, empty[nearest[first]])

    def told(self, wheel: str, samples: int, interpolated: int) -> Notice:
        """Say what became of the rows: how many samples, and in how many values were interpolated."""
        text = (
            f"{the_wheel(wheel)}: columns are filled on clocks of their own: {self.slowest} has a value "
            f"every {self.interval:.3g} s, and its {samples} rows are the samples"
        )
        if interpolated:
            text += f"; in {interpolated} of them others are interpolated between two neighbours"
        return Notice(text)


def find(raw: Raw) -> OwnClocks | None:
    """Find the clocks of a wheel's columns; none where the rows are the clock, and empty cells are lost."""
    if raw.time is None or len(raw) < 2:
        return None
    there = {name: mask for name, mask in _filled(raw.channels).items() if mask.any()}
    counted = {name: there[name] for name in _measured(raw) if name in there}
    sparse = [name for name, mask in counted.items() if np.count_nonzero(mask) < _SPARSE * len(raw)]
    if not sparse:
        return None
    usual = _interval(raw.time)[0]
    clocks = {name: _interval(raw.time[mask]) for name, mask in there.items()}
    for name in sorted(sparse, key=lambda one: np.count_nonzero(counted[one])):
        interval, regular = clocks[name]
        slower = regular and interval > _INTERVALS * usual
        others = [mask for other, mask in counted.items() if other != name]
        fullest = max(others, key=np.count_nonzero, default=None)
        if slower or (fullest is not None and _avoid(counted[name], fullest)):
            own = [o for o, mask in there.items() if clocks[o][1] or _avoid(mask, there[name])]
            return OwnClocks(name, interval, slower, {o: clocks[o][0] for o in own if o != name})
    return None


def _filled(channels: Mapping[str, Array]) -> dict[str, Mask]:
    return {name: ~np.isnan(values) for name, values in channels.items()}


def _measured(raw: Raw) -> list[str]:
    return _counted([name for name in raw.channels if raw.feeds[name].constant is None])


def _counted(measured: Collection[str]) -> list[str]:
    """Return the measured channels that make a sample, in the order of `CLOCKS`."""
    parts = ((name,) if name in measured else sources for name, sources in _MADE_OF.items())
    found = [name for several in parts for name in several if name in measured]
    return sorted(found, key=lambda name: CLOCKS.index(name) if name in CLOCKS else len(CLOCKS))


def slowest(times: Mapping[str, Array]) -> tuple[str, float] | None:
    """Return the clearly slowest of the channels (times in s) that make a sample, and its interval in s."""
    intervals = {name: _interval(times[name])[0] for name in _counted(times)}
    if not intervals:
        return None
    name = max(intervals, key=intervals.__getitem__)
    usual = next(iter(intervals.values()))
    return (name, intervals[name]) if intervals[name] > _SLOWER * usual > 0.0 else None


def _interval(time: Array) -> tuple[float, bool]:
    """Return the usual step of a clock, and whether it is regular."""
    steps = np.diff(time[np.isfinite(time)])
    steps = steps[steps > 0.0]
    if not len(steps):
        return 0.0, False
    usual = float(np.median(steps))
    near = np.count_nonzero(np.abs(steps - usual) <= _NEAR * usual + alignment.RESOLUTION)
    return usual, bool(len(steps) >= _STEPS and near >= _REGULAR * len(steps))


def _avoid(one: Mask, other: Mask) -> bool:
    """Tell whether two columns have values in the same rows far less often than by chance."""
    expected = np.count_nonzero(one) * np.count_nonzero(other) / len(one)
    return bool(expected >= _MEETINGS and np.count_nonzero(one & other) <= _AVOID * expected)


def _pieces(raw: Raw) -> list[int]:
    """Return where runs and restarts of the clock bound the rows."""
    assert raw.time is not None  # noqa: S101 - only called where there is a clock
    restarts = alignment.split_clock(raw.time)[0]
    bounds = {0, len(raw.time), *restarts.tolist()}
    if "run" in raw.labels:
        codes = raw.labels["run"].codes
        known = np.flatnonzero(codes >= 0)
        bounds.update(known[1:][np.diff(codes[known]) != 0].tolist())
    return sorted(bounds)
