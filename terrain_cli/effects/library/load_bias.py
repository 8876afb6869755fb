"""The load cell has a gain and an offset."""

from __future__ import annotations

from typing import Any

from terrain_cli.mechanics.effect import Effect, Parameter, Quantities


def _load(q: Quantities) -> Any:
    return (q["load"] - q["offset"]) / q["gain"]


EFFECT = Effect(
    id="load-bias",
    title="Gain and offset of the load cell",
    kind="sensor",
    parameters=(
        Parameter(
            "gain", "1", 1.0, 0.05, lower=0.7, upper=1.4, meaning="newtons shown per newton on the wheel"
        ),
        Parameter(
            "offset",
            "N",
            0.0,
            10.0,
            lower=-1000.0,
            upper=1000.0,
            meaning="newtons shown with the wheel in the air",
        ),
    ),
    laws={"load": _load},
    needs=("load",),
    formula="W shown = gain · W + offset",
    explanation=(
        "A load cell that was zeroed under the weight of the leg, or drifts with temperature, shows g W + "
        "o: on the wheels of a rover in the field g was 0.95 to 0.99 and o 1 to 114 N. Sinkage, torque and "
        "pull are all too high or too low for the load that is shown. An offset passes for cohesion, as "
        "both are the same at every load; a gain passes for friction and stiffness. At one load gain and "
        "offset are the same thing. Drivetrain-friction moves torque only; load-transfer is nothing on the "
        "flat."
    ),
    shows="sinkage, torque and drawbar pull against load",
    reference=(
        "Gerdes, Pérez del Pulgar, Castilla Arquillo, Azkarate (2024), Field assessment of force torque "
        "sensors for planetary rover navigation, arXiv 2411.04700"
    ),
    settled_by="a load step, and the reading with the wheel in the air",
)
