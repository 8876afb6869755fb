"""From rows or messages as they arrive to the samples of each wheel."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections import Counter
from typing import TYPE_CHECKING, Any

import numpy as np

from terrain_cli import telemetry
from terrain_cli.errors import InputError
from terrain_cli.telemetry import own_clocks, raw_channels, raw_columns
from terrain_cli.telemetry.long_logs import joined
from terrain_cli.telemetry.usable_samples import BACKWARDS

if TYPE_CHECKING:
    from collections.abc import Iterator

    from formats import Batch, Labels, Source
    from formats.text.arriving_rows import ArrivingRows
    from terrain_cli.effects import Effect
    from terrain_cli.rover import Rover
    from terrain_cli.run.settings import Settings
    from terrain_cli.telemetry import Samples

#: Samples of a wheel that are looked at again with the next ones: they tell its usual rate, what is late, and
#: what is a gap. Judged: enough for the median of the steps.
BEFORE = 256
#: Rows of a wheel among which a column on a clock of its own shows.
_SHOWN = 128
#: Samples of a wheel that tell whether its units can be true.
_JUDGED = 512
#: A clock that stands back for so many rows in a row began anew: with the next one `alignment.split_clock`
#: would say so, but of rows that were judged already.
ANEW = 9


class ArrivingSamples(ABC):
    """Makes samples of what arrives; those of each wheel are consecutive."""

    def __init__(
        self, source: Source, rover: Rover, settings: Settings, effects: tuple[Effect, ...] | None
    ) -> None:
        where = telemetry.Condition(settings.where) if settings.where else None
        self._reader = telemetry.part_reader(
            source, rover, wheels=settings.wheels, where=where, effects=effects
        )
        #: The first samples of each wheel, until its units are judged.
        self._first: dict[str, list[Samples]] = {}
        #: Samples of each wheel, and those set aside by reason.
        self.count: Counter[str] = Counter()
        self.reasons: dict[str, Counter[str]] = {}
        #: What a person should know, in the order in which it showed.
        self.remarks: list[str] = []
        #: Messages that were too late to be taken.
        self.late = 0

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
    """Makes samples of the rows of a table."""

    def __init__(
        self, rows: ArrivingRows, rover: Rover, settings: Settings, effects: tuple[Effect, ...] | None
    ) -> None:
        super().__init__(rows, rover, settings, effects)
        request = self._reader.request
        rows.wanted = raw_channels.fields(request.layout, request.channels, request.extras)
        self._rows = rows
        self._label = request.layout.labels.get("", "")
        self._before: dict[str, Batch] = {}
        self._back: Counter[str] = Counter()
        self._checked: set[str] = set()

    def take(self, batch: Batch) -> Iterator[Samples]:
        """Yield the samples of some rows."""
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
        back = (
            part.set_aside.codes == part.set_aside.names.index(BACKWARDS)
            if BACKWARDS in part.set_aside.names
            else np.zeros(len(part), dtype=bool)
        )
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

        for raw in raw_channels.wheels(request.layout, table, request.channels, (), choose):
            if len(raw) and (found := own_clocks.find(raw)):
                raise InputError(
                    f"{self._rows.label}: {found.slowest} is filled in fewer rows than others, and rows that "
                    "arrive are not brought to one clock",
                    hint="send every channel of a wheel in one row, or record it and run estimate",
                )


def _length(batch: Batch) -> int:
    return len(next(iter(batch.values())))
