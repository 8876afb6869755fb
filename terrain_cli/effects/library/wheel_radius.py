"""Slip is computed with a wrong radius."""

from __future__ import annotations

from typing import Any

from terrain_cli.mechanics.contact import slip_of_radius
from terrain_cli.mechanics.effect import Effect, Parameter, Quantities


def _slip(q: Quantities) -> Any:
    return slip_of_radius(q["slip"], 1.0 + q["relative_error"])


EFFECT = Effect(
    id="wheel-radius",
    title="The radius from which slip was computed",
    kind="sensor",
    parameters=(
        Parameter(
            "relative_error",
            "1",
            0.0,
            0.03,
            lower=-0.4,
            upper=0.4,
            meaning="Δr/r: how far the rolling radius exceeds the stated one",
        ),
    ),
    laws={"slip": _slip},
    needs=("slip",),
    formula="1 − i felt = (1 − i)/(1 + Δr/r), so that i rises by nearly (1 − i) Δr/r",
    explanation=(
        "Slip is 1 − V/(r ω). With grousers, tyre wear or a bent rim the radius on which the wheel rolls "
        "is 1 to 10 % off, and slip is off by (1 − i) Δr/r: all of it at low slip, nothing at full slip. A "
        "speed that is off by a factor does the same. The curves of torque and pull over slip are shifted "
        "sideways, so that torque is zero at a slip that is not. Grousers shift them too, but add torque "
        "at high slip; flexible-wheel shifts them and lengthens the contact; shear-modulus bends them and "
        "leaves their beginning at zero."
    ),
    shows="torque and drawbar pull along the slip axis; no torque at a slip that is not zero",
    reference=(
        "Borenstein, Feng (1996), Measurement and correction of systematic odometry errors in mobile "
        "robots, IEEE Transactions on Robotics and Automation 12(6), 869–880, doi 10.1109/70.544770"
    ),
    settled_by="a slip sweep through zero, or the distance of ten turns on firm ground",
)
