"""Reads rover.toml: what each key may be."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from terrain_cli import strict, units
from terrain_cli.channels import CHANNELS, LABEL, unit_hint
from terrain_cli.choices import BASES, METHODS, SEGMENTS
from terrain_cli.errors import ConfigurationError
from terrain_cli.rover.parts import FILE_NAME, NOISY, Entry, Motor, Noise, Rover, Vehicle, Wheel
from terrain_cli.strict import ABOVE_ZERO, choice, flag, number, require, table, tables, text, vector

if TYPE_CHECKING:
    from terrain_cli.strict import Rule
    from terrain_cli.units import Unit

#: Fields whose unit no message type tells: effort is N, N m or A, data is anything.
_UNIT_UNKNOWN = frozenset({"effort", "data"})


def find(explicit: str | None, first_input: str | None) -> Path | None:
    """Find the rover file: the one named, else beside the first input, else here.

    Parameters
    ----------
    explicit : str or None
        ``--rover FILE``; it need not exist, `load` says so.
    first_input : str or None
        A file, a folder (looked into first) or "-".

    Returns
    -------
    Path or None
    """
    if explicit:
        return Path(explicit)
    places = [Path()]
    if first_input and first_input != "-":
        first = Path(first_input)
        places = [*([first] if first.is_dir() else []), first.parent, *places]
    return next((place / FILE_NAME for place in places if (place / FILE_NAME).is_file()), None)


def load(path: str | Path | None) -> Rover:
    """Read a rover file.

    Parameters
    ----------
    path : str or Path or None
        None for no file: nothing is known of the rover.

    Returns
    -------
    Rover

    Raises
    ------
    ConfigurationError
        The file cannot be read, is not TOML, or has an unknown key or an impossible value.
    """
    if path is None:
        return Rover()
    path = Path(path)
    content = strict.parse(strict.read_text(path), path)
    return _rover(path, _FILE(content, f"{path}: "))


def _rover(path: Path, content: dict[str, Any]) -> Rover:
    motor = content.get("motor", {})
    default = Wheel(
        **content.get("wheel", {}),
        channels=content.get("channels", {}),
        motor=_motor(motor, f"{path}: motor"),
    )
    wheels = {}
    for name, given in content.get("wheels", {}).items():
        own = _motor({**motor, **given.pop("motor", {})}, f"{path}: wheels.{name}.motor")
        channels = {**default.channels, **given.pop("channels", {})}
        wheels[name] = replace(default, name=name, channels=channels, motor=own, **given)
    return Rover(
        path=path,
        default=default,
        wheels=wheels,
        shear_modulus=content.get("soil", {}).get("shear_modulus"),
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


def _motor(values: dict[str, float], place: str) -> Motor | None:
    if not values:
        return None
    require(values, place, "torque_constant")
    return Motor(**values)


def _vehicle(value: Any, place: str) -> Vehicle:
    values = _VEHICLE(value, place)
    require(values, place, "mass", "centre_of_mass")
    suspension = values.get("suspension", "rigid")
    pivots = {"rigid": set(), "rocker": {"rocker_pivot"}, "rocker-bogie": {"rocker_pivot", "bogie_pivot"}}
    require(values, place, *sorted(pivots[suspension]))
    for key in {"rocker_pivot", "bogie_pivot"} - pivots[suspension]:
        if key in values:
            raise ConfigurationError(f"{place}: a {suspension} suspension has no {key}")
    return Vehicle(**values)


def _entry(channel: str) -> Rule:
    def rule(value: Any, place: str) -> Entry:
        if isinstance(value, str):
            return Entry(channel, place, column=text(value, place))
        if not isinstance(value, dict):
            form = f'{{ constant = {value!r}, unit = "…" }}'
            raise ConfigurationError(f"{place}: must be a column or a table such as {form}, not {value!r}")
        values = _ENTRY(value, place)
        _check_place_of_values(values, place)
        _check_unit(channel, values, place)
        return Entry(channel, place, **values)

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
    def rule(value: Any, place: str) -> Noise:
        values = _NOISE(value, place)
        if not {"relative", "absolute"} & values.keys():
            raise ConfigurationError(
                f"{place}: give relative or absolute or both", hint="such as { relative = 0.02 }"
            )
        absolute = values.get("absolute", 0.0)
        if "unit" in values:
            # A standard deviation: no offset, as between K and °C.
            absolute *= _unit(values["unit"], channel, f"{place}.unit").factor
        elif "absolute" in values and CHANNELS[channel].dimension != "ratio":
            raise ConfigurationError(f"{place}: unit of absolute is missing", hint=unit_hint(channel))
        return Noise(values.get("relative", 0.0), absolute)

    return rule


def _constant(value: Any, place: str) -> Any:
    return text(value, place) if isinstance(value, str) else number("a number")(value, place)


_SIZE = number("a positive length in m, at most 5", ABOVE_ZERO, 5.0)
_WHEEL: dict[str, Rule] = {
    "radius": _SIZE,
    "width": _SIZE,
    "grouser_count": number("a whole number, at least 0", 0, whole=True),
    "grouser_height": number("a length in m from 0 to 1", 0.0, 1.0),
}
_CHANNELS = table({name: _entry(name) for name in CHANNELS})
_MOTOR = table(
    {
        "torque_constant": number("a positive number of N m/A", ABOVE_ZERO),
        "gear_ratio": number("a positive number", ABOVE_ZERO),
        "efficiency": number("a positive number up to 1", ABOVE_ZERO, 1.0),
        # Outside this range it is in %/K by mistake: no magnet loses 2 % per kelvin.
        "temperature_coefficient": number("in 1/K, from -0.02 to 0.02", -0.02, 0.02),
        "reference_temperature": number("a temperature in °C", -273.15),
        "no_load_current": number("a current in A, at least 0", 0.0),
    }
)
_VEHICLE = table(
    {
        "mass": number("a positive number of kg", ABOVE_ZERO),
        "gravity": number("a positive number of m/s²", ABOVE_ZERO),
        "centre_of_mass": vector(3, "[x, y, z]"),
        "suspension": choice("rigid", "rocker", "rocker-bogie"),
        "rocker_pivot": vector(2, "[x, z]"),
        "bogie_pivot": vector(2, "[x, z]"),
    }
)
_NOISE = table(
    {
        "relative": number("a share from 0 to 1", 0.0, 1.0),
        "absolute": number("a number, at least 0", 0.0),
        "unit": text,
    }
)
_ENTRY = table(
    {
        "topic": text,
        "field": text,
        "name": text,
        "index": number("a whole number, at least 0", 0, whole=True),
        "column": text,
        "constant": _constant,
        "unit": text,
        "scale": number("a number"),
        "offset": number("a number"),
    }
)
_FILE = table(
    {
        "wheel": table(_WHEEL),
        "wheels": tables(
            table({**_WHEEL, "position": vector(3, "[x, y, z]"), "channels": _CHANNELS, "motor": _MOTOR})
        ),
        "soil": table({"shear_modulus": number("a positive length in m, at most 1", ABOVE_ZERO, 1.0)}),
        "channels": _CHANNELS,
        "motor": _MOTOR,
        "vehicle": _vehicle,
        "noise": table({name: _noise(name) for name in NOISY}),
        "sampling": table({"max_gap": number("a positive number of seconds", ABOVE_ZERO), "steady": flag}),
        "estimate": table(
            {
                "method": choice(*METHODS),
                "segments": choice(*SEGMENTS),
                "min-samples": number("a whole number, at least 3", 3, whole=True),
                "window-distance": number("a positive length in m", ABOVE_ZERO),
                "where": text,
                "crs": text,
                "model": text,
                "robust": flag,
                "places": text,
            }
        ),
    }
)
