"""The effects that come with the program, by what they act on; `terrain_cli.effects` lists them."""

from __future__ import annotations

from typing import Any

from terrain_cli.mechanics.effect import Parameter


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
