"""Lugs carry the shear surface round outside the rim."""

from __future__ import annotations

from typing import Any

import numpy as np

from terrain_cli.mechanics.effect import Effect, Parameter, Quantities


def _radius(q: Quantities) -> Any:
    return q["shear_radius"] + q["lambda_s"] * q["grouser_height"]


def _slip_of_the_rim(q: Quantities) -> Any:
    """Return 1 − V/(rω) where 1 − V/(rs ω) was recorded, and the same of a wheel that skids."""
    slip = q["slip"]
    advance = np.where(slip < 0.0, 1.0 / (1.0 + np.minimum(slip, 0.0)), 1.0 - slip)
    advance = advance * (1.0 + q["lambda_s"] * q["grouser_height"] / q["wheel_radius"])
    return np.where(advance > 1.0, 1.0 / advance - 1.0, 1.0 - advance)


EFFECT = Effect(
    id="grousers",
    title="Grousers shear the soil outside the rim",
    kind="contact",
    parameters=(
        Parameter(
            "lambda_s",
            "1",
            0.0,
            0.5,
            lower=-0.5,
            upper=2.0,
            meaning="share of the grouser height by which the shear surface lies outside",
            side=1,
        ),
    ),
    laws={"shear_radius": _radius},
    needs=("grouser_height",),
    formula="rs = r + λs h",
    explanation=(
        "Between grousers the soil is carried round with the wheel, so that the shear surface is a circle "
        "outside the rim: its radius is r + λs h, with λs of 0.5 for sparse lugs to 1 for dense ones. "
        "Torque and drawbar pull gain at once by about 2 h/r, and the soil is already sheared at a slip of "
        "zero, as if the slip axis were shifted. The wheel-radius effect shifts the slip axis but adds no "
        "torque at high slip; a higher strength adds torque but shifts nothing; slip-sinkage moves the "
        "sinkage, which grousers hardly do. Slip is that of the rim, 1 − V/(rω). Where it was recorded as "
        "1 − V/(rs ω), as Ding and others have it, c, tan φ and k take up everything but a torque higher by "
        "rs/r: no drive then tells grousers from gear-efficiency with η = r/rs, and a diagnosis leaves both."
    ),
    shows="torque and drawbar pull at every slip, and a shift along the slip axis",
    reference=(
        "Ding, Gao, Deng, Nagatani, Yoshida (2011), Experimental study and analysis on driving wheels' "
        "performance for planetary exploration rovers moving in deformable soil, Journal of Terramechanics "
        "48(1), 27–45"
    ),
    others=({"slip": _slip_of_the_rim, "shear_radius": _radius},),
    settled_by="a slip sweep through zero with drawbar pull measured, or the same drive on a smooth wheel",
)
