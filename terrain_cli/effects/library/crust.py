"""A crust carries the wheel until it breaks."""

from __future__ import annotations

from typing import Any

import numpy as np

from terrain_cli.mechanics.effect import Effect, Parameter, Quantities


def _stress(q: Quantities) -> Any:
    return q["normal_stress"] - q["strength"] * np.expm1(-q["depth"] / q["thickness"])


EFFECT = Effect(
    id="crust",
    title="A crust over soft soil",
    kind="soil",
    parameters=(
        Parameter(
            "strength",
            "Pa",
            0.0,
            2e3,
            lower=0.0,
            upper=1e6,
            meaning="pressure that the crust bears before it breaks",
        ),
        Parameter(
            "thickness",
            "m",
            0.005,
            0.003,
            lower=0.0005,
            upper=0.05,
            meaning="depth over which it takes up that pressure",
            shape=True,
        ),
    ),
    laws={"normal_stress": _stress},
    formula="σ += strength (1 − exp(−depth/thickness))",
    explanation=(
        "Salts, moisture or frost cement the surface to a crust of 0.5 to 10 kPa over soft soil, as at "
        "Troy, where Spirit broke through. The ground is stiff until the pressure reaches that of the "
        "crust and soft beyond: little sinkage up to a load, and much for a little more. As the crust's "
        "strength changes from place to place, sinkage and torque jump between two values, and their "
        "residuals have two peaks. A smaller exponent n has the same shape, without the threshold; hardpan "
        "is soft first and stiff below."
    ),
    shows="sinkage and torque in jumps, with two peaks in their residuals",
    reference=(
        "Arvidson et al. (2010), Spirit Mars Rover Mission: Overview and selected results from the "
        "northern Home Plate Winter Haven to the side of Scamander crater, Journal of Geophysical Research "
        "115, doi 10.1029/2010JE003633"
    ),
    settled_by="load steps from a light wheel on, on fresh ground",
)
