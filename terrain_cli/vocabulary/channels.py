"""The vocabulary of a wheel's telemetry: channels, their units, and the headers that mean them."""

from __future__ import annotations

import re
from dataclasses import KW_ONLY, dataclass
from typing import TYPE_CHECKING

from terrain_cli.errors import InputError
from terrain_cli.vocabulary import units

if TYPE_CHECKING:
    from collections.abc import Collection, Iterable, Iterator

    from terrain_cli.vocabulary.units import Unit

LABEL = "label"


@dataclass(frozen=True, slots=True)
class Channel:
    """One quantity of a sample."""

    name: str
    symbol: str
    #: One of `units.DIMENSIONS`, or "label" (text).
    dimension: str
    #: One line for a person.
    description: str
    _: KW_ONLY
    #: Words, in lower case with underscores: other names that can mean nothing else.
    aliases: tuple[str, ...] = ()
    #: Symbols, which are this channel only as they are written.
    letters: tuple[str, ...] = ()

    @property
    def unit(self) -> Unit | None:
        """The unit inside the program; none for labels."""
        return None if self.dimension == LABEL else units.si(self.dimension)


# Left out because they also mean something else: effort, current, speed, wheel_speed and
# wheel_velocity (of the rim or of the centre), motor_torque (before the gear), tractive_force
# and tractive_effort (thrust or pull), altitude (above an ellipsoid), trial, temperature, tau.
_CHANNELS = (
    Channel(
        "time",
        "t",
        "time",
        "time of the sample",
        aliases=("timestamp", "time_stamp", "stamp", "datetime", "time_utc", "utc_time", "time_iso_8601"),
        letters=("t",),
    ),
    Channel("wheel", "", LABEL, "name of the wheel", aliases=("wheel_name", "wheel_id")),
    Channel(
        "load",
        "W",
        "force",
        "vertical load on the wheel",
        aliases=(
            "normal_load",
            "vertical_load",
            "wheel_load",
            "normal_force",
            "vertical_force",
            "fz",
            "fz_load",
        ),
        letters=("W",),
    ),
    Channel(
        "torque",
        "T",
        "torque",
        "drive torque at the wheel",
        aliases=("wheel_torque", "drive_torque", "driving_torque", "wheel_drive_torque"),
        letters=("T",),
    ),
    Channel("sinkage", "z", "length", "sinkage of the wheel", aliases=("wheel_sinkage",), letters=("z",)),
    Channel(
        "entry_angle",
        "θ1",
        "angle",
        "angle from the vertical at which the rim meets the ground",
        aliases=("theta1", "theta_1", "θ1", "θ_1"),
    ),
    Channel(
        "angular_velocity",
        "ω",
        "angular speed",
        "angular velocity of the wheel",
        aliases=("omega", "angular_speed", "wheel_angular_velocity", "wheel_angular_speed"),
        letters=("ω",),
    ),
    Channel(
        "velocity",
        "V",
        "speed",
        "forward velocity of the wheel centre",
        aliases=(
            "forward_velocity",
            "forward_speed",
            "travel_velocity",
            "travel_speed",
            "longitudinal_velocity",
        ),
        letters=("V",),
    ),
    Channel(
        "slip",
        "i",
        "ratio",
        "slip",
        aliases=("slip_ratio", "wheel_slip", "longitudinal_slip"),
        letters=("i",),
    ),
    Channel(
        "drawbar_pull", "DP", "force", "drawbar pull", aliases=("drawbar", "drawbar_force"), letters=("DP",)
    ),
    Channel("pitch", "", "angle", "pitch, positive nose up", aliases=("pitch_angle",)),
    Channel("roll", "", "angle", "roll, positive left side up", aliases=("roll_angle",)),
    Channel("yaw_rate", "", "angular speed", "yaw rate, positive to the left"),
    Channel("motor_current", "", "current", "current of the drive motor", aliases=("drive_motor_current",)),
    Channel(
        "motor_temperature",
        "",
        "temperature",
        "temperature of the drive motor",
        aliases=("motor_temp", "drive_motor_temperature"),
    ),
    Channel(
        "acceleration",
        "",
        "acceleration",
        "acceleration along the track",
        aliases=("forward_acceleration", "longitudinal_acceleration"),
    ),
    Channel("pass_number", "", "ratio", "number of wheels that drove here before", aliases=("pass_no",)),
    Channel(
        "slip_angle",
        "β",
        "angle",
        "slip angle",
        aliases=("beta", "sideslip_angle", "side_slip_angle"),
        letters=("β",),
    ),
    Channel("x", "", "length", "position in the site frame", aliases=("easting",), letters=("x",)),
    Channel("y", "", "length", "position in the site frame", aliases=("northing",), letters=("y",)),
    Channel("elevation", "", "length", "elevation in the site frame"),
    Channel("longitude", "", "coordinate", "longitude", aliases=("lon", "lng")),
    Channel("latitude", "", "coordinate", "latitude", aliases=("lat",)),
    Channel("terrain", "", LABEL, "terrain", aliases=("terrain_label", "terrain_type", "terrain_class")),
    Channel("run", "", LABEL, "one continuous drive", aliases=("run_id", "run_name")),
)
CHANNELS: dict[str, Channel] = {channel.name: channel for channel in _CHANNELS}

_LETTERS = {letter: channel for channel in _CHANNELS for letter in channel.letters}
_WORDS = {
    word: channel for channel in _CHANNELS for word in (channel.name, *channel.aliases) if len(word) > 1
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
    #: Stated in the header, else the program's own; none for labels.
    unit: Unit | None
    #: The header has the channel's own name, not an alias.
    exact: bool
    #: The header has the unit.
    stated: bool


def _look_up(name: str, *, letters: bool) -> Channel | None:
    for text in (name, _MEASURED.sub("", name)):
        channel = (_LETTERS.get(text) if letters else None) or _WORDS.get(_GAP.sub("_", text).casefold())
        if channel:
            return channel
    return None


def _readings(header: str) -> Iterator[tuple[str, str, bool]]:
    """Split a header into a name and the text of a unit in every way it can be read.

    Yields the name, the text, and whether the text stood in brackets.
    """
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
        channel = _look_up(name, letters=letters)
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
    """Refuse a wrong unit, unless name or unit is too short to be sure that it is meant.

    `T [°C]` is a temperature and no torque, velocity_n points north, torque_min is a minimum.
    """
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
    """Find the header, and what it says, of each channel; the channel's own name wins over an alias.

    InputError where two headers mean one channel equally well, or one has a wrong unit.
    """
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
