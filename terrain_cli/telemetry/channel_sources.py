"""The source of each channel of each wheel, a field of a file or a constant; and which names mean one wheel.

``front-left``, ``/front_left/load`` and ``FrontLeftWheelJoint`` are one.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from functools import cache
from typing import TYPE_CHECKING

import numpy as np

from formats import Labels

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from numpy.typing import NDArray

    from formats import Source
    from terrain_cli.errors import InputError
    from terrain_cli.vocabulary.units import Unit

    Array = NDArray[np.float64]
    from collections.abc import Iterable

#: Whose samples the other channels are brought to: the first of these that is there.
CLOCKS = ("torque", "motor_current", "drawbar_pull", "sinkage", "entry_angle", "load")
#: Said of every wheel, so that they tell none apart.
_GENERIC = re.compile(r"wheel|joint|motor|drive", re.IGNORECASE)
#: Shorter texts occur inside others by chance.
_LONG_ENOUGH = 4


@dataclass(frozen=True, slots=True, kw_only=True)
class Feed:
    """Where a channel comes from, and what turns it into SI."""

    channel: str
    #: Empty for a table.
    topic: str = ""
    #: What to read; none for a constant.
    fields: tuple[str, ...] = ()
    #: Unit of ``raw · scale + offset``; none for labels and counts.
    unit: Unit | None = None
    scale: float = 1.0
    offset: float = 0.0
    constant: float | str | None = None
    combine: Callable[..., Array] | None = None
    #: What a person should know: taken for granted, or converted.
    note: str = ""
    #: Of two feeds found without being asked for, the lower rank is used.
    rank: int = 0
    #: Of the origin of the body, not of each wheel.
    of_body: bool = False
    asked: bool = False
    #: rover.toml or the header states its unit.
    stated: bool = False

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
        """Repeat a constant label."""
        return Labels(np.zeros(n, dtype=np.int32), (str(self.constant),))

    @property
    def place(self) -> str:
        """The column, or the topic and its field; empty for a constant."""
        # Of a quaternion what its fields belong to says enough.
        several = self.fields[0].rpartition(".")[0] if self.topic and self.fields else " + ".join(self.fields)
        names = self.fields if len(self.fields) < 2 else (several,)
        return " ".join(filter(None, (self.topic, *names)))

    def __str__(self) -> str:
        """Say in words where the channel comes from."""
        return _origin(self)

    def _words(self) -> str:
        text = self.place if self.constant is None else f"constant {self.constant}"
        text += f" · {self.scale:g}" * (self.scale != 1.0) + f" {self.offset:+g}" * (self.offset != 0.0)
        if self.unit and self.unit.symbol != "1":
            text += f" in {self.unit.symbol}"
        notes = "; ".join(filter(None, (self.note, "rover.toml" * self.asked)))
        return f"{text} ({notes})" if notes else text


@cache
def _origin(feed: Feed) -> str:
    """Remember the words: of a stream they are asked for with every row."""
    return feed._words()  # noqa: SLF001 - the other half of it


@dataclass(kw_only=True)
class Plan:
    """What will be read of one source."""

    source: Source
    #: Channels of every wheel.
    shared: dict[str, Feed] = field(default_factory=dict)
    #: Channels of one wheel only; they stand above the shared ones. In a table or topic with a column of
    #: wheel labels, the wheels are found when it is read.
    wheels: dict[str, dict[str, Feed]] = field(default_factory=dict)
    #: topic → its column of wheel labels.
    labels: dict[str, str] = field(default_factory=dict)
    #: Further numeric columns of a table.
    extras: tuple[str, ...] = ()
    #: wheel ("" for any) → channel → feeds none of which may be preferred.
    doubtful: dict[str, dict[str, list[Feed]]] = field(default_factory=dict)
    #: Why the rows of a table without time can hardly be steady test points.
    no_time: InputError | None = None

    @property
    def every_feed(self) -> list[Feed]:
        """The shared ones first."""
        return [feed for feeds in (self.shared, *self.wheels.values()) for feed in feeds.values()]

    def feeds(self, wheel: str) -> dict[str, Feed]:
        """Return the feeds of one wheel."""
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
    """Find the one name that means the same wheel.

    The one that is equal but for punctuation, else has the same words, more, fewer, is written within the
    other, or has its initials: the first of these that fits any. None if it fits several, or nothing does.
    """
    names = [name for name in dict.fromkeys(names) if _plain(name)]
    if not _plain(wanted):
        return None
    for same in _SAME:
        found = [name for name in names if same(wanted, name)]
        if found:
            return found[0] if len(found) == 1 else None
    return None
