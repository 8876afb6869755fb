"""The effects that come with the program, read from effects.toml; `terrain_cli.effects` lists them."""

import tomllib
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any

from terrain_cli.mechanics.effect import Effect, Law, Parameter, Sum

_ENTRIES: dict[str, dict[str, Any]] = tomllib.loads(
    Path(__file__).with_name("effects.toml").read_text("utf-8")
)
NAMES = tuple(_ENTRIES)


@cache
def effect(name: str) -> Effect:
    entry = _ENTRIES[name]
    told: dict[str, Any] = {
        key: " ".join(text.split()) for key, text in entry.items() if isinstance(text, str)
    }
    return Effect(
        id=name,
        parameters=tuple(_parameter(short, **one) for short, one in entry["parameters"].items()),
        laws=_laws(entry["laws"]),
        others=tuple(map(_laws, entry.get("others", ()))),
        sums=tuple(Sum(**{**one, "names": tuple(one["names"])}) for one in entry.get("sums", ())),
        needs=tuple(entry.get("needs", ())),
        any_of=tuple(entry.get("any_of", ())),
        remembers=entry.get("remembers", False),
        **told,
    )


def _parameter(
    name: str, *, scale: float, meaning: str, unit: str = "1", null: float = 0.0, **more: Any
) -> Parameter:
    more = {key: tuple(value) if isinstance(value, list) else value for key, value in more.items()}
    return Parameter(name, unit, null, scale, meaning, **more)


def _laws(texts: Mapping[str, str]) -> dict[str, Law]:
    """Return laws as they can be called: a bare name stands for a function."""
    from terrain_cli.effects.laws import grammar
    from terrain_cli.effects.library import law_functions

    known = vars(law_functions)
    return {
        quantity: known[text] if text.isidentifier() else grammar.Law(text)
        for quantity, text in texts.items()
    }
