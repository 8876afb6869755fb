"""The keys of a user's effect file, and what each may be."""

from __future__ import annotations

import math
import re
from typing import Any

from terrain_cli.errors import ConfigurationError
from terrain_cli.mechanics.effect import KINDS, QUANTITIES
from terrain_cli.toml import strict

_MOST_PARAMETERS = 20
_MOST_NEEDS = 20
_ID = re.compile(r"[a-z][a-z0-9]*(?:-[a-z0-9]+)*")
LONGEST_NAME = 40
NAME_FORM = f"letters a to z, digits and _, beginning with a letter, up to {LONGEST_NAME} characters"


def _id(value: Any, place: str) -> Any:
    if len(strict.text(value, place)) > LONGEST_NAME or not _ID.fullmatch(value):
        raise ConfigurationError(
            f"{place}: {value[:LONGEST_NAME]!r} is no id",
            hint=f"lower-case words joined by hyphens, up to {LONGEST_NAME} characters, such as cable-drag",
        )
    return value


def _line(value: Any, place: str) -> Any:
    """Accept a text of one line: it stands in tables."""
    if not strict.text(value, place).isprintable():
        raise ConfigurationError(f"{place}: must be one line of text")
    return value


def _unit(value: Any, place: str) -> Any:
    """Accept any text here; a unit may be empty."""
    return value if isinstance(value, str) else strict.text(value, place)


def _needs(value: Any, place: str) -> Any:
    names = strict.several(_line)(value, place)
    if len(names) > _MOST_NEEDS:
        raise ConfigurationError(f"{place}: more than {_MOST_NEEDS}")
    for name in names:
        if names.count(name) > 1:
            raise ConfigurationError(f"{place}: {name} is there twice")
    return names


def _bound(value: Any, place: str) -> Any:
    """Accept a number or an infinity."""
    return value if value in (math.inf, -math.inf) else strict.number("a number")(value, place)


def _parameters(value: Any, place: str) -> Any:
    checked = strict.tables(_PARAMETER)(value, place)
    if len(checked) > _MOST_PARAMETERS:
        raise ConfigurationError(f"{place}: more than {_MOST_PARAMETERS} parameters")
    return checked


def _quantity(value: Any, place: str) -> Any:
    return strict.choice(*QUANTITIES)(value, place)


_PARAMETER = strict.table(
    {
        "unit": _unit,
        "null": strict.number("a number"),
        "scale": strict.number("a positive number", strict.ABOVE_ZERO),
        "lower": _bound,
        "upper": _bound,
        "meaning": _line,
        "reference": _line,
    }
)
FILE = strict.table(
    {
        "id": _id,
        "title": _line,
        "kind": strict.choice(*KINDS),
        "changes": _quantity,
        "law": strict.text,
        "laws": strict.table(dict.fromkeys(QUANTITIES, strict.text)),
        "needs": _needs,
        "columns": strict.tables(_unit),
        "parameters": _parameters,
        "explanation": strict.text,
        "shows": _line,
        "settled_by": _line,
        "reference": _line,
    }
)
