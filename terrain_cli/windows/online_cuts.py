"""Change points while samples still arrive: the search of `change_points`, over what came last.

The cost of a window needs the samples of no other: all partitions that may still become the best one share
the bounds that lie well behind. That is what lets PELT forget places for bounds (Killick, Fearnhead & Eckley
2012, JASA 107(500)), and the best path of a hidden Markov model be told before its end (Šrámek, Brejová &
Vinař 2007, WABI). Here that is not proved but measured: a bound is final when two searches in a row find it,
and so many samples lie behind it as tell a new soil from a bridge.

The constants were chosen by benchmarks/follow_study.py; its table is in benchmarks/results.
"""

from typing import Any

import numpy as np

from terrain_cli.vocabulary.arrays import Array, Index
from terrain_cli.vocabulary.choices import CUT_SAMPLES, MIN_DISTANCE
from terrain_cli.windows.change_points import change_points, needed
from terrain_cli.windows.cut_windows import NEAR, drives
from terrain_cli.windows.sinkage_changes import sinkage_changes

HORIZON = 2048  # Samples that are searched: what is further back does not move a bound any more
#: Samples behind a bound that make it final, twice those in which a new soil must show (`merging.BESIDE`).
SETTLED = 120
#: The next search is after so many seconds and so many samples, so that slow and fast clocks cost alike; and
#: after fewer seconds where a bound waits to be found again.
EVERY_SECONDS, AGAIN_SECONDS, EVERY_SAMPLES = 10.0, 5.0, 20
_SAME = 60  # Samples by which a bound may differ from the same one in the search before
#: Rows of what is added: the place of a sample among all, which bounds are told in; time in s, x and y in Pa,
#: metres driven, load in N, sinkage in m (NaN where not known). Any further ones are what the line may follow
#: (`needed`), of which the first is slip.
PLACE, TIME, X, Y, DRIVEN, LOAD, SINKAGE, SLIP = range(8)


class Driven:
    """The samples in which a wheel drives on average, told once those behind them are known."""

    def __init__(self) -> None:
        self._held: Array = np.empty((0, 0))
        self._told = 0  # Of those held

    def add(self, columns: Array, *, last: bool = False) -> Array:
        """Take samples, however many; return those that drive among the ones that are now told."""
        every = np.concatenate([self._held, columns], axis=1) if self._held.size else columns
        told = every.shape[1] if last else max(every.shape[1] - NEAR, self._told)
        some = slice(self._told, told)
        found: Array = every[:, some][:, drives(every[SLIP])[some]]
        kept = max(told - NEAR, 0)
        self._held, self._told = every[:, kept:], told - kept
        return found

    def end(self) -> Array:
        """Return those that drive among the last ones."""
        return self.add(self._held[:, :0], last=True) if self._held.size else np.empty((0, 0))


class OnlineCuts:
    """The windows of one stretch of a wheel, each told as soon as its end is sure."""

    def __init__(self, *, min_samples: int = CUT_SAMPLES, min_distance: float = MIN_DISTANCE) -> None:
        self._limits: dict[str, Any] = {"min_samples": min_samples, "min_distance": min_distance}
        self._recent: Array = np.empty((0, 0))
        #: Samples so far, and which of them begins the open window.
        self.count = self.begin = 0
        self._bounds: list[int] = []
        self._last: tuple[float, int] | None = None
        self._seen: Index = np.empty(0, dtype=np.intp)

    def add(self, columns: Array) -> list[int]:
        """Take samples, however many at once; return the places of the bounds that are final now."""
        told: list[int] = []
        while columns.shape[1]:
            due = self._due(columns[TIME])
            self._keep(columns[:, :due])
            if due <= columns.shape[1]:
                told += self._search(last=False)
            columns = columns[:, due:]
        return told

    def end(self) -> list[int]:
        """Return the bounds that are still to be told, once the stretch has ended."""
        return self._search(last=True) if self.count > self.begin else []

    def _due(self, time: Array) -> int:
        """Return how many samples there are to the next search, or one more than there are."""
        if self._last is None:
            self._last = (float(time[0]), self.count)
        since, count = self._last
        # Seconds to the next search.
        wait = AGAIN_SECONDS if self._seen.max(initial=0) > self.begin else EVERY_SECONDS
        late = int(np.searchsorted(time, since + wait))
        return max(late + 1, count + EVERY_SAMPLES - self.count)

    def _keep(self, columns: Array) -> None:
        before = self._recent if self._recent.size else columns[:, :0]
        every = np.concatenate([before, columns], axis=1)
        # What was summed part by part may fall by a digit.
        np.maximum.accumulate(every[DRIVEN], out=every[DRIVEN])
        self._recent = every[:, -HORIZON:]
        self.count += columns.shape[1]

    def _search(self, *, last: bool) -> list[int]:
        recent = self._recent
        first = self.count - recent.shape[1]
        begin = max(self.begin, first)
        part = recent[:, begin - first :]
        distance = None if np.isnan(part[DRIVEN]).any() else part[DRIVEN]
        found = begin + change_points(part[X], part[Y], distance=distance, **self._limits)
        inner = self._explained(recent, first, found[1:-1])
        self._last = (float(recent[TIME, -1]), self.count)
        final = []
        for bound in inner.tolist():
            known_before = len(self._seen) and np.abs(self._seen - bound).min() <= _SAME
            if not last and not (known_before and self.count - bound >= SETTLED):
                break
            final.append(bound)
        self._seen = inner
        if final:
            self.begin = final[-1]
            self._bounds += final
        return [int(recent[PLACE, bound - first]) for bound in final]

    def _explained(self, recent: Array, first: int, inner: Index) -> Index:
        """Return the bounds that nothing recorded explains, and those at which the wheel sinks otherwise."""
        self._bounds = [bound for bound in self._bounds if bound > first]
        # In the light of those told before, and behind them.
        every = np.array([first, *self._bounds, *inner.tolist(), self.count], dtype=np.intp) - first
        if len(inner):
            kept = needed(recent[X], recent[Y], list(recent[SLIP:]), every, np.empty(0, dtype=np.intp))
            inner = inner[np.isin(inner, kept + first)]
            every = np.array([first, *self._bounds, *inner.tolist(), self.count], dtype=np.intp) - first
        distance = None if np.isnan(recent[DRIVEN]).any() else recent[DRIVEN]
        columns = recent[LOAD], recent[SINKAGE], recent[SLIP], list(recent[SLIP:])
        found = first + sinkage_changes(*columns, every, distance=distance, **self._limits)
        return found[(found > max(self.begin, first)) & (found < self.count)]
