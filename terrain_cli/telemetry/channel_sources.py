"""The source of each channel of each wheel: a field of a file, or a constant."""

from __future__ import annotations

from dataclasses import dataclass, field
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

#: Whose samples the other channels are brought to: the first of these that is there.
CLOCKS = ("torque", "motor_current", "drawbar_pull", "sinkage", "entry_angle", "load")


@dataclass(frozen=True, slots=True, kw_only=True)
class Feed:
    """Where a channel comes from, and what turns it into SI.

    Parameters
    ----------
    topic : str
        Empty for a table.
    fields : tuple of str
        What to read; none for a constant.
    unit : Unit or None
        Unit of ``raw · scale + offset``; none for labels and counts.
    combine : callable, optional
        Function of several fields.
    note : str
        What a person should know: taken for granted, or converted.
    rank : int
        Of two feeds found without being asked for, the lower rank is used.
    of_body : bool
        Of the origin of the body, not of each wheel.
    asked : bool
        rover.toml asks for it.
    stated : bool
        rover.toml or the header states its unit.
    """

    channel: str
    topic: str = ""
    fields: tuple[str, ...] = ()
    unit: Unit | None = None
    scale: float = 1.0
    offset: float = 0.0
    constant: float | str | None = None
    combine: Callable[..., Array] | None = None
    note: str = ""
    rank: int = 0
    of_body: bool = False
    asked: bool = False
    stated: bool = False

    def si(self, raw: Sequence[Array]) -> Array:
        """Return the channel in SI units from its raw fields.

        Parameters
        ----------
        raw : sequence of ndarray, shape (n,)
            In the order of `fields`.

        Returns
        -------
        ndarray, shape (n,)
        """
        # A field may hold anything; what is not finite is set aside later.
        with np.errstate(invalid="ignore", over="ignore"):
            values = self.combine(*raw) if self.combine else raw[0].astype(np.float64, copy=False)
            if self.scale != 1.0 or self.offset != 0.0:
                values = values * self.scale + self.offset
            return self.unit.to_si(values) if self.unit else values

    def values(self, n: int) -> Array:
        """Repeat a constant, in SI units.

        Returns
        -------
        ndarray, shape (n,)
        """
        return self.si([np.full(n, float(self.constant or 0.0))])

    def labels(self, n: int) -> Labels:
        """Repeat a constant label.

        Returns
        -------
        Labels, shape (n,)
        """
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
        text = self.place if self.constant is None else f"constant {self.constant}"
        text += f" · {self.scale:g}" * (self.scale != 1.0) + f" {self.offset:+g}" * (self.offset != 0.0)
        if self.unit and self.unit.symbol != "1":
            text += f" in {self.unit.symbol}"
        notes = "; ".join(filter(None, (self.note, "rover.toml" * self.asked)))
        return f"{text} ({notes})" if notes else text


@dataclass(kw_only=True)
class Plan:
    """What will be read of one source.

    Parameters
    ----------
    shared : dict of str to Feed
        Channels of every wheel.
    wheels : dict of str to dict
        Channels of one wheel only; they stand above the shared ones. In a table or topic with a
        column of wheel labels, the wheels are found when it is read.
    labels : dict of str to str
        topic → its column of wheel labels.
    extras : tuple of str
        Further numeric columns of a table.
    doubtful : dict of str to dict
        wheel ("" for any) → channel → feeds none of which may be preferred.
    no_time : InputError or None
        Why the rows of a table without time can hardly be steady test points.
    """

    source: Source
    shared: dict[str, Feed] = field(default_factory=dict)
    wheels: dict[str, dict[str, Feed]] = field(default_factory=dict)
    labels: dict[str, str] = field(default_factory=dict)
    extras: tuple[str, ...] = ()
    doubtful: dict[str, dict[str, list[Feed]]] = field(default_factory=dict)
    no_time: InputError | None = None

    def feeds(self, wheel: str) -> dict[str, Feed]:
        """Return the feeds of one wheel."""
        return self.shared | self.wheels.get(wheel, {})

    def doubts(self, wheel: str) -> dict[str, list[Feed]]:
        """Return the channels of one wheel that several feeds could give."""
        doubts = self.doubtful.get("", {}) | self.doubtful.get(wheel, {})
        return {channel: feeds for channel, feeds in doubts.items() if channel not in self.feeds(wheel)}
