"""Doubts: remarks on improbable channels, with the line of rover.toml that would correct each."""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal, NamedTuple

from terrain_cli.errors import InputError
from terrain_cli.telemetry.plan import rover_advice
from terrain_cli.telemetry.wheel_samples import Notice
from terrain_cli.vocabulary import units
from terrain_cli.vocabulary.channels import CHANNELS

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

    from terrain_cli.telemetry.channel_sources import Feed, Plan

#: What has the unit of another channel.
ALIKE = {"x": "y", "longitude": "latitude"}


class Doubt(Notice):
    """A remark that says that what was measured is hardly true."""

    __slots__ = ()


class ImplausibleError(InputError):
    """What was measured cannot be true; the unit of `channel` is likely to be wrong."""

    def __init__(self, message: str, *, hint: str = "", channel: str = "") -> None:
        super().__init__(message, hint=hint)
        self.channel = channel


class Mend(NamedTuple):
    """A unit that a channel may be in."""

    channel: str
    unit: str
    #: To that unit: 0.001 kgf are grams.
    scale: float = 1.0

    @property
    def factor(self) -> float:
        """What the values read so far are multiplied by."""
        unit = units.parse(self.unit, CHANNELS[self.channel].dimension)
        return self.scale * (unit.factor if unit else 1.0)


Weight = Literal["odd", "impossible", "contradiction"]


class Suspicion(NamedTuple):
    """What is hardly true."""

    #: And why.
    what: str
    #: Whose unit or sign it may be.
    channel: str
    #: What would make it true.
    mend: Mend | None = None
    #: The last two are errors: what no unit makes true, unless the file or rover.toml states the unit;
    #: channels that contradict each other, unless rover.toml does.
    weight: Weight = "odd"


def tell(layout: Plan, wheel: str, feeds: Mapping[str, Feed], suspicions: Iterable[Suspicion]) -> list[Doubt]:
    """Say what is hardly true of a wheel, and what would mend it; what cannot be true is an error."""
    told = []
    for suspicion in suspicions:
        feed = feeds.get(suspicion.channel)
        what, weight = f"wheel {wheel}: {suspicion.what}", suspicion.weight
        if feed is None:
            told.append(Doubt(what))
            continue
        header, lines = rover_advice.header(layout, wheel, suspicion.channel), _lines(feeds, suspicion)
        if weight != "odd" and not (feed.stated and (feed.asked or weight == "impossible")):
            hint = [f"state its unit in rover.toml, whichever it is; {_if(feed, suspicion)}:", header, *lines]
            raise ImplausibleError(
                f"{layout.source.path}: {what}", hint="\n".join(hint), channel=suspicion.channel
            )
        if suspicion.mend is None:
            told.append(Doubt(f"{what}; see whether {feed.place} is what it is taken for"))
        else:
            told.append(
                Doubt(f"{what}: {_if(feed, suspicion)}, {', '.join(lines)} under {header} of rover.toml")
            )
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
        return "if it is the one taken"
    _, unit, scale = suspicion.mend
    if scale < 0.0:
        return "if the sensor's sign is the other way round"
    return f"if it is in {rover_advice.meant(feed, unit, scale)}"
