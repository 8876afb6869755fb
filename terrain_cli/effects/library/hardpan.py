"""Below a depth the soil is firmer."""

from __future__ import annotations

from typing import Any

import numpy as np

from terrain_cli.mechanics.effect import Effect, Parameter, Quantities

#: m: over this distance to either side of its top the layer sets in.
_ROUND = 5e-4


def _stress(q: Quantities) -> Any:
    over = q["depth"] - q["top"]
    # A parabola between two straight lines: no kink, and exact away from the top.
    within = np.minimum(np.maximum(over + _ROUND, 0.0), 2.0 * _ROUND)
    into = within * within / (4.0 * _ROUND) + np.maximum(over - _ROUND, 0.0)
    return q["normal_stress"] + q["modulus"] * into


EFFECT = Effect(
    id="hardpan",
    title="A firmer layer below",
    kind="soil",
    parameters=(
        Parameter(
            "modulus",
            "Pa/m",
            0.0,
            2e6,
            lower=0.0,
            upper=1e9,
            meaning="pressure that the layer adds per depth into it",
        ),
        Parameter(
            "top",
            "m",
            0.01,
            0.01,
            lower=0.001,
            upper=0.3,
            meaning="depth of the layer below the surface",
            shape=True,
        ),
    ),
    laws={"normal_stress": _stress},
    formula="σ += modulus · (depth − top), where that is positive",
    explanation=(
        "Loose soil over a firm layer, ice or rock is soft until the wheel reaches it, 10 to 100 mm down, "
        "and then takes more load at little more sinkage. Sinkage rises with load and slip and then "
        "saturates, and the load sits on the lowest part of the rim, which raises drawbar pull. Loads that "
        "never reach the layer show nothing. A larger exponent n also stiffens with depth, but from the "
        "surface on, without a bend; crust is stiff first and soft below, just the other way round."
    ),
    shows="sinkage, saturating as load and slip grow",
    reference="Wong (2008), Theory of Ground Vehicles, 4th edition, Wiley: layered terrain",
    settled_by="a wide range of load, beyond the one that reaches the layer",
)
