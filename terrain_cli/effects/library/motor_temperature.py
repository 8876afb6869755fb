"""Magnets weaken as the motor warms, and the current tells too high a torque."""

from __future__ import annotations

from typing import Any

import numpy as np

from terrain_cli.mechanics.effect import Effect, Parameter, Quantities

#: T0 in °C: the temperature for which data sheets give the torque constant.
REFERENCE = 25.0


def _torque(q: Quantities) -> Any:
    constant = 1.0 + q["alpha"] * (q["motor_temperature"] - REFERENCE)
    return q["torque"] / np.maximum(constant, 0.2)


EFFECT = Effect(
    id="motor-temperature",
    title="The motor's torque constant changes as it warms",
    kind="sensor",
    parameters=(
        Parameter(
            "alpha",
            "1/K",
            0.0,
            1e-3,
            lower=-0.01,
            upper=0.01,
            meaning="temperature coefficient of the torque constant; mostly < 0",
        ),
    ),
    laws={"torque": _torque},
    needs=("motor_temperature",),
    formula="T shown = T/(1 + α (Tm − 25 °C))",
    explanation=(
        "A torque that is derived from motor current with the torque constant of a data sheet is right at "
        "25 °C only. The remanence of the magnets falls with temperature, by 0.03 to 0.05 % per kelvin for "
        "SmCo, about 0.1 for NdFeB and 0.2 for ferrite, so α is −0.0003 to −0.002 per kelvin: a warm motor "
        "draws more current for the same torque, and the torque shown is too high. Where torque comes from "
        "voltage, the copper's 0.4 % per kelvin enters instead. The residual is a share of the torque that "
        "drifts slowly as the motor warms. Gear-efficiency does not drift; a soil that hardens along the "
        "way drifts too, and moves sinkage and drawbar pull as well."
    ),
    shows="torque alone, in proportion to torque, against motor temperature",
    reference=(
        "Deshpande (2003), Recent advances in materials for use in permanent magnet machines: a review, "
        "IEEE International Electric Machines and Drives Conference, doi 10.1109/IEMDC.2003.1211311"
    ),
    settled_by="the same track driven with a cold and with a warm motor",
)
