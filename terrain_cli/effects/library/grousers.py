"""Lugs carry the shear surface round outside the rim."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from terrain_cli.effects.effect import Effect, Parameter

if TYPE_CHECKING:
    from collections.abc import Mapping


def _radius(q: Mapping[str, Any]) -> Any:
    return q["shear_radius"] + q["lambda_s"] * q["grouser_height"]


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
            -0.5,
            2.0,
            "share of the grouser height by which the shear surface lies outside",
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
        "sinkage, which grousers hardly do."
    ),
    shows="torque and drawbar pull at every slip, and a shift along the slip axis",
    reference=(
        "Ding, Gao, Deng, Nagatani, Yoshida (2011), Experimental study and analysis on driving wheels' "
        "performance for planetary exploration rovers moving in deformable soil, Journal of Terramechanics "
        "48(1), 27–45"
    ),
    settled_by="a slip sweep through zero with drawbar pull measured, or the same drive on a smooth wheel",
)
