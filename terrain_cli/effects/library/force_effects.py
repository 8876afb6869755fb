"""Effects that put a force on the wheel."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from terrain_cli.effects.laws.grammar import Law
from terrain_cli.effects.library import effect, parameter

if TYPE_CHECKING:
    from terrain_cli.mechanics.effect import Quantities

#: Of loose dry soil, in kg/m³.
_DENSITY = 1600.0


def bearing_factors(tan_phi: Any) -> tuple[Any, Any, Any]:
    """Bearing-capacity factors of Terzaghi under a rough footing; Nγ, which he gives as a table, to 25 %."""
    tan_phi = np.maximum(tan_phi, 0.02)
    phi = np.arctan(tan_phi)
    n_q = np.exp((1.5 * np.pi - phi) * tan_phi) / (1.0 - np.sin(phi))
    return (n_q - 1.0) / tan_phi, n_q, 2.0 * (n_q + 1.0) * tan_phi / (1.0 + 0.4 * np.sin(4.0 * phi))


def _pull_less_the_wall(q: Quantities) -> Any:
    tan_phi = np.maximum(q["tan_phi"], 0.02)
    n_c, _, n_gamma = bearing_factors(tan_phi)
    flat = 1.0 / (1.0 + tan_phi * tan_phi)
    k_c, k_gamma = (n_c - tan_phi) * flat, (2.0 * n_gamma / tan_phi + 1.0) * flat
    z = q["sinkage"]
    wall = q["width"] * z * (q["cohesion"] * k_c + 0.5 * _DENSITY * q["gravity"] * k_gamma * z)
    return q["drawbar_pull"] - q["factor"] * wall


BULLDOZING = effect(
    id="bulldozing",
    title="The wheel pushes soil before it",
    kind="force",
    parameters=(
        parameter(
            "factor", 0.2, "share of the textbook resistance that acts; 1 is all of it", (-0.5, 5.0), side=1
        ),
    ),
    laws={"drawbar_pull": _pull_less_the_wall},
    formula="DP −= factor · b (c Kc z + ½ γ Kγ z²), Kc = (Nc − tan φ) cos²φ, Kγ = (2 Nγ/tan φ + 1) cos²φ",
)

#: Share of the weight that presses on the ground.
_PRESSING = "(1 + factor * (cos(pitch) - 1))"

SLOPE = effect(
    id="slope",
    title="Weight along a slope",
    kind="force",
    parameters=(
        parameter(
            "factor", 1.0, "share of the weight's parts that the data leave out; 1 is all", (-0.5, 2.0)
        ),
    ),
    laws={
        "load": Law(f"load * {_PRESSING}"),
        "drawbar_pull": Law(f"drawbar_pull - factor * (load / max({_PRESSING}, 0.1)) * sin(pitch)"),
    },
    needs=("pitch", "load"),
    formula="W felt = W cos(pitch), DP shown = DP − W sin(pitch), each taken by the factor",
)


def _load_transferred(q: Quantities) -> Any:
    load = q["load"]
    along = load * np.sin(q.get("pitch", 0.0))
    pull = q.get("measured_drawbar_pull", along)
    climbing = along if "measured_drawbar_pull" in q else 0.0
    inertia = load / q["gravity"] * q.get("acceleration", 0.0)
    return load + q["ratio"] * (pull + inertia) + q["slope_ratio"] * climbing


LOAD_TRANSFER = effect(
    id="load-transfer",
    title="Load moves between the axles",
    kind="force",
    parameters=(
        parameter(
            "ratio", 0.2, "h/L: height of the pull over the wheelbase; < 0 for a front wheel", (-2.0, 2.0)
        ),
        parameter(
            "slope_ratio",
            0.2,
            "h/L: height of the weight, where others than this wheel hold it on a slope",
            (-2.0, 2.0),
            needs=("pitch", "drawbar_pull"),
        ),
    ),
    laws={"load": _load_transferred},
    needs=("load",),
    any_of=("drawbar_pull", "acceleration", "pitch"),
    formula=(
        "W felt = W + ratio (DP + m a) + slope_ratio W sin(pitch), m = W/g; where DP is not measured, W "
        "sin(pitch) stands for it and slope_ratio says nothing"
    ),
)
