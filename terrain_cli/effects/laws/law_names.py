"""Keys and names of a user's effect file: what each may be, and which quantities a law may read."""

import json
import math
import re
import tomllib
from collections.abc import Collection, Mapping
from pathlib import Path
from typing import Any

from terrain_cli.effects.laws.expression import FUNCTIONS
from terrain_cli.effects.laws.grammar import RESERVED
from terrain_cli.errors import ConfigurationError, nearest
from terrain_cli.mechanics.effect import KINDS, QUANTITIES
from terrain_cli.vocabulary import toml_files
from terrain_cli.vocabulary.channels import CHANNELS, LABEL

_MOST_PARAMETERS = 20
_MOST_NEEDS = 20
_ID = re.compile(r"[a-z][a-z0-9]*(?:-[a-z0-9]+)*")
LONGEST_NAME = 40
NAME_FORM = f"letters a to z, digits and _, beginning with a letter, up to {LONGEST_NAME} characters"


def _id(value: Any, place: str) -> Any:
    if len(toml_files.text(value, place)) > LONGEST_NAME or not _ID.fullmatch(value):
        raise ConfigurationError(
            f"{place}: {value[:LONGEST_NAME]!r} is no id",
            hint=f"lower-case words joined by hyphens, up to {LONGEST_NAME} characters, such as cable-drag",
        )
    return value


def _line(value: Any, place: str) -> Any:
    """Accept a text of one line: it stands in tables."""
    if not toml_files.text(value, place).isprintable():
        raise ConfigurationError(f"{place}: must be one line of text")
    return value


def _unit_text(value: Any, place: str) -> Any:
    """Accept any text here; a unit may be empty."""
    return value if isinstance(value, str) else toml_files.text(value, place)


def _several_needs(value: Any, place: str) -> Any:
    names = toml_files.several(_line)(value, place)
    if len(names) > _MOST_NEEDS:
        raise ConfigurationError(f"{place}: more than {_MOST_NEEDS}")
    for name in names:
        if names.count(name) > 1:
            raise ConfigurationError(f"{place}: {name} is there twice")
    return names


def _bound(value: Any, place: str) -> Any:
    """Accept a number or an infinity."""
    return value if value in (math.inf, -math.inf) else toml_files.number("a number")(value, place)


def _parameters(value: Any, place: str) -> Any:
    checked = toml_files.tables(_PARAMETER)(value, place)
    if len(checked) > _MOST_PARAMETERS:
        raise ConfigurationError(f"{place}: more than {_MOST_PARAMETERS} parameters")
    return checked


_KEYS = tomllib.loads(Path(__file__).with_name("effect_keys.toml").read_text("utf-8"))
_PARAMETER = toml_files.rules(_KEYS["parameter"], {"unit": _unit_text, "bound": _bound, "line": _line})
FILE = toml_files.rules(
    _KEYS["file"],
    {
        "id": _id,
        "line": _line,
        "kind": toml_files.choice(*KINDS),
        "quantity": toml_files.choice(*QUANTITIES),
        "laws": toml_files.table(dict.fromkeys(QUANTITIES, toml_files.text)),
        "needs": _several_needs,
        "columns": toml_files.tables(_unit_text),
        "parameters": _parameters,
    },
)

OF_THE_WHEEL = {"wheel_radius": "m", "width": "m", "gravity": "m/s²"}  # Always known, whatever is measured
#: To be listed among the needs: rover.toml may lack them, and only a log with time has a wheel's angle, or a
#: rut with a slope.
ON_DEMAND = {"grouser_height": "m", "grouser_count": "1", "wheel_angle": "rad", "rut_slope": "1"}
#: Known once the radius is; at the nodes under the rim; with the shear stress.
ENTRY_ANGLE = {"entry_angle": "rad"}
UNDER_THE_RIM = {"angle": "rad", "depth": "m"}
SHEARED = {"shear_displacement": "m"}

_STRESSES = ("normal_stress", "shear_stress")
_FORCES = ("torque", "drawbar_pull")
_RATE = "_rate"
_MEASURED = "measured_"


def reached(changes: str) -> dict[str, str]:
    """Return what the model knows when a quantity is changed, and the wheel's constants: name → unit."""
    order = list(QUANTITIES)
    known = order[: order.index(changes) + 1]
    if changes == "slip":
        known.append("load")
    if changes in _FORCES:
        # Both are known before either is changed; the stresses are integrated and gone.
        known = [name for name in order if name not in _STRESSES]
    units = {name: QUANTITIES[name] for name in known} | OF_THE_WHEEL
    if order.index(changes) > order.index("radius"):
        units |= ENTRY_ANGLE
    if changes in _STRESSES:
        units |= UNDER_THE_RIM
    if changes == "shear_stress":
        units |= SHEARED
    return units


def measured(needs: Collection[str], columns: Mapping[str, str]) -> dict[str, str]:
    """Return what a law may read of the needs, torque and pull as `measured_…`: name → unit."""
    return {_MEASURED + name if name in _FORCES else name: _unit(name, columns) for name in needs}


def is_column(name: str) -> bool:
    """Say whether a need is a further column, or the rate of one, and not a channel."""
    return not {name, name.removesuffix(_RATE)} & (CHANNELS.keys() | ON_DEMAND.keys())


def _unit(name: str, columns: Mapping[str, str]) -> str:
    if name in columns or name in ON_DEMAND:
        return columns.get(name) or ON_DEMAND.get(name, "1")
    channel = CHANNELS.get(name)
    if channel is not None and channel.unit is not None:
        return channel.unit.symbol
    if name.endswith(_RATE):
        return f"{_unit(name.removesuffix(_RATE), columns) or 1}/s"
    return "1"


def refused_need(name: str) -> str:  # noqa: PLR0911 - one for each reason
    """Say why a name cannot be among the needs of an effect; nothing if it can."""
    if name in OF_THE_WHEEL:
        return f"{name} is always known"
    if name in ENTRY_ANGLE:
        return "entry_angle follows from the sinkage and is always known"
    if name in _of_the_model() - CHANNELS.keys():
        return f"{name} is a quantity of the model, which nothing measures"
    if name.removeprefix(_MEASURED) in _FORCES and name.startswith(_MEASURED):
        return f"the channel is {name.removeprefix(_MEASURED)}"
    channel = CHANNELS.get(name) or CHANNELS.get(name.removesuffix(_RATE))
    if channel is not None and channel.dimension == LABEL:
        return f"{channel.name} is a label, not a number"
    if name in RESERVED:
        return f"{name} is a word of the language of laws"
    return ""


def refused_parameter(name: str) -> str:
    """Say whose name a parameter would take; nothing if it is free."""
    if name in RESERVED:
        return "a word of the language of laws"
    if name in ON_DEMAND or {name, name.removesuffix(_RATE), name.removeprefix(_MEASURED)} & CHANNELS.keys():
        return "a channel"
    if name in _of_the_model() or name in OF_THE_WHEEL:
        return "a quantity of the model"
    return ""


def _of_the_model() -> set[str]:
    return QUANTITIES.keys() | UNDER_THE_RIM.keys() | SHEARED.keys()


def unreadable(name: str, changes: str, known: Collection[str], needs: Collection[str]) -> tuple[str, str]:
    """Say why a law cannot read a name, and what to do about it."""
    channel = name.removeprefix(_MEASURED) if name.removeprefix(_MEASURED) in _FORCES else name
    if name in _FORCES and changes not in _FORCES:
        return (
            f"{name} is not known yet where {changes} is changed",
            f"the sensor's is {_MEASURED}{name}, with {_needs(needs, name)}",
        )
    if name in ENTRY_ANGLE or name in _of_the_model() - CHANNELS.keys():
        return (
            f"{name} is not known where {changes} is changed",
            f"known there: {', '.join(reached(changes))}",
        )
    if refused_need(channel):
        return refused_need(channel), ""
    if not is_column(channel):
        return f"{name} is read and not listed in needs", _needs(needs, channel)
    everything = {*known, *CHANNELS, *FUNCTIONS} - {
        name for name, channel in CHANNELS.items() if channel.dimension == LABEL
    }
    return (
        f"there is no {name}{nearest(name, everything)}",
        f"a parameter stands in [parameters.{name}], a further column of the data in {_needs(needs, name)}",
    )


def _needs(needs: Collection[str], name: str) -> str:
    return f"needs = {json.dumps([*needs, name])}"
