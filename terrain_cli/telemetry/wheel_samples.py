"""Where the channels of a wheel come from, and its samples: every channel on the clock of its torque.

Names may mean one wheel: ``front-left``, ``/front_left/load`` and ``FrontLeftWheelJoint``.
"""

import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache
from typing import Any, NamedTuple, Self

import numpy as np

from formats import Column, Labels, Source
from terrain_cli.errors import InputError
from terrain_cli.mechanics.wheel_model import WheelGeometry
from terrain_cli.rover import SensorNoise
from terrain_cli.telemetry.raw_columns import take
from terrain_cli.vocabulary.arrays import Array, Index, Mask
from terrain_cli.vocabulary.choices import K_FACTOR
from terrain_cli.vocabulary.quantities import the_wheel
from terrain_cli.vocabulary.units import STANDARD_GRAVITY, Unit

#: Whose samples the other channels are brought to: the first of these that is there.
CLOCKS = ("torque", "motor_current", "drawbar_pull", "sinkage", "entry_angle", "load")
#: Said of every wheel, so that they tell none apart.
_GENERIC = re.compile(r"wheel|joint|motor|drive", re.IGNORECASE)
_LONG_ENOUGH = 4  # Shorter texts occur inside others by chance
DERIVED = "derived from"  # How the words begin that say where a channel comes from that nobody recorded
NEEDED = ("load", "torque", "sinkage", "slip")  # What the line y = c + x tan φ is computed from
#: What `Samples` hold of each sample: some columns, and columns by their names.
COLUMNS, TABLES = (
    ("time", "stretch", "distance", "set_aside", "drive", "aside"),
    ("channels", "labels", "drivers"),
)


@dataclass(frozen=True, slots=True, kw_only=True)
class Feed:
    """Where a channel comes from, and what turns it into SI."""

    channel: str
    topic: str = ""  # Empty for a table
    fields: tuple[str, ...] = ()  # What to read; none for a constant
    #: Unit of ``raw · scale + offset``; none for labels and counts.
    unit: Unit | None = None
    scale: float = 1.0
    offset: float = 0.0
    constant: float | str | None = None
    combine: Callable[..., Array] | None = None
    note: str = ""  # What a person should know: taken for granted, or converted
    rank: int = 0  # Of two feeds found without being asked for, the lower rank is used
    #: Of the origin of the body, not of each wheel.
    of_body: bool = False
    asked: bool = False
    stated: bool = False  # rover.toml or the header states its unit
    #: Of one found without being asked for, names that might tell its wheel: the parts of the topic, or the
    #: name beside a list.
    places: tuple[str, ...] = field(default=(), compare=False)

    def si(self, raw: Sequence[Array]) -> Array:
        """Return the channel in SI units from its raw fields, in the order of `fields`."""
        # A field may hold anything; what is not finite is set aside later.
        with np.errstate(invalid="ignore", over="ignore"):
            values = self.combine(*raw) if self.combine else raw[0].astype(np.float64, copy=False)
            if self.scale != 1.0 or self.offset != 0.0:
                values = values * self.scale + self.offset
            return self.unit.to_si(values) if self.unit else values

    def values(self, n: int) -> Array:
        """Repeat a constant, in SI units."""
        return self.si([np.full(n, float(self.constant or 0.0))])

    def labels(self, n: int) -> Labels:
        return Labels(np.zeros(n, dtype=np.int32), (str(self.constant),))

    @property
    def place(self) -> str:
        """The column, or the topic and its field; empty for a constant."""
        # Of a quaternion what its fields belong to says enough.
        several = self.fields[0].rpartition(".")[0] if self.topic and self.fields else " + ".join(self.fields)
        names = self.fields if len(self.fields) < 2 else (several,)
        return " ".join(filter(None, (self.topic, *names)))

    @cache  # noqa: B019 - of a stream the words of its few feeds are asked for with every row
    def __str__(self) -> str:
        text = self.place if self.constant is None else f"constant {self.constant}"
        text += f" · {self.scale:g}" * (self.scale != 1.0) + f" {self.offset:+g}" * (self.offset != 0.0)
        if self.unit and self.unit.symbol != "1":
            text += f" in {self.unit.symbol}"
        notes = "; ".join(filter(None, (self.note, "rover.toml" * self.asked)))
        return f"{text} ({notes})" if notes else text


@dataclass(kw_only=True)
class Plan:
    source: Source
    shared: dict[str, Feed] = field(default_factory=dict)  # Channels of every wheel
    #: Channels of one wheel only; they stand above the shared ones. In a table or topic with a column of
    #: wheel labels, the wheels are found when it is read.
    wheels: dict[str, dict[str, Feed]] = field(default_factory=dict)
    labels: dict[str, str] = field(default_factory=dict)  # topic → its column of wheel labels
    extras: tuple[str, ...] = ()  # Further numeric columns of a table
    #: wheel ("" for any) → channel → feeds none of which may be preferred.
    doubtful: dict[str, dict[str, list[Feed]]] = field(default_factory=dict)
    no_time: InputError | None = None  # Why the rows of a table without time can hardly be steady test points

    @property
    def every_feed(self) -> list[Feed]:
        """The feeds that all wheels share, then those of each."""
        return [feed for feeds in (self.shared, *self.wheels.values()) for feed in feeds.values()]

    def feeds(self, wheel: str) -> dict[str, Feed]:
        return self.shared | self.wheels.get(wheel, {})

    def doubts(self, wheel: str) -> dict[str, list[Feed]]:
        """Return the channels of one wheel that several feeds could give."""
        doubts = self.doubtful.get("", {}) | self.doubtful.get(wheel, {})
        return {channel: feeds for channel, feeds in doubts.items() if channel not in self.feeds(wheel)}


@cache
def words(name: str) -> frozenset[str]:
    """Split a name such as "wheel_fl" or "RearLeftJoint" into the words that tell it from others."""
    parted = re.sub(r"(?<=[a-z0-9])(?=[A-Z])", "_", name)
    special = re.findall(r"[^\W_]+", _GENERIC.sub("_", parted).casefold())
    # A number belongs to what stands before it: rover1 is not wheel 1.
    return frozenset(special or re.findall(r"[^\W_]+", parted.casefold()))


@cache
def _plain(name: str) -> str:
    return re.sub(r"[\W_]+", "", name).casefold()


def _contains(a: str, b: str) -> bool:
    short, long = sorted((_plain(_GENERIC.sub("", name)) for name in (a, b)), key=len)
    # "wheel1" is not in "wheel10".
    return len(short) >= _LONG_ENOUGH and re.search(rf"{short}(?!\d)", long) is not None


def _initials(a: str, b: str) -> bool:
    long, short = sorted((words(a), words(b)), key=len, reverse=True)
    return len(short) == 1 < len(long) and sorted(*short) == sorted(word[0] for word in long)


_SAME: tuple[Callable[[str, str], bool], ...] = (
    lambda a, b: _plain(a) == _plain(b),
    lambda a, b: words(a) == words(b),
    lambda a, b: words(a) < words(b),
    lambda a, b: words(a) > words(b) > frozenset(),
    _contains,
    _initials,
)


def match_name(wanted: str, names: Iterable[str]) -> str | None:
    """Find the one name that means the same wheel; None where several do."""
    # Equal but for punctuation, else with the same words, more, fewer, one within the other, or initials.
    names = [name for name in dict.fromkeys(names) if _plain(name)]
    if not _plain(wanted):
        return None
    for same in _SAME:
        found = [name for name in names if same(wanted, name)]
        if found:
            return found[0] if len(found) == 1 else None
    return None


class Geometry(NamedTuple):
    """Of a wheel, and the shear modulus assumed of its soil."""

    #: r, b and k in m.
    radius: float
    width: float
    shear_modulus: float
    #: In m.
    grouser_height: float = 0.0
    grouser_count: int = 0
    gravity: float = STANDARD_GRAVITY  # In m/s²
    shear_modulus_factor: float = K_FACTOR  # Within which k is expected to be right (one standard deviation)
    #: Standard deviations of r and b in m.
    radius_error: float = 0.0
    width_error: float = 0.0

    @property
    def line(self) -> dict[str, Any]:
        """What the line y = c + x tan φ is computed with, in m, by the names that its equations have."""
        return {"radius": self.radius, "width": self.width, "shear_modulus": self.shear_modulus}

    @property
    def wheel(self) -> WheelGeometry:
        """The constants of the wheel for the whole model."""
        return WheelGeometry(self.radius, self.width, self.grouser_height, self.grouser_count, self.gravity)


@dataclass(kw_only=True)
class Raw:
    """The channels of one wheel on one clock, before anything is derived or judged."""

    wheel: str
    origin: float = 0.0  # Whole seconds taken off the clock
    time: Array | None = None  # In s; shape (n,)
    channels: dict[str, Array] = field(default_factory=dict)  # In SI units; shape (n,)
    labels: dict[str, Labels] = field(default_factory=dict)
    #: Further columns that were asked for, as read; shape (n,).
    extras: dict[str, Column] = field(default_factory=dict)
    feeds: dict[str, Feed]
    remarks: list[str] = field(default_factory=list)

    def __len__(self) -> int:
        columns = (*self.channels.values(), *self.labels.values(), *self.extras.values())
        return len(self.time) if self.time is not None else max(map(len, columns), default=0)

    def select(self, rows: Index | Mask) -> None:
        self.time = None if self.time is None else self.time[rows]
        self.channels = {name: values[rows] for name, values in self.channels.items()}
        self.labels = {name: column.take(rows) for name, column in self.labels.items()}
        self.extras = {name: take(column, rows) for name, column in self.extras.items()}


@dataclass(kw_only=True)
class Samples:
    """One wheel of one input."""

    source: str  # The input, as the user named it
    wheel: str
    geometry: Geometry
    origin: float  # Whole seconds that were taken off the clock
    # Shape (n,), or None: s since `origin`; None for a table of steady test points
    time: Array | None
    # Shape (n,): by the names of the contract, in SI units; NaN where not known
    channels: dict[str, Array]
    labels: dict[str, Labels]  # "run" and "terrain", where the input has them
    # Shape (n,): number of the continuous stretch, which ends with a run, a gap or a restart of the clock
    stretch: Index
    # Shape (n,), or None: metres driven since the first sample; None where no channel tells
    distance: Array | None
    set_aside: Labels  # Why a sample is not used; code −1 for those that are
    origins: dict[str, str] = field(default_factory=dict)  # Where each channel comes from, in words
    remarks: list[str] = field(default_factory=list)  # What a person should know about the input
    # Shape (n,): what makes a difference to the effects of the model, by the names they have there
    drivers: dict[str, Array] = field(default_factory=dict)
    # What rover.toml says of the sensors, by channel
    noise: Mapping[str, SensorNoise] = field(default_factory=dict)
    # Shape (n,), or None: where only pieces of a log were kept: number of the continuous stretch of the log
    # that each sample is of. `stretch` then tells the pieces apart.
    drive: Index | None = None
    aside: Mask | None = None  # Shape (n,), or None: kept aside from diagnosis, to judge what it names
    total: int | None = None  # Usable samples of the log, where only pieces of it were kept

    def __len__(self) -> int:
        return len(self.set_aside)

    def __str__(self) -> str:
        return f"{self.source}: {the_wheel(self.wheel)}"

    def derives(self, channel: str) -> bool:
        """Tell whether a channel was derived from others, with the constants of rover.toml."""
        return self.origins.get(channel, "").startswith(DERIVED)

    @property
    def usable(self) -> Index:
        return np.flatnonzero(self.set_aside.codes < 0)

    def taken(self, rows: Index | Mask | slice) -> Self:
        own = {name: getattr(self, name) for name in COLUMNS}
        columns: dict[str, Any] = {name: take(one, rows) for name, one in own.items() if one is not None}
        for name in TABLES:
            columns[name] = {key: take(one, rows) for key, one in getattr(self, name).items()}
        return replace(self, **columns)

    def reasons(self) -> dict[str, int]:
        """Count the samples set aside by reason, the most frequent first."""
        codes = self.set_aside.codes
        counts = np.bincount(codes[codes >= 0], minlength=len(self.set_aside.names))
        order = np.argsort(-counts, kind="stable")
        return {self.set_aside.names[j]: int(counts[j]) for j in order if counts[j]}
