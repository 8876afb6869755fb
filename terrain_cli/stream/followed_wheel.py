"""One wheel that is followed: from its samples to the rows of its segments, closed and open."""

import sys
from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from terrain_cli.errors import InputError
from terrain_cli.estimation import WindowEstimates, assumed, estimators
from terrain_cli.estimation.estimators import Fitted
from terrain_cli.estimation.line.pooled import RecursiveLine
from terrain_cli.estimation.strength import with_strengths
from terrain_cli.estimation.wheel_fit import Noise
from terrain_cli.models import ModelFile
from terrain_cli.presentation import segment_table
from terrain_cli.run.long_log import BEHIND, with_behind
from terrain_cli.run.settings import Settings
from terrain_cli.stream.model_watch import ModelMiss, ModelWatch
from terrain_cli.telemetry import Samples, effect_inputs
from terrain_cli.telemetry.long_logs import joined
from terrain_cli.telemetry.wheel_samples import NEEDED
from terrain_cli.vocabulary.arrays import Array
from terrain_cli.vocabulary.choices import CUT_SAMPLES, FIT_SAMPLES, MIN_DISTANCE
from terrain_cli.windows import cut_windows
from terrain_cli.windows.online_cuts import SETTLED, Driven, OnlineCuts

#: Samples of a segment at the most, some 100 bytes each: a soil that goes on for longer is cut there.
LONGEST = 1 << 17
#: What estimates and rows are made of; the effects of a model may need anything.
_KEPT = {*NEEDED, "drawbar_pull", "x", "y", "longitude", "latitude"}
#: What takes far longer than the rest of an open row, and hardly depends on the last samples, is found anew
#: when a segment has grown by this factor: the noise of the full model, and what a line assumes.
_GROWN = 1.5
#: Segments that are fitted again with the next one, and samples of each: the sensors and the effects are
#: those of all. benchmarks/follow_agreement.py: of 240 rows over six soils 29, 65, 89 and 100 % have the φ of
#: the log so far with 0, 2, 4 and 8 such segments, in 0.12, 0.17, 0.18 and 0.19 s.
_EARLIER, _OF_EACH = 8, 4000
#: Segments that are held at the most to be told again at the end: some 20 MB if all are long. Judged.
_HELD = 64
#: Columns of the table that follow from the fit of the full model.
_OF_FIT = (
    *("method", "status", "c_kPa", "c_se_kPa", "phi_deg", "phi_se_deg", "corr_c_phi", "k_mm"),
    *("sigma_star_kPa", "strength_kPa", "strength_se_kPa"),
    *("stress_kPa", "strength_at_stress_kPa", "strength_at_stress_se_kPa", "torque_rmse_Nm"),
)
#: The model is set against samples that are this many seconds and `SETTLED` samples old: by then 95 % of the
#: changes of soil before them are told, which are no fault of a model.
_WATCHED_AFTER = 25.0
_LOOK = 5.0  # Seconds between two looks
_TOGETHER = 64  # Samples that are taken at once where a model is watched
#: Pieces that are held before all are joined: so many that copies of long segments take no time.
_PIECES = 1024


@dataclass
class CommonStress:
    """The stress at which all segments of a stream are compared, in Pa; that of the first if not given."""

    value: float | None


class OpenSegment:
    """Usable samples in the order of time; those set aside are counted behind the one before."""

    def __init__(self) -> None:
        self._pieces: list[Samples] = []
        self.count = self.ahead = 0  # Samples, and those set aside ahead of the first

    def add(self, samples: Samples) -> None:
        """Take the samples that follow, with what is behind each among their drivers."""
        self.count += len(samples)
        self._pieces.append(samples)
        if len(self._pieces) > _PIECES:
            self.whole()

    def set_aside(self, count: int) -> None:
        if self.count:
            self._pieces[-1].drivers[BEHIND][-1] += count
        else:
            self.ahead += count

    def whole(self) -> Samples:
        """Return all of it; one sample at least."""
        self._pieces = [joined(self._pieces)]
        return self._pieces[0]

    def split(self, first: int) -> Samples:
        """Take the first so many samples away, and return them."""
        whole = self.whole()
        self._pieces = [] if first == self.count else [whole.taken(slice(first, None))]
        self.count -= first
        return whole if not self.count else whole.taken(slice(0, first))


class FollowedWheel:
    """Segments of a wheel as they close, and the one that is open."""

    def __init__(
        self, settings: Settings, file: ModelFile | None, stress: CommonStress, *, again: bool = False
    ) -> None:
        """Prepare; what tells all segments `again` at the end is held, if wanted."""
        self._settings, self._file, self._stress = settings, file, stress
        self._effects = () if file is None else file.model.effects
        self._segment = OpenSegment()
        self._watch = ModelWatch(file) if file is not None and settings.model is not None else None
        #: What the model was found to miss; whoever tells it empties this.
        self.alarms: list[ModelMiss] = []
        self._stretch: int | None = None
        #: The last closed segments: the row of each, and some of its samples.
        self._held: deque[tuple[segment_table.Table, Samples]] = deque(maxlen=_HELD if again else _EARLIER)
        self._begin()
        self.mixed: set[str] = set()  # What closed segments of more than one terrain are called
        self.closed = self.cut = 0  # Closed segments, and those of them that were cut as they became too long

    def _begin(self) -> None:
        """Begin a stretch: what came before it says nothing of where its soil changes."""
        least, distance = self._settings.min_samples, self._settings.window_distance
        self._cuts = OnlineCuts(
            min_samples=CUT_SAMPLES if least is None else least,
            min_distance=MIN_DISTANCE if distance is None else distance,
        )
        self._driven = Driven()
        #: Samples of the stretch before the open segment.
        self._past = 0
        self._looked = -np.inf
        self._label: str | None = None
        self._anew()

    def _anew(self) -> None:
        """Begin a segment with the samples that are held."""
        self._line = RecursiveLine()
        self._moved: Array | None = None
        self._noise: Noise | None = None
        self._known_at = 0
        if self._watch:
            self._watch.begin()
        if self._segment.count:
            held = self._segment.whole()
            self._line.add(_driving(held, cut_windows.line(held, np.arange(len(held)))))

    def take(self, part: Samples) -> Iterator[segment_table.Table]:
        """Take the samples that follow; yield the row of each segment that they close."""
        used, ahead = with_behind(part, part.usable)
        self._segment.set_aside(ahead)
        bounds = [0, *(np.flatnonzero(np.diff(used.stretch)) + 1).tolist(), len(used)] if len(used) else []
        for begin, end in pairwise(bounds):
            piece = used if end - begin == len(used) else used.taken(slice(begin, end))
            if self._stretch is not None and piece.stretch[0] != self._stretch:
                yield from self.end()
            self._stretch = int(piece.stretch[0])
            yield from self._follow(piece)

    def _follow(self, piece: Samples) -> Iterator[segment_table.Table]:
        left: Samples | None = piece
        while left is not None:
            room = self._room(left)
            size = min(room, LONGEST - self._segment.count, len(left))
            if self._watch:
                # What has passed is watched before it is closed, however much comes at once.
                size = min(size, _TOGETHER)
            taken = left if size == len(left) else left.taken(slice(0, size))
            left = None if size == len(left) else left.taken(slice(size, None))
            if size:
                yield from self._take(taken)
            if size == room:
                yield self._close(self._segment.count)
            elif self._segment.count >= LONGEST:
                self.cut += 1
                yield from self.end()

    def _room(self, piece: Samples) -> int:
        """Return how many samples of a piece still belong to the open segment, where that shows at once."""
        given = self._settings
        if given.segments == "fixed":
            return (given.window_samples or sys.maxsize) - self._segment.count
        labels = piece.labels.get("terrain")
        if given.segments != "terrain" or labels is None:
            return sys.maxsize
        names = np.array([*labels.names, None], dtype=object)[labels.codes]
        self._label = self._label if self._segment.count else names[0]
        other = np.flatnonzero(names != self._label)
        return int(other[0]) if len(other) else sys.maxsize

    def _take(self, piece: Samples) -> Iterator[segment_table.Table]:
        place = self._past + self._segment.count
        line = cut_windows.line(piece, np.arange(len(piece)))
        if not self._effects:
            kept = {name: column for name, column in piece.channels.items() if name in _KEPT}
            self._segment.add(replace(piece, channels=kept))
        else:
            self._segment.add(piece)
        self._line.add(_driving(piece, line))
        if self._settings.segments == "auto":
            yield from self._search(piece, place, line)
        self._look(piece)

    def _search(self, piece: Samples, place: int, line: tuple[Array, Array]) -> Iterator[segment_table.Table]:
        """Close what ends at a change of soil that is sure by now; `place` is that of the piece."""
        nothing = np.full(len(piece), np.nan)
        columns = np.array(
            [
                place + np.arange(len(piece)),
                nothing if piece.time is None else piece.time,
                *line,
                nothing if piece.distance is None else piece.distance,
                *(piece.channels[name] for name in ("load", "sinkage")),
                *cut_windows.drivers(piece, slice(None)),
            ]
        )
        for bound in self._cuts.add(self._driven.add(columns)):
            yield self._close(bound - self._past)

    def _look(self, piece: Samples) -> None:
        """Set the model against what is old enough, now and then."""
        if self._watch is None or piece.time is None or not piece.time[-1] >= self._looked + _LOOK:
            return
        self._looked = float(piece.time[-1])
        whole = self._segment.whole()
        assert whole.time is not None  # noqa: S101 - its last part has one
        old = int(np.searchsorted(whole.time, self._looked - _WATCHED_AFTER))
        self.alarms += self._watch.look(whole, min(old, self._segment.count - SETTLED))

    def end(self) -> Iterator[segment_table.Table]:
        """End the stretch: close what is open."""
        if self._settings.segments == "auto":
            told = self._cuts.add(self._driven.end())
            for bound in (*told, *self._cuts.end()):
                yield self._close(bound - self._past)
        if self._segment.count:
            yield self._close(self._segment.count)
        self._begin()

    def _close(self, count: int) -> segment_table.Table:
        """Estimate the first so many samples of what is open, and give up holding them."""
        samples = self._with_effects(self._segment.split(count))
        self._past += count
        row, fitted = self._fitted(samples)
        self.mixed |= segment_table.several_terrains(samples, row)
        self._stress.value = estimators.common_stress(self._stress.value, fitted.estimates)
        if self._file is not None:
            self._held.append((row, samples.taken(slice(None, None, -(-count // _OF_EACH)))))
        self.closed += 1
        self._segment.ahead = 0
        self._anew()
        return row

    def _fitted(self, samples: Samples, begun: Noise | None = None) -> tuple[segment_table.Table, Fitted]:
        """Estimate a segment beside some samples of those before it; return its row, and the fit of all."""
        held = [part for _, part in self._held]
        cut, fitted = self._fit([*held[max(len(held) - _EARLIER, 0) :], samples], self._stress, begun)
        return self._row(cut, fitted.estimates, samples), fitted

    def _fit(
        self, segments: list[Samples], stress: CommonStress, begun: Noise | None = None
    ) -> tuple[cut_windows.Windows, Fitted]:
        parts = [replace(part, stretch=np.full(len(part), place)) for place, part in enumerate(segments)]
        cut = cut_windows.cut(joined(parts), "none")
        given = replace(self._settings.of_fits, at_stress=stress.value)
        return cut, estimators.estimate(cut, self._settings.method, self._file, given, begun=begun)

    def again(self, stress: CommonStress) -> list[segment_table.Table]:
        """Return the rows held, with what a fit of all their segments says; none of the line alone."""
        if not self._held:
            return []
        cut, fitted = self._fit([part for _, part in self._held], stress)
        stress.value = estimators.common_stress(stress.value, fitted.estimates)
        found = segment_table.table(cut, fitted.estimates)
        own = [{name: found[name][place : place + 1] for name in _OF_FIT} for place in range(len(self._held))]
        return [{**row, **columns} for (row, _), columns in zip(self._held, own, strict=True)]

    def _with_effects(self, samples: Samples) -> Samples:
        """Return samples with what effects need: rates know now what came behind."""
        if not self._effects:
            return samples
        drivers = dict(samples.drivers)
        for name, values in effect_inputs.of_samples(samples, self._effects).items():
            drivers[name] = np.where(np.isfinite(values), values, drivers.get(name, np.nan))
        return replace(samples, drivers=drivers)

    def _row(
        self, cut: cut_windows.Windows, estimates: WindowEstimates, samples: Samples
    ) -> segment_table.Table:
        """Return the last row of a table, which is that of these samples."""
        row = {name: column[-1:] for name, column in segment_table.table(cut, estimates).items()}
        row["segment"] = np.array([self.closed + 1])
        row["n_rejected"] = np.array([int(samples.drivers[BEHIND].sum()) + self._segment.ahead])
        return row

    def open_row(self) -> segment_table.Table | None:
        """Return the row of the open segment; None where there is none."""
        if not self._segment.count:
            return None
        whole = self._segment.whole()
        if len(whole) > _GROWN * self._known_at:
            self._moved, self._noise, self._known_at = None, None, len(whole)
        return self._open_fit(whole) or self._open_line(whole)

    def _open_fit(self, whole: Samples) -> segment_table.Table | None:
        """Return the row by the full model; None where it is not chosen, or the samples tell no soil yet."""
        least = self._settings.min_samples or FIT_SAMPLES
        if self._file is None or len(whole) < least:
            return None
        try:
            row, fitted = self._fitted(self._with_effects(whole), self._noise)
        except InputError:
            # The row of the closed segment says what is wrong with it.
            return None
        self._noise = fitted.noise
        return row if np.isfinite([row["c_kPa"][0], row["phi_deg"][0]]).all() else None

    def _open_line(self, whole: Samples) -> segment_table.Table | None:
        """Return the row by the recursive estimator."""
        cut = cut_windows.cut(whole, "none").on_line()
        if not len(cut.rows):
            return None
        line = estimators.estimate_lines(cut, "recursive", self._settings.of_fits)
        if self._moved is None:
            self._moved = assumed.deviations(line, cut, "recursive")
        line = assumed.with_assumptions(line, cut, "recursive", self._moved)
        return self._row(cut, with_strengths(line, cut, self._stress.value), whole)

    @property
    def soil(self) -> tuple[float, float, int]:
        """Cohesion in Pa, tan φ and the samples of the open segment, after every sample."""
        return *self._line.soil, self._segment.count


def _driving(piece: Samples, line: tuple[Array, Array]) -> Array:
    """Return x and y of a wheel that does not skid, shape (2, n)."""
    return np.array(line)[:, piece.channels["slip"] >= 0.0]
