"""Bearings, seals and gears take torque that the soil never sees."""

from __future__ import annotations

from typing import Any

import numpy as np

from terrain_cli.mechanics.effect import Effect, Parameter, Quantities


def _torque(q: Quantities) -> Any:
    # Torque is counted positive the way the wheel turns, so the sign of ω is already in it.
    return q["torque"] + q["Tc"] + q["Bv"] * np.absolute(q.get("angular_velocity", 0.0))


EFFECT = Effect(
    id="drivetrain-friction",
    title="Friction in the drivetrain",
    kind="sensor",
    parameters=(
        Parameter("Tc", "N m", 0.0, 0.5, lower=-50.0, upper=500.0, meaning="dry friction", side=1),
        Parameter(
            "Bv",
            "N m s/rad",
            0.0,
            0.2,
            lower=-50.0,
            upper=500.0,
            meaning="viscous friction per wheel speed",
            needs=("angular_velocity",),
        ),
    ),
    laws={"torque": _torque},
    formula="T shown = T + Tc + Bv |ω|, torque counted positive the way the wheel turns",
    explanation=(
        "A torque that is measured at the motor, or derived from its current, includes what bearings, "
        "seals and gears take: a constant part Tc, 5 to 30 % of a rover's torque, and a part that grows "
        "with wheel speed. Torque is too high by the same amount whatever slip, load and sinkage are; "
        "drawbar pull and sinkage stay. T/r − DP − W tan(θ1/2) is then constant, where max-stress-angle "
        "makes it grow with slip. Without drawbar pull it passes for cohesion, which also adds torque at "
        "any load, and at one wheel speed Tc and Bv are the same thing. Gear-efficiency takes a share of "
        "the torque instead. Without a measured wheel speed only Tc acts."
    ),
    shows="torque alone, constant or against wheel speed",
    reference=(
        "Armstrong-Hélouvry, Dupont, Canudas de Wit (1994), A survey of models, analysis tools and "
        "compensation methods for the control of machines with friction, Automatica 30(7), 1083–1138, doi "
        "10.1016/0005-1098(94)90209-7"
    ),
    settled_by="the wheel turning in the air at several speeds, or a load step with drawbar pull measured",
)
