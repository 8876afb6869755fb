"""Reads rover.toml, and checks the value of each key."""

import tomllib
from dataclasses import replace
from pathlib import Path
from typing import Any

from terrain_cli.errors import ConfigurationError
from terrain_cli.rover import vehicle
from terrain_cli.vocabulary import toml_files, units
from terrain_cli.vocabulary.channels import CHANNELS, LABEL, unit_hint
from terrain_cli.vocabulary.choices import BASES, K_FACTOR, METHODS, SEGMENTS, SOIL_BOUNDS
from terrain_cli.vocabulary.toml_files import Rule, choice, number, require, rules, table, tables, text
from terrain_cli.vocabulary.units import Unit

#: Fields whose unit no message type tells: effort is N, N m or A, data is anything.
_UNIT_UNKNOWN = frozenset({"effort", "data"})
#: Largest error of a size, as a share: with four standard deviations less a wheel is still there.
_MOST_SIZE_ERROR = 0.2


def find(explicit: str | None, first_input: str | None) -> Path | None:
    """Find the rover file: the one named, be it there or not, else in or beside the first input, or here."""
    if explicit:
        return Path(explicit)
    places = [Path()]
    if first_input and first_input != "-":
        first = Path(first_input)
        places = [*([first] if first.is_dir() else []), first.parent, *places]
    return next(
        (place / vehicle.FILE_NAME for place in places if (place / vehicle.FILE_NAME).is_file()), None
    )


def load(path: str | Path | None) -> vehicle.Rover:
    """Read a rover file; without one nothing is known of the rover."""
    if path is None:
        return vehicle.Rover()
    path = Path(path)
    if not path.exists():
        raise ConfigurationError(f"{path}: no such file", hint=f"terrain-est init LOG -o {path} drafts one")
    content = toml_files.parse(toml_files.read_text(path), path)
    return _rover(path, _FILE(content, f"{path}: "))


def of_text(text: str) -> vehicle.Rover:
    """Read what a rover file would hold; raises as `load`."""
    path = Path(vehicle.FILE_NAME)
    return replace(_rover(path, _FILE(toml_files.parse(text, path), f"{path}: ")), path=None)


def _rover(path: Path, content: dict[str, Any]) -> vehicle.Rover:
    motor = content.get("motor", {})
    given, channels = content.get("wheel", {}), content.get("channels", {})
    default = vehicle.Wheel(**_sizes(given), channels=channels, motor=_motor(motor, f"{path}: motor"))
    wheels = {}
    for name, given in content.get("wheels", {}).items():
        own = _motor({**motor, **given.pop("motor", {})}, f"{path}: wheels.{name}.motor")
        channels = {**default.channels, **given.pop("channels", {})}
        wheels[name] = replace(default, name=name, channels=channels, motor=own, **_sizes(given))
    modulus, factor = content.get("soil", {}).get("shear_modulus", (None, K_FACTOR))
    return vehicle.Rover(
        path=path,
        default=default,
        wheels=wheels,
        shear_modulus=modulus,
        shear_modulus_factor=factor,
        vehicle=content.get("vehicle"),
        max_gap=content.get("sampling", {}).get("max_gap"),
        steady=content.get("sampling", {}).get("steady", False),
        noise=content.get("noise", {}),
        estimate=_beside(path, content.get("estimate", {})),
    )


def _beside(path: Path, options: dict[str, Any]) -> dict[str, Any]:
    """Take the paths of a model file and of a localisation table from the folder of rover.toml."""
    files = {name: options[name] for name in ("model", "places") if name in options}
    return options | {name: str(path.parent / file) for name, file in files.items() if file not in BASES}


def _motor(values: dict[str, float], place: str) -> vehicle.Motor | None:
    if not values:
        return None
    require(values, place, "torque_constant")
    return vehicle.Motor(**values)


def _vehicle(value: Any, place: str) -> vehicle.Vehicle:
    values = _VEHICLE(value, place)
    require(values, place, "mass", "centre_of_mass")
    suspension = values.get("suspension", "rigid")
    pivots = {"rigid": set(), "rocker": {"rocker_pivot"}, "rocker-bogie": {"rocker_pivot", "bogie_pivot"}}
    require(values, place, *sorted(pivots[suspension]))
    for key in {"rocker_pivot", "bogie_pivot"} - pivots[suspension]:
        if key in values:
            raise ConfigurationError(f"{place}: a {suspension} suspension has no {key}")
    return vehicle.Vehicle(**values)


def _entry(channel: str) -> Rule:
    def rule(value: Any, place: str) -> vehicle.ChannelEntry:
        if isinstance(value, str):
            return vehicle.ChannelEntry(channel=channel, place=place, column=text(value, place))
        if not isinstance(value, dict):
            form = f'{{ constant = {value!r}, unit = "…" }}'
            raise ConfigurationError(f"{place}: must be a column or a table such as {form}, not {value!r}")
        values = _ENTRY(value, place)
        _check_place_of_values(values, place)
        _check_unit(channel, values, place)
        return vehicle.ChannelEntry(channel=channel, place=place, **values)

    return rule


def _check_place_of_values(values: dict[str, Any], place: str) -> None:
    given = [key for key in ("topic", "column", "constant") if key in values]
    if len(given) != 1:
        raise ConfigurationError(f"{place}: give one of topic, column and constant, not {len(given)}")
    stray = {"field", "name", "index"} & values.keys()
    if given != ["topic"] and stray:
        raise ConfigurationError(f"{place}: {min(stray)} belongs to a topic, not to a {given[0]}")
    if {"name", "index"} <= values.keys():
        raise ConfigurationError(f"{place}: give name or index, not both")


def _check_unit(channel: str, values: dict[str, Any], place: str) -> None:
    dimension = CHANNELS[channel].dimension
    constant = values.get("constant")
    if dimension == LABEL:
        numeric = {"unit", "scale", "offset"} & values.keys()
        if numeric:
            raise ConfigurationError(f"{place}: {channel} is a label and has no {min(numeric)}")
        return
    if isinstance(constant, str):
        raise ConfigurationError(f"{place}.constant: must be a number, not {constant!r}")
    if "unit" in values:
        values["unit"] = _unit(values["unit"], channel, f"{place}.unit")
        return
    field = str(values.get("field", "")).split("[")[0].rsplit(".", maxsplit=1)[-1]
    if dimension != "ratio" and (constant is not None or field in _UNIT_UNKNOWN):
        source = f"field {field!r}" if field else "a constant"
        raise ConfigurationError(f"{place}: unit is missing, and {source} has none", hint=unit_hint(channel))


def _unit(symbol: str, channel: str, place: str) -> Unit:
    unit = units.parse(symbol, CHANNELS[channel].dimension)
    if unit is None:
        other = units.parse(symbol)
        what = f"is a unit of {other.dimension}" if other else "is not a known unit"
        raise ConfigurationError(f"{place}: {symbol!r} {what}; {unit_hint(channel)}")
    return unit


def _noise(channel: str) -> Rule:
    def rule(value: Any, place: str) -> vehicle.SensorNoise:
        values = _NOISE(value, place)
        if not values.keys() - {"unit"}:
            what = f"{place}: give relative, absolute, offset or gain, or several of them"
            raise ConfigurationError(what, hint="such as { relative = 0.02 }")
        # Standard deviations: no zero point, as between K and °C.
        factor = _unit(values["unit"], channel, f"{place}.unit").factor if "unit" in values else 1.0
        amounts = [name for name in ("absolute", "offset") if name in values]
        if amounts and "unit" not in values and CHANNELS[channel].dimension != "ratio":
            raise ConfigurationError(f"{place}: unit of {amounts[0]} is missing", hint=unit_hint(channel))
        shares = {name: values.get(name, 0.0) for name in ("relative", "gain")}
        sizes = {name: factor * values.get(name, 0.0) for name in ("absolute", "offset")}
        return vehicle.SensorNoise(**shares, **sizes, known=bool({"relative", "absolute"} & values.keys()))

    return rule


def _size(value: Any, place: str) -> tuple[float, float]:
    if not isinstance(value, dict):
        return _LENGTH(value, place), 0.0
    given = _SIZE(value, place)
    require(given, place, "value", "error")
    size, error = given["value"], given["error"]
    most = _MOST_SIZE_ERROR * size
    if error > most:
        what = f"must be at most {_MOST_SIZE_ERROR:.0%} of the value, {most:g} m, not {error:g} m"
        raise ConfigurationError(f"{place}.error: {what}", hint="measure the wheel")
    return size, error


def _sizes(given: dict[str, Any]) -> dict[str, Any]:
    """Split what is known of each size of a wheel into its value and its error."""
    there = [name for name in ("radius", "width") if name in given]
    values = {name: given[name][0] for name in there}
    return given | values | {f"{name}_error": given[name][1] for name in there}


def _modulus(value: Any, place: str) -> tuple[float, float]:
    if not isinstance(value, dict):
        return _K(value, place), K_FACTOR
    given = _K_WITHIN(value, place)
    require(given, place, "value")
    return given["value"], given.get("factor", K_FACTOR)


def _scale(value: Any, place: str) -> Any:
    # From ns to hours is 3e-13; 0 would make one value of all.
    what = "a number from 1e-15 to 1e15, or from -1e15 to -1e-15"
    scale = number(what, -1e15, 1e15)(value, place)
    number(what, 1e-15)(abs(scale), place)
    return scale


_KEYS = tomllib.loads(Path(__file__).with_name("rover_keys.toml").read_text("utf-8"))
#: Any number in any unit, nanoseconds since 1970 among them, whose square and the square of that are numbers.
_ANY = number("a number from -1e20 to 1e20", -1e20, 1e20)
_ENTRY = rules(
    _KEYS["channel"],
    {
        "any": _ANY,
        "constant": lambda value, place: (text if isinstance(value, str) else _ANY)(value, place),
        "scale": _scale,
    },
)
_CHANNELS = table({name: _entry(name) for name in CHANNELS})
_MOTOR, _VEHICLE, _NOISE = (rules(_KEYS[name]) for name in ("motor", "vehicle", "noise"))
_K = number("a positive length in m, from 0.0001 to 1", *SOIL_BOUNDS["shear_modulus"])
_K_WITHIN = rules(_KEYS["shear_modulus"], {"shear modulus": _K})
#: From a toy's wheel to twice that of the largest mining truck.
_LENGTH = number("a positive length in m, from 0.001 to 5", 1e-3, 5.0)
_SIZE = rules(_KEYS["size"], {"length": _LENGTH})
_OF_SIZE = {"size": _size}
_OF_WHEEL = rules({**_KEYS["wheel"], **_KEYS["wheels"]}, {**_OF_SIZE, "channels": _CHANNELS, "motor": _MOTOR})
_FILE = table(
    {
        "wheel": rules(_KEYS["wheel"], _OF_SIZE),
        "wheels": tables(_OF_WHEEL),
        "soil": table({"shear_modulus": _modulus}),
        "channels": _CHANNELS,
        "motor": _MOTOR,
        "vehicle": _vehicle,
        "noise": table({name: _noise(name) for name in vehicle.NOISY}),
        "sampling": rules(_KEYS["sampling"]),
        "estimate": rules(_KEYS["estimate"], {"method": choice(*METHODS), "segments": choice(*SEGMENTS)}),
    }
)
