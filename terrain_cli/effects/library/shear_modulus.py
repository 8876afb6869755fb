"""The way over which the soil shears grows with slip."""

from __future__ import annotations

from typing import Any

import numpy as np

from terrain_cli.mechanics.effect import Effect, Parameter, Quantities


def _modulus(q: Quantities) -> Any:
    return q["shear_modulus"] * (1.0 + q["k1"] * np.absolute(q["slip"]))


EFFECT = Effect(
    id="shear-modulus",
    title="The shear modulus grows with slip",
    kind="stress",
    parameters=(
        Parameter(
            "k1",
            "1",
            0.0,
            1.0,
            lower=-0.95,
            upper=20.0,
            meaning="growth of the shear modulus, as a share, from no slip to full slip",
        ),
    ),
    laws={"shear_modulus": _modulus},
    formula="k = k0 (1 + k1 |i|)",
    explanation=(
        "The displacement k after which the soil's strength is nearly all there depends on the thickness "
        "of the layer that is sheared: 1 to 40 mm, and under a plate it is not what it is under a wheel. "
        "As a wheel slips it loosens the soil and shears a thicker layer, and k grows. Torque and pull "
        "then rise more slowly with slip than one k allows: the curve is bent below a slip of about 0.2, "
        "and flatter beyond. Sinkage hardly moves, which tells it from slip-sinkage; T/r − DP hardly "
        "moves, which tells it from max-stress-angle. A wrong but constant k is no effect: let k be "
        "estimated first. Post-peak-softening makes the curve fall at high slip, which no k1 does."
    ),
    shows="torque and drawbar pull at slips below 0.2, by their curvature",
    reference=(
        "Wong (2008), Theory of Ground Vehicles, 4th edition, Wiley; Ishigami, Miwa, Nagatani, Yoshida "
        "(2007), Journal of Field Robotics 24(3), for a k that changes with the motion"
    ),
    settled_by="a slip sweep with many points below 0.3 and some near 1, sinkage and drawbar pull measured",
)
