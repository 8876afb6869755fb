"""Rows or messages that arrive, wheel by wheel, to rows of the table that are told as they close."""

from __future__ import annotations

import math
import shlex
import time
from collections import Counter
from collections.abc import Iterable
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

from formats.byte_sources import ArrivingBytes
from formats.content import BAGS, HEAD_BYTES, content
from formats.text.arriving_rows import ArrivingRows
from terrain_cli.errors import ConfigurationError, InputError
from terrain_cli.estimation import estimators
from terrain_cli.presentation import segment_table
from terrain_cli.presentation.segment_table import Table
from terrain_cli.rover import Rover
from terrain_cli.run.one_log import nothing_usable
from terrain_cli.run.settings import Settings
from terrain_cli.stream import followed_wheel
from terrain_cli.stream.arriving_samples import ArrivingSamples, MessageSamples, RowSamples
from terrain_cli.stream.followed_wheel import FollowedWheel
from terrain_cli.stream.model_watch import ModelMiss
from terrain_cli.telemetry import Samples
from terrain_cli.telemetry.usable_samples import BACKWARDS
from terrain_cli.vocabulary.channels import CHANNELS
from terrain_cli.vocabulary.quantities import the_wheel

if TYPE_CHECKING:
    from formats.rosbag.arriving_bag import ArrivingBag

#: Seconds in which more rows may come before the columns are told from those that are there, and in which a
#: topic may begin of which something is needed. Judged: as `arriving_bag` has it of log time.
_PATIENCE, _WAITED = 1.0, 10.0
_REPEATED = "time repeated"
_NOTHING = "of a table a header and rows are needed, of a bag messages"


class Teller(Protocol):
    """Writes or shows what a followed drive gives."""

    def closed(self, row: Table) -> None: ...  # Of a segment that has closed
    def open(self, rows: list[Table]) -> None: ...  # Of the segments that are open
    def now(self, text: str) -> None: ...  # What is said in one line of the open segments
    def again(self, row: Table) -> None: ...  # Of a segment as all that was followed tells it
    def remark(self, text: str) -> None: ...  # What a person should know


class Follow:
    """One input, followed to its end."""

    def __init__(
        self, rover: Rover, settings: Settings, teller: Teller, *, every: float | None, again: bool = False
    ) -> None:
        """Prepare; open segments are told `every` so many seconds, if given, and all `again` at the end."""
        self._rover, self._settings, self._teller, self._every = rover, settings, teller, every
        self._again = again
        self._file = estimators.choose(settings.method, settings.model, robust=settings.robust)
        self._stress = followed_wheel.CommonStress(settings.stress)
        self._wheels: dict[str, FollowedWheel] = {}
        self._fresh: set[str] = set()
        self._told = 0
        self._next = -math.inf
        self._rows: ArrivingRows | ArrivingBag
        self._samples: ArrivingSamples | None = None

    def run(self, arriving: ArrivingBytes, path: str) -> None:
        """Take all that arrives from an input, which the user named `path`."""
        self._rows = ArrivingRows(path)
        head = b""
        began: float | None = None
        for block in arriving:
            if self._samples is None:
                head = (head + block)[:HEAD_BYTES]
                self._choose(head)
                waited = 0.0 if began is None else time.monotonic() - began
                if self._rows.prepare(block, hurry=waited >= _PATIENCE):
                    self._begin(wait=self._rows.young and waited < _WAITED)
                began = time.monotonic() if began is None and self._rows.begun else began
            else:
                self._take(self._rows.take(block))
            self._tick()
            if self._rows.ended:
                break
        self._end()

    def _choose(self, head: bytes) -> None:
        """Take it for a bag, as soon as its first bytes say so; one in a pipe is refused as a table."""
        path = self._rows.path
        if head and isinstance(self._rows, ArrivingRows) and Path(path).exists():
            kind = content(path, head)
            if kind in BAGS:
                from formats.rosbag.arriving_bag import ArrivingBag

                self._rows = ArrivingBag(path, kind)

    def _begin(self, *, wait: bool = False) -> None:
        """Tell what is read; what is missing may `wait` for a topic that begins later."""
        try:
            effects = None if self._file is None else self._file.model.effects
            given = self._rover, self._settings, effects
            rows = self._rows
            samples: ArrivingSamples = (
                RowSamples(rows, *given) if isinstance(rows, ArrivingRows) else MessageSamples(rows, *given)
            )
            came = self._rows.take()
            samples.check(came)
        except (ConfigurationError, InputError):
            if not wait:
                raise
        else:
            self._samples = samples
            self._take(came)

    def _take(self, came: Any) -> None:
        if came is not None and self._samples is not None:
            self._follow(self._samples.take(came))

    def _follow(self, parts: Iterable[Samples]) -> None:
        for part in parts:
            wheel = self._wheels.get(part.wheel)
            if wheel is None:
                given = self._settings, self._file, self._stress
                wheel = FollowedWheel(*given, again=self._again)
                self._wheels[part.wheel] = wheel
            self._fresh.add(part.wheel)
            for row in wheel.take(part):
                self._teller.closed(row)
            while wheel.alarms:
                self._teller.remark(self._missed(part, wheel.alarms.pop(0)))
        self._tell()

    def _missed(self, part: Samples, alarm: ModelMiss) -> str:
        """Say what the model misses, and what to do about it."""
        unit = CHANNELS[alarm.channel].unit
        size = f"{abs(alarm.size):.3g} {unit.symbol if unit else ''}".rstrip()
        since = alarm.since + part.origin
        when = f"{since:.1f} s"
        if part.origin:
            when = datetime.fromtimestamp(since, UTC).strftime("%H:%M:%S UTC")
        model = f" --model {shlex.quote(str(self._settings.model))}"
        log = "LOG" if self._rows.path == "-" else shlex.quote(self._rows.path)
        return (
            f"{the_wheel(part.wheel)}: the model predicts {size} too "
            f"{'little' if alarm.size > 0.0 else 'much'} {alarm.channel.replace('_', ' ')} since {when}. "
            f"Next: terrain-est diagnose {log}{model}"
        )

    def _tell(self) -> None:
        if self._samples is not None:
            for remark in self._samples.remarks[self._told :]:
                self._teller.remark(remark)
            self._told = len(self._samples.remarks)

    def _tick(self) -> None:
        """Tell the open segments, where it is time and something is new."""
        if not self._fresh:
            return
        self._teller.now("   ".join(map(self._state, sorted(self._wheels))))
        if self._every is None or time.monotonic() < self._next:
            return
        began = time.monotonic()
        rows = [self._wheels[name].open_row() for name in sorted(self._fresh)]
        self._teller.open([row for row in rows if row is not None])
        self._fresh.clear()
        now = time.monotonic()
        # As much time as the open segments took is left to the rows that arrive.
        self._next = now + max(self._every, now - began)

    def _state(self, name: str) -> str:
        cohesion, slope, count = self._wheels[name].soil
        if math.isnan(cohesion):
            return f"{name}: {count} samples"
        return f"{name}: c {cohesion / 1e3:.2f} kPa φ {math.degrees(math.atan(slope)):.1f}° ({count})"

    def _end(self) -> None:
        if self._samples is None:
            if not self._rows.prepare(b"\n", hurry=True):
                hint = "\n".join([*self._rows.faults(), _NOTHING])
                raise InputError(f"{self._rows.label}: no {self._rows.counted[:-1]} came", hint=hint)
            self._begin()
        samples = self._samples
        assert samples is not None  # noqa: S101 - begun above
        self._take(self._rows.take(last=True))
        while self._rows.full:
            self._take(self._rows.take(last=True))
        self._follow(samples.rest())
        self._close()
        samples.end()
        self._tell()
        if not samples.count.total():
            where = f" where {self._settings.where}" if self._settings.where else ""
            raise InputError(f"{self._rows.label}: there are no samples{where}")
        if not any(wheel.closed for wheel in self._wheels.values()):
            raise nothing_usable(
                self._rows.label,
                [
                    {"wheel": name, "samples": count, "set_aside": dict(samples.reasons[name].most_common())}
                    | {"remarks": samples.remarks}
                    for name, count in samples.count.items()
                ],
            )
        for text in self._summary(samples):
            self._teller.remark(text)

    def _close(self) -> None:
        """Tell what is still open as closed, and all segments again if that is wanted."""
        for wheel in self._wheels.values():
            for row in wheel.end():
                self._teller.closed(row)
        if self._again:
            stress = followed_wheel.CommonStress(self._settings.stress)
            for wheel in self._wheels.values():
                for row in wheel.again(stress):
                    self._teller.again(row)

    def _summary(self, samples: ArrivingSamples) -> list[str]:
        """Say once what came, what was wrong with it, and what was cut."""
        every = sum(samples.reasons.values(), Counter())
        late, repeated = every[BACKWARDS], every[_REPEATED]
        closed, cut = (sum(getattr(w, what) for w in self._wheels.values()) for what in ("closed", "cut"))
        late, repeated = late + samples.late, repeated + self._rows.repeated
        text = f"{self._rows.counted}: {self._rows.count}, late: {late}, repeated: {repeated}"
        text += f"; segments: {closed}"
        more = f"a soil that went on was cut every {followed_wheel.LONGEST:,} samples ({cut} times)"
        mixed = [
            told for n, w in self._wheels.items() for told in segment_table.mixed_terrain_notes(n, w.mixed)
        ]
        return [text, *self._rows.faults(), *([more] if cut else []), *mixed]
