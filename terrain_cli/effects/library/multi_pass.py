"""Soil that a wheel has driven over is another soil."""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np

from terrain_cli.mechanics.effect import Effect, Parameter, Quantities


def _packed(quantity: str, q: Quantities) -> Any:
    """Change a quantity of the soil by a share, all of it after one pass and little more after others."""
    passes = np.expm1(-np.maximum(q["pass_number"], 0.0)) / np.expm1(-1.0)
    return q[quantity] * (1.0 + q[f"{quantity}_gain"] * passes)


EFFECT = Effect(
    id="multi-pass",
    title="Soil that has been driven over",
    kind="soil",
    parameters=(
        Parameter(
            "stiffness_gain",
            "1",
            0.0,
            0.5,
            lower=-0.6,
            upper=10.0,
            meaning="change of the stiffness by the first pass, as a share",
            side=1,
        ),
        Parameter(
            "cohesion_gain",
            "1",
            0.0,
            0.3,
            lower=-0.6,
            upper=10.0,
            meaning="change of the cohesion by the first pass, as a share",
        ),
        Parameter(
            "shear_modulus_gain",
            "1",
            0.0,
            0.3,
            lower=-0.6,
            upper=10.0,
            meaning="change of the shear modulus by the first pass, as a share",
        ),
    ),
    laws={name: partial(_packed, name) for name in ("stiffness", "cohesion", "shear_modulus")},
    needs=("pass_number",),
    formula="keq, c and k each times 1 + gain (1 − exp(−N))/(1 − exp(−1)), N the number of passes before",
    explanation=(
        "The first wheel compacts the soil, and the next in its rut finds it stiffer, mostly by 10 to 100 "
        "%, more cohesive, and sheared over a shorter way. The first pass does most; later ones add less "
        "each, and after three or four nothing changes. Sinkage falls and drawbar pull rises in a step "
        "where the pass number changes, between front and rear wheels or where the rover crosses its own "
        "track. Load-transfer also tells front from rear wheels, but follows pitch and acceleration; a "
        "change of soil along the way makes a step too, and not at the same place for every wheel."
    ),
    shows="sinkage and drawbar pull, in a step at the pass number; rear wheels against front ones",
    reference=(
        "Abebe et al. (1989), Soil compaction by multiple passes of a rigid wheel relevant for "
        "optimization of traffic, Journal of Terramechanics 26(2), 139, doi 10.1016/0022-4898(89)90003-7; "
        "after Holm (1969), Multi-pass behaviour of a pneumatic tire, Journal of Terramechanics 6"
    ),
    settled_by="the same track driven twice",
)
