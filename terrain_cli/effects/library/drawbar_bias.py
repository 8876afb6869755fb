"""The sensor of the drawbar pull has an offset."""

from __future__ import annotations

from typing import Any

from terrain_cli.mechanics.effect import Effect, Parameter, Quantities


def _drawbar_pull(q: Quantities) -> Any:
    return q["drawbar_pull"] + q["offset"]


EFFECT = Effect(
    id="drawbar-bias",
    title="Offset of the drawbar-pull sensor",
    kind="sensor",
    parameters=(
        Parameter(
            "offset",
            "N",
            0.0,
            10.0,
            lower=-1000.0,
            upper=1000.0,
            meaning="pull shown by a wheel that pulls nothing",
        ),
    ),
    laws={"drawbar_pull": _drawbar_pull},
    formula="DP shown = DP + offset",
    explanation=(
        "The pull is read from a force sensor at the hub, or from a cell between the carriage and what holds "
        "it back. Friction of the carriage's guides, the drag of a cable, a sensor zeroed under load or one "
        "mounted some degrees off the horizontal, which shows a share of the weight, add the same newtons at "
        "every slip and sinkage. Torque and sinkage stay as they are. A parasitic torque "
        "(drivetrain-friction) leaves the same gap between torque and pull, but on the side of the torque; "
        "bulldozing and a slope take pull away too, the one with the sinkage, the other with the pitch."
    ),
    shows="drawbar pull by a constant",
    reference=(
        "Gerdes, Pérez del Pulgar, Castilla Arquillo, Azkarate (2024), Field assessment of force torque "
        "sensors for planetary rover navigation, arXiv 2411.04700: offsets of such sensors on a rover"
    ),
    settled_by="the reading with the wheel in the air, another load, or a slope",
)
