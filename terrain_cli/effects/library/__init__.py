"""The effects that come with the program, by what they act on; `terrain_cli.effects` lists them."""

from __future__ import annotations

import tomllib
from functools import cache
from importlib.resources import files
from typing import Any

from terrain_cli.mechanics.effect import Effect, Parameter


def parameter(
    name: str,
    scale: float,
    meaning: str,
    bounds: tuple[float, float],
    unit: str = "1",
    null: float = 0.0,
    **more: Any,
) -> Parameter:
    """Return a parameter of most effects: a number within bounds, and no effect at 0."""
    return Parameter(name, unit, null, scale, meaning, lower=bounds[0], upper=bounds[1], **more)


def effect(**what: Any) -> Effect:
    """Return an effect of the catalogue, with what is told of it in effects.toml."""
    told: dict[str, Any] = {key: " ".join(text.split()) for key, text in _told()[what["id"]].items()}
    return Effect(**what, **told)


@cache
def _told() -> dict[str, dict[str, str]]:
    return tomllib.loads(files(__package__).joinpath("effects.toml").read_text("utf-8"))
