"""A log too long for the memory, worked through in parts (reaches).

A window needs the samples of no other, and a change of soil shows in the samples about it. So the
windows of a reach are final, save the last ones, whose samples begin the next reach.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from terrain_cli import estimation
from terrain_cli.estimation import estimators
from terrain_cli.presentation import segment_table
from terrain_cli.telemetry.long_logs import joined
from terrain_cli.telemetry.wheel_samples import NEEDED
from terrain_cli.windows import cut_windows

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from numpy.typing import NDArray

    from terrain_cli.estimation import WindowEstimates
    from terrain_cli.models import ModelFile
    from terrain_cli.run.settings import Settings
    from terrain_cli.telemetry import Samples
    from terrain_cli.windows.cut_windows import Windows

#: Rows of a table from which on it is worked through in reaches.
MOST_ROWS = 2_000_000
#: Usable samples of a reach, and those behind a bound that make it final.
REACH, SETTLED = 1 << 19, 20_000
#: Longest window: a soil that goes on for longer is cut there.
LONGEST = 1 << 20
#: Channels that windows, estimates and the table are made of.
_KEPT = {*NEEDED, "x", "y", "longitude", "latitude"}
#: Samples set aside behind each usable one, among its drivers.
BEHIND = "@behind"


def hindrance(settings: Settings, file: ModelFile | None) -> str | None:
    """Say what needs a log whole; None where reaches do."""
    if file is not None and not settings.automatic:
        return "the whole model learns its noise from all samples of a wheel"
    if settings.whole or settings.places:
        return "rejects, trace, samples, posterior, plot and places need every sample"
    if settings.segments == "none":
        return "--segments none makes one window of all samples"
    if settings.segments == "fixed" and settings.window_samples is None:
        return "--segments fixed counts its metres from the start"
    return None


def lean(part: Samples) -> Samples:
    """Return a part with no more than windows, estimates and the table are made of."""
    channels = {name: values for name, values in part.channels.items() if name in _KEPT}
    return replace(part, channels=channels, drivers={})


def work(parts: Iterable[Samples], settings: Settings) -> dict[str, LongWheel]:
    """Work through the lean samples of a log, of each wheel in turn; results by the names of the wheels."""
    wheels: dict[str, LongWheel] = {}
    source = ""
    for part in parts:
        source = part.source
        wheels.setdefault(part.wheel, LongWheel(settings)).take(part)
        cut_windows.check_number(source, sum(wheel.windows for wheel in wheels.values()))
    for wheel in wheels.values():
        wheel.end()
    cut_windows.check_number(source, sum(wheel.windows for wheel in wheels.values()))
    return wheels


def with_behind(part: Samples, usable: NDArray[np.intp]) -> tuple[Samples, int]:
    """Return the usable samples of a part, and how many are set aside ahead of the first.

    Those set aside behind each are counted among its drivers.
    """
    if len(usable) == len(part):
        return replace(part, drivers={**part.drivers, BEHIND: np.zeros(len(part))}), 0
    behind = np.diff(np.append(usable, len(part))) - 1.0
    used = part.taken(usable)
    ahead = int(usable[0]) if len(usable) else len(part)
    return replace(used, drivers={**used.drivers, BEHIND: behind}), ahead


class LongWheel:
    """The windows of one wheel so far, and the samples that are not yet in one."""

    def __init__(self, settings: Settings) -> None:
        self._settings = settings
        self._first: Samples | None = None
        self._pending: list[Samples] = []
        self._waiting = self._carried = self._before = self._cut = self._ahead = 0
        self._rows = self._used = 0
        self._reasons: Counter[str] = Counter()
        #: How many windows there are.
        self.windows = 0
        #: That of the first reach, for all of them.
        self._stress = settings.stress
        self._tables: list[segment_table.Table] = []
        self._estimates: list[WindowEstimates] = []

    def __len__(self) -> int:
        return self._rows

    def take(self, part: Samples) -> None:
        """Add the samples that follow."""
        if self._first is None:
            self._first = part.taken(slice(0, 0))
        usable = part.usable
        self._rows += len(part)
        self._used += len(usable)
        self._reasons.update(part.reasons())
        used, ahead = with_behind(part, usable)
        if self._pending:
            self._pending[-1].drivers[BEHIND][-1] += ahead
        else:
            self._before += ahead
        if not len(usable):
            return
        self._pending.append(used)
        self._waiting += len(usable)
        # A long window that is carried on is not searched again for every few samples.
        if self._waiting >= self._carried + max(REACH, self._carried):
            self._work(last=False)

    def end(self) -> None:
        """Make windows of what is left."""
        if self._pending:
            self._work(last=True)

    def _work(self, *, last: bool) -> None:
        given = self._settings
        samples = joined(self._pending)
        self._pending = []
        cut = cut_windows.cut(
            samples,
            given.segments,
            min_samples=given.min_samples,
            window_samples=given.window_samples,
            window_distance=given.window_distance,
            before=self._ahead,
        )
        n = len(samples)
        final = len(cut) if last else int(np.searchsorted(cut.bounds, n - SETTLED, side="right")) - 1
        if not last and n - cut.bounds[final] > LONGEST:
            final, self._cut = len(cut), self._cut + 1
        end = int(cut.bounds[final])
        if final:
            self._keep(
                cut_windows.Windows(
                    samples.taken(slice(0, end)),
                    cut.rows[:end],
                    cut.bounds[: final + 1],
                    cut.x[:end],
                    cut.y[:end],
                )
            )
        self._waiting = self._carried = n - end
        if end < n:
            going_on = samples.stretch[end]
            self._ahead = int(np.count_nonzero(samples.stretch[:end] == going_on)) + (
                self._ahead if samples.stretch[0] == going_on else 0
            )
            self._pending = [samples.taken(np.arange(end, n))]

    def _keep(self, cut: Windows) -> None:
        given = self._settings
        fitted = estimators.estimate(
            cut, given.method, min_samples=given.min_samples, folds=given.folds, at_stress=self._stress
        )
        if len(cut):
            self._stress = float(fitted.estimates.stress[0])
        table = segment_table.table(cut, fitted.estimates)
        behind = np.add.reduceat(cut.samples.drivers[BEHIND], cut.bounds[:-1]).astype(np.intp)
        behind[0] += self._before
        self._before = 0
        table["n_rejected"] = behind
        table["segment"] = table["segment"] + self.windows
        self.windows += len(cut)
        self._tables.append(table)
        self._estimates.append(fitted.estimates)

    @property
    def table(self) -> segment_table.Table | None:
        """Its rows; None without usable samples."""
        # What was joined is not held in parts too.
        self._tables = [segment_table.join(self._tables)] if self._tables else []
        return self._tables[0] if self._tables else None

    @property
    def estimates(self) -> WindowEstimates:
        """Behind the rows."""
        self._estimates = [estimation.join(self._estimates)]
        return self._estimates[0]

    def account(self, remarks: Sequence[str]) -> dict[str, Any]:
        """Say what became of its samples, as the summary shows it."""
        assert self._first is not None  # noqa: S101 - a wheel is there once it has samples
        remarks = list(remarks)
        if self._settings.automatic:
            remarks.append(
                f"a log of more than {MOST_ROWS:,} rows: c and φ are from the line, whose errors take k and "
                "the stresses for true; --method wong-reece fits the full model, with the log in memory"
            )
        if self._cut:
            remarks.append(
                f"wheel {self._first.wheel}: a soil that goes on is cut every {LONGEST:,} samples or so "
                f"({self._cut} times)"
            )
        return {
            "wheel": self._first.wheel,
            "samples": self._rows,
            "used": self._used,
            "set_aside": dict(self._reasons.most_common()),
            "channels": self._first.origins,
            "remarks": remarks,
            "model": None,
        }
