"""A log too long for the memory, worked through in parts (reaches), while the next ones are read.

A window needs the samples of no other, and a change of soil shows in the samples about it. So the windows of
a reach are final, save the last ones, whose samples begin the next reach.
"""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from terrain_cli import estimation
from terrain_cli.estimation import WindowEstimates, estimators
from terrain_cli.models import ModelFile
from terrain_cli.presentation import segment_table
from terrain_cli.run.settings import Settings
from terrain_cli.telemetry import Samples
from terrain_cli.telemetry.long_logs import joined
from terrain_cli.telemetry.wheel_samples import NEEDED
from terrain_cli.vocabulary.quantities import the_wheel
from terrain_cli.windows import cut_windows
from terrain_cli.windows.cut_windows import Windows

MOST_ROWS = 2_000_000  # Rows of a table from which on it is worked through in reaches
#: Usable samples of a reach, and those behind a bound that make it final.
REACH, SETTLED = 1 << 19, 20_000
LONGEST = 1 << 20  # Longest window: a soil that goes on for longer is cut there
#: Channels that windows, estimates and the table are made of.
_KEPT = {*NEEDED, "x", "y", "longitude", "latitude"}
BEHIND = "@behind"  # Samples set aside behind each usable one, among its drivers
_AHEAD = 5  # Parts that may wait: as many as make a reach, and one that is being read


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
    """Return the usable samples of a part with the number set aside behind each, and that ahead of all."""
    if len(usable) == len(part):
        return replace(part, drivers={**part.drivers, BEHIND: np.zeros(len(part))}), 0
    behind = np.diff(np.append(usable, len(part))) - 1.0
    used = part.taken(usable)
    ahead = int(usable[0]) if len(usable) else len(part)
    return replace(used, drivers={**used.drivers, BEHIND: behind}), ahead


def windows_of(samples: Samples, given: Settings, before: int = 0) -> Windows:
    """Cut samples as the settings say; so many usable ones of the first stretch came before these."""
    return cut_windows.cut(
        samples,
        given.segments,
        min_samples=given.min_samples,
        window_samples=given.window_samples,
        window_distance=given.window_distance,
        before=before,
    )


class LongWheel:
    """The windows of one wheel so far, and the samples that are not yet in one."""

    def __init__(self, settings: Settings) -> None:
        self._settings = settings
        self._first: Samples | None = None
        self._pending: list[Samples] = []
        self._waiting = self._carried = self._before = self._cut = self._ahead = 0
        self._rows = self._used = 0
        self._reasons: Counter[str] = Counter()
        self.windows = 0  # How many windows there are
        self._mixed: set[str] = set()
        #: That of the first reach, for all of them.
        self._stress = settings.stress
        self._tables: list[segment_table.Table] = []
        self._estimates: list[WindowEstimates] = []

    def __len__(self) -> int:
        return self._rows

    def take(self, part: Samples) -> None:
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
        if self._pending:
            self._work(last=True)

    def _work(self, *, last: bool) -> None:
        given = self._settings
        samples = joined(self._pending)
        self._pending = []
        cut = windows_of(samples, given, self._ahead)
        n = len(samples)
        final = len(cut) if last else int(np.searchsorted(cut.bounds, n - SETTLED, side="right")) - 1
        if not last and n - cut.bounds[final] > LONGEST:
            final, self._cut = len(cut), self._cut + 1
        end = int(cut.bounds[final])
        if final:
            own = cut.taken(slice(end), cut.bounds[: final + 1])
            self._keep(replace(own, samples=samples.taken(slice(end))))
        self._waiting = self._carried = n - end
        if end < n:
            going_on = samples.stretch[end]
            before = self._ahead if samples.stretch[0] == going_on else 0
            self._ahead = int(np.count_nonzero(samples.stretch[:end] == going_on)) + before
            self._pending = [samples.taken(np.arange(end, n))]

    def _keep(self, cut: Windows) -> None:
        given = replace(self._settings.of_fits, at_stress=self._stress)
        fitted = estimators.estimate(cut, self._settings.method, None, given)
        if len(cut):
            self._stress = float(fitted.estimates.stress[0])
        table = segment_table.table(cut, fitted.estimates)
        self._mixed |= segment_table.several_terrains(cut.samples, table)
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
        self._estimates = [estimation.join(self._estimates)]
        return self._estimates[0]

    def account(self, remarks: Sequence[str]) -> dict[str, Any]:
        assert self._first is not None  # noqa: S101 - a wheel is there once it has samples
        remarks = list(remarks)
        if self._settings.automatic:
            remarks.append(
                f"a log of more than {MOST_ROWS:,} rows: c and φ are from the linear model, and their errors "
                "take its k and stresses as exact; --method wong-reece fits the full model, in memory"
            )
        if self._cut:
            often = f"every {LONGEST:,} samples or so ({self._cut} times)"
            remarks.append(f"{the_wheel(self._first.wheel)}: a soil that goes on is cut {often}")
        remarks += segment_table.mixed_terrain_notes(self._first.wheel, self._mixed)
        return account(self._first, self._rows, self._used, dict(self._reasons.most_common()), remarks)


def account(of: Samples, rows: int, used: int, reasons: dict[str, int], remarks: list[str]) -> dict[str, Any]:
    """Say what became of the samples of a wheel, as the summary shows it."""
    return {
        "wheel": of.wheel,
        "samples": rows,
        "used": used,
        "set_aside": reasons,
        "channels": of.origins,
        "remarks": remarks,
        "model": None,
    }


def read_ahead(parts: Iterable[Samples]) -> Iterator[Samples]:
    """Read some parts ahead in another thread, beside which this one goes on while NumPy works for either."""
    left: Iterator[Samples] = iter(parts)
    with ThreadPoolExecutor(1) as pool:
        try:
            waiting = deque(pool.submit(next, left, None) for _ in range(_AHEAD))
            while (part := waiting.popleft().result()) is not None:
                waiting.append(pool.submit(next, left, None))
                yield part
        finally:
            pool.shutdown(cancel_futures=True)
