"""A gear takes a share of the torque that passes through it."""

from __future__ import annotations

from typing import Any

import numpy as np

from terrain_cli.mechanics.effect import Effect, Parameter, Quantities


def _torque(q: Quantities) -> Any:
    torque = q["torque"]
    # A wheel that drives its motor loses the same share the other way.
    return np.where(torque < 0.0, torque * q["eta"], torque / q["eta"])


EFFECT = Effect(
    id="gear-efficiency",
    title="Efficiency of the gear",
    kind="sensor",
    parameters=(
        Parameter(
            "eta",
            "1",
            1.0,
            0.2,
            lower=0.2,
            upper=1.1,
            meaning="share of the measured torque that reaches the wheel",
            side=-1,
        ),
    ),
    laws={"torque": _torque},
    formula="T shown = T/η, or T η where the wheel drives the motor",
    explanation=(
        "A harmonic or planetary gear loses a share of what passes through it: η is 0.5 to 0.95, lower "
        "when cold or lightly loaded. Torque measured before the gear is too high by the same share "
        "everywhere, so the residual is a multiple of the torque itself. A soil with c and tan φ higher by "
        "that share gives nearly the same torque, so without drawbar pull η cannot be told from the "
        "strength: fix it from a data sheet. With drawbar pull, T/r − DP grows with torque; "
        "drivetrain-friction adds the same torque at every load, and motor-temperature follows the motor's "
        "temperature."
    ),
    shows="torque alone, in proportion to torque",
    reference=(
        "Tuttle, Seering (1996), A nonlinear model of a harmonic drive gear transmission, IEEE "
        "Transactions on Robotics and Automation 12(3), 368–374"
    ),
    settled_by="a load step with drawbar pull measured, or torque measured behind the gear",
)
