"""Doubts about the units of channels, from their sizes and from how they change together."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from itertools import pairwise
from typing import Literal, NamedTuple, Self

import numpy as np

from formats.recovery import Notice
from terrain_cli.errors import InputError
from terrain_cli.telemetry import rover_advice
from terrain_cli.telemetry.derived_channels import stands
from terrain_cli.telemetry.wheel_samples import Feed, Geometry, Plan, Samples
from terrain_cli.vocabulary import units
from terrain_cli.vocabulary.arrays import Array, Index
from terrain_cli.vocabulary.channels import CHANNELS
from terrain_cli.vocabulary.quantities import the_wheel

#: Samples that are kept: the 5th and 95th percentile of so many are known to a hundredth of a deviation.
MOST = 1 << 14
BLOCKS = 8  # Blocks into which a part is cut to set the distance beside the track: enough for a median
#: Metres in a degree of the Earth's meridian. The Moon's is 0.27 of that: no check is so fine as to see it.
_DEGREE = 111_195.0
ALIKE = {"x": "y", "longitude": "latitude"}  # What has the unit of another channel
#: Samples of which none differs from the others; and what a person reads off a scale.
STUCK, ROUNDED = 20, ("sinkage", "entry_angle")
LONG = 0.1  # Share of a drive in which a channel is frozen, that weighs on an estimate. Judged.
#: Change of DP over that of T/r, in a stretch of an eighth of the drive, of at least ten samples, in which
#: they follow each other at the same load. Simulated drives of every soil, manoeuvre and effect of the
#: catalogue, with noise up to 5 %: 0.57 to 1.06; of 30 with slip-sinkage on clay, up to 1.6 times its full
#: size, 0.35 to 0.87. A pull in pounds that is read in newtons has 0.22 of it. Where they were less alike,
#: noise or soils that change within a stretch made 0.04.
LEAST_PULL, MOST_PULL, ALIKE_PULL, FEWEST = 0.3, 1.2, 0.9, 10
_PULL = 0.95  # What a typical drive has of that
#: How much wider T/r − W tan(θ1/2) less the pull scatters than with the pull turned round: the two are equal
#: for triangular stresses. Of 350 simulated drives 337 have less than 0.5; strong slip-sinkage made 1.46.
WIDER = 2.0


class UnitEvidence:
    """Some samples of a wheel that turns, evenly spread, and what needs every sample."""

    def __init__(self, geometry: Geometry, feeds: Mapping[str, Feed]) -> None:
        self.geometry, self.feeds = geometry, feeds
        #: Channels that are neither derived nor a constant of rover.toml.
        self.measured = frozenset(name for name, feed in feeds.items() if feed.constant is None)
        self.interval = np.nan  # Median time between two samples in s; NaN without a clock
        self.count = 0  # Samples of which the ends are known
        #: The places are longitudes and latitudes, or metres of a map: from a satellite receiver.
        self.on_earth = False
        self.ends: dict[str, tuple[float, float]] = {}  # Least and greatest value of each channel
        #: Of each block: metres by time and velocity, metres along the track, metres from its first place to
        #: its last, and how much of that is the jitter of the places.
        self.blocks: list[tuple[float, float, float, float]] = []
        self._kept: dict[str, Array] = {}
        self._step, self._skip = 1, 0

    def columns(self, *names: str) -> list[Array] | None:
        """Return the samples in which each of some channels is known; None of fewer than a median needs."""
        if not all(name in self._kept for name in names):
            return None
        columns = np.array([self._kept[name] for name in names])
        columns = columns[:, np.isfinite(columns).all(axis=0)]
        return list(columns) if columns.shape[1] >= 5 else None

    def add(self, part: Samples) -> None:
        channels = part.channels
        if part.time is not None and np.isnan(self.interval):
            steps = np.abs(np.diff(part.time[np.isfinite(part.time)]))
            self.interval = float(np.median(steps)) if len(steps) else np.nan
        self._add_track(part)
        omega = channels.get("angular_velocity")
        turning = np.full(len(part), fill_value=True) if omega is None else ~stands(omega)
        rows = np.flatnonzero(turning)
        self.count += len(rows)
        for name, values in channels.items():
            known = values[rows]
            known = known[np.isfinite(known)]
            if len(known):
                least, greatest = self.ends.get(name, (np.inf, -np.inf))
                self.ends[name] = min(least, float(known.min())), max(greatest, float(known.max()))
        while len(rows) > MOST * self._step:
            self._thin()
        chosen = rows[self._skip :: self._step]
        self._skip = (self._skip - len(rows)) % self._step
        for name in channels:
            kept = self._kept.get(name, np.empty(0))
            self._kept[name] = np.concatenate([kept, channels[name][chosen]])
        while len(next(iter(self._kept.values()), ())) > MOST:
            self._thin()

    def _thin(self) -> None:
        self._kept = {name: values[::2] for name, values in self._kept.items()}
        self._step *= 2

    def _add_track(self, part: Samples) -> None:
        """Set the distance beside the track, where they are from different channels."""
        channels = part.channels
        if part.distance is None or "velocity" not in channels:
            return
        geographic = not channels.keys() >= {"x", "y"}
        names = ("longitude", "latitude") if geographic else ("x", "y")
        if not channels.keys() >= set(names):
            return
        x, y = (channels[name] for name in names)
        rows = np.flatnonzero(np.isfinite(x) & np.isfinite(y))
        if len(rows) <= BLOCKS:
            return
        x, y = x[rows], y[rows]
        if geographic:
            x, y = x * _DEGREE * np.cos(np.radians(np.median(y))), y * _DEGREE
        # Eastings and northings of a map are large numbers; a site begins at its origin.
        self.on_earth |= bool(geographic or np.median(np.abs(y)) > 1e5)
        driven, stretch = part.distance[rows], part.stretch[rows]
        bounds = np.linspace(0, len(rows), BLOCKS + 1).astype(int)
        self.blocks += [_block(driven[a:b], x[a:b], y[a:b], stretch[a:b]) for a, b in pairwise(bounds)]


def _block(driven: Array, x: Array, y: Array, stretch: Index) -> tuple[float, float, float, float]:
    """Measure the longest stretch of a block in each way."""
    own = stretch == np.bincount(stretch - stretch[0]).argmax() + stretch[0]
    driven, x, y = driven[own], x[own], y[own]
    with np.errstate(over="ignore", invalid="ignore"):
        steps = np.hypot(np.diff(x), np.diff(y))
        # White noise σ of the places makes second differences of 1.65 σ in the median.
        jitter = max(float(np.median(np.abs(np.diff(c, 2)))) if len(c) > 2 else 0.0 for c in (x, y))
        ends = float(np.hypot(x[-1] - x[0], y[-1] - y[0]))
        return float(driven[-1] - driven[0]), float(steps.sum()), ends, jitter


class Doubt(Notice):
    """A remark that says that what was measured is hardly true."""

    __slots__ = ("beyond", "of")

    of: str  # Such as "the sign of drawbar pull", where a line of rover.toml would settle it; else empty
    #: Of a sensor that is stuck or at its limit, the condition of the other samples: "torque < 10.3"
    beyond: str

    def __new__(cls, text: str, of: str = "", beyond: str = "") -> Self:
        self = super().__new__(cls, text)
        self.of, self.beyond = of, beyond
        return self


class ImplausibleError(InputError):
    """What was measured cannot be true; the unit of a channel is likely to be wrong."""


class Mend(NamedTuple):
    """A unit that a channel may be in."""

    channel: str
    unit: str
    scale: float = 1.0  # To that unit: 0.001 kgf are grams

    @property
    def factor(self) -> float:
        """What the values read so far are multiplied by."""
        unit = units.parse(self.unit, CHANNELS[self.channel].dimension)
        return self.scale * (unit.factor if unit else 1.0)


Weight = Literal["odd", "impossible", "contradiction"]


class Suspicion(NamedTuple):
    """A unit or sign that is improbable, and what would mend it."""

    what: str
    #: Whose unit or sign it may be.
    channel: str
    mend: Mend | None = None
    #: The last two are errors: what no unit makes true, unless the file or rover.toml states the unit;
    #: channels that contradict each other, unless rover.toml does.
    weight: Weight = "odd"
    beyond: str = ""  # As in `Doubt`


def tell(layout: Plan, wheel: str, feeds: Mapping[str, Feed], suspicions: Iterable[Suspicion]) -> list[Doubt]:
    """Say what is hardly true of a wheel, and what would mend it; what cannot be true is an error."""
    told = []
    for suspicion in suspicions:
        feed = feeds.get(suspicion.channel)
        what, weight = f"{the_wheel(wheel)}: {suspicion.what}", suspicion.weight
        if feed is None:
            told.append(Doubt(what))
            continue
        header, lines = rover_advice.header(layout, wheel, suspicion.channel), _lines(feeds, suspicion)
        if weight != "odd" and not (feed.stated and (feed.asked or weight == "impossible")):
            unit = f"state the unit of {suspicion.channel} in rover.toml; {_if(feed, suspicion)}:"
            hint = [unit, header, *lines]
            raise ImplausibleError(f"{layout.source.path}: {what}", hint="\n".join(hint))
        if suspicion.beyond:
            told.append(
                Doubt(f"{what}; to leave these out: --where '{suspicion.beyond}'", "", suspicion.beyond)
            )
        elif suspicion.mend is None:
            told.append(Doubt(f"{what}; check the sensor of {feed.place}"))
        else:
            mending = f"{_if(feed, suspicion)}, {', '.join(lines)} under {header} of rover.toml"
            # Who states the unit in rover.toml has looked.
            sign = "sign" if suspicion.mend.scale < 0.0 else "unit"
            of = f"the {sign} of {suspicion.mend.channel.replace('_', ' ')}"
            told.append(Doubt(f"{what}: {mending}", "" if feed.stated and feed.asked else of))
    return told


def _lines(feeds: Mapping[str, Feed], suspicion: Suspicion) -> list[str]:
    """Write the line of rover.toml that mends it, or else the one that says that nothing is to mend."""
    channel = suspicion.channel
    own = CHANNELS[channel].unit
    _, unit, scale = suspicion.mend or Mend(channel, own.symbol if own else "1")
    names = (channel, ALIKE.get(channel, channel))
    return [rover_advice.entry(feeds[name], unit, scale) for name in dict.fromkeys(names) if name in feeds]


def _if(feed: Feed, suspicion: Suspicion) -> str:
    if suspicion.mend is None:
        return "if the one taken is right"
    _, unit, scale = suspicion.mend
    if scale < 0.0:
        return "if the sensor's sign is the other way round"
    return f"if {suspicion.channel} is in {rover_advice.meant(feed, unit, scale)}"


def pull(e: UnitEvidence) -> Suspicion | None:
    """Set the changes of the drawbar pull against those of the torque, at the same load."""
    # Both are the shear stress under the wheel: in a stretch of a drive the pull changes by as much as T/r.
    # On a slope the weight pulls too.
    moved = ("load", "pitch") if "pitch" in e.measured else ("load",)
    found = e.columns("drawbar_pull", "torque", *moved) if {"drawbar_pull", "time"} <= e.measured else None
    if found is None:
        return None
    force, torque, *others = found
    middle = odd_changes(force, torque / e.geometry.radius, others)
    # A torque that brakes is in doubt itself: as it is, it says nothing of the sign of the pull.
    if np.median(torque) < 0.0 and not (middle or 0.0) > 0.0:
        return None
    if middle is None:
        return _turned_round(e)
    share = f"{middle:.2g} of what torque over wheel radius changes by"
    what = f"drawbar_pull changes by {share}, at the same load"
    options = {
        **{Mend("drawbar_pull", unit): 1.0 for unit in ("kgf", "lbf", "kN", "mN")},
        Mend("drawbar_pull", "kgf", 1e-3): 1.0,
        **{Mend("torque", unit): -1.0 for unit in ("lbf ft", "N mm", "N cm", "kN m")},
        Mend("motor_current", "mA"): -1.0,
    }
    there = [mend for mend in options if mend.channel in e.feeds]
    best = min(there, key=lambda m: abs(np.log(abs(middle) * m.factor ** options[m] / _PULL)))
    if middle < 0.0:
        best = Mend("drawbar_pull", "N", -1.0)
    return Suspicion(what, best.channel, best)


def _turned_round(e: UnitEvidence) -> Suspicion | None:
    """Tell whether the pull goes against what the torque pushes with beyond what the soil resists."""
    found = e.columns("drawbar_pull", "torque", "load", "sinkage")
    if found is None:
        return None
    force, torque, load, depth = found
    radius = e.geometry.radius
    with np.errstate(invalid="ignore"):
        push = torque / radius - load * np.sqrt(depth / (2.0 * radius - depth))
        scatter = [float(np.nanstd(push - sign * force)) for sign in (1.0, -1.0)]
    if not scatter[0] > WIDER * scatter[1]:
        return None
    what = "drawbar_pull falls where torque over wheel radius, less what the soil resists, rises"
    return Suspicion(what, "drawbar_pull", Mend("drawbar_pull", "N", -1.0))


def odd_changes(force: Array, rim: Array, others: Sequence[Array]) -> float | None:
    """Return the ratio of the changes of a pull and of T/r in a drive, typically; None where it is usual."""
    bounds = np.linspace(0, len(force), BLOCKS + 1).astype(int)
    parts = [slice(a, b) for a, b in pairwise(bounds) if b - a >= FEWEST]
    times = [_changes(force[part], rim[part], [column[part] for column in others]) for part in parts]
    known = sorted(value for value in times if value is not None)
    if len(known) < max(1.0, BLOCKS / 2):
        return None
    # A wrong unit is the same in every stretch, a drag that comes and goes is not: one of eight may differ.
    spared = len(known) // BLOCKS
    usual = known[spared] <= MOST_PULL and known[-1 - spared] >= LEAST_PULL
    return None if usual else float(np.median(known))


def _changes(pull: Array, rim: Array, others: list[Array]) -> float | None:
    """Return the ratio of the changes of two forces, less what goes with `others`, that follow each other."""
    with np.errstate(all="ignore"):
        scaled = [column / max(np.max(np.abs(column)), 1e-300) for column in others]
        known = np.column_stack([*scaled, np.ones(len(pull))])
        parts = np.column_stack([pull, rim])
        if not np.isfinite(known).all():
            return None
        pull, rim = (parts - known @ np.linalg.lstsq(known, parts, rcond=None)[0]).T
        alike = float(pull @ rim / np.sqrt((pull @ pull) * (rim @ rim)))
        return float(np.copysign(np.std(pull) / np.std(rim), alike)) if abs(alike) > ALIKE_PULL else None


def stuck(name: str) -> Callable[[UnitEvidence], Suspicion | None]:
    """Return a check of a channel that must change where slip or load do."""

    def check(e: UnitEvidence) -> Suspicion | None:
        least, greatest = e.ends.get(name, (0.0, 1.0))
        always = least == greatest
        if name not in e.measured or e.count < STUCK or (always and name == "load"):
            return None
        # A sinkage that was rounded to one or two digits may well be the same all the time.
        coarse = name in ROUNDED and len(f"{abs(least):.9g}".replace(".", "").strip("0")) < 3
        for other, changes in (("slip", 0.3 if coarse else 0.1), ("load", 1.5 if coarse else 1.2)):
            columns = e.columns(name, other)
            run = columns and (slice(None) if always else _frozen(columns[0]))
            if not columns or not run or other == name:
                continue
            same, others = columns[0][run], columns[1][run]
            low, high = np.quantile(others, [0.05, 0.95])
            if high - low >= changes if other == "slip" else 0.0 < changes * low <= high:
                share = len(same) / len(columns[0])
                where = "every sample" if always else f"{share:.0%} of the samples, one after another"
                what = f"{name} is {same[0]:.4g} in {where}, while {other} goes from {low:.3g} to {high:.3g}"
                return Suspicion(what, name, beyond="" if always else _apart_from(name, float(same[0])))
        return None

    return check


def limited(name: str) -> Callable[[UnitEvidence], Suspicion | None]:
    """Return a check of a channel whose sensor may end where the quantity does not."""

    def check(e: UnitEvidence) -> Suspicion | None:
        columns = e.columns(name) if name in e.measured else None
        for column in columns or ():
            for end, never, sign in ((column.max(), "more", "<"), (column.min(), "less", ">")):
                rest = column[column != end]
                # What is rounded, or held until the next value comes, has few values everywhere.
                if end != 0.0 and len(column) - len(rest) >= STUCK and len(np.unique(rest)) > 0.5 * len(rest):
                    share = 1.0 - len(rest) / len(column)
                    what = f"{name} is {end:.4g} in {share:.0%} of the samples, and never {never}: a sensor,"
                    what += " or what reads it, may be at its limit"
                    return Suspicion(what, name, beyond=_apart_from(name, end, sign))
        return None

    return check


def _apart_from(name: str, value: float, *sides: str) -> str:
    """Write the condition of the samples on these sides of a value, by default on both."""
    # A little on this side, so that a rounded condition leaves out the value itself.
    ends = {"<": value - 1e-6 * abs(value), ">": value + 1e-6 * abs(value)}
    return " or ".join(f"{name} {sign} {ends[sign]:.7g}" for sign in sides or ends)


def _frozen(values: Array) -> slice | None:
    """Find the longest run of one value in a channel that otherwise changes from sample to sample."""
    bounds = np.flatnonzero(np.concatenate([[True], values[1:] != values[:-1], [True]]))
    lengths = np.diff(bounds)
    longest = int(lengths.argmax())
    length = int(lengths[longest])
    rest = len(values) - length
    # What is rounded, or held until the next value comes, has runs all the time.
    if length < max(STUCK, LONG * len(values)) or rest < STUCK or len(lengths) - 1 < 0.5 * rest:
        return None
    return slice(int(bounds[longest]), int(bounds[longest]) + length)
