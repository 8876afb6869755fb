"""Laws of the catalogue that are no arithmetic of users' laws, by the names that effects.toml gives them."""

import math
from functools import partial
from typing import Any

import numpy as np

from terrain_cli.mechanics.contact import rolling, slip_of_radius
from terrain_cli.mechanics.effect import Quantities
from terrain_cli.mechanics.past import SUFFIX

#: What a pass changes as a share of what the one before it did, where nothing else is known.
_FURTHER = math.exp(-1.0)
_GRAIN = 3e-4  # m, a grain: less displacement than this along has no direction
_DENSITY = 1600.0  # Of loose dry soil, in kg/m³


def packed(quantity: str, q: Quantities) -> Any:
    """Change a quantity of the soil by a share at the first pass, and by less at each further one."""
    share = _FURTHER + q["further"]
    geometric = np.expm1(np.maximum(q["pass_number"], 0.0) * np.log(share)) / (share - 1.0)
    return q[quantity] * (1.0 + q[f"{quantity}_gain"] * geometric)


packed_stiffness, packed_cohesion = partial(packed, "stiffness"), partial(packed, "cohesion")
packed_shear_modulus = partial(packed, "shear_modulus")


def _mean_share(x: Any) -> Any:
    return -np.expm1(-x) / x


def shared_stress(q: Quantities) -> Any:
    k, along = q["shear_modulus"], q["shear_displacement"]
    across = q["radius"] * rolling(q["slip"]) * (q["entry_angle"] - q["angle"]) * np.tan(q["slip_angle"])
    square = along * along + _GRAIN**2
    alone, both = np.sqrt(square) / k, np.sqrt(square + q["lateral"] * across * across) / k
    return q["shear_stress"] * _mean_share(both) / _mean_share(alone)


def slip_of_the_rim(q: Quantities) -> Any:
    """Return 1 − V/(rω) where 1 − V/(rs ω) was recorded, and the same of a wheel that skids."""
    slip = q["slip"]
    advance = np.where(slip < 0.0, 1.0 / (1.0 + np.minimum(slip, 0.0)), 1.0 - slip)
    advance = advance * (1.0 + q["lambda_s"] * q["grouser_height"] / q["wheel_radius"])
    return np.where(advance > 1.0, 1.0 / advance - 1.0, 1.0 - advance)


def slip_of_a_flat_wheel(q: Quantities) -> Any:
    return slip_of_radius(q["slip"], 1.0 - q["deflection"])


def slip_of_another_radius(q: Quantities) -> Any:
    return slip_of_radius(q["slip"], 1.0 + q["relative_error"])


def bearing_factors(tan_phi: Any) -> tuple[Any, Any, Any]:
    """Bearing-capacity factors of Terzaghi under a rough footing; Nγ, which he gives as a table, to 25 %."""
    tan_phi = np.maximum(tan_phi, 0.02)
    phi = np.arctan(tan_phi)
    n_q = np.exp((1.5 * np.pi - phi) * tan_phi) / (1.0 - np.sin(phi))
    return (n_q - 1.0) / tan_phi, n_q, 2.0 * (n_q + 1.0) * tan_phi / (1.0 + 0.4 * np.sin(4.0 * phi))


def pull_less_the_wall(q: Quantities) -> Any:
    tan_phi = np.maximum(q["tan_phi"], 0.02)
    n_c, _, n_gamma = bearing_factors(tan_phi)
    flat = 1.0 / (1.0 + tan_phi * tan_phi)
    k_c, k_gamma = (n_c - tan_phi) * flat, (2.0 * n_gamma / tan_phi + 1.0) * flat
    z = q["sinkage"]
    wall = q["width"] * z * (q["cohesion"] * k_c + 0.5 * _DENSITY * q["gravity"] * k_gamma * z)
    return q["drawbar_pull"] - q["factor"] * wall


def load_transferred(q: Quantities) -> Any:
    load = q["load"]
    along = load * np.sin(q.get("pitch", 0.0))
    pull = q.get("measured_drawbar_pull", along)
    climbing = along if "measured_drawbar_pull" in q else 0.0
    inertia = load / q["gravity"] * q.get("acceleration", 0.0)
    return load + q["ratio"] * (pull + inertia) + q["slope_ratio"] * climbing


def torque_with_friction(q: Quantities) -> Any:
    # Torque is counted positive the way the wheel turns, so the sign of ω is already in it.
    return q["torque"] + q["Tc"] + q["Bv"] * np.absolute(q.get("angular_velocity", 0.0))


def torque_with_inertia(q: Quantities) -> Any:
    # Torque is counted positive the way the wheel turns, and so is its acceleration here.
    way = np.where(np.asarray(q.get("angular_velocity", 1.0)) < 0.0, -1.0, 1.0)
    return q["torque"] + q["J"] * way * q["angular_velocity_rate"]


def late(channel: str, q: Quantities, filtered: float | None = None) -> Any:
    """Show what was predicted a little earlier, or smoothed; a share of the lag is that of a filter."""
    past = q.get(f"{channel}{SUFFIX}")
    if past is None:
        return q[channel]
    lag, share = q[f"{channel}_lag"], q["filtered"] if filtered is None else filtered
    return q[channel] + past.change((1.0 - share) * lag, share * lag)


late_torque, late_drawbar_pull = partial(late, "torque"), partial(late, "drawbar_pull")
late_sinkage = partial(late, "sinkage")
filtered_torque, filtered_drawbar_pull, filtered_sinkage = (
    partial(late, channel, filtered=1.0) for channel in ("torque", "drawbar_pull", "sinkage")
)


def sinkage_on_the_way(q: Quantities) -> Any:
    past = q.get(f"sinkage{SUFFIX}")
    return q["sinkage"] if past is None else q["sinkage"] + past.change(0.0, q["length"], "way")


def sinkage_of_the_place_before(q: Quantities) -> Any:
    past = q.get(f"sinkage{SUFFIX}")
    return q["sinkage"] if past is None else q["sinkage"] + past.change(q["length"], 0.0, "way")
