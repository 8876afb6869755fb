"""Effects between the motor, where torque is measured, and the soil."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from terrain_cli.effects.laws.grammar import Law
from terrain_cli.effects.library import parameter
from terrain_cli.mechanics.effect import Effect, Quantities, Sum


def _torque_with_friction(q: Quantities) -> Any:
    # Torque is counted positive the way the wheel turns, so the sign of ω is already in it.
    return q["torque"] + q["Tc"] + q["Bv"] * np.absolute(q.get("angular_velocity", 0.0))


DRIVETRAIN_FRICTION = Effect(
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
    explanation=(
        "A torque that is measured at the motor, or derived from its current, includes what bearings, seals "
        "and gears take: a constant part Tc, 5 to 30 % of a rover's torque, and a part that grows with wheel "
        "speed, or falls with it where the parts hardly move (Stribeck). Torque is too high by the same "
        "amount whatever slip, load and sinkage are; drawbar pull and sinkage stay. T/r − DP − W tan(θ1/2) "
        "is then constant, where max-stress-angle makes it grow with slip. Without drawbar pull it passes "
        "for cohesion, which also adds torque at any load, and at one wheel speed Tc and Bv are the same "
        "thing. Gear-efficiency takes a share of the torque instead. Without a measured wheel speed only Tc "
        "acts."
    ),
    shows="torque alone, constant or against wheel speed",
    reference=(
        "Armstrong-Hélouvry, Dupont, Canudas de Wit (1994), A survey of models, analysis tools and "
        "compensation methods for the control of machines with friction, Automatica 30(7), 1083–1138, doi "
        "10.1016/0005-1098(94)90209-7"
    ),
    settled_by="the wheel turning in the air at several speeds, or a load step with drawbar pull measured",
)

GEAR_EFFICIENCY = Effect(
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
    explanation=(
        "A harmonic or planetary gear loses a share of what passes through it: η is 0.5 to 0.95, lower when "
        "cold or lightly loaded. Torque measured before the gear is too high by the same share everywhere, "
        "so the residual is a multiple of the torque itself. A soil with c and tan φ higher by that share "
        "gives nearly the same torque, so without drawbar pull η cannot be told from the strength: fix it "
        "from a data sheet. With drawbar pull, T/r − DP grows with torque; drivetrain-friction adds the same "
        "torque at every load, and motor-temperature follows the motor's temperature."
    ),
    shows="torque alone, in proportion to torque",
    reference=(
        "Tuttle, Seering (1996), A nonlinear model of a harmonic drive gear transmission, IEEE Transactions "
        "on Robotics and Automation 12(3), 368–374"
    ),
    settled_by="a load step with drawbar pull measured, or torque measured behind the gear",
)

MOTOR_TEMPERATURE = Effect(
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
    explanation=(
        "A torque that is derived from motor current with the torque constant of a data sheet is right at 25 "
        "°C only. The remanence of the magnets falls with temperature, by 0.03 to 0.05 % per kelvin for "
        "SmCo, about 0.1 for NdFeB and 0.2 for ferrite, so α is −0.0003 to −0.002 per kelvin: a warm motor "
        "draws more current for the same torque, and the torque shown is too high. Where torque comes from "
        "voltage, the copper's 0.4 % per kelvin enters instead. The residual is a share of the torque that "
        "drifts slowly as the motor warms. Gear-efficiency does not drift; a soil that hardens along the way "
        "drifts too, and moves sinkage and drawbar pull as well."
    ),
    shows="torque alone, in proportion to torque, against motor temperature",
    reference=(
        "Deshpande (2003), Recent advances in materials for use in permanent magnet machines: a review, IEEE "
        "International Electric Machines and Drives Conference, doi 10.1109/IEMDC.2003.1211311"
    ),
    settled_by="the same track driven with a cold and with a warm motor",
)


def _torque_with_inertia(q: Quantities) -> Any:
    # Torque is counted positive the way the wheel turns, and so is its acceleration here.
    way = np.where(np.asarray(q.get("angular_velocity", 1.0)) < 0.0, -1.0, 1.0)
    return q["torque"] + q["J"] * way * q["angular_velocity_rate"]


ACCELERATION_TORQUE = Effect(
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
    explanation=(
        "Torque measured at the motor also turns the wheel, the gear and the rotor faster. The rotor counts "
        "most: its inertia is multiplied by the square of the gear ratio. The residual is in torque alone, "
        "in proportion to the angular acceleration, positive as the wheel speeds up and negative as it "
        "slows. Sensor-lag follows the rate of the torque itself, and a lag in wheel speed that of slip; in "
        "a drive where speed, slip and torque all change together they look alike. Drivetrain-friction is "
        "there at steady speed too."
    ),
    shows="torque alone, against angular acceleration",
    reference=(
        "Ojeda, Cruz, Reina, Borenstein (2006), Current-based slippage detection and odometry correction for "
        "mobile robots and planetary rovers, IEEE Transactions on Robotics 22(2), 366–378, doi "
        "10.1109/TRO.2005.862480 (torque from motor current)"
    ),
    settled_by="the wheel speeding up and slowing down freely in the air",
)
