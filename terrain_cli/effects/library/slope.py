"""On a slope part of the weight pulls backwards, and less of it presses."""

from __future__ import annotations

from typing import Any

import numpy as np

from terrain_cli.mechanics.effect import Effect, Parameter, Quantities


def _pressing(q: Quantities) -> Any:
    return 1.0 + q["factor"] * (np.cos(q["pitch"]) - 1.0)


def _load(q: Quantities) -> Any:
    return q["load"] * _pressing(q)


def _pull(q: Quantities) -> Any:
    weight = q["load"] / np.maximum(_pressing(q), 0.1)
    return q["drawbar_pull"] - q["factor"] * weight * np.sin(q["pitch"])


EFFECT = Effect(
    id="slope",
    title="Weight along a slope",
    kind="force",
    parameters=(
        Parameter(
            "factor",
            "1",
            0.0,
            1.0,
            lower=-0.5,
            upper=2.0,
            meaning="share of the weight's parts that the data leave out; 1 is all",
        ),
    ),
    laws={"load": _load, "drawbar_pull": _pull},
    needs=("pitch", "load"),
    formula="W felt = W cos(pitch), DP shown = DP − W sin(pitch), each taken by the factor",
    explanation=(
        "Where the load is the weight on the wheel and the drawbar pull is what is left to pull with, a "
        "slope takes W sin(pitch) from the pull and leaves W cos(pitch) to press on the ground. The factor "
        "is 1 if the channels know nothing of the slope, 0 if they already account for it, as a load does "
        "that is derived from the rover's mass, and a pull that is measured between wheel and axle. "
        "Drawbar pull falls in proportion to the sine of pitch, and everything else only by the small loss "
        "of load. Load-transfer follows pitch too, but moves load, sinkage and torque more than pull."
    ),
    shows="drawbar pull against pitch",
    reference="Wong (2008), Theory of Ground Vehicles, 4th edition, Wiley: grade resistance",
    settled_by="the same slope up and down, at one slip",
)
