"""Pulling, climbing and accelerating move weight from one wheel to another."""

from __future__ import annotations

from typing import Any

import numpy as np

from terrain_cli.mechanics.effect import Effect, Parameter, Quantities


def _load(q: Quantities) -> Any:
    load = q["load"]
    along = load * np.sin(q.get("pitch", 0.0))
    pull = q.get("measured_drawbar_pull", along)
    climbing = along if "measured_drawbar_pull" in q else 0.0
    inertia = load / q["gravity"] * q.get("acceleration", 0.0)
    return load + q["ratio"] * (pull + inertia) + q["slope_ratio"] * climbing


EFFECT = Effect(
    id="load-transfer",
    title="Load moves between the axles",
    kind="force",
    parameters=(
        Parameter(
            "ratio",
            "1",
            0.0,
            0.2,
            lower=-2.0,
            upper=2.0,
            meaning="h/L: height of the pull over the wheelbase; < 0 for a front wheel",
        ),
        Parameter(
            "slope_ratio",
            "1",
            0.0,
            0.2,
            lower=-2.0,
            upper=2.0,
            meaning="h/L: height of the weight, where others than this wheel hold it on a slope",
            needs=("pitch", "drawbar_pull"),
        ),
    ),
    laws={"load": _load},
    needs=("load",),
    any_of=("drawbar_pull", "acceleration", "pitch"),
    formula=(
        "W felt = W + ratio (DP + m a) + slope_ratio W sin(pitch), m = W/g; where DP is not measured, "
        "W sin(pitch) stands for it and slope_ratio says nothing"
    ),
    explanation=(
        "A pull, a climb or an acceleration acts at a height h above the ground and is held by the wheels "
        "a length L apart: rear wheels gain load and front wheels lose it, 5 to 20 %. A load that is taken "
        "as constant, or measured only at rest, is then wrong for the wheel. The measured drawbar pull is "
        "used where there is one, and beside it the weight along the slope, which all wheels hold together; "
        "else that weight alone. The inertia is added where acceleration is measured. Sinkage, torque and "
        "pull all follow, in proportion to pitch and acceleration and with opposite signs in front and "
        "behind. Load-bias is there on the flat too; multi-pass also parts front from rear wheels, but in a "
        "fixed step."
    ),
    shows="sinkage, torque and drawbar pull against pitch and acceleration",
    reference="Wong (2008), Theory of Ground Vehicles, 4th edition, Wiley: loads of the axles in motion",
    settled_by="the same slope up and down, or starting and stopping hard on the flat",
)
