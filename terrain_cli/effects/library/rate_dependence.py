"""Soil is stronger when it is sheared faster."""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np

from terrain_cli.mechanics.effect import Effect, Parameter, Quantities

#: V0 in m/s: the speed at which the strength is the soil's own.
REFERENCE = 0.1
_SLOWEST = 1e-3


def _faster(quantity: str, q: Quantities) -> Any:
    """Change a part of the strength with speed."""
    speed = np.maximum(np.absolute(q["velocity"]), _SLOWEST)
    return q[quantity] * np.maximum(1.0 + q["beta"] * np.log(speed / REFERENCE), 0.1)


EFFECT = Effect(
    id="rate-dependence",
    title="Strength depends on speed",
    kind="stress",
    parameters=(
        Parameter(
            "beta",
            "1",
            0.0,
            0.05,
            lower=-0.5,
            upper=0.5,
            meaning="growth of the shear stress, as a share, per factor e of speed",
        ),
    ),
    laws={name: partial(_faster, name) for name in ("cohesion", "tan_phi")},
    needs=("velocity",),
    formula="τ = τ0 (1 + β ln(V/V0)), V0 = 0.1 m/s: c and tan φ both by that factor",
    explanation=(
        "Shear strength grows with the logarithm of the rate of shearing: clearly the cohesion of moist "
        "soils, little the friction of dry sand, β from 0 to 0.15. Beyond 0.2 m/s a wheel in loose sand "
        "loses pull instead, as it throws soil away, and β comes out negative. Torque and drawbar pull "
        "differ between slow and fast at the same slip. In most drives slip changes with speed, and then "
        "all that depends on slip, such as shear-modulus and max-stress-angle, passes for it and it for "
        "them. The viscous part of drivetrain-friction depends on speed too, but leaves drawbar pull "
        "alone."
    ),
    shows="torque and drawbar pull against speed at one slip",
    reference=(
        "Stafford, Tanner (1983), Effect of rate on soil shear strength and soil-metal friction I. Shear "
        "strength, Soil and Tillage Research 3(3), 245–260, doi 10.1016/0167-1987(83)90026-0; for fast "
        "wheels Rodríguez-Martínez et al. (2023), arXiv 2306.02167"
    ),
    settled_by="several speeds at one slip and one load",
)
