"""From rows or messages as they arrive to the samples of each wheel."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections import Counter
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np

from formats import LOG_TIME, Batch, Column, Labels, Source
from formats.text.arriving_rows import ArrivingRows
from terrain_cli import telemetry
from terrain_cli.effects import Effect
from terrain_cli.errors import InputError
from terrain_cli.rover import Rover
from terrain_cli.run.settings import Settings
from terrain_cli.telemetry import Samples, alignment, own_clocks, raw_channels, raw_columns
from terrain_cli.telemetry.long_logs import joined
from terrain_cli.telemetry.raw_channels import TopicClocks
from terrain_cli.telemetry.usable_samples import BACKWARDS, is_aside
from terrain_cli.vocabulary.arrays import Array

if TYPE_CHECKING:
    from formats.rosbag.arriving_bag import ArrivingBag

Effects = tuple[Effect, ...] | None  # Of the full model; None for the line
#: Samples of a wheel that are looked at again with the next ones: they tell its usual rate, what is late, and
#: what is a gap. Judged: enough for the median of the steps.
BEFORE = 256
_SHOWN = 128  # Rows of a wheel among which a column on a clock of its own shows
_JUDGED = 512  # Samples of a wheel that tell whether its units can be true
#: A clock that stands back for so many rows in a row began anew: with the next one `alignment.split_clock`
#: would say so, but of rows that were judged already.
ANEW = 9
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


class ArrivingSamples(ABC):
    """Makes samples of what arrives; those of each wheel are consecutive."""

    def __init__(self, source: Source, rover: Rover, settings: Settings, effects: Effects) -> None:
        where = telemetry.Condition(settings.where) if settings.where else None
        asked: dict[str, Any] = {"wheels": settings.wheels, "where": where, "effects": effects}
        self._reader = telemetry.part_reader(source, rover, **asked)
        #: The first samples of each wheel, until its units are judged.
        self._first: dict[str, list[Samples]] = {}
        #: Samples of each wheel, and those set aside by reason.
        self.count: Counter[str] = Counter()
        self.reasons: dict[str, Counter[str]] = {}
        self.remarks: list[str] = []  # What a person should know, in the order in which it showed
        self.late = 0  # Messages that were too late to be taken

    def check(self, came: Any) -> None:  # noqa: B027 - rows are checked as they are taken
        """Refuse a stream of which something is missing, by what came first."""

    @abstractmethod
    def take(self, came: Any) -> Iterator[Samples]:
        """Yield the samples that are known with what came."""

    def _account(self, part: Samples) -> Samples:
        """Count samples, and look once at the units of a wheel, when enough of its samples are there."""
        self.count[part.wheel] += len(part)
        self.reasons.setdefault(part.wheel, Counter()).update(part.reasons())
        if self.count[part.wheel] - len(part) < _JUDGED:
            first = self._first.setdefault(part.wheel, [])
            first.append(part)
            if self.count[part.wheel] >= _JUDGED:
                self._tell(first)
        return part

    def _tell(self, first: list[Samples]) -> None:
        doubts = self._reader.doubts(joined(first))
        self.remarks += dict.fromkeys([*first[0].remarks, *doubts])
        first.clear()

    def rest(self) -> Iterator[Samples]:
        """Yield the samples that wait for others, as nothing more will come."""
        yield from ()

    def end(self) -> None:
        """Judge the wheels of which too few samples came before, and refuse wheels that never came."""
        for first in self._first.values():
            if first:
                self._tell(first)
        self._reader.end()


class RowSamples(ArrivingSamples):
    def __init__(self, rows: ArrivingRows, rover: Rover, settings: Settings, effects: Effects) -> None:
        super().__init__(rows, rover, settings, effects)
        request = self._reader.request
        rows.wanted = raw_channels.fields(request)[""]
        self._rows = rows
        self._label = request.layout.labels.get("", "")
        self._before: dict[str, Batch] = {}
        self._back: Counter[str] = Counter()
        self._checked: set[str] = set()

    def take(self, batch: Batch) -> Iterator[Samples]:
        for key, rows in self._by_wheel(batch):
            yield from self._of_wheel(key, rows)

    def _by_wheel(self, batch: Batch) -> Iterator[tuple[str, Batch]]:
        if not self._label:
            yield "", batch
            return
        labels = raw_columns.as_labels(batch[self._label])
        batch[self._label] = labels
        codes = labels.codes
        if (codes == codes[0]).all():
            yield labels.names[codes[0]] if codes[0] >= 0 else "", batch
            return
        for code in np.unique(codes).tolist():
            rows = np.flatnonzero(codes == code)
            some = {name: raw_columns.take(column, rows) for name, column in batch.items()}
            yield labels.names[code] if code >= 0 else "", some

    def _of_wheel(self, key: str, rows: Batch) -> Iterator[Samples]:
        before = self._before.get(key)
        first = _length(before) if before else 0
        table = raw_columns.whole([before, rows]) if before else rows
        last = _length(table)
        begin = slice(max(0, last - BEFORE), None)
        self._before[key] = {name: raw_columns.take(column, begin) for name, column in table.items()}
        if key not in self._checked and last >= _SHOWN:
            self._checked.add(key)
            self._refuse_clocks(dict(table))
        for part in self._reader.parts(table, first, last):
            self._judge_clock(key, part)
            yield self._account(part)

    def _judge_clock(self, key: str, part: Samples) -> None:
        """Forget the rows before, where the clock has stood back for so long that it began anew."""
        back = is_aside(part.set_aside, BACKWARDS)
        ahead = np.flatnonzero(~back)
        self._back[key] = len(back) - 1 - int(ahead[-1]) if len(ahead) else self._back[key] + len(back)
        if self._back[key] >= ANEW:
            self._before.pop(key, None)
            self._back[key] = 0

    def _refuse_clocks(self, table: Batch) -> None:
        """Refuse columns that are filled at times of their own: only what comes later would fill the gaps."""
        request = self._reader.request

        def choose(labels: Labels | None) -> list[str]:
            wheels = sorted(request.layout.wheels) or [""]
            return wheels if labels is None else [name for name in labels.names if name in self.count]

        for raw in raw_channels.of_table(request, table, (), choose):
            if len(raw) and (found := own_clocks.find(raw)):
                what = f"{self._rows.label}: {found.slowest} is filled in fewer rows than others"
                hint = "send every channel of a wheel in one row, or record it and run estimate"
                raise InputError(f"{what}, and rows that arrive are not brought to one clock", hint=hint)


def _length(batch: Batch) -> int:
    return len(next(iter(batch.values())))


class MessageSamples(ArrivingSamples):
    """Makes samples of the messages of a bag, once all topics have passed their time."""

    def __init__(self, bag: ArrivingBag, rover: Rover, settings: Settings, effects: Effects) -> None:
        super().__init__(bag, rover, settings, effects)
        request = self._reader.request
        bag.wanted = raw_channels.fields(request)
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
            self._clocks = raw_channels.topic_clocks(self._held)
        times = self._clocks.times(self._held)
        until = np.inf
        if not last:
            # Of the topics that are silent nothing is waited for.
            newest = max(float(time.max()) for time in times.values() if len(time))
            until = min(self._passed(time, newest - _LATE) for time in times.values())
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
