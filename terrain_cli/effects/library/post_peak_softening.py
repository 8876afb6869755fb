"""Sheared beyond its peak, a dense soil loses strength."""

from __future__ import annotations

from typing import Any

import numpy as np

from terrain_cli.mechanics.effect import Effect, Parameter, Quantities


def _stress(q: Quantities) -> Any:
    sheared = -np.expm1(-np.absolute(q["shear_displacement"]) / q["length"])
    return q["shear_stress"] * (1.0 - q["loss"] * sheared)


EFFECT = Effect(
    id="post-peak-softening",
    title="Strength is lost beyond a peak",
    kind="stress",
    parameters=(
        Parameter(
            "loss",
            "1",
            0.0,
            0.3,
            lower=-0.5,
            upper=0.95,
            meaning="share of the strength that is lost in the end",
        ),
        Parameter(
            "length",
            "m",
            0.05,
            0.03,
            lower=0.003,
            upper=0.5,
            meaning="shear displacement over which it is lost",
            shape=True,
        ),
    ),
    laws={"shear_stress": _stress},
    formula="τ = (c + σ tan φ)(1 − exp(−j/k))(1 − loss (1 − exp(−j/length)))",
    explanation=(
        "Dense sand, crusted soil, mats of roots and frozen snow shear through a hump: strength rises to a "
        "peak and falls to a residual of 0.5 to 0.9 of it. With a length equal to k this is the hump that "
        "Wong fits to snow, apart from the name of its constants; a greater length loses strength later. c "
        "and φ are those before the loss. Torque and drawbar pull fall at high slip, where the soil has "
        "been sheared furthest, and a deep wheel shows it sooner. Drawbar pull alone falls with "
        "slip-sinkage too, but there torque keeps rising; shear-modulus flattens the curves and cannot "
        "make them fall."
    ),
    shows="torque and drawbar pull, falling together at high slip",
    reference="Wong (2008), Theory of Ground Vehicles, 4th edition, Wiley: shear curves with a hump",
    settled_by="a slip sweep up to 0.8 or more, with sinkage measured",
)
