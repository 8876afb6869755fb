"""Speeding the wheel up takes torque that the soil never sees."""

from __future__ import annotations

from typing import Any

import numpy as np

from terrain_cli.mechanics.effect import Effect, Parameter, Quantities


def _torque(q: Quantities) -> Any:
    # Torque is counted positive the way the wheel turns, and so is its acceleration here.
    way = np.where(np.asarray(q.get("angular_velocity", 1.0)) < 0.0, -1.0, 1.0)
    return q["torque"] + q["J"] * way * q["angular_velocity_rate"]


EFFECT = Effect(
    id="acceleration-torque",
    title="Torque that accelerates the wheel",
    kind="sensor",
    parameters=(
        Parameter(
            "J",
            "kg m^2",
            0.0,
            0.5,
            lower=-10.0,
            upper=1000.0,
            meaning="moment of inertia of wheel, gear and motor, at the wheel",
            side=1,
        ),
    ),
    laws={"torque": _torque},
    needs=("angular_velocity_rate",),
    formula="T shown = T + J dω/dt, both counted positive the way the wheel turns",
    explanation=(
        "Torque measured at the motor also turns the wheel, the gear and the rotor faster. The rotor "
        "counts most: its inertia is multiplied by the square of the gear ratio. The residual is in torque "
        "alone, in proportion to the angular acceleration, positive as the wheel speeds up and negative as "
        "it slows. Sensor-lag follows the rate of the torque itself, and a lag in wheel speed that of "
        "slip; in a drive where speed, slip and torque all change together they look alike. "
        "Drivetrain-friction is there at steady speed too."
    ),
    shows="torque alone, against angular acceleration",
    reference=(
        "Ojeda, Cruz, Reina, Borenstein (2006), Current-based slippage detection and odometry correction "
        "for mobile robots and planetary rovers, IEEE Transactions on Robotics 22(2), 366–378, doi "
        "10.1109/TRO.2005.862480 (torque from motor current)"
    ),
    settled_by="the wheel speeding up and slowing down freely in the air",
)
