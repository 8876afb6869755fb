"""The wheel pushes a wall of soil before it."""

from __future__ import annotations

from typing import Any

import numpy as np

from terrain_cli.mechanics.effect import Effect, Parameter, Quantities

#: Of loose dry soil, in kg/m³.
DENSITY = 1600.0


def bearing_factors(tan_phi: Any) -> tuple[Any, Any, Any]:
    """Bearing-capacity factors of Terzaghi for general shear under a rough footing.

    Nγ, which he gives as a table, by 2 (Nq + 1) tan φ / (1 + 0.4 sin 4φ): within a quarter.
    """
    tan_phi = np.maximum(tan_phi, 0.02)
    phi = np.arctan(tan_phi)
    n_q = np.exp((1.5 * np.pi - phi) * tan_phi) / (1.0 - np.sin(phi))
    return (n_q - 1.0) / tan_phi, n_q, 2.0 * (n_q + 1.0) * tan_phi / (1.0 + 0.4 * np.sin(4.0 * phi))


def _pull(q: Quantities) -> Any:
    tan_phi = np.maximum(q["tan_phi"], 0.02)
    n_c, _, n_gamma = bearing_factors(tan_phi)
    flat = 1.0 / (1.0 + tan_phi * tan_phi)
    k_c, k_gamma = (n_c - tan_phi) * flat, (2.0 * n_gamma / tan_phi + 1.0) * flat
    z = q["sinkage"]
    wall = q["width"] * z * (q["cohesion"] * k_c + 0.5 * DENSITY * q["gravity"] * k_gamma * z)
    return q["drawbar_pull"] - q["factor"] * wall


EFFECT = Effect(
    id="bulldozing",
    title="The wheel pushes soil before it",
    kind="force",
    parameters=(
        Parameter(
            "factor",
            "1",
            0.0,
            0.2,
            lower=-0.5,
            upper=5.0,
            meaning="share of the textbook resistance that acts; 1 is all of it",
            side=1,
        ),
    ),
    laws={"drawbar_pull": _pull},
    formula="DP −= factor · b (c Kc z + ½ γ Kγ z²), Kc = (Nc − tan φ) cos²φ, Kγ = (2 Nγ/tan φ + 1) cos²φ",
    explanation=(
        "In deep loose soil the wheel heaps up a wall before it and must push it: passive earth pressure "
        "on a blade of the wheel's width and the depth of the sinkage, with Terzaghi's bearing-capacity "
        "factors. It is felt from z/2r of about 0.06. Unit weight cannot be told from the size of the "
        "force, so it is that of 1600 kg/m³ under the gravity of the rover's world and one factor scales "
        "the whole; the formula is for firm soil, and in loose soil 0.1 to 0.5 of it is usual. Only "
        "drawbar pull falls, with z and z²: torque and load stay. That tells it from rear-contact and "
        "max-stress-angle, which move the load too, and from slope, which does not ask how deep the wheel "
        "stands."
    ),
    shows="drawbar pull alone, against sinkage and its square",
    reference=(
        "Bekker (1969), Introduction to Terrain-Vehicle Systems, University of Michigan Press; "
        "Apostolopoulos (2001), Analytical Configuration of Wheeled Robotic Locomotion, Carnegie Mellon "
        "University, CMU-RI-TR-01-08"
    ),
    settled_by="load steps, or a slip sweep that sinks the wheel, with drawbar pull measured",
)
