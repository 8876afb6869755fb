"""The sinkage sensor has an offset."""

from __future__ import annotations

from typing import Any

from terrain_cli.mechanics.effect import Effect, Parameter, Quantities


def _sinkage(q: Quantities) -> Any:
    return q["sinkage"] + q["offset"]


EFFECT = Effect(
    id="sinkage-bias",
    title="Offset of the sinkage sensor",
    kind="sensor",
    parameters=(
        Parameter(
            "offset",
            "m",
            0.0,
            0.002,
            lower=-0.1,
            upper=0.1,
            meaning="sinkage shown by a wheel that does not sink",
        ),
    ),
    laws={"sinkage": _sinkage},
    needs=("sinkage",),
    formula="z shown = z + offset",
    explanation=(
        "Sinkage is read from an image of the rim, or from the height of the axle over ground whose height "
        "is guessed: a few millimetres are easily missed, and the rut's wall or a heap before the wheel "
        "counts as ground. The reading is off by the same amount everywhere. Torque and pull that are "
        "predicted from it are wrong through the entry angle, most where the wheel sinks least, and a "
        "wheel on firm ground shows a sinkage, perhaps a negative one. A softer soil adds sinkage in "
        "proportion to load instead; slip-sinkage adds it with slip."
    ),
    shows="sinkage by a constant; torque and drawbar pull through the entry angle",
    reference=(
        "Brooks, Iagnemma, Dubowsky (2006), Visual wheel sinkage measurement for planetary rover mobility "
        "characterization, Autonomous Robots 21"
    ),
    settled_by="the reading on firm ground, or a load step",
)
