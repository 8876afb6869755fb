"""Writes what was simulated: the log, the truth, and the rover file."""

from __future__ import annotations

import json
import math
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

import formats
from formats.output.text_writer import PACKINGS, write_packed
from terrain_cli.simulation import scenario
from terrain_cli.simulation import simulated_log as logs
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


Kind = Literal["csv", "parquet", "ros1", "mcap", "db3"]
_KINDS: dict[str, Kind] = {
    ".csv": "csv",
    ".parquet": "parquet",
    ".bag": "ros1",
    ".mcap": "mcap",
    ".db3": "db3",
}
BAGS = frozenset({"ros1", "mcap", "db3"})


def kind_of(destination: str) -> Kind:
    """Tell from its name how a log is written; "-" takes CSV, as do pipes and devices."""
    path = Path(destination)
    folder = destination.endswith("/")
    packed = path.suffix.lower() in PACKINGS
    kind = _KINDS.get(Path(path.stem).suffix.lower() if packed else path.suffix.lower())
    if kind is None and (destination == "-" or path.is_fifo() or path.is_char_device()):
        return "csv"
    if kind is None or (packed and kind != "csv") or (folder and kind not in {"mcap", "db3"}):
        raise formats.CannotWriteError(
            destination,
            f"the ending {path.suffix!r} is not known" if kind is None else "cannot be written so",
            hint=f"known are {', '.join(_KINDS)}, .csv{', .csv'.join(PACKINGS)}, "
            "and .mcap/ and .db3/ for the folder of a ROS 2 recording",
        )
    return kind


def write_log(log: SimulatedLog, destination: str) -> None:
    """Write the telemetry, whole or not at all."""
    kind = kind_of(destination)
    if kind in BAGS:
        from formats.output.bag_writer import write_bag
        from terrain_cli.simulation.bag_messages import topics

        write_bag(topics(log), destination, kind)
    elif Path(destination).suffix.lower() in PACKINGS:
        write_packed(logs.table(log), destination)
    else:
        formats.write_table(logs.table(log), destination, kind=kind)


def write(log: SimulatedLog, destination: str, *, truth: str | None = None, rover: str | None = None) -> None:
    """Write the log, simulated for a bag where it becomes one, and what belongs to it: all of them, or none.

    The truth is a table where it ends in .csv or .parquet, else everything as JSON.
    """
    with ExitStack() as stack:
        if truth:
            _write_truth(log, stack.enter_context(formats.replacing(truth)))
        if rover:
            temporary = stack.enter_context(formats.replacing(rover))
            Path(temporary).write_text(scenario.rover_text(log.scenario), encoding="utf-8")
        write_log(log, destination)


def _write_truth(log: SimulatedLog, path: str) -> None:
    if Path(path).suffix.lower() in {".csv", ".parquet"}:
        formats.write_table(logs.truth_table(log), path)
        return
    text = json.dumps(document(log), ensure_ascii=False, indent=1, allow_nan=False)
    Path(path).write_text(text + "\n", encoding="utf-8")


def rover_is_in_the_way(destination: Path) -> bool:
    """Tell whether a rover file is there that was not written by this program."""
    try:
        return not destination.read_text("utf-8").startswith(scenario.HEADER)
    except FileNotFoundError:
        return False
    except (OSError, UnicodeDecodeError):
        return True
