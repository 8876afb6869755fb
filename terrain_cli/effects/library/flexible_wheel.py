"""An elastic wheel flattens: it rolls on a smaller radius and stands on a longer contact."""

from __future__ import annotations

from typing import Any

from terrain_cli.mechanics.contact import slip_of_radius
from terrain_cli.mechanics.effect import Effect, Parameter, Quantities

#: Keeps the contact's radius finite where the wheel does not sink, as a share of r.
_LEAST = 0.02


def _slip(q: Quantities) -> Any:
    return slip_of_radius(q["slip"], 1.0 - q["deflection"])


def _radius(q: Quantities) -> Any:
    r = q["wheel_radius"]
    return q["radius"] * (1.0 + q["deflection"] * r / (q["sinkage"] + _LEAST * r))


def _torque(q: Quantities) -> Any:
    # The stresses of the flattened arc act at the height of the axle, not at the arc's radius.
    return q["torque"] * (1.0 - q["deflection"]) * q["wheel_radius"] / q["radius"]


EFFECT = Effect(
    id="flexible-wheel",
    title="The wheel flattens under load",
    kind="contact",
    parameters=(
        Parameter(
            "deflection",
            "1",
            0.0,
            0.05,
            lower=-0.1,
            upper=0.4,
            meaning="δ/r: how far the rim gives way, over the radius",
            side=1,
        ),
    ),
    laws={"slip": _slip, "radius": _radius, "torque": _torque},
    needs=("slip",),
    formula="rolling radius r − δ; radius of the contact r (1 + δ/z), so that it is as long as that of z + δ",
    explanation=(
        "A metal or elastic wheel flattens by δ, 2 to 10 % of its radius. The contact is then as long as "
        "that of a wheel sunk by z + δ, on an arc of a greater radius: the load spreads, sinkage is lower "
        "than a rigid wheel's, and the stresses lean less against the motion, so that drawbar pull gains. "
        "The wheel rolls on r − δ, and slip computed with r is too high by (1 − i) δ/r. Wheel-radius "
        "shifts slip alone. A stiffer soil lowers sinkage alone. The two signs together, low sinkage and a "
        "shift along the slip axis, are the mark of a flexible wheel. The deflection is taken as constant; "
        "it grows with load."
    ),
    shows="sinkage below that of a rigid wheel, and torque and drawbar pull along the slip axis",
    reference=(
        "Wong (2008), Theory of Ground Vehicles, 4th edition, Wiley: elastic wheels; Sharma, Tiwary, "
        "Kumar, Suresha Kumar, Keshava Murthy (2018), Systematic design and development of a flexible "
        "wheel for low mass lunar rover, Journal of Terramechanics 76, 39–52"
    ),
    settled_by="a slip sweep through zero with sinkage measured, or a side view of the loaded wheel",
)
