"""The truth behind a simulated log, as a document."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from terrain_cli.simulation.simulated_log import truth_table

if TYPE_CHECKING:
    from terrain_cli.simulation.scenario import Scenario
    from terrain_cli.simulation.simulated_log import SimulatedLog

FORMAT = "terrain-est/truth/1"


def document(log: SimulatedLog) -> dict[str, Any]:
    """Describe the truth behind a log, ready for JSON; see docs/simulate.md."""
    scenario = log.scenario
    return {
        "format": FORMAT,
        "seed": scenario.seed,
        "start_s": scenario.start,
        "duration_s": scenario.duration,
        "model": {"base": scenario.base, "effects": [_effect(chosen) for chosen in scenario.effects]},
        "soils": {soil.name: _soil(soil, scenario) for soil in scenario.soils},
        "wheel": scenario.geometry._asdict(),
        "noise": {name: sensor.describe() for name, sensor in scenario.sensors.items()},
        "wheels": [
            {
                "wheel": place.name,
                "position_m": [place.x, place.y],
                "soils": [
                    {
                        "soil": scenario.soils[stretch.soil].name,
                        "t_start_s": scenario.start + stretch.start,
                        "t_end_s": scenario.start + stretch.end,
                    }
                    for stretch in log.stretches[place.name]
                ],
            }
            for place in scenario.wheels
        ],
        "channels": {name: _plain(column) for name, column in truth_table(log).items()},
    }


def _effect(chosen: Any) -> dict[str, Any]:
    return {
        "effect": chosen.effect.id,
        "title": chosen.effect.title,
        "hidden": chosen.hidden,
        "parameters": {
            p.name: {"value": chosen.values[p.name], "unit": p.unit} for p in chosen.effect.parameters
        },
    }


def _soil(soil: Any, scenario: Scenario) -> dict[str, Any]:
    return {
        "c_kPa": soil.cohesion / 1e3,
        "phi_deg": math.degrees(soil.friction_angle),
        **soil.values(scenario.geometry.width),
        "reference": soil.reference,
    }


def _plain(column: Any) -> list[Any]:
    """Return a column as JSON can hold it: null where nothing is defined."""
    if isinstance(column, np.ndarray):
        return [None if cell != cell else cell for cell in column.tolist()]  # noqa: PLR0124 - NaN
    return list(column)
