"""Forces from stresses that effects have changed, node by node under the rim, and from triangular ones.

The integrals of `contact`, written plainly for numbers with derivatives: slower, and open to any
law on the normal and the shear stress.
"""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from terrain_cli.mechanics.contact import ORDER, half_angle, nodes, rolling
from terrain_cli.mechanics.dual import chain, value
from terrain_cli.vocabulary.arrays import Array

Change = Callable[[str, dict[str, Any]], Any]


def forces(
    q: Mapping[str, Any], width: float, change: Change, *, bends: Sequence[Any] = (), order: int = ORDER
) -> tuple[Any, Any, Any]:
    """Integrate the stresses over the contact, letting laws change them: W in N, T in N m, DP in N.

    `q`, shape (n,), has the quantities of `contact.Contact` and whatever the laws read. `change` is called
    for "normal_stress" and then for "shear_stress" with all quantities at the nodes, shape (2 m, n): the
    front arc's, then the rear arc's. `width` is b in m, `order` the nodes on each arc, and on each part of
    it where the normal stress bends, at depths `bends` in m, one number or shape (n,).
    """
    one, peak, two = q["entry_angle"], q["max_stress_angle"], q["exit_angle"]
    half, half_weight = _parted(q, bends, order) if bends else nodes(order)
    u, w = np.concatenate([half, half]), np.concatenate([half_weight, half_weight])
    front = np.repeat([[1.0], [0.0]], len(half), axis=0)
    rear = 1.0 - front
    r, R = q["radius"], q["shear_radius"]
    long, short = one - peak, peak - two
    gap = 0.5 * (front * (u * long) + rear * (one - two - u * short))
    square, mixed = half_angle(gap)
    s1, c1 = np.sin(one), np.cos(one)
    # cos θ − cos θ1 and sin θ1 − sin θ.
    rise, run = 2.0 * (s1 * mixed - c1 * square), 2.0 * (c1 * mixed + s1 * square)
    # The normal stress behind θm is that of the same share of the arc in front of it.
    depth = r * rise[np.r_[0 : len(half), 0 : len(half)]]
    at_nodes = {
        **q,
        "angle": one - 2.0 * gap,
        "depth": depth,
        "normal_stress": q["stiffness"] * np.exp(q["sinkage_exponent"] * np.log(depth)),
    }
    sigma = at_nodes["normal_stress"] = change("normal_stress", at_nodes)
    travel = 2.0 * R * gap - rolling(q["slip"]) * r * run
    turn = np.where(value(travel) < 0.0, -1.0, 1.0)
    mobilised = turn * (1.0 - np.exp(-np.absolute(travel) / q["shear_modulus"]))
    at_nodes["shear_displacement"] = travel
    at_nodes["shear_stress"] = (q["cohesion"] + q["tan_phi"] * sigma) * mobilised
    tau = change("shear_stress", at_nodes)
    weight = w * (front * long + rear * short)
    cos, sin = weight * (c1 + rise), weight * (s1 - run)
    load = width * (r * _total(sigma * cos) + R * _total(tau * sin))
    torque = R * R * width * _total(tau * weight)
    pull = width * (R * _total(tau * cos) - r * _total(sigma * sin))
    return load, torque, pull


def _parted(q: Mapping[str, Any], bends: Sequence[Any], order: int) -> tuple[Array, Array]:
    """Return nodes and weights as `nodes`, on each part of the arc between two bends, shape (m, n).

    An integral does not change with the place where it is parted, so that this has no derivatives.
    """
    one, peak, radius = (value(q[name]) for name in ("entry_angle", "max_stress_angle", "radius"))
    angles = (np.arccos(np.minimum(np.cos(one) + value(depth) / radius, 1.0)) for depth in bends)
    places = [np.clip((one - angle) / (one - peak), 0.0, 1.0) for angle in angles]
    edges = np.sort([np.zeros_like(one), *places, np.ones_like(one)], axis=0)[:, None]
    half, weight = nodes(order)
    parts = np.diff(edges, axis=0)
    return np.concatenate(edges[:-1] + parts * half), np.concatenate(parts * weight)


def _total(x: Any) -> Any:
    result = value(x).sum(axis=0)
    if value(x) is x:
        return result
    shape = value(x).shape
    sums = {name: np.broadcast_to(slope, shape).sum(axis=0) for name, slope in x.slopes.items()}
    return chain(result, [(1.0, type(x)(result, sums))])


def triangular_forces(q: Mapping[str, Any], width: float) -> tuple[Any, Any]:
    """T in N m and DP in N of a wheel under a load, of the triangular stresses of the linearised model.

    Equations [10] to [13] of Iagnemma et al. 2004 (doi 10.1109/TRO.2004.829462): σ and τ rise linearly from
    θ1 to θm; behind it σ falls to nothing at θ2 and τ to c. The load gives the height of σ, so that no
    pressure–sinkage law is needed. Nothing is dropped here, κ3 neither.

    `q`, shape (n,), has load (N), slip, radius, shear_radius, entry_angle, max_stress_angle, exit_angle,
    cohesion, tan_phi and shear_modulus, in SI units and rad; `width` is b in m.
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
