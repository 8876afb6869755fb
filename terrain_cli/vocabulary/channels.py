"""The vocabulary of a wheel's telemetry: channels, their units, and the headers that mean them."""

import re
import tomllib
import unicodedata
from collections.abc import Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

from terrain_cli.errors import InputError
from terrain_cli.vocabulary import units
from terrain_cli.vocabulary.units import Unit

LABEL = "label"


@dataclass(frozen=True, slots=True, kw_only=True)
class Channel:
    """One quantity of a sample; channels.toml says what each field is."""

    name: str
    dimension: str
    symbol: str = ""
    aliases: str = ""
    letters: str = ""

    @property
    def unit(self) -> Unit | None:
        """The unit inside the program; none for labels."""
        return None if self.dimension == LABEL else units.si(self.dimension)


_VOCABULARY = tomllib.loads(Path(__file__).with_name("channels.toml").read_text("utf-8"))
CHANNELS = {name: Channel(name=name, **entry) for name, entry in _VOCABULARY["channels"].items()}
_LETTERS = {
    letter: channel
    for channel in CHANNELS.values()
    for letter in (channel.symbol, *channel.letters)
    if letter
}
#: Alone it may be ω or a load, with its unit only one of them.
_OPEN_LETTERS = {"w": ("angular_velocity", "load")}
_WORDS = {
    word: channel
    for channel in CHANNELS.values()
    for word in (channel.name, *channel.aliases.split())
    if len(word) > 1
}
_MEASURED = re.compile(r"^(?:meas|measured)[_\s-]+", re.IGNORECASE)
_GAP = re.compile(r"[_\s-]+")
_BRACKETS = re.compile(r"(.*\S)\s*(?:\[([^\[\]]*)\]|\(([^()]*)\))$")
#: Endings that are English or a number more often than a unit: torque_in, load_ratio, slip_1.
_NO_UNIT = frozenset({"in", "1", "ratio", "fraction"})


@dataclass(frozen=True, slots=True)
class Match:
    """The channel that a header means."""

    channel: str
    unit: Unit | None  # Stated in the header, else the program's own; none for labels
    exact: bool  # The header has the channel's own name, not an alias
    stated: bool  # The header has the unit


def _look_up(name: str, *, letters: bool) -> Channel | None:
    for text in (name, _MEASURED.sub("", name)):
        channel = (_LETTERS.get(text) if letters else None) or _WORDS.get(_GAP.sub("_", text).casefold())
        if channel:
            return channel
    return None


def _by_unit(letter: str, text: str) -> Channel | None:
    # One letter after another is an index more often than a unit: w_n.
    several = (CHANNELS[name] for name in _OPEN_LETTERS.get(letter, ()) if len(text) > 1)
    return next((channel for channel in several if units.parse(text, channel.dimension)), None)


def _readings(header: str) -> Iterator[tuple[str, str, bool]]:
    """Yield every way to read a header: name, text of the unit, whether that stood in brackets."""
    brackets = _BRACKETS.match(header)
    if brackets:
        yield brackets[1], (brackets[2] or brackets[3] or "").strip(), True
        return
    for gap in _GAP.finditer(header):
        if header[gap.end() :].casefold() not in _NO_UNIT:
            yield header[: gap.start()], header[gap.end() :], False


def identify(header: str, *, letters: bool = True, chosen: Collection[str] = ()) -> Match | None:
    """Find the channel and unit that a header means (``torque``, ``Normal load (kN)``, ``T [mN m]``).

    `letters` takes W, T, z, x, … as channels: not for fields of messages, where x and z are the coordinates
    of anything. No header is taken for a channel `chosen` elsewhere. InputError for a unit that is none, or
    not of its dimension.
    """
    header = header.strip()
    # Brackets need not hold a unit: "time (UTC)" is the alias time_utc.
    channel = _look_up(_BRACKETS.sub(r"\1 \2\3", header), letters=letters)
    if channel:
        exact = header == channel.name
        return None if channel.name in chosen else Match(channel.name, channel.unit, exact, stated=False)
    for name, text, bracketed in _readings(header):
        channel = _look_up(name, letters=letters) or (_by_unit(name, text) if letters else None)
        # Where slip is given elsewhere, slip_angle_deg is an angle all the same.
        if channel is None or channel.unit is None or channel.name in chosen:
            continue
        unit = units.parse(text, channel.dimension)
        if unit:
            return Match(channel.name, unit, name == channel.name, stated=True)
        if bracketed or (len(text) > 1 and text != "min"):
            _refuse(header, name, text, channel, bracketed=bracketed)
    return None


def _refuse(header: str, name: str, text: str, channel: Channel, *, bracketed: bool) -> None:
    """Refuse a wrong unit where one is surely meant: T [°C] is a temperature, velocity_n points north."""
    other = units.parse(text)
    if len(name) == 1 or not (other or bracketed):
        return
    what = f"is a unit of {other.dimension}" if other else "is not a known unit"
    raise InputError(
        f"column {header!r}: {text!r} {what}; {unit_hint(channel.name)}",
        hint=f"correct the header, or choose the column of {channel.name} in rover.toml",
    )


def unit_hint(channel: str) -> str:
    """Say which units a channel takes."""
    dimension = CHANNELS[channel].dimension
    if dimension == LABEL:
        return f"{channel} takes no unit"
    return f"{channel} takes {', '.join(units.symbols(dimension))}"


def stated_unit(header: str, dimension: str | None = None) -> Unit | None:
    """Return the unit (of some dimension) that the header of any column states, in brackets or at its end."""
    readings = (text for _, text, bracketed in _readings(header.strip()) if bracketed or text != "min")
    return next(filter(None, (units.parse(text, dimension) for text in readings)), None)


def resolve(headers: Iterable[str], *, chosen: Collection[str] = ()) -> dict[str, tuple[str, Match]]:
    """Find header and match of each channel, its own name first; InputError where two are equally good."""
    headers = list(headers)
    bare = CHANNELS.keys() & set(headers)
    found: dict[str, list[tuple[str, Match]]] = {}
    for header in headers:
        match = identify(header, chosen=chosen if header in bare else bare.union(chosen))
        if match:
            found.setdefault(match.channel, []).append((header, match))
    channels: dict[str, tuple[str, Match]] = {}
    for channel, candidates in found.items():
        best = [candidate for candidate in candidates if candidate[1].exact] or candidates
        if len(best) > 1:
            raise InputError(
                f"columns {' and '.join(repr(header) for header, _ in best)} can all be {channel}",
                hint=f'choose one in rover.toml: [channels] {channel} = "{best[0][0]}"',
            )
        channels[channel] = best[0]
    return channels


_TIME_WORDS = frozenset(_VOCABULARY["time"]["words"].split())  # Headers that mean a time
#: Where a topic's name stands before it: /wheel/header/stamp, msg.timestamp.
_TIME_LEAVES = frozenset({"time", *CHANNELS["time"].aliases.split()})
#: What `rostopic echo -p` and rosbag_to_csv write is in ns, whatever the header is called.
_NANOSECONDS = re.compile(r"%time|field\.(.*\.)?stamp|rosbagTimestamp")
_TIME_BRACKETS = re.compile(r"(.*\S)\s*[\[(]([^\[\]()]*)[\])]$")
_TIME_ENDING = re.compile(r"(.+)[_./](.+)$")
_FRACTION = re.compile(r"(?P<stem>.*?)(?P<unit>n(?:ano)?secs?|usecs?)$", re.IGNORECASE)
#: Beside one of these, seconds are those of a minute.
_PARTS_OF_A_DAY = frozenset({"min", "minute", "minutes", "h", "hour", "hours"})


class TimeName(NamedTuple):
    """Columns that may be the time."""

    headers: tuple[str, ...]  # One, or whole seconds and what is beyond them
    unit: Unit  # Of the last


def time_pairs(headers: Sequence[str]) -> list[TimeName]:
    """Find the columns of whole seconds that have another of what is beyond them (secs, nsecs)."""
    found = []
    for header in headers:
        match = _FRACTION.fullmatch(header)
        unit = units.parse(match["unit"].lower(), "time") if match else None
        wholes = {f"{match['stem']}{ending}".casefold() for ending in ("sec", "secs")} if match else set()
        whole = next((other for other in headers if other.casefold() in wholes), None)
        if whole and unit:
            found.append(TimeName((whole, header), unit))
    return found


def time_names(headers: Iterable[str]) -> list[TimeName]:
    """Find the columns whose names mean a time, among those that are no channel."""
    plain = {header: _plain_time(header) for header in headers}
    of_a_day = not _PARTS_OF_A_DAY.isdisjoint(plain.values())
    found = []
    for header, text in plain.items():
        unit = _time_unit(header, text)
        if unit and not (of_a_day and units.parse(text, "time")):
            found.append(TimeName((header,), unit))
    return found


def _plain_time(header: str) -> str:
    """Spell a header in one way: rosTime, "ROS time" and __ros_time are one."""
    text = unicodedata.normalize("NFKC", header)
    text = re.sub(r"(?<=[a-z])(?=[A-Z])", "_", text).casefold()
    return re.sub(r"[_\s-]+", "_", text).strip("_%#/ ")


def _time_unit(header: str, text: str) -> Unit | None:
    """Return the unit of a header that means a time, seconds where it says none; else None."""
    if _NANOSECONDS.fullmatch(header.strip()):
        return units.parse("ns", "time")
    if len(text) > 1 and text not in _PARTS_OF_A_DAY and (unit := units.parse(text, "time")):
        return unit
    if _means_time(text):
        return CHANNELS["time"].unit
    for pattern in (_TIME_BRACKETS, _TIME_ENDING):
        match = pattern.fullmatch(text)
        if match and _means_time(match[1].strip("_")):
            unit = units.parse(match[2], "time")
            # A bracket may also say which clock it is: elapsed (UTC).
            return unit or (CHANNELS["time"].unit if match[2] in _TIME_WORDS else None)
    return None


def _means_time(name: str) -> bool:
    return name in _TIME_WORDS or re.split(r"[./]", name)[-1] in _TIME_LEAVES
