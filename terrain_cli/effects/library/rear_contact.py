"""The soil rises behind the axle and stays in contact with the rim."""

from __future__ import annotations

from typing import Any

from terrain_cli.mechanics.effect import Effect, Parameter, Quantities


def _angle(q: Quantities) -> Any:
    return q["exit_angle"] - q["c3"] * q["entry_angle"]


EFFECT = Effect(
    id="rear-contact",
    title="Contact behind the axle",
    kind="contact",
    parameters=(
        Parameter(
            "c3",
            "1",
            0.0,
            0.2,
            lower=-0.3,
            upper=1.2,
            meaning="angle of contact behind the axle, as a share of the entry angle",
            side=1,
        ),
    ),
    laws={"exit_angle": _angle},
    formula="θ2 = −c3 θ1",
    explanation=(
        "The soil springs back or flows in behind the wheel, and the contact ends behind the lowest point "
        "instead of at it. Ishigami et al. give the height of the rut as a share λ of the sinkage, θ2 = "
        "−arccos(1 − λ z/r), which for shallow sinkage is c3 = √λ; λ is 0.9 to 1.1 in regolith and 0.05 to "
        "0.1 in soil that stays compacted. The longer contact carries more load at the same sinkage, and "
        "its rear part pushes the wheel forward: drawbar pull and torque gain, the more the deeper the "
        "wheel. A stiffer soil also carries more at the same sinkage, but does not push; grousers add "
        "torque and pull without carrying load."
    ),
    shows="load and drawbar pull against sinkage",
    reference=(
        "Ishigami, Miwa, Nagatani, Yoshida (2007), Terramechanics-based model for steering maneuver of "
        "planetary exploration rovers on loose soil, Journal of Field Robotics 24(3)"
    ),
    settled_by="load steps at one slip, with sinkage and drawbar pull measured, or a photograph of the rut",
)
