"""A wheel that slides sideways spends part of the soil's strength across its course."""

from __future__ import annotations

from typing import Any

import numpy as np

from terrain_cli.mechanics.contact import rolling
from terrain_cli.mechanics.effect import Effect, Parameter, Quantities

#: m, a grain: less displacement than this along has no direction.
_SMALL = 3e-4


def _mean_share(x: Any) -> Any:
    """Return (1 − exp(−x))/x."""
    return -np.expm1(-x) / x


def _stress(q: Quantities) -> Any:
    k, along = q["shear_modulus"], q["shear_displacement"]
    across = q["radius"] * rolling(q["slip"]) * (q["entry_angle"] - q["angle"]) * np.tan(q["slip_angle"])
    square = along * along + _SMALL**2
    alone, both = np.sqrt(square) / k, np.sqrt(square + q["lateral"] * across * across) / k
    return q["shear_stress"] * _mean_share(both) / _mean_share(alone)


def _modulus(q: Quantities) -> Any:
    return q["shear_modulus"] * (1.0 + q["k_growth"] * np.absolute(q["slip_angle"]))


EFFECT = Effect(
    id="side-slip",
    title="Sliding sideways takes strength from driving",
    kind="stress",
    parameters=(
        Parameter(
            "k_growth",
            "1/rad",
            0.0,
            1.0,
            lower=-1.0,
            upper=30.0,
            meaning="growth of the shear modulus, as a share, per radian",
        ),
        Parameter(
            "lateral",
            "1",
            0.0,
            2.0,
            lower=0.0,
            upper=50.0,
            meaning="(k/ky)²: how much sooner the soil shears across than along",
        ),
    ),
    laws={"shear_modulus": _modulus, "shear_stress": _stress},
    needs=("slip_angle",),
    formula=(
        "k = k0 (1 + k_growth |β|); τ = τmax (1 − exp(−ρ)) (j/k)/ρ, ρ² = (j/k)² + lateral (jy/k)², jy = r "
        "(1 − i)(θ1 − θ) tan β"
    ),
    explanation=(
        "In a turn or across a slope the wheel moves at an angle β to its plane. The soil is then sheared "
        "along and across at once. Ishigami et al. find that it gives way over a longer displacement "
        "along, k = 0.043 |β| + 0.036 m, which is a k_growth of 1.2 per radian, and over ky = 0.020 |β| + "
        "0.013 m across. Beyond that the strength is shared in the direction of the displacement, each "
        "part counted by its own modulus: `lateral` is (k/ky)², 1 for a soil that is the same both ways "
        "and some 4 to 8 with those moduli; 0 leaves the sharing out. Torque and drawbar pull fall with "
        "|β|, most at low slip, where the displacement across outweighs the one along. It looks like a "
        "lower strength in turns. Slope and load-transfer often come together with it, and follow pitch, "
        "not β."
    ),
    shows="drawbar pull and torque against |slip angle|, and so against yaw rate",
    reference=(
        "Ishigami, Miwa, Nagatani, Yoshida (2007), Terramechanics-based model for steering maneuver of "
        "planetary exploration rovers on loose soil, Journal of Field Robotics 24(3)"
    ),
    settled_by="the same slip and load at several slip angles, to either side",
)
