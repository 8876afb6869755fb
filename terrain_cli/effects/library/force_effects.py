"""Effects that put a force on the wheel."""

from __future__ import annotations

from typing import Any

import numpy as np

from terrain_cli.effects.laws.grammar import Law
from terrain_cli.effects.library import parameter
from terrain_cli.mechanics.effect import Effect, Quantities

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


BULLDOZING = Effect(
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
    explanation=(
        "In deep loose soil the wheel heaps up a wall before it and must push it: passive earth pressure on "
        "a blade of the wheel's width and the depth of the sinkage, with Terzaghi's bearing-capacity "
        "factors. It is felt from z/2r of about 0.06. Unit weight cannot be told from the size of the force, "
        "so it is that of 1600 kg/m³ under the gravity of the rover's world and one factor scales the whole; "
        "the formula is for firm soil, and in loose soil 0.1 to 0.5 of it is usual. Only drawbar pull falls, "
        "with z and z²: torque and load stay. That tells it from rear-contact and max-stress-angle, which "
        "move the load too, and from slope, which does not ask how deep the wheel stands."
    ),
    shows="drawbar pull alone, against sinkage and its square",
    reference=(
        "Bekker (1969), Introduction to Terrain-Vehicle Systems, University of Michigan Press; "
        "Apostolopoulos (2001), Analytical Configuration of Wheeled Robotic Locomotion, Carnegie Mellon "
        "University, CMU-RI-TR-01-08"
    ),
    settled_by="load steps, or a slip sweep that sinks the wheel, with drawbar pull measured",
)

#: Share of the weight that presses on the ground.
_PRESSING = "(1 + factor * (cos(pitch) - 1))"

SLOPE = Effect(
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
    explanation=(
        "Where the load is the weight on the wheel and the drawbar pull is what is left to pull with, a "
        "slope takes W sin(pitch) from the pull and leaves W cos(pitch) to press on the ground. The factor "
        "is 1 if the channels know nothing of the slope, 0 if they already account for it, as a load does "
        "that is derived from the rover's mass, and a pull that is measured between wheel and axle. Drawbar "
        "pull falls in proportion to the sine of pitch, and everything else only by the small loss of load. "
        "Load-transfer follows pitch too, but moves load, sinkage and torque more than pull."
    ),
    shows="drawbar pull against pitch",
    reference="Wong (2008), Theory of Ground Vehicles, 4th edition, Wiley: grade resistance",
    settled_by="the same slope up and down, at one slip",
)


def _load_transferred(q: Quantities) -> Any:
    load = q["load"]
    along = load * np.sin(q.get("pitch", 0.0))
    pull = q.get("measured_drawbar_pull", along)
    climbing = along if "measured_drawbar_pull" in q else 0.0
    inertia = load / q["gravity"] * q.get("acceleration", 0.0)
    return load + q["ratio"] * (pull + inertia) + q["slope_ratio"] * climbing


LOAD_TRANSFER = Effect(
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
    explanation=(
        "A pull, a climb or an acceleration acts at a height h above the ground and is held by the wheels a "
        "length L apart: rear wheels gain load and front wheels lose it, 5 to 20 %. A load that is taken as "
        "constant, or measured only at rest, is then wrong for the wheel. The measured drawbar pull is used "
        "where there is one, and beside it the weight along the slope, which all wheels hold together; else "
        "that weight alone. The inertia is added where acceleration is measured. Sinkage, torque and pull "
        "all follow, in proportion to pitch and acceleration and with opposite signs in front and behind. "
        "Load-bias is there on the flat too; multi-pass also parts front from rear wheels, but in a fixed "
        "step."
    ),
    shows="sinkage, torque and drawbar pull against pitch and acceleration",
    reference="Wong (2008), Theory of Ground Vehicles, 4th edition, Wiley: loads of the axles in motion",
    settled_by="the same slope up and down, or starting and stopping hard on the flat",
)
