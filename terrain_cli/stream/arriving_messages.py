"""From the messages of a bag as they arrive, each topic at its own rate, to the samples of each wheel."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from formats import LOG_TIME
from terrain_cli.stream.arriving_samples import ANEW, BEFORE, ArrivingSamples
from terrain_cli.telemetry import alignment, bags, raw_columns

if TYPE_CHECKING:
    from collections.abc import Iterator

    from formats import Batch, Column
    from formats.rosbag.arriving_bag import ArrivingBag
    from terrain_cli.effects import Effect
    from terrain_cli.rover import Rover
    from terrain_cli.run.settings import Settings
    from terrain_cli.telemetry import Samples
    from terrain_cli.telemetry.bags import TopicClocks
    from terrain_cli.vocabulary.arrays import Array

#: Messages of each topic that tell its rate, and whose clock is right, if they come within so many seconds.
#: Judged: two steps have a median, and what has a message in five seconds is no clock of a wheel.
_TOLD, _WITHIN = 3, 10.0
#: Seconds that a message may be late, beyond which its topic is silent, and those that one may come behind a
#: later one of its topic. Judged: recorders write within a second or two.
_LATE, _OUT_OF_ORDER = 5.0, 0.5
#: Seconds of samples that are handed over together at the least. Judged: a fifth of the work at 10 looks a
#: second, and nothing to a change of soil.
_STEP = 0.5
#: Seconds at the most that a silent topic is waited for, and that are looked at again with what comes next.
#: Judged: they bound the memory, whatever the clocks say.
_WAITED, _KEPT = 60.0, 300.0


class MessageSamples(ArrivingSamples):
    """Makes samples of the messages of a bag, once all topics have passed their time."""

    def __init__(
        self, bag: ArrivingBag, rover: Rover, settings: Settings, effects: tuple[Effect, ...] | None
    ) -> None:
        super().__init__(bag, rover, settings, effects)
        request = self._reader.request
        bag.wanted = bags.fields(request.layout, request.channels)
        self._gap = rover.max_gap
        self._empty = {topic: raw_columns.empty(names) for topic, names in bag.wanted.items()}
        self._held: dict[str, dict[str, Column]] = dict(self._empty)
        self._clocks: TopicClocks | None = None
        #: Until when the samples were handed over, and seconds before that which are still held.
        self._done, self._before = -np.inf, 0.0
        self._back = 0

    def check(self, came: dict[str, Batch] | None) -> None:
        self._reader.check({**self._empty, **(came or {})})

    def take(self, came: dict[str, Batch]) -> Iterator[Samples]:
        """Yield the samples that nothing can change any more."""
        self._count_late(came)
        for topic, batch in came.items():
            parts = [self._held[topic], batch] if len(self._held[topic][LOG_TIME]) else [batch]
            self._held[topic] = raw_columns.whole(parts)
        yield from self._known(last=False)

    def rest(self) -> Iterator[Samples]:
        """Yield the samples that wait for others, as nothing more will come."""
        yield from self._known(last=True)

    def _count_late(self, came: dict[str, Batch]) -> None:
        """Count the messages of times that were handed over; if nothing else comes, the clock began anew."""
        if self._clocks is None:
            return
        for time in self._clocks.times(came).values():
            late = int(np.count_nonzero(time <= self._done))
            self.late += late
            self._back = self._back + late if late == len(time) else 0
        if self._back >= ANEW * len(self._held):
            self._held, self._done, self._back = dict(self._empty), -np.inf, 0

    def _known(self, *, last: bool) -> Iterator[Samples]:
        if self._clocks is None:
            if not (last or self._settled()):
                return
            self._clocks = bags.topic_clocks(self._held)
        times = self._clocks.times(self._held)
        until = np.inf if last else self._until(list(times.values()))
        if until < self._done + _STEP:
            return
        intervals = [0.0]
        for part in self._reader.topics(dict(self._held), self._clocks, self._done, until):
            assert part.time is not None  # noqa: S101 - a bag has a clock
            intervals.append(float(np.median(np.diff(part.time))) if len(part) > 1 else 0.0)
            yield self._account(part)
        self._done, self._before = until, max(self._before, min(_KEPT, BEFORE * max(intervals)))
        self._forget(times)

    def _settled(self) -> bool:
        """Tell whether enough came to know the clocks and rates of the topics."""
        logs = [np.asarray(table[LOG_TIME]) for table in self._held.values()]
        if all(len(log) >= _TOLD for log in logs):
            return True
        every = np.concatenate(logs)
        return bool(len(every) and (every.max() - every.min()) / np.timedelta64(1, "s") >= _WITHIN)

    def _until(self, times: list[Array]) -> float:
        """Return the time that all topics have passed, those that are silent left out."""
        newest = max(float(time.max()) for time in times if len(time))
        return min(self._passed(time, newest - _LATE) for time in times)

    def _passed(self, time: Array, silent: float) -> float:
        """Return the time up to which nothing of a topic will come, or nothing that is interpolated."""
        if not len(time):
            return silent
        gap = alignment.default_gap(np.sort(time)) if self._gap is None else self._gap
        last = float(time.max())
        return silent if silent > last + min(gap, _WAITED) else last - _OUT_OF_ORDER

    def _forget(self, times: dict[str, Array]) -> None:
        """Drop the messages that are not looked at again."""
        for topic, time in times.items():
            kept = time > self._done - self._before
            # What comes seldom, such as the label of a soil, holds until the next.
            kept[np.argsort(time, kind="stable")[-BEFORE:]] = True
            if not kept.all():
                self._held[topic] = {n: raw_columns.take(c, kept) for n, c in self._held[topic].items()}
