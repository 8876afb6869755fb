"""Logs too long to be held at once: an excerpt of pieces, and the samples of a long table part by part."""

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from formats import Batch, Column, Labels
from formats.recovery import Notice, told
from terrain_cli.processes import keep_freed
from terrain_cli.telemetry import (
    alignment,
    own_clocks,
    plausibility,
    raw_channels,
    raw_columns,
    usable_samples,
)
from terrain_cli.telemetry.assembly import Request, assemble, check
from terrain_cli.telemetry.effect_inputs import ANGLE
from terrain_cli.telemetry.own_clocks import OwnClocks
from terrain_cli.telemetry.raw_channels import TopicClocks, choose_wheels, labels_there
from terrain_cli.telemetry.unit_doubts import Doubt, UnitEvidence
from terrain_cli.telemetry.wheel_samples import COLUMNS, TABLES, Raw, Samples
from terrain_cli.vocabulary.arrays import Array, Index, Mask

#: Rows that are read whole, of all inputs together, where only a share of them is compared.
MOST_ROWS = 2_000_000
PIECE = 1000  # Usable samples of a piece
#: Rows in a part, and rows on either side that are looked at with it: where a clock restarts, what
#: a rate is, and across which gap a channel is interpolated depends on neighbours.
ROWS, BESIDE = 1 << 17, 4096
_ROW = "@row"  # Number of the row of each sample, among its further columns


def excerpt(most: int, parts: Iterable[Samples]) -> list[Samples]:
    """Keep every so many pieces of the usable samples of each wheel, together no more than `most`."""
    # The length of the log need not be known: where the limit is passed, every second piece goes.
    step = 1
    kept: dict[str, list[tuple[Samples, Index]]] = {}
    seen: Counter[str] = Counter()
    rows: Counter[str] = Counter()

    def chosen(number: Index) -> Mask:
        return np.asarray(number // PIECE % step == 0)

    for part in parts:
        usable, wheel = part.usable, part.wheel
        number = seen[wheel] + np.arange(len(usable))
        seen[wheel] += len(usable)
        rows[wheel] += len(part)
        own = chosen(number)
        kept.setdefault(wheel, []).append((part.taken(usable[own]), number[own]))
        while sum(len(numbers) for pieces in kept.values() for _, numbers in pieces) > most:
            step *= 2
            for name, pieces in kept.items():
                thinned = [(samples.taken(c), n[c]) for samples, n in pieces for c in [chosen(n)]]
                kept[name] = [one for one in thinned if len(one[1])] or thinned[:1]
    result = []
    for wheel in sorted(kept):
        pieces = kept.pop(wheel)
        number = np.concatenate([numbers for _, numbers in pieces])
        whole = joined([samples for samples, _ in pieces])
        broken = np.diff(number, prepend=number[:1]) > 1
        broken |= np.diff(whole.stretch, prepend=whole.stretch[:1]) != 0
        total = seen[wheel] if rows[wheel] else None
        result.append(replace(whole, stretch=np.cumsum(broken), drive=whole.stretch, total=total))
    return result


def joined(parts: Sequence[Samples]) -> Samples:
    """Join parts of one wheel, with the words of the first; NaN where one lacks a column."""
    columns: dict[str, Any] = {}
    for name in COLUMNS:
        known = [own for part in parts if (own := getattr(part, name)) is not None]
        columns[name] = raw_columns.join(known) if known else None
    nothing = [np.full(len(part), np.nan) for part in parts]
    for name in TABLES:
        own = [getattr(part, name) for part in parts]
        keys = dict.fromkeys(key for table in own for key in table)
        columns[name] = {
            key: raw_columns.join([table.get(key, none) for table, none in zip(own, nothing, strict=True)])
            for key in keys
        }
    return replace(parts[0], **columns)


def excerpted(samples: Sequence[Samples]) -> list[str]:
    """Say of how many samples how many were kept, if not all were."""
    total = sum(len(one.usable) if one.total is None else one.total for one in samples)
    kept = sum(len(one.usable) for one in samples)
    if kept == total:
        return []
    return [f"{kept} of {total} samples are read, in unbroken pieces of {PIECE} spread over each input"]


def notes(samples: Sequence[Samples]) -> list[str]:
    """Say what was not read of some inputs, lost or left out, and what every command says of them."""
    saved = []
    for one in samples:
        notices = (remark for remark in one.remarks if isinstance(remark, Notice))
        saved += [f"{one.source}: {remark}" for remark in (*told(one.remarks), *notices)]
    return [*dict.fromkeys(saved), *excerpted(samples)]


def in_parts(request: Request, batches: Iterable[Batch]) -> Iterator[Samples]:
    """Yield the samples of a table part by part, of each wheel in turn."""
    # Distance, stretches, the angle of the wheel and the clock's origin go on from part to part. What a
    # person should know stands in the first part of a wheel.
    keep_freed()
    reader = PartReader(request)
    for table, first, last in _tables(batches):
        yield from reader.parts(table, first, last)
    reader.end()


class PartReader:
    """Makes samples of one part of a table, or of the topics of a bag, after another."""

    def __init__(self, request: Request, *, evident: bool = True) -> None:
        self.request = request
        #: Whether every part is evidence on the units; of small ones only those that are asked for.
        self._evident = evident
        self._ends: dict[str, _End] = {}
        self._seen: set[str] = set()
        self._nameless = 0

    def parts(self, table: dict[str, Column], first: int, last: int) -> Iterator[Samples]:
        """Yield the samples of the rows from first to last; the others are their neighbours."""
        request, layout, rover = self.request, self.request.layout, self.request.rover
        table[_ROW] = np.arange(len(next(iter(table.values()))), dtype=float)
        raws = raw_channels.of_table(request, table, [*request.extras, _ROW], self._choose)
        self._nameless += raw_channels.nameless(layout, table, slice(first, last))
        check(request, [raw for raw in raws if raw.wheel not in self._ends])
        for raw in raws:
            # The first part shows whether its columns have clocks of their own, or one was out for a while.
            if raw.wheel not in self._ends:
                self._ends[raw.wheel] = _End(clocks=own_clocks.find(raw))
            self._ends[raw.wheel].bring(raw, first, last, rover.max_gap)
            yield self._part(raw, first, last)

    def check(self, tables: Mapping[str, dict[str, Column]]) -> None:
        """Refuse a bag of which something is missing."""
        check(self.request, raw_channels.of_topics(self.request, tables, self._choose))

    def topics(
        self, tables: Mapping[str, dict[str, Column]], clocks: TopicClocks, begin: float, end: float
    ) -> Iterator[Samples]:
        """Yield the samples of a bag later than one time and not than another (s), of the messages about."""
        raws = raw_channels.of_topics(self.request, tables, self._choose, clocks)
        check(self.request, [raw for raw in raws if raw.wheel not in self._ends])
        for raw in raws:
            self._ends.setdefault(raw.wheel, _End(clocks=None))
            time = np.empty(0) if raw.time is None else raw.time
            raw.extras[_ROW] = np.arange(len(time), dtype=float)
            first, last = np.searchsorted(time, [begin, end], side="right").tolist()
            yield self._part(raw, first, last)

    def _part(self, raw: Raw, first: int, last: int) -> Samples:
        """Return the samples of the rows from first to last of a wheel; the others are their neighbours."""
        layout, rover = self.request.layout, self.request.rover
        end = self._ends[raw.wheel]
        end.count_on(raw)
        checked = end.begun if self._evident else end.clocked
        columns = (*layout.extras, _ROW)
        samples = assemble(self.request, raw, columns, checked=checked, judged=self._evident)
        end.clocked |= len(raw) >= alignment.FEW_TIMES
        if not end.begun:
            told = samples.remarks[len(layout.source.remarks) :]
            end.remarks = [remark for remark in told if not isinstance(remark, Doubt)]
            end.evidence = UnitEvidence(samples.geometry, raw.feeds)
        part = end.go_on(samples, first, last, rover.max_gap)
        if self._evident:
            end.evidence.add(part)
        return part

    def doubts(self, part: Samples) -> list[Doubt]:
        """Take more evidence on the units of a wheel; return what is hardly true by all of it."""
        evidence = self._ends[part.wheel].evidence
        evidence.add(part)
        return plausibility.found(self.request.layout, part.wheel, evidence)

    def _choose(self, labels: Labels | None) -> list[str]:
        if labels is None:
            return choose_wheels(self.request, None)
        there = labels_there(labels)
        self._seen.update(there)
        return [name for name in there if name in self.request.wheels or not self.request.wheels]

    def end(self) -> None:
        """Complete the remarks, once there are no more parts."""
        layout = self.request.layout
        if "" in layout.labels:
            every = Labels(np.arange(len(self._seen), dtype=np.int32), tuple(sorted(self._seen)))
            choose_wheels(self.request, every)
        for wheel, end in self._ends.items():
            if end.clocks:
                end.remarks.insert(0, end.clocks.told(wheel, end.samples, end.interpolated))
            end.remarks[:0] = layout.source.remarks
            end.remarks += raw_channels.passed_over(layout, self._nameless)
            end.remarks += plausibility.found(layout, wheel, end.evidence)


def _tables(batches: Iterable[Batch]) -> Iterator[tuple[dict[str, Column], int, int]]:
    """Join batches to tables, each with rows of its neighbours; of its own are those from first to last."""
    pending: list[Batch] = []
    count = before = 0

    def short() -> Iterator[Batch]:
        for batch in batches:
            rows = len(next(iter(batch.values())))
            for start in range(0, rows, ROWS):
                part = slice(start, start + ROWS)
                yield batch if rows <= ROWS else {n: raw_columns.take(c, part) for n, c in batch.items()}

    for batch in short():
        pending.append(batch)
        count += len(next(iter(batch.values())))
        if count >= ROWS + 2 * BESIDE:
            table = raw_columns.whole(pending)
            yield dict(table), before, count - BESIDE
            kept = np.arange(max(count - 2 * BESIDE, 0), count)
            pending = [{name: raw_columns.take(column, kept) for name, column in table.items()}]
            count, before = len(kept), len(kept) - BESIDE
    if pending and count > before:
        yield raw_columns.whole(pending), before, count


@dataclass(kw_only=True)
class _End:
    """How far a wheel has come."""

    clocks: OwnClocks | None
    #: Of columns on clocks of their own: rows that are left, and those of them with interpolated values.
    samples: int = 0
    interpolated: int = 0
    origin: float | None = None
    begun: bool = False
    #: Whether there were rows enough to tell what its clock counts.
    clocked: bool = False
    used: bool = False
    stretch: int = 0
    distance: float = 0.0
    angle: float = 0.0
    turning: int = -1
    #: Driving time since the last usable sample, where that is out of sight of the next part.
    lost: float = 0.0
    remarks: list[str] = field(default_factory=list)
    evidence: UnitEvidence = field(init=False)

    def bring(self, raw: Raw, first: int, last: int, max_gap: float | None) -> None:
        """Bring columns on clocks of their own to one, and count the part's own rows."""
        if self.clocks:
            interpolated = self.clocks.bring(raw, max_gap)
            row = raw_columns.as_numbers(raw.extras[_ROW])
            own = (row >= first) & (row < last)
            self.samples += int(own.sum())
            self.interpolated += int((interpolated & own).sum())

    def count_on(self, raw: Raw) -> None:
        """Count the time from the origin of the first part."""
        if raw.time is None or not np.isfinite(raw.time).any():
            return
        if self.origin is None:
            self.origin = raw.origin
        elif raw.origin != self.origin:
            raw.time = np.round(raw.time + (raw.origin - self.origin), 6)
            raw.origin = self.origin

    def go_on(self, samples: Samples, first: int, last: int, max_gap: float | None) -> Samples:
        """Return the samples of a part alone, counted on from where the part before ended."""
        row = samples.drivers.pop(_ROW)
        i, j = np.searchsorted(row, [first, last]).tolist()
        part = samples.taken(slice(i, j))
        if i == j:
            return replace(part, remarks=self.remarks)
        stretch, distance = self._stretches(samples, row, i, j, last, max_gap), part.distance
        drivers = dict(part.drivers)
        if self.begun:
            # Where nothing of the part before is in sight, the drive was interrupted.
            before = samples.stretch[i - 1] if i else samples.stretch[0] - 1
            stretch = stretch + (self.stretch - before)
        if distance is not None and samples.distance is not None:
            distance = distance + (self.distance - (samples.distance[i - 1] if i else 0.0))
            self.distance = float(distance[-1])
        if ANGLE in drivers:
            drivers[ANGLE] = self._angle(samples.drivers[ANGLE], i, j, stretch)
        self.begun, self.stretch = True, int(stretch[-1])
        return replace(part, stretch=stretch, distance=distance, drivers=drivers, remarks=self.remarks)

    def _stretches(
        self, samples: Samples, row: Array, i: int, j: int, last: int, max_gap: float | None
    ) -> Index:
        """Count a gap in what is usable that began where the part does not see it."""
        stretch, time = samples.stretch[i:j], samples.time
        ground = usable_samples.on_ground(samples.set_aside)
        own = ground[np.searchsorted(ground, i) :]
        own = own[: np.searchsorted(own, j)]
        seen = ground[: np.searchsorted(ground, j)]
        hidden, ends_hidden = len(own) == len(seen), not len(seen) or row[seen[-1]] < last - BESIDE
        if time is not None and (ends_hidden or (hidden and self.used)):
            gap = usable_samples.longest_gap(time, samples.set_aside, max_gap)
            driven = usable_samples.driving_time(time, samples.set_aside, gap)
            begin = driven[max(i - 1, 0)]
            lost = self.lost + driven[own[0]] - begin if hidden and self.used and len(own) else 0.0
            if lost > gap + alignment.RESOLUTION:
                stretch = stretch + (np.arange(i, j) >= own[0])
            self.lost = driven[j - 1] - driven[seen[-1]] if len(seen) else self.lost + driven[j - 1] - begin
        self.used |= len(own) > 0
        return stretch

    def _angle(self, angle: Array, i: int, j: int, stretch: Index) -> Array:
        """Count the angle of the wheel on through the stretch in which it was last known."""
        known = np.isfinite(angle)
        before = np.flatnonzero(known[:i])
        begin = angle[before[-1]] if len(before) else 0.0
        result = angle[i:j] + np.where(stretch == self.turning, self.angle - begin, 0.0)
        own = np.flatnonzero(known[i:j])
        if len(own):
            self.angle, self.turning = float(result[own[-1]]), int(stretch[own[-1]])
        return np.asarray(result)
