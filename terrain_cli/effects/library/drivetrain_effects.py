"""Effects between the motor, where torque is measured, and the soil."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from terrain_cli.effects.laws.grammar import Law
from terrain_cli.effects.library import effect, parameter
from terrain_cli.mechanics.effect import Quantities, Sum


def _torque_with_friction(q: Quantities) -> Any:
    # Torque is counted positive the way the wheel turns, so the sign of ω is already in it.
    return q["torque"] + q["Tc"] + q["Bv"] * np.absolute(q.get("angular_velocity", 0.0))


DRIVETRAIN_FRICTION = effect(
    id="drivetrain-friction",
    title="Friction in the drivetrain",
    kind="sensor",
    parameters=(
        parameter("Tc", 0.5, "dry friction", (-50.0, 500.0), unit="N m", side=1),
        parameter(
            "Bv",
            0.2,
            "viscous friction per wheel speed",
            (-50.0, 500.0),
            unit="N m s/rad",
            needs=("angular_velocity",),
        ),
    ),
    # Friction may fall with speed (Stribeck), but never drives.
    sums=(Sum(("Tc", "Bv"), 0.0, math.inf, {"Bv": "angular_velocity"}),),
    laws={"torque": _torque_with_friction},
    formula="T shown = T + Tc + Bv |ω|, torque counted positive the way the wheel turns",
)

GEAR_EFFICIENCY = effect(
    id="gear-efficiency",
    title="Efficiency of the gear",
    kind="sensor",
    parameters=(
        parameter(
            "eta", 0.2, "share of the measured torque that reaches the wheel", (0.2, 1.1), null=1.0, side=-1
        ),
    ),
    # A wheel that drives its motor loses the same share the other way.
    laws={"torque": Law("where(torque < 0, torque * eta, torque / eta)")},
    formula="T shown = T/η, or T η where the wheel drives the motor",
)

MOTOR_TEMPERATURE = effect(
    id="motor-temperature",
    title="The motor's torque constant changes as it warms",
    kind="sensor",
    parameters=(
        parameter(
            "alpha",
            1e-3,
            "temperature coefficient of the torque constant; mostly < 0",
            (-0.01, 0.01),
            unit="1/K",
        ),
    ),
    # Data sheets give the torque constant at 25 °C.
    laws={"torque": Law("torque / max(1 + alpha * (motor_temperature - 25), 0.2)")},
    needs=("motor_temperature",),
    formula="T shown = T/(1 + α (Tm − 25 °C))",
)


def _torque_with_inertia(q: Quantities) -> Any:
    # Torque is counted positive the way the wheel turns, and so is its acceleration here.
    way = np.where(np.asarray(q.get("angular_velocity", 1.0)) < 0.0, -1.0, 1.0)
    return q["torque"] + q["J"] * way * q["angular_velocity_rate"]


ACCELERATION_TORQUE = effect(
    id="acceleration-torque",
    title="Torque that accelerates the wheel",
    kind="sensor",
    parameters=(
        parameter(
            "J",
            0.5,
            "moment of inertia of wheel, gear and motor, at the wheel",
            (-10.0, 1000.0),
            unit="kg m^2",
            side=1,
        ),
    ),
    laws={"torque": _torque_with_inertia},
    needs=("angular_velocity_rate",),
    formula="T shown = T + J dω/dt, both counted positive the way the wheel turns",
)
