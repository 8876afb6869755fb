"""The effects of a simulation, and how large each is."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from terrain_cli.errors import ConfigurationError, TerrainError, nearest
from terrain_cli.toml import strict

if TYPE_CHECKING:
    from collections.abc import Mapping

    import numpy as np

    from terrain_cli.mechanics.effect import Effect, Parameter

#: Where the values of parameters lie that are not just one typical size above their null.
PLAUSIBLE = {
    # Wong and Reece 1967: 0.18 in loose sand, 0.43 in compact sand; Ding et al. 2011: c2 0.09 to 0.32.
    "max-stress-angle.c1": (0.18, 0.43),
    "max-stress-angle.c2": (0.1, 0.32),
    # Harmonic and planetary gears at part load.
    "gear-efficiency.eta": (0.6, 0.9),
    # Load cells of a rover in the field read 0.95 to 0.99 of the load.
    "load-bias.gain": (0.9, 0.98),
    "sensor-lag.torque_lag": (0.05, 0.4),
    "sensor-lag.drawbar_pull_lag": (0.05, 0.4),
    "sensor-lag.sinkage_lag": (0.05, 0.4),
    # What not every rover or soil has besides.
    "slip-sinkage.n2": (0.0, 0.0),
    "load-transfer.slope_ratio": (0.0, 0.0),
}


@dataclass(frozen=True, slots=True)
class Chosen:
    """An effect of a drive."""

    effect: Effect
    values: Mapping[str, float] = field(default_factory=dict)  # Every parameter by its short name, SI
    hidden: bool = False  # Drawn at random, and told only in the truth

    def qualified(self) -> dict[str, float]:
        """Return the values by the names that the model has for them."""
        return {self.effect.qualified(p): self.values[p.name] for p in self.effect.parameters}


def effects_rule(value: Any, place: str) -> dict[str, dict[str, float]]:
    """Read the table [effects]: id or file → its parameters; names are not looked up here."""
    result: dict[str, dict[str, float]] = strict.tables(strict.tables(strict.number("a number")))(
        value, place
    )
    return result


def choose(name: str, given: Mapping[str, float], place: str) -> Chosen:
    """Find an effect by id or path; parameters that are not given have their typical size."""
    from terrain_cli import models

    try:
        effect = models.find_effect(name)
    except TerrainError as error:
        raise ConfigurationError(f"{place}: {error}", hint=error.hint) from None
    return settle(effect, given, place)


def settle(effect: Effect, given: Mapping[str, float], place: str) -> Chosen:
    """Give every parameter of an effect a value, by short name; those not given their typical size."""
    known = {p.name: p for p in effect.parameters}
    for parameter, value in given.items():
        if parameter not in known:
            raise ConfigurationError(
                f"{place}: effect {effect.id} has no parameter {parameter!r}{nearest(parameter, known)}",
                hint=f"it has {', '.join(known)}",
            )
        bounds = known[parameter]
        if not bounds.lower <= value <= bounds.upper:
            raise ConfigurationError(
                f"{place}: {parameter} of {effect.id} must be from {bounds.lower:g} to {bounds.upper:g} "
                f"{bounds.unit if bounds.unit != '1' else ''}".rstrip()
                + f", not {value:g}"
            )
    return Chosen(effect, {n: given.get(n, typical(p, effect.qualified(p))) for n, p in known.items()})


def typical(parameter: Parameter, name: str = "") -> float:
    """Return a value that is not given: in the middle of `PLAUSIBLE`, else one typical size from the null."""
    if name in PLAUSIBLE:
        return 0.5 * sum(PLAUSIBLE[name])
    return parameter.null if parameter.shape else _away(parameter, 1.0)


def drawn(effect: Effect, rng: np.random.Generator) -> dict[str, float]:
    """Draw the size of an effect, as it may occur, by short names of its parameters."""
    values = {}
    for parameter in effect.parameters:
        size, side = float(rng.uniform(0.6, 1.6)), float(rng.choice([-1.0, 1.0]))
        below, above = parameter.null - parameter.lower, parameter.upper - parameter.null
        if (name := effect.qualified(parameter)) in PLAUSIBLE:
            low, high = PLAUSIBLE[name]
            values[parameter.name] = low + (high - low) * (size - 0.6)
        elif parameter.shape:
            values[parameter.name] = _away(parameter, 0.5 * side * (size - 0.6))
        else:
            # What may be off either way has bounds that are as far on either side.
            either = effect.kind == "sensor" and math.isclose(below, above)
            values[parameter.name] = _away(parameter, size * side if either else size)
    return values


def _away(parameter: Parameter, sizes: float) -> float:
    """Return a value some typical sizes from the null, on the other side where this one is out of bounds."""
    step = sizes * parameter.scale
    for value in (parameter.null + step, parameter.null - step):
        if parameter.lower <= value <= parameter.upper:
            return value
    return parameter.upper if step > 0.0 else parameter.lower
