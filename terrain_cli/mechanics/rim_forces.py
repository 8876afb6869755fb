"""Forces from stresses that effects have changed, node by node under the rim.

The integrals of `contact`, written plainly for numbers with derivatives: slower, and open to any
law on the normal and the shear stress.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from terrain_cli.mechanics.contact import rolling
from terrain_cli.mechanics.dual import chain, value
from terrain_cli.mechanics.quadrature import ORDER, nodes

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    # Takes the name of a stress and all quantities, and returns the stress with every law applied.
    Change = Callable[[str, dict[str, Any]], Any]


def forces(q: Mapping[str, Any], width: float, change: Change, *, order: int = ORDER) -> tuple[Any, Any, Any]:
    """Integrate the stresses over the contact, letting laws change them.

    Parameters
    ----------
    q : mapping of str to ndarray or Dual, shape (n,)
        The quantities of `contact.Contact` and whatever the laws read.
    width : float
        b in m.
    change : callable
        Called for "normal_stress" and then for "shear_stress" with all quantities at the nodes,
        shape (2 order, n): the front arc's, then the rear arc's.
    order : int
        Nodes on each arc.

    Returns
    -------
    load, torque, drawbar_pull : ndarray or Dual, shape (n,)
        W in N, T in N m, DP in N.
    """
    half, half_weight = nodes(order)
    u, w = np.concatenate([half, half]), np.concatenate([half_weight, half_weight])
    front = np.repeat([[1.0], [0.0]], order, axis=0)
    rear = 1.0 - front
    one, peak, two = q["entry_angle"], q["max_stress_angle"], q["exit_angle"]
    r, R = q["radius"], q["shear_radius"]
    long, short = one - peak, peak - two
    angle = front * (one - u * long) + rear * (two + u * short)
    # The normal stress behind θm is that of the same share of the arc in front of it.
    above = 0.5 * u * long
    depth = 2.0 * r * np.sin(one - above) * np.sin(above)
    at_nodes = {
        **q,
        "angle": angle,
        "depth": depth,
        "normal_stress": q["stiffness"] * np.exp(q["sinkage_exponent"] * np.log(depth)),
    }
    sigma = at_nodes["normal_stress"] = change("normal_stress", at_nodes)
    gap = 0.5 * (one - angle)
    travel = 2.0 * R * gap - rolling(q["slip"]) * r * 2.0 * np.cos(one - gap) * np.sin(gap)
    turn = np.where(value(travel) < 0.0, -1.0, 1.0)
    mobilised = turn * (1.0 - np.exp(-np.absolute(travel) / q["shear_modulus"]))
    at_nodes["shear_displacement"] = travel
    at_nodes["shear_stress"] = (q["cohesion"] + q["tan_phi"] * sigma) * mobilised
    tau = change("shear_stress", at_nodes)
    weight = w * (front * long + rear * short)
    cos, sin = weight * np.cos(angle), weight * np.sin(angle)
    load = width * (r * _total(sigma * cos) + R * _total(tau * sin))
    torque = R * R * width * _total(tau * weight)
    pull = width * (R * _total(tau * cos) - r * _total(sigma * sin))
    return load, torque, pull


def _total(x: Any) -> Any:
    """Sum over the nodes."""
    result = value(x).sum(axis=0)
    if value(x) is x:
        return result
    shape = value(x).shape
    sums = {name: np.broadcast_to(slope, shape).sum(axis=0) for name, slope in x.slopes.items()}
    return chain(result, [(1.0, type(x)(result, sums))])
