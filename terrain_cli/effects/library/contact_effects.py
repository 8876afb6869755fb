"""Effects on the shape of the contact."""

from __future__ import annotations

from typing import Any

import numpy as np

from terrain_cli.effects.laws.grammar import Law
from terrain_cli.effects.library import effect, parameter
from terrain_cli.mechanics.contact import slip_of_radius
from terrain_cli.mechanics.effect import Quantities, Sum

MAX_STRESS_ANGLE = effect(
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
)

REAR_CONTACT = effect(
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
)

_SHEAR_RADIUS = Law("shear_radius + lambda_s * grouser_height")


def _slip_of_the_rim(q: Quantities) -> Any:
    """Return 1 − V/(rω) where 1 − V/(rs ω) was recorded, and the same of a wheel that skids."""
    slip = q["slip"]
    advance = np.where(slip < 0.0, 1.0 / (1.0 + np.minimum(slip, 0.0)), 1.0 - slip)
    advance = advance * (1.0 + q["lambda_s"] * q["grouser_height"] / q["wheel_radius"])
    return np.where(advance > 1.0, 1.0 / advance - 1.0, 1.0 - advance)


GROUSERS = effect(
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
    others=({"slip": _slip_of_the_rim, "shear_radius": _SHEAR_RADIUS},),
)


def _slip_of_a_flat_wheel(q: Quantities) -> Any:
    return slip_of_radius(q["slip"], 1.0 - q["deflection"])


FLEXIBLE_WHEEL = effect(
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
)
