"""Effects on the shape of the contact."""

from __future__ import annotations

from typing import Any

import numpy as np

from terrain_cli.effects.laws.grammar import Law
from terrain_cli.effects.library import parameter
from terrain_cli.mechanics.contact import slip_of_radius
from terrain_cli.mechanics.effect import Effect, Quantities, Sum

MAX_STRESS_ANGLE = Effect(
    id="max-stress-angle",
    title="The greatest stress moves forward with slip",
    kind="contact",
    parameters=(
        parameter("c1", 0.1, "share of the entry angle at no slip", (0.02, 0.98), null=0.5),
        parameter("c2", 0.3, "growth of that share from no slip to full slip", (-0.9, 0.9)),
    ),
    # Shares at full slip that were published lie between 0.5 and 0.8; near 1 the rim carries nothing, and
    # any wheel sinks.
    sums=(Sum(("c1", "c2"), 0.0, 0.85),),
    laws={"max_stress_angle": Law("max_stress_angle + (c1 - 0.5 + c2 * slip) * entry_angle")},
    formula="θm = (c1 + c2 i) θ1",
    explanation=(
        "Where two bodies of soil part, one flowing forward and one backward, the stress on the rim is "
        "greatest. The base models put that point half-way to the entry angle. Wong and Reece found it "
        "moving forward with slip: c1, c2 of 0.18, 0.32 in loose and 0.43, 0.32 in compact sand. A stress "
        "further forward leans against the motion and carries less: at one load drawbar pull falls with slip "
        "and sinkage rises somewhat, while torque hardly changes. The excess of T/r over DP, close to W tan "
        "θm, grows with slip; the parasitic torque of drivetrain-friction makes an excess too, but a "
        "constant one. Slip-sinkage raises sinkage far more, and torque with it; shear-modulus lowers torque "
        "and pull together. Shares at full slip, c1 + c2, were found from 0.5 to 0.8: where a fit needs "
        "more, it stands for something else."
    ),
    shows="drawbar pull against slip, and T/r − DP most of all",
    reference=(
        "Wong, Reece (1967), Prediction of rigid wheel performance based on the analysis of soil-wheel "
        "stresses, part I: Performance of driven rigid wheels, Journal of Terramechanics 4(1), 81–98"
    ),
    settled_by="a slip sweep at one load, with sinkage and drawbar pull measured together",
)

REAR_CONTACT = Effect(
    id="rear-contact",
    title="Contact behind the axle",
    kind="contact",
    parameters=(
        parameter(
            "c3", 0.2, "angle of contact behind the axle, as a share of the entry angle", (-0.3, 1.2), side=1
        ),
    ),
    laws={"exit_angle": Law("exit_angle - c3 * entry_angle")},
    formula="θ2 = −c3 θ1",
    explanation=(
        "The soil springs back or flows in behind the wheel, and the contact ends behind the lowest point "
        "instead of at it. Ishigami et al. give the height of the rut as a share λ of the sinkage, θ2 = "
        "−arccos(1 − λ z/r), which for shallow sinkage is c3 = √λ; λ is 0.9 to 1.1 in regolith and 0.05 to "
        "0.1 in soil that stays compacted. The longer contact carries more load at the same sinkage, and its "
        "rear part pushes the wheel forward: drawbar pull and torque gain, the more the deeper the wheel. A "
        "stiffer soil also carries more at the same sinkage, but does not push; grousers add torque and pull "
        "without carrying load."
    ),
    shows="load and drawbar pull against sinkage",
    reference=(
        "Ishigami, Miwa, Nagatani, Yoshida (2007), Terramechanics-based model for steering maneuver of "
        "planetary exploration rovers on loose soil, Journal of Field Robotics 24(3)"
    ),
    settled_by="load steps at one slip, with sinkage and drawbar pull measured, or a photograph of the rut",
)

_SHEAR_RADIUS = Law("shear_radius + lambda_s * grouser_height")


def _slip_of_the_rim(q: Quantities) -> Any:
    """Return 1 − V/(rω) where 1 − V/(rs ω) was recorded, and the same of a wheel that skids."""
    slip = q["slip"]
    advance = np.where(slip < 0.0, 1.0 / (1.0 + np.minimum(slip, 0.0)), 1.0 - slip)
    advance = advance * (1.0 + q["lambda_s"] * q["grouser_height"] / q["wheel_radius"])
    return np.where(advance > 1.0, 1.0 / advance - 1.0, 1.0 - advance)


GROUSERS = Effect(
    id="grousers",
    title="Grousers shear the soil outside the rim",
    kind="contact",
    parameters=(
        parameter(
            "lambda_s",
            0.5,
            "share of the grouser height by which the shear surface lies outside",
            (-0.5, 2.0),
            side=1,
        ),
    ),
    laws={"shear_radius": _SHEAR_RADIUS},
    needs=("grouser_height",),
    formula="rs = r + λs h",
    explanation=(
        "Between grousers the soil is carried round with the wheel, so that the shear surface is a circle "
        "outside the rim: its radius is r + λs h, with λs of 0.5 for sparse lugs to 1 for dense ones. Torque "
        "and drawbar pull gain at once by about 2 h/r, and the soil is already sheared at a slip of zero, as "
        "if the slip axis were shifted. The wheel-radius effect shifts the slip axis but adds no torque at "
        "high slip; a higher strength adds torque but shifts nothing; slip-sinkage moves the sinkage, which "
        "grousers hardly do. Slip is that of the rim, 1 − V/(rω). Where it was recorded as 1 − V/(rs ω), as "
        "Ding and others have it, c, tan φ and k take up everything but a torque higher by rs/r: no drive "
        "then tells grousers from gear-efficiency with η = r/rs, and a diagnosis leaves both."
    ),
    shows="torque and drawbar pull at every slip, and a shift along the slip axis",
    reference=(
        "Ding, Gao, Deng, Nagatani, Yoshida (2011), Experimental study and analysis on driving wheels' "
        "performance for planetary exploration rovers moving in deformable soil, Journal of Terramechanics "
        "48(1), 27–45"
    ),
    others=({"slip": _slip_of_the_rim, "shear_radius": _SHEAR_RADIUS},),
    settled_by="a slip sweep through zero with drawbar pull measured, or the same drive on a smooth wheel",
)


def _slip_of_a_flat_wheel(q: Quantities) -> Any:
    return slip_of_radius(q["slip"], 1.0 - q["deflection"])


FLEXIBLE_WHEEL = Effect(
    id="flexible-wheel",
    title="The wheel flattens under load",
    kind="contact",
    parameters=(
        parameter("deflection", 0.05, "δ/r: how far the rim gives way, over the radius", (-0.1, 0.4), side=1),
    ),
    laws={
        "slip": _slip_of_a_flat_wheel,
        # A share of r keeps the contact's radius finite where the wheel does not sink.
        "radius": Law("radius * (1 + deflection * wheel_radius / (sinkage + 0.02 * wheel_radius))"),
        # The stresses of the flattened arc act at the height of the axle, not at the arc's radius.
        "torque": Law("torque * (1 - deflection) * wheel_radius / radius"),
    },
    needs=("slip",),
    formula="rolling radius r − δ; radius of the contact r (1 + δ/z), so that it is as long as that of z + δ",
    explanation=(
        "A metal or elastic wheel flattens by δ, 2 to 10 % of its radius. The contact is then as long as "
        "that of a wheel sunk by z + δ, on an arc of a greater radius: the load spreads, sinkage is lower "
        "than a rigid wheel's, and the stresses lean less against the motion, so that drawbar pull gains. "
        "The wheel rolls on r − δ, and slip computed with r is too high by (1 − i) δ/r. Wheel-radius shifts "
        "slip alone. A stiffer soil lowers sinkage alone. The two signs together, low sinkage and a shift "
        "along the slip axis, are the mark of a flexible wheel. The deflection is taken as constant; it "
        "grows with load."
    ),
    shows="sinkage below that of a rigid wheel, and torque and drawbar pull along the slip axis",
    reference=(
        "Wong (2008), Theory of Ground Vehicles, 4th edition, Wiley: elastic wheels; Sharma, Tiwary, Kumar, "
        "Suresha Kumar, Keshava Murthy (2018), Systematic design and development of a flexible wheel for low "
        "mass lunar rover, Journal of Terramechanics 76, 39–52"
    ),
    settled_by="a slip sweep through zero with sinkage measured, or a side view of the loaded wheel",
)
