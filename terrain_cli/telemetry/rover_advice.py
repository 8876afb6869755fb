"""What can be derived, what is missing, and the lines of rover.toml that would supply it."""

import re
from collections.abc import Collection, Iterator, Mapping, Sequence
from typing import Any, NamedTuple, cast

import numpy as np

from terrain_cli.mechanics import linear
from terrain_cli.rover import Rover, Wheel
from terrain_cli.telemetry import derived_channels, topic_discovery
from terrain_cli.telemetry.mapping import is_table
from terrain_cli.telemetry.topic_discovery import OF_WHEELS
from terrain_cli.telemetry.wheel_samples import DERIVED, NEEDED, Feed, Plan, Raw, match_name
from terrain_cli.vocabulary import toml_files, units
from terrain_cli.vocabulary.arrays import Array
from terrain_cli.vocabulary.channels import CHANNELS, stated_unit
from terrain_cli.vocabulary.quantities import listed

#: Positive forward or nose up, and so with the other sign to a wheel that turns backwards. Pitch and roll
#: are turned for the effects only (`effect_inputs.drivers`): in the body's frame they say where the load is.
_WITH_DIRECTION = {"torque", "drawbar_pull", "acceleration"}
NOWHERE = "not measured"  # How a reason begins where the data are silent
#: Every channel from which a needed one, or the place of a sample, may come, or which an effect of the
#: catalogue reads: the errors of an estimate allow for those that it lacks (`further_unknowns.suspects`).
SOURCES = (
    *NEEDED,
    *("time", "run", "terrain", "entry_angle", "angular_velocity", "velocity", "pitch", "roll", "yaw_rate"),
    *("slip_angle", "motor_current", "motor_temperature", "x", "y", "longitude", "latitude"),
    *("acceleration", "pass_number"),
)
MOST = 8  # More names than this help nobody
#: In the name of a column that may be the drawbar pull.
_PULL = re.compile(r"tract(ive|ion)|drawbar|thrust|(^|[^a-z])(pull|dp|fx)($|[^a-z])", re.IGNORECASE)
#: In the name of a column that may hold the effort of a joint; a tractive effort is a force.
_EFFORT = re.compile(r"(?<!tractive[ _])effort", re.IGNORECASE)


class Lack(NamedTuple):
    """Something that is needed and can be had from nothing."""

    #: A channel, "geometry" or "shear modulus".
    what: str
    because: str
    ask: tuple[str, ...] = ()  # Channels that would supply it; empty where rover.toml itself must say it
    #: What to add to rover.toml, if not a channel: the header of a table, then its keys.
    lines: tuple[str, ...] = ()


def routes(available: Collection[str], wheel: Wheel, rover: Rover) -> tuple[dict[str, str], list[Lack]]:
    """Say how needed channels not recorded, and V or ω, can be derived, and what is missing."""
    have = set(available)
    missing = tuple(name for name in ("angular_velocity", "velocity") if name not in have)
    no_depth = Lack("sinkage", f"{NOWHERE}, and there is no entry angle", ("sinkage",))
    no_slip = Lack("slip", f"{NOWHERE}, and there is no {' or '.join(missing)} to derive it from", missing)
    ways = {
        "load": _load(have, wheel, rover),
        "torque": _torque(have, wheel),
        "sinkage": "entry angle" if "entry_angle" in have else no_depth,
        "slip": no_slip if missing else "angular velocity and velocity",
    }
    found = {name: way for name, way in ways.items() if name not in have}
    derived = {name: way for name, way in found.items() if isinstance(way, str)}
    if "velocity" not in have and {"angular_velocity", "slip"} <= have:
        derived["velocity"] = "angular velocity and slip"
    if "angular_velocity" not in have and {"velocity", "slip"} <= have:
        derived["angular_velocity"] = "velocity and slip"
    return derived, [way for way in found.values() if isinstance(way, Lack)]


def _load(have: set[str], wheel: Wheel, rover: Rover) -> str | Lack:
    if rover.vehicle is None:
        return Lack("load", f"{NOWHERE}, and there is no [vehicle] to derive it from", ("load",))
    if wheel.position is None:
        lines = (f"[wheels.{toml_files.key(wheel.name)}]", "position = [x, y, z]  # m")
        return Lack("load", "the balance of the vehicle needs the place of every wheel", lines=lines)
    if "pitch" not in have:
        return Lack("load", "the balance of the vehicle needs the pitch", ("pitch",))
    return "the quasi-static balance of the vehicle, pitch" + " and roll" * ("roll" in have)


def _torque(have: set[str], wheel: Wheel) -> str | Lack:
    if "motor_current" not in have:
        return Lack("torque", f"{NOWHERE}, and there is no motor current", ("torque",))
    if wheel.motor is None:
        lines = ("[motor]", "torque_constant = …  # N m/A", "gear_ratio = …")
        return Lack("torque", "motor_current is there, but not the data of the motor", lines=lines)
    if wheel.motor.temperature_coefficient == 0.0:
        return "motor current"
    if "motor_temperature" not in have:
        because = "temperature_coefficient is not 0, and needs the temperature of the motor"
        return Lack("torque", because, ("motor_temperature",))
    return "motor current and temperature"


def settings(wheel: Wheel, rover: Rover) -> list[Lack]:
    """Return what rover.toml does not say of a wheel and its soil."""
    lacks = []
    sizes = [name for name in ("radius", "width") if getattr(wheel, name) is None]
    if sizes:
        lines = ("[wheel]", *(f"{name} = …  # m" for name in sizes))
        lacks.append(Lack("geometry", f"the {' and '.join(sizes)} of the wheel", lines=lines))
    if rover.shear_modulus is None:
        lines = ("[soil]", "shear_modulus = …  # m, the k assumed of the soil: 0.001 to 0.04")
        lacks.append(Lack("shear modulus", "the shear modulus of the soil", lines=lines))
    return lacks


def complete(raw: Raw, wheel: Wheel, rover: Rover) -> dict[str, str]:
    """Derive in place the channels not recorded that `routes` finds; say where every channel comes from."""
    origins = {name: str(feed) for name, feed in raw.feeds.items()}
    body = raw.feeds.get("velocity")
    # What is infinite is set aside later.
    with np.errstate(invalid="ignore", over="ignore"):
        if body is not None and body.of_body and wheel.position and "yaw_rate" in raw.channels:
            speed, yaw_rate = raw.channels["velocity"], raw.channels["yaw_rate"]
            raw.channels["velocity"] = derived_channels.wheel_velocity(speed, yaw_rate, wheel.position[1])
            origins["velocity"] = f"{DERIVED} {body} and yaw rate"
        derived, _ = routes(raw.channels, wheel, rover)
        _derive(raw.channels, derived, wheel, rover)
    omega = raw.channels.get("angular_velocity")
    if omega is not None:
        # The way the wheel turns: the soil sees no other way.
        for name in raw.channels.keys() & _WITH_DIRECTION:
            raw.channels[name] = np.where(omega < 0.0, -raw.channels[name], raw.channels[name])
    return origins | {name: f"{DERIVED} {how}" for name, how in derived.items()}


def _derive(channels: dict[str, Array], derived: Collection[str], wheel: Wheel, rover: Rover) -> None:
    radius = cast("float", wheel.radius)  # `settings` says where it is not given
    if "load" in derived and rover.vehicle:
        positions = rover.positions()
        roll = channels.get("roll", np.zeros_like(channels["pitch"]))
        loads = derived_channels.wheel_loads(channels["pitch"], roll, rover.vehicle, list(positions.values()))
        channels["load"] = loads[:, list(positions).index(wheel.name)]
    if "torque" in derived and wheel.motor:
        current, temperature = channels["motor_current"], channels.get("motor_temperature")
        channels["torque"] = derived_channels.torque_from_current(
            current, wheel.motor, temperature=temperature, angular_velocity=channels.get("angular_velocity")
        )
    if "sinkage" in derived:
        # Beyond half a turn the cosine would make any depth of it.
        angle = np.clip(channels["entry_angle"], -np.pi, np.pi)
        channels["sinkage"] = np.sign(angle) * linear.sinkage_of(angle, radius)
    if "slip" in derived:
        channels["slip"] = derived_channels.slip(channels["angular_velocity"], channels["velocity"], radius)
    if "velocity" in derived:
        omega, slip = channels["angular_velocity"], channels["slip"]
        channels["velocity"] = derived_channels.velocity(omega, slip, radius)
    if "angular_velocity" in derived:
        speed, slip = channels["velocity"], channels["slip"]
        channels["angular_velocity"] = derived_channels.angular_velocity(speed, slip, radius)


def because(plan: Plan, wheel: str, lack: Lack) -> str:
    """Say why something is missing: it is neither measured nor derived, or several columns may be it."""
    doubts = plan.doubts(wheel)
    for channel in (lack.what, *lack.ask):
        if channel in doubts:
            places = ", ".join(feed.place for feed in doubts[channel][:MOST])
            return f"{channel} could be any of {places}"
    return lack.because


def reasons(plan: Plan, wheel: str, lacks: Sequence[Lack]) -> list[str]:
    """Say in a few words why channels are missing; those of which the data say nothing in one."""
    told = [(lack.what, because(plan, wheel, lack)) for lack in lacks]
    silent = [what for what, text in told if text.startswith(NOWHERE)]
    loud = [f"no {what}: {text}" for what, text in told if not text.startswith(NOWHERE)]
    are = "is" if len(silent) == 1 else "are"
    return [f"{listed(silent)} {are} neither measured nor derived", *loud] if silent else loud


def lines(plan: Plan, lacks: Mapping[str, Sequence[Lack]]) -> str:
    """Write the lines of TOML, each table once, that would supply what is missing of each wheel."""
    tables: dict[str, dict[str, None]] = {}
    for wheel, missing in lacks.items():
        for lack in missing:
            if lack.lines:
                tables.setdefault(lack.lines[0], {}).update(dict.fromkeys(lack.lines[1:]))
            for channel in lack.ask:
                entry = proposals(plan, wheel, channel)
                tables.setdefault(header(plan, wheel, channel), {}).update(dict.fromkeys(entry))
    # The wheel and its soil first, as a rover file has them.
    order = sorted(tables, key=lambda table: table not in {"[wheel]", "[soil]"})
    text = [line for table in order for line in (table, *tables[table])]
    if is_table(plan.source) and "[channels]" in tables and plan.extras:
        text.append(f"# the columns that are left: {_some(plan.extras, 3 * MOST)}")
    return "\n".join(text)


def proposals(plan: Plan, wheel: str, channel: str) -> list[str]:
    """Write the lines that would supply a channel, alternatives as comments."""
    if not is_table(plan.source):
        return _topic(plan, wheel, channel)
    dimension = CHANNELS[channel].dimension
    stated = {name: stated_unit(name, dimension) for name in plan.extras}
    fitting = {name: unit.symbol for name, unit in stated.items() if unit}
    efforts = [name for name in plan.extras if _EFFORT.search(name)] if channel == "torque" else []
    if efforts and not fitting:
        only = efforts[0] if len(efforts) == 1 else "…"
        return _of_effort(f'column = "{only}"', _one_of(efforts) if only == "…" else "")
    # A unit that is given here stands above that of the header: of several, each has its own.
    symbols = set(fitting.values()) or {units.si(dimension).symbol}
    in_unit = f', unit = "{symbols.pop()}"' if len(symbols) == 1 else ""
    return [f'{channel} = {{ column = "…"{in_unit} }}{_one_of(list(fitting))}']


def _of_effort(where: str, comment: str) -> list[str]:
    """Write the lines for an effort, which is a torque or a current: only the user can tell."""
    return [
        f'torque = {{ {where}, unit = "N m" }}{comment}',
        f'# motor_current = {{ {where}, unit = "A" }}  # instead, if that is what effort is here',
    ]


def pulls(plan: Plan, channels: Collection[str]) -> dict[str, str]:
    """Return the columns of forces that may be the drawbar pull, if none is read, with their lines."""
    if "drawbar_pull" in channels:
        return {}
    units = {name: stated_unit(name, "force") for name in plan.extras if _PULL.search(name)}
    entries = {name: {"column": name, "unit": unit.symbol} for name, unit in units.items() if unit}
    return {name: f"drawbar_pull = {toml_files.value(entry)}" for name, entry in entries.items()}


def pull(plan: Plan, wheel: str, channels: Collection[str]) -> list[str]:
    """Say which columns of forces may be the drawbar pull: `estimate` works without it."""
    found = pulls(plan, channels)
    table = header(plan, wheel, "drawbar_pull")
    lines = (f"write into rover.toml: {table} {line}" for line in found.values())
    return [f"no drawbar pull is read; if {_some(list(found))} is one, {line}" for line in lines][:1]


def not_compared(plan: Plan, wheel: str, absent: Sequence[Lack]) -> list[str]:
    """Say what a model would predict and nothing gives, where the log has something that may be it."""
    told = []
    for lack in absent:
        reason = because(plan, wheel, lack)
        if reason.startswith(NOWHERE) and not plan.extras:
            continue
        columns = f" (columns that are left: {_some(plan.extras)})" * bool(plan.extras)
        line = " ".join(lines(plan, {wheel: [lack]}).splitlines()[:2])
        then = f"if it was measured, write into rover.toml: {line}"
        told.append(f"{lack.what} is not compared: {reason}{columns}; {then}")
    return told


def header(plan: Plan, wheel: str, channel: str) -> str:
    """Name the table of rover.toml in which a channel of a wheel stands."""
    own = len(plan.wheels) > 1 and wheel in plan.wheels and channel in OF_WHEELS
    return f"[wheels.{toml_files.key(wheel)}.channels]" if own else "[channels]"


def entry(feed: Feed, unit: str, scale: float = 1.0) -> str:
    """Write the line that reads a channel in another unit: that which `scale` times what was read is in."""
    symbol, scale = _in(feed, unit, scale)
    whole = float(f"{feed.scale * scale:.9g}")
    keys = place(feed) if feed.constant is None else {"constant": feed.constant}
    keys |= {"unit": symbol, "scale": None if whole == 1.0 else whole, "offset": feed.offset * scale or None}
    return f"{feed.channel} = {toml_files.value(keys)}"


def meant(feed: Feed, unit: str, scale: float = 1.0) -> str:
    """Name the unit that `entry` writes, as a person would."""
    symbol, scale = _in(feed, unit, scale)
    if symbol == "kgf":
        # A balance shows the mass.
        return {1.0: "kg", 1e-3: "g"}.get(scale, f"{scale:g} kg")
    return symbol if scale == 1.0 else f"{scale:g} {symbol}"


def _in(feed: Feed, unit: str, scale: float) -> tuple[str, float]:
    """Apply a unit to what is converted already: metres taken for mm are in m."""
    dimension = CHANNELS[feed.channel].dimension
    other, own = units.parse(unit, dimension), feed.unit
    if other is None or own is None or own.factor == 1.0:
        return unit, scale
    factor = own.factor * other.factor
    for symbol in units.symbols(dimension):
        known = units.parse(symbol, dimension)
        if known and abs(known.factor / factor - 1.0) < 1e-9:
            return symbol, scale
    return own.symbol, scale * other.factor


def _some(names: Sequence[str], most: int = MOST) -> str:
    return ", ".join(names[:most]) + ", …" * (len(names) > most)


def _one_of(names: Sequence[str]) -> str:
    return f"  # one of: {_some(names)}" if names else ""


def _topic(plan: Plan, wheel: str, channel: str) -> list[str]:
    symbol = units.si(CHANNELS[channel].dimension).symbol
    doubts = plan.doubts(wheel).get(channel)
    if doubts:
        first, *others = [", ".join(toml_files.lines(place(feed))) for feed in doubts]
        return [f"{channel} = {{ {first} }}  # or {', or '.join(others[:MOST])}"]
    streams = plan.source.streams()
    joints = [
        (stream.topic, names)
        for stream in (streams if channel == "torque" else ())
        if stream.type == topic_discovery.JOINT_STATE
        and (names := next((f.elements for f in stream.fields if f.name == "effort"), ()))
    ]
    # Of several topics of joints that which has the one called as the wheel.
    for topic, names in sorted(joints, key=lambda one: match_name(wheel, one[1]) is None)[:1]:
        joint = match_name(wheel, names) or (names[0] if len(names) == 1 else "…")
        which = f"index = {joint}" if joint.isdigit() else f'name = "{joint}"'
        where = f'topic = "{topic}", field = "effort", {which}'
        return _of_effort(where, _one_of(names) if joint == "…" else "")
    numbers = {
        stream.topic: [f.name for f in stream.fields if f.kind == "number" and "header." not in f.name]
        for stream in streams
    }
    free = [topic for topic, names in numbers.items() if names == ["data"] and not _used(plan, topic)]
    if free:
        return [f'{channel} = {{ topic = "…", field = "data", unit = "{symbol}" }}{_one_of(free)}']
    fitting = _one_of(list(_fitting(plan, CHANNELS[channel].dimension)))
    return [f'{channel} = {{ topic = "…", field = "…", unit = "{symbol}" }}{fitting}']


def _fitting(plan: Plan, dimension: str) -> Iterator[str]:
    """Yield the topics that are not used with their fields of one number, which may be of a dimension."""
    for stream in plan.source.streams():
        for field in stream.fields if not _used(plan, stream.topic) else ():
            symbol = topic_discovery.unit_symbol(stream.type, field.name)
            known = units.parse(symbol, dimension) if symbol else not topic_discovery.is_standard(stream.type)
            if field.kind == "number" and known and not field.name.startswith("header."):
                yield f"{stream.topic} {field.name}"


def place(feed: Feed) -> dict[str, Any]:
    """Return the keys that say where a channel is read."""
    if not feed.topic:
        return {"column": feed.fields[0]}
    if feed.combine is not None:
        return {"topic": feed.topic}
    name, _, element = feed.fields[0].partition("[")
    which = {"index": int(element[:-1])} if element[:-1].isdigit() else {"name": element[:-1] or None}
    return {"topic": feed.topic, "field": name, **which}


def _used(plan: Plan, topic: str) -> bool:
    return any(feed.topic == topic for feed in plan.every_feed)
