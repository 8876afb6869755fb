"""Effects on what the soil is."""

from __future__ import annotations

import math
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from terrain_cli.effects.laws.grammar import Law
from terrain_cli.effects.library import effect, parameter

if TYPE_CHECKING:
    from terrain_cli.mechanics.effect import Quantities

#: What a pass changes as a share of what the one before it did, where nothing else is known.
_FURTHER = math.exp(-1.0)


def _packed(quantity: str, q: Quantities) -> Any:
    """Change a quantity of the soil by a share at the first pass, and by less at each further one."""
    share = _FURTHER + q["further"]
    geometric = np.expm1(np.maximum(q["pass_number"], 0.0) * np.log(share)) / (share - 1.0)
    return q[quantity] * (1.0 + q[f"{quantity}_gain"] * geometric)


MULTI_PASS = effect(
    id="multi-pass",
    title="Soil that has been driven over",
    kind="soil",
    parameters=(
        parameter(
            "stiffness_gain",
            0.5,
            "change of the stiffness by the first pass, as a share",
            (-0.6, 10.0),
            side=1,
        ),
        parameter("cohesion_gain", 0.3, "change of the cohesion by the first pass, as a share", (-0.6, 10.0)),
        parameter(
            "shear_modulus_gain",
            0.3,
            "change of the shear modulus by the first pass, as a share",
            (-0.6, 10.0),
        ),
        parameter(
            "further",
            0.3,
            "by how much more than 37 % of what the pass before it did each further pass does, as a share",
            (-0.35, 0.6),
            shape=True,
        ),
    ),
    laws={name: partial(_packed, name) for name in ("stiffness", "cohesion", "shear_modulus")},
    needs=("pass_number",),
    formula="keq, c, k each times 1 + gain (1 − f^N)/(1 − f), f = 0.37 + further, N passes before",
)

SINKAGE_RELAXATION = effect(
    id="sinkage-relaxation",
    title="A wheel has to roll on before it has sunk",
    kind="soil",
    parameters=(
        parameter(
            "length",
            0.03,
            "distance over which the sinkage comes two thirds of the way to its steady value",
            (-0.5, 1.0),
            unit="m",
            side=1,
        ),
    ),
    laws={"sinkage": Law("sinkage - length * rut_slope")},
    needs=("rut_slope",),
    formula="length · dz/ds = z steady − z, ds = |V| dt",
)


#: m: over this distance to either side of its top the layer sets in.
_ROUND = 5e-4


def _on_a_layer(q: Quantities) -> Any:
    over = q["depth"] - q["top"]
    # A parabola between two straight lines: no kink, and exact away from the top.
    within = np.minimum(np.maximum(over + _ROUND, 0.0), 2.0 * _ROUND)
    into = within * within / (4.0 * _ROUND) + np.maximum(over - _ROUND, 0.0)
    return q["normal_stress"] + q["modulus"] * into


HARDPAN = effect(
    id="hardpan",
    title="A firmer layer below",
    kind="soil",
    parameters=(
        parameter("modulus", 2e6, "pressure that the layer adds per depth into it", (0.0, 1e9), unit="Pa/m"),
        parameter(
            "top",
            0.01,
            "depth of the layer below the surface",
            (0.001, 0.3),
            unit="m",
            null=0.01,
            shape=True,
            along="sinkage",
        ),
    ),
    laws={"normal_stress": _on_a_layer},
    formula="σ += modulus · (depth − top), where that is positive",
)


def _under_a_crust(q: Quantities) -> Any:
    return q["normal_stress"] - q["strength"] * np.expm1(-q["depth"] / q["thickness"])


CRUST = effect(
    id="crust",
    title="A crust over soft soil",
    kind="soil",
    parameters=(
        parameter("strength", 2e3, "pressure that the crust bears before it breaks", (0.0, 1e6), unit="Pa"),
        parameter(
            "thickness",
            0.003,
            "depth over which it takes up that pressure",
            (0.0005, 0.05),
            unit="m",
            null=0.005,
            shape=True,
        ),
    ),
    laws={"normal_stress": _under_a_crust},
    formula="σ += strength (1 − exp(−depth/thickness))",
)
