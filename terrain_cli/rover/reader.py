"""Reads rover.toml strictly: every key must be known, and every value possible."""

from __future__ import annotations

import math
import tomllib
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from terrain_cli import units
from terrain_cli.channels import CHANNELS, LABEL, unit_hint
from terrain_cli.errors import ConfigurationError
from terrain_cli.rover.parts import FILE_NAME, Entry, Motor, Rover, Vehicle, Wheel, nearest
from terrain_cli.settings import METHODS, SEGMENTS

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping

    # Takes a value and its place in the file, and returns the value as the program wants it.
    Rule = Callable[[Any, str], Any]

#: Fields whose unit no message type tells: effort is N, N m or A, data is anything.
_UNIT_UNKNOWN = frozenset({"effort", "data"})
_ABOVE_ZERO = math.ulp(0.0)


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
    try:
        content = tomllib.loads(path.read_text("utf-8-sig"))
    except OSError as error:
        raise ConfigurationError(f"{path}: {(error.strerror or str(error)).lower()}") from error
    except UnicodeDecodeError as error:
        raise ConfigurationError(f"{path}: not text in UTF-8", hint="save it as UTF-8") from error
    except tomllib.TOMLDecodeError as error:
        raise ConfigurationError(f"{path}: not TOML: {error}") from error
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
        estimate=content.get("estimate", {}),
    )


def _motor(values: dict[str, float], place: str) -> Motor | None:
    if not values:
        return None
    _require(values, place, "torque_constant")
    return Motor(**values)


def _require(values: Mapping[str, object], place: str, *keys: str) -> None:
    for key in keys:
        if key not in values:
            raise ConfigurationError(f"{place}: {key} is missing")


def _number(what: str, low: float = -math.inf, high: float = math.inf, *, whole: bool = False) -> Rule:
    kinds = int if whole else (int, float)

    def rule(value: Any, place: str) -> Any:
        try:
            number = float(value) if isinstance(value, kinds) and not isinstance(value, bool) else math.nan
        except OverflowError:
            number = math.inf
        if not (math.isfinite(number) and low <= number <= high):
            raise ConfigurationError(f"{place}: must be {what}, not {value!r}")
        return value if whole else number

    return rule


def _vector(size: int, axes: str) -> Rule:
    number = _number("a number of metres")

    def rule(value: Any, place: str) -> Any:
        if not isinstance(value, list) or len(value) != size:
            raise ConfigurationError(f"{place}: must be {axes} in m, not {value!r}")
        return tuple(number(element, f"{place}[{index}]") for index, element in enumerate(value))

    return rule


def _text(value: Any, place: str) -> Any:
    if not isinstance(value, str) or not value.strip():
        raise ConfigurationError(f"{place}: must be text, not {value!r}")
    return value


def _choice(*choices: str) -> Rule:
    def rule(value: Any, place: str) -> Any:
        if value not in choices:
            raise ConfigurationError(f"{place}: must be one of {', '.join(choices)}, not {value!r}")
        return value

    return rule


def _each(value: Any, place: str) -> Iterator[tuple[str, Any, str]]:
    """Yield key, value and place of all in a table."""
    if not isinstance(value, dict):
        raise ConfigurationError(f"{place}: must be a table, not {value!r}")
    for key, inner in value.items():
        yield key, inner, f"{place}{key}" if place.endswith(": ") else f"{place}.{key}"


def _table(rules: Mapping[str, Rule]) -> Rule:
    def rule(value: Any, place: str) -> Any:
        checked = {}
        for key, inner, where in _each(value, place):
            if key not in rules:
                hint = f"known here: {', '.join(rules)}"
                raise ConfigurationError(f"{where}: unknown key{nearest(key, rules)}", hint=hint)
            checked[key] = rules[key](inner, where)
        return checked

    return rule


def _tables(rule_of_each: Rule) -> Rule:
    """Accept a table whose keys are names that the user chooses."""

    def rule(value: Any, place: str) -> Any:
        return {key: rule_of_each(inner, where) for key, inner, where in _each(value, place)}

    return rule


def _vehicle(value: Any, place: str) -> Vehicle:
    values = _VEHICLE(value, place)
    _require(values, place, "mass", "centre_of_mass")
    suspension = values.get("suspension", "rigid")
    pivots = {"rigid": set(), "rocker": {"rocker_pivot"}, "rocker-bogie": {"rocker_pivot", "bogie_pivot"}}
    _require(values, place, *sorted(pivots[suspension]))
    for key in {"rocker_pivot", "bogie_pivot"} - pivots[suspension]:
        if key in values:
            raise ConfigurationError(f"{place}: a {suspension} suspension has no {key}")
    return Vehicle(**values)


def _entry(channel: str) -> Rule:
    def rule(value: Any, place: str) -> Entry:
        if isinstance(value, str):
            return Entry(channel, place, column=_text(value, place))
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
        number = {"unit", "scale", "offset"} & values.keys()
        if number:
            raise ConfigurationError(f"{place}: {channel} is a label and has no {min(number)}")
        return
    if isinstance(constant, str):
        raise ConfigurationError(f"{place}.constant: must be a number, not {constant!r}")
    if "unit" in values:
        text = values["unit"]
        values["unit"] = units.parse(text, dimension)
        if values["unit"] is None:
            other = units.parse(text)
            what = f"is a unit of {other.dimension}" if other else "is not a known unit"
            raise ConfigurationError(f"{place}.unit: {text!r} {what}; {unit_hint(channel)}")
        return
    field = str(values.get("field", "")).split("[")[0].rsplit(".", maxsplit=1)[-1]
    if dimension != "ratio" and (constant is not None or field in _UNIT_UNKNOWN):
        source = f"field {field!r}" if field else "a constant"
        raise ConfigurationError(f"{place}: unit is missing, and {source} has none", hint=unit_hint(channel))


def _constant(value: Any, place: str) -> Any:
    return _text(value, place) if isinstance(value, str) else _number("a number")(value, place)


_SIZE = _number("a positive length in m, at most 5", _ABOVE_ZERO, 5.0)
_WHEEL: dict[str, Rule] = {
    "radius": _SIZE,
    "width": _SIZE,
    "grouser_count": _number("a whole number, at least 0", 0, whole=True),
    "grouser_height": _number("a length in m from 0 to 1", 0.0, 1.0),
}
_CHANNELS = _table({name: _entry(name) for name in CHANNELS})
_MOTOR = _table(
    {
        "torque_constant": _number("a positive number of N m/A", _ABOVE_ZERO),
        "gear_ratio": _number("a positive number", _ABOVE_ZERO),
        "efficiency": _number("a positive number up to 1", _ABOVE_ZERO, 1.0),
        # Outside this range it is in %/K by mistake: no magnet loses 2 % per kelvin.
        "temperature_coefficient": _number("in 1/K, from -0.02 to 0.02", -0.02, 0.02),
        "reference_temperature": _number("a temperature in °C", -273.15),
        "no_load_current": _number("a current in A, at least 0", 0.0),
    }
)
_VEHICLE = _table(
    {
        "mass": _number("a positive number of kg", _ABOVE_ZERO),
        "gravity": _number("a positive number of m/s²", _ABOVE_ZERO),
        "centre_of_mass": _vector(3, "[x, y, z]"),
        "suspension": _choice("rigid", "rocker", "rocker-bogie"),
        "rocker_pivot": _vector(2, "[x, z]"),
        "bogie_pivot": _vector(2, "[x, z]"),
    }
)
_ENTRY = _table(
    {
        "topic": _text,
        "field": _text,
        "name": _text,
        "index": _number("a whole number, at least 0", 0, whole=True),
        "column": _text,
        "constant": _constant,
        "unit": _text,
        "scale": _number("a number"),
        "offset": _number("a number"),
    }
)
_FILE = _table(
    {
        "wheel": _table(_WHEEL),
        "wheels": _tables(
            _table({**_WHEEL, "position": _vector(3, "[x, y, z]"), "channels": _CHANNELS, "motor": _MOTOR})
        ),
        "soil": _table({"shear_modulus": _number("a positive length in m, at most 1", _ABOVE_ZERO, 1.0)}),
        "channels": _CHANNELS,
        "motor": _MOTOR,
        "vehicle": _vehicle,
        "sampling": _table({"max_gap": _number("a positive number of seconds", _ABOVE_ZERO)}),
        "estimate": _table(
            {
                "method": _choice(*METHODS),
                "segments": _choice(*SEGMENTS),
                "min-samples": _number("a whole number, at least 3", 3, whole=True),
                "window-distance": _number("a positive length in m", _ABOVE_ZERO),
                "where": _text,
                "crs": _text,
            }
        ),
    }
)
