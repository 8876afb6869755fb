"""Forces under the triangular stresses of the linearised model.

Equations [10] to [13] of Iagnemma et al. 2004 (doi 10.1109/TRO.2004.829462): σ and τ rise linearly
from θ1 to θm; behind it σ falls to nothing at θ2 and τ to c. The load gives the height of σ, so
that no pressure–sinkage law is needed. Nothing is dropped here, κ3 neither.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from terrain_cli.mechanics.contact import rolling

if TYPE_CHECKING:
    from collections.abc import Mapping


def forces(q: Mapping[str, Any], width: float) -> tuple[Any, Any]:
    """Torque and drawbar pull of a wheel under a load.

    Parameters
    ----------
    q : mapping of str to ndarray or Dual, shape (n,)
        load (N), slip, radius, shear_radius, entry_angle, max_stress_angle, exit_angle, cohesion,
        tan_phi and shear_modulus, in SI units and rad.
    width : float
        b in m.

    Returns
    -------
    torque, drawbar_pull : ndarray or Dual, shape (n,)
        T in N m, DP in N.
    """
    one, peak, two = q["entry_angle"], q["max_stress_angle"], q["exit_angle"]
    r, R, c, tan_phi = q["radius"], q["shear_radius"], q["cohesion"], q["tan_phi"]
    front, rear = one - peak, peak - two
    sin, cos = np.sin(peak), np.cos(peak)
    # ∫ (distance to an end) cos θ and sin θ over each arc, by the length of the arc.
    front_cos = (2.0 * np.sin(0.5 * (one + peak)) * np.sin(0.5 * front)) / front - sin
    front_sin = cos - (2.0 * np.cos(0.5 * (one + peak)) * np.sin(0.5 * front)) / front
    rear_cos = sin - (2.0 * np.sin(0.5 * (peak + two)) * np.sin(0.5 * rear)) / rear
    rear_sin = (2.0 * np.cos(0.5 * (peak + two)) * np.sin(0.5 * rear)) / rear - cos
    all_cos = 2.0 * np.cos(0.5 * (peak + two)) * np.sin(0.5 * rear)
    all_sin = 2.0 * np.sin(0.5 * (peak + two)) * np.sin(0.5 * rear)
    hat_cos, hat_sin = front_cos + rear_cos, front_sin + rear_sin
    # The cohesion behind θm, which fades to nothing where the hat has its height.
    tail_cos, tail_sin = all_cos - rear_cos, all_sin - rear_sin

    travel = R * front - rolling(q["slip"]) * r * 2.0 * np.cos(0.5 * (one + peak)) * np.sin(0.5 * front)
    # Where the wheel skids the shear stress turns round, and so does the cohesion behind θm.
    turn = np.where(travel < 0.0, -1.0, 1.0)
    mobilised = turn * (1.0 - np.exp(-np.absolute(travel) / q["shear_modulus"]))
    area = width * r
    held = q["load"] - R * width * (mobilised * c * hat_sin + turn * c * tail_sin)
    sigma = held / (area * hat_cos + R * width * mobilised * tan_phi * hat_sin)
    tau = mobilised * (c + sigma * tan_phi)
    torque = R * R * width * (tau * 0.5 * (front + rear) + turn * c * 0.5 * rear)
    pull = R * width * (tau * hat_cos + turn * c * tail_cos) - area * sigma * hat_sin
    return torque, pull
