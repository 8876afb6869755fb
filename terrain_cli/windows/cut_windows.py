"""Windows of homogeneous terrain: which usable samples belong together."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from terrain_cli.errors import InputError, UsageError
from terrain_cli.mechanics import linear
from terrain_cli.mechanics.rates import wheel_angle
from terrain_cli.telemetry.usable_samples import on_ground
from terrain_cli.telemetry.wheel_samples import NEEDED, Samples
from terrain_cli.vocabulary.arrays import Array, Bounds, Index, Mask
from terrain_cli.vocabulary.choices import CUT_SAMPLES, MIN_DISTANCE, Segments
from terrain_cli.windows.change_points import (
    Breaks,
    Means,
    change_points,
    needed,
    of_any_modulus,
    whole_windows,
)
from terrain_cli.windows.sinkage_changes import placed, placed_by_sinkage, sinkage_changes

#: Samples of an unbroken piece where windows are thinned, the fewest pieces of a window, and what is
#: kept of one at least.
_PIECE, _FEWEST, _LEAST_KEPT = 1000, 4, 200

#: Samples on either side that tell whether a wheel drives. On 18 wheels both 5 and 16 remove all ten cuts
#: within one soil where wheels roll freely; 16 leaves three more where slip changes fast.
NEAR = 5

#: Values of k by which the line of a soil is sought, in standard deviations of what is known of k. Of 258
#: drives over one to four soils the one k assumed, 5 and 9 leave 67, 31 and 29 false cuts, and miss 14 each.
_MODULI = np.linspace(-2.0, 2.0, 9)

#: What every verb reads of a log, and what effects follow: without them a soil would seem to change with it.
_FOLLOWED = (
    *("slip", "load", "angular_velocity", "motor_temperature", "pitch", "roll", "yaw_rate", "slip_angle"),
)
#: Windows of one input, some 1.5 kB each with their rows; judged: more than anyone reads, in 3 GB.
MOST = 2_000_000


@dataclass(frozen=True, kw_only=True)
class Windows:
    """The usable samples of a wheel, cut into windows."""

    samples: Samples
    rows: Index  # Shape (n,): the usable samples, as indices into `samples`
    bounds: Index  # Shape (windows + 1,): window j is ``rows[bounds[j]:bounds[j + 1]]``
    # x, y: shape (n,): coordinates in Pa of the line y = c + x tan φ of each usable sample; NaN without
    # torque or sinkage, and where the wheel skids, which no line covers
    x: Array
    y: Array
    by_soil: bool = False  # Whether they were cut where the soil seems to change, and not as somebody asked

    def __len__(self) -> int:
        return len(self.bounds) - 1

    @property
    def lined(self) -> bool:
        """Whether torque and sinkage are there, without which no sample has a line."""
        return _lined(self.samples)

    def measured(self) -> dict[str, Any]:
        """Return load, torque, sinkage and slip of the usable samples, in SI units."""
        return _measured(self.samples, self.rows)

    @property
    def line_columns(self) -> list[Array]:
        """x, y, load, torque, sinkage and slip of the usable samples, as estimators of the line take them."""
        return [self.x, self.y, *self.measured().values()]

    @property
    def driving(self) -> Mask:
        """Which of the usable samples are of a wheel that does not skid, shape (n,)."""
        return np.asarray(at_rows(self.samples.channels["slip"], self.rows) >= 0.0)

    def thinned(self, most: int) -> Self:
        """Return the same windows with no more samples of each than some number, evenly spread."""
        count = np.diff(self.bounds)
        if not np.any(count > most):
            return self
        step = np.maximum(-(-count // most), 1)
        place = np.arange(len(self.rows)) - np.repeat(self.bounds[:-1], count)
        chosen = np.flatnonzero(place % np.repeat(step, count) == 0)
        return self.taken(chosen, np.searchsorted(chosen, self.bounds))

    def groups(self, most: int) -> Iterator[Self]:
        """Yield runs of whole windows with so many samples together, or one window each."""
        for first, last in runs(self.bounds, most):
            bounds = self.bounds[first : last + 1]
            yield self.taken(slice(bounds[0], bounds[-1]), bounds - bounds[0])

    def on_line(self) -> Self:
        """Return the same windows without the samples of a skidding wheel."""
        driving = self.driving
        if driving.all():
            return self
        before = np.concatenate([[0], np.cumsum(driving)])
        return self.taken(driving, before[self.bounds])

    def taken(self, chosen: Index | Mask | slice, bounds: Index) -> Self:
        """Return windows of some of the usable samples, with bounds among these."""
        return replace(self, rows=self.rows[chosen], bounds=bounds, x=self.x[chosen], y=self.y[chosen])


def runs(bounds: Bounds, most: int) -> Iterator[tuple[int, int]]:
    """Part windows into runs of so many samples together, or one window each: first to last − 1."""
    first, windows = 0, len(bounds) - 1
    while first < windows:
        last = int(np.searchsorted(bounds, bounds[first] + most, side="right")) - 1
        last = min(max(last, first + 1), windows)
        yield first, last
        first = last


def at_rows(column: NDArray[Any], rows: Index) -> NDArray[Any]:
    """Return some values of a column: the column itself, not a copy, where these are all."""
    return column[which(rows, len(column))]


def which(rows: Index, n: int) -> Index | slice:
    """Return an index of rows that makes no copy where these are all n, in their order."""
    return slice(None) if len(rows) == n and bool(np.all(rows[1:] > rows[:-1])) else rows


def _lined(samples: Samples) -> bool:
    return {"torque", "sinkage"} <= samples.channels.keys()


def _measured(samples: Samples, rows: Index) -> dict[str, Any]:
    index = which(rows, len(samples))
    return {name: samples.channels[name][index] for name in NEEDED}


def line(samples: Samples, rows: Index) -> tuple[Array, Array]:
    """Return the coordinates x and y, in Pa, of samples on the soil's line."""
    return linear.line_coordinates(**_measured(samples, rows), **samples.geometry.line)


def _lines(samples: Samples, rows: Index, means: Means) -> list[tuple[Array, Array]]:
    """Return x and y by each k that the soils may have, up to two standard deviations from that assumed."""
    geometry = samples.geometry
    measured: dict[str, Any] = {name: means.of(c) for name, c in _measured(samples, rows).items()}
    return [
        linear.line_coordinates(**measured, **{**geometry.line, "shear_modulus": float(k)})
        for k in geometry.shear_modulus * geometry.shear_modulus_factor**_MODULI
    ]


def drives(slip: Array) -> Mask:
    """Tell in which samples a wheel drives on average over their neighbours.

    Where a wheel rolls freely, noise alone makes the slip of some samples positive: these have less torque
    than goes with it, and would look like another soil.
    """
    total = np.concatenate([[0.0], np.cumsum(slip)])
    place, n = np.arange(len(slip)), len(slip)
    return np.asarray(total[np.minimum(place + NEAR + 1, n)] >= total[np.maximum(place - NEAR, 0)])


def _coordinates(samples: Samples, rows: Index, driving: Index) -> tuple[Array, Array]:
    """Return x and y of some rows, NaN of those that are not driving, or have no line."""
    lined = _lined(samples)
    if lined and len(driving) == len(rows):
        return line(samples, rows)
    x, y = np.full((2, len(rows)), np.nan)
    if lined:
        x[driving], y[driving] = line(samples, rows[driving])
    return x, y


def cut(
    samples: Samples,
    method: Segments = "auto",
    *,
    min_samples: int | None = None,
    window_samples: int | None = None,
    window_distance: float | None = None,
    before: int = 0,
) -> Windows:
    """Cut the usable samples of a wheel into windows.

    "auto" cuts where the soil changes; "fixed" every so many samples or metres; "terrain" where the label
    changes; "none" makes one window for each continuous stretch. Of steady test points, and without torque,
    "auto" makes one window for each terrain label, or one of all. `before` counts the usable samples of the
    first stretch that came before these, which are a part of a long log.
    """
    labels = samples.labels.get("terrain")
    if method == "auto" and (samples.time is None or not _lined(samples)):
        # Steady test points have no order in which the soil could change, and without torque and sinkage
        # there is no line whose change would show it.
        method = "none" if labels is None else "terrain"
    # The soil changes in the same places for a model that does not cover a wheel that skids.
    rows = on_ground(samples.set_aside) if method == "auto" else samples.usable
    if samples.time is None and labels is not None and method == "terrain":
        rows = rows[np.argsort(labels.codes[rows], kind="stable")]
    index = which(rows, len(samples))
    slip = samples.channels["slip"][index]
    on_average = drives(slip)
    x, y = _coordinates(samples, rows, np.flatnonzero((slip >= 0.0) | on_average))
    # A soil goes on between pieces of one drive.
    stretch = (samples.stretch if samples.drive is None else samples.drive)[index]
    breaks = np.flatnonzero(np.diff(stretch)) + 1
    distance = samples.distance[index] if samples.distance is not None else None
    if method == "terrain":
        if labels is None:
            raise InputError(
                f"{samples}: there is no terrain label to cut by",
                hint="name its column, or its topic and field, as terrain under [channels] of rover.toml, "
                "or use --segments auto",
            )
        bounds = label_windows(labels.codes[rows], breaks=breaks)
    elif method == "fixed":
        if (window_samples is None) == (window_distance is None):
            raise UsageError(
                "--segments fixed needs the length of a segment",
                hint="give --window-samples N or --window-distance M",
            )
        if window_distance is not None and distance is None:
            raise InputError(
                f"{samples}: the distance is not known: there is no velocity, nor x and y",
                hint="use --window-samples N",
            )
        bounds = fixed_windows(
            len(rows), samples=window_samples, metres=window_distance, distance=distance, breaks=breaks
        )
    elif method == "auto":
        shortest = {
            "min_samples": CUT_SAMPLES if min_samples is None else min_samples,
            "min_distance": MIN_DISTANCE if window_distance is None else window_distance,
        }
        bounds = _where_soil_changes(samples, rows, (x, y), on_average, stretch, breaks, before, shortest)
    else:
        bounds = whole_windows(len(rows), breaks=breaks)
    x[slip < 0.0] = y[slip < 0.0] = np.nan
    windows = Windows(samples=samples, rows=rows, bounds=bounds, x=x, y=y, by_soil=method == "auto")
    usable = samples.set_aside.codes[rows] < 0
    if usable.all():
        return windows
    before_each = np.concatenate([[0], np.cumsum(usable)])
    return windows.taken(usable, np.unique(before_each[bounds]))


def _where_soil_changes(
    samples: Samples,
    rows: Index,
    coordinates: tuple[Array, Array],
    on_average: Mask,
    stretch: Index,
    breaks: Index,
    before: int,
    shortest: dict[str, Any],
) -> Bounds:
    """Return the bounds of windows of some rows, with `coordinates` on the line, where the soil changes."""
    index = which(rows, len(samples))
    slip, (x, y) = samples.channels["slip"][index], coordinates
    seen, driving = np.flatnonzero((slip >= 0.0) | on_average), np.flatnonzero(on_average)

    def known(
        chosen: Index,
    ) -> tuple[Index | slice, Index, tuple[Array, Array], tuple[Array, Array, Array], dict[str, Any]]:
        at = which(chosen, len(rows))
        own = breaks if len(chosen) == len(rows) else np.flatnonzero(np.diff(stretch[at])) + 1
        load, sinkage = (samples.channels[name][index][at] for name in ("load", "sinkage"))
        limits = {**shortest, "distance": None if samples.distance is None else samples.distance[index][at]}
        return at, own, (x[at], y[at]), (load, sinkage, slip[at]), limits

    at, own, lines, wheel, limits = known(driving)
    followed = drivers(samples, which(rows[at], len(samples)))
    followed += [turn[:, at] for turn in _turns(samples, index, stretch)]
    changes = change_points(*lines, breaks=own, before=before, **limits)
    if len(changes) > len(own) + 2:
        means = Means(changes)
        tried = _lines(samples, rows[at], means)
        places = of_any_modulus(tried, *map(means.places, (changes, own)), before=before // means.step)
        changes = means.edges[places]
    changes = needed(*lines, followed, changes, own)
    changes = sinkage_changes(*wheel, followed, changes, before=before, **limits)
    inner = driving[np.setdiff1d(changes[1:-1], own, assume_unique=True)]
    # Where soils meet under a wheel that rolls freely, the few samples on the line still tell where.
    _, own, lines, wheel, limits = known(seen)
    changes = whole_windows(len(seen), breaks=np.concatenate([own, np.searchsorted(seen, inner)]))
    changes = placed(lines, wheel, changes, own, **limits)
    inner = np.setdiff1d(changes[1:-1], own, assume_unique=True)
    bounds = whole_windows(len(rows), breaks=np.concatenate([breaks, seen[inner]]))
    # Where a wheel skids between two soils no line tells, but the sinkage does.
    inner = placed_by_sinkage(known(np.arange(len(rows)))[3], bounds, seen[inner], seen[inner - 1] + 1)
    return whole_windows(len(rows), breaks=np.concatenate([breaks, inner]))


def drivers(samples: Samples, rows: Index | slice) -> list[Array]:
    """Return what the line of a soil may seem to follow in some rows where the model lacks an effect."""
    channels = {name: samples.channels[name][rows] for name in _FOLLOWED if name in samples.channels}
    # A wheel that slides to the left loses as much as one that slides to the right.
    return [np.abs(values) if name == "slip_angle" else values for name, values in channels.items()]


def _turns(samples: Samples, rows: Index | slice, stretch: Index) -> Iterator[Array]:
    """Yield the sine and the cosine of the angle that the wheel has turned, shape (2, n), if it turns."""
    omega = samples.channels.get("angular_velocity")
    if omega is not None and samples.time is not None:
        angle = wheel_angle(samples.time[rows], stretch, omega[rows])
        if angle.any():
            yield np.stack([np.sin(angle), np.cos(angle)])


def label_windows(codes: ArrayLike, *, breaks: Breaks = ()) -> Bounds:
    """Return a window for each run of samples with the same label, or all without one."""
    labels = np.asarray(codes)
    changes = np.flatnonzero(labels[1:] != labels[:-1]) + 1
    return whole_windows(len(labels), breaks=np.concatenate([changes, breaks]))


def fixed_windows(
    n: int,
    *,
    samples: int | None = None,
    metres: float | None = None,
    distance: Array | None = None,
    breaks: Breaks = (),
) -> Bounds:
    """Return windows of one length, counted anew from each break; what is left at its end is one too."""
    bounds = whole_windows(n, breaks=breaks)
    length = samples if samples is not None else float(metres or 0.0)
    if not length > 0:
        raise ValueError(f"a window of {length} holds no sample")
    passed = np.arange(n) if samples is not None or distance is None else distance
    inner = []
    for a, b in pairwise(bounds):
        # A hair before the mark: 0.3 m are three windows of 0.1 m whatever the rounding.
        window = np.floor((passed[a:b] - passed[a]) / length + 1e-9)
        inner.append(a + 1 + np.flatnonzero(window[1:] != window[:-1]))
    return np.unique(np.concatenate([bounds, *inner])).astype(np.intp)


def check_number(source: str, count: int) -> None:
    """Refuse more windows than can be held."""
    if count > MOST:
        raise InputError(
            f"{source}: more than {MOST:,} segments",
            hint="make them longer (--window-samples, --window-distance, --min-samples), or split the log",
        )


def unbroken(windows: Windows) -> Windows:
    """Return the same samples, cut only where the drive breaks off or the terrain label changes."""
    samples, rows = windows.samples, windows.rows
    labels = samples.labels.get("terrain")
    drive = samples.stretch if samples.drive is None else samples.drive
    breaks = np.flatnonzero(np.diff(drive[rows])) + 1
    codes = np.zeros(len(rows)) if labels is None else labels.codes[rows]
    return windows.taken(slice(None), label_windows(codes, breaks=breaks))


def by_terrain(windows: Windows, step: int = 1) -> tuple[Windows, Index] | None:
    """Join the windows of each terrain, if not one each, of every `step`-th sample; say which these are."""
    labels, rows = windows.samples.labels.get("terrain"), windows.rows
    terrain = np.zeros(len(rows), dtype=np.intp) if labels is None else labels.codes[rows].astype(np.intp)
    order = np.argsort(terrain, kind="stable")[::step]
    names, counts = np.unique(terrain[order], return_counts=True)
    if len(names) >= len(windows):
        return None
    return windows.taken(order, np.concatenate([[0], np.cumsum(counts)]).astype(np.intp)), order


def thinned(windows: Windows, share: float) -> Windows:
    """Keep a share of every window, more of short ones, in unbroken pieces, each a stretch of its own."""
    kept = []
    for start, stop in zip(windows.bounds[:-1], windows.bounds[1:], strict=True):
        size = int(stop - start)
        wanted = min(size, max(_LEAST_KEPT, round(size * share)))
        count = max(_FEWEST, round(wanted / _PIECE)) if wanted < size else 1
        length = wanted // count
        begins = np.linspace(0, size - length, count).astype(int)
        kept.append(start + (begins[:, None] + np.arange(length)).ravel())
    return pieces(windows, np.concatenate([np.zeros(0, dtype=np.intp), *kept]))


def pieces(windows: Windows, chosen: Index) -> Windows:
    """Keep some of the usable samples; those between which others are left out are of other stretches."""
    rows, stretch = windows.rows, windows.samples.stretch.copy()
    kept = np.zeros(len(rows), dtype=bool)
    kept[chosen] = True
    breaks = np.diff(kept) | (np.diff(stretch[rows]) != 0)
    stretch[rows] = np.cumsum(np.concatenate([[False], breaks])[: len(rows)])
    kept_windows = windows.taken(chosen, np.unique(np.searchsorted(chosen, windows.bounds)))
    return replace(kept_windows, samples=replace(windows.samples, stretch=stretch))
