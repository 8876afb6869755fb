"""Laws of the catalogue that are no arithmetic of users' laws, by the names that effects.toml gives them."""

import math
from functools import partial
from typing import Any

import numpy as np

from terrain_cli.mechanics.contact import rolling, slip_of_radius
from terrain_cli.mechanics.dual import value
from terrain_cli.mechanics.effect import Quantities
from terrain_cli.mechanics.rates import LEADS

#: What a pass changes as a share of what the one before it did, where nothing else is known.
_FURTHER = math.exp(-1.0)
_GRAIN = 3e-4  # m, a grain: less displacement than this along has no direction
_SLOW = 0.05  # Radii in a second below which a wheel stands
_DENSITY = 1600.0  # Of loose dry soil, in kg/m³


def packed(quantity: str, q: Quantities) -> Any:
    """Change a quantity of the soil by a share at the first pass, and by less at each further one."""
    share = _FURTHER + q["further"]
    geometric = np.expm1(np.maximum(q["pass_number"], 0.0) * np.log(share)) / (share - 1.0)
    return q[quantity] * (1.0 + q[f"{quantity}_gain"] * geometric)


packed_stiffness, packed_cohesion = partial(packed, "stiffness"), partial(packed, "cohesion")
packed_shear_modulus = partial(packed, "shear_modulus")


def _mean_share(x: Any) -> Any:
    """Return (1 − exp(−x))/x."""
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


def late(channel: str, q: Quantities) -> Any:
    return shown_late(channel, q[f"{channel}_lag"], q.get("filtered", 0.0), q)


def shown_late(channel: str, lag: Any, share: Any, q: Quantities) -> Any:
    """Show what was true a little earlier, by what the sensor shows later.

    A delay τ shows y with true(t) = y(t + τ), a first-order filter with true = y + τ dy/dt. Of a lag of which
    a `share` is a filter, and u the rest, true(t) = y(t + u) + (τ − u) y'(t + u).
    """
    rate = q.get(f"{channel}_rate", 0.0)
    if f"{channel}_rate_{LEADS[0]:g}" not in q or not np.any(value(lag)):
        return q[channel] - lag * rate
    delay = (1.0 - share) * lag
    at = value(delay)
    risen = [0.0, *(lead * q[f"{channel}_rate_{lead:g}"] for lead in LEADS)]
    rise, then, bend = _ahead(np.abs(at), risen, rate)
    back = at < 0.0
    if np.any(back):
        # Before a sample the channel goes on as it begins after it.
        rise, then = np.where(back, rise + 2.0 * at * rate, rise), np.where(back, 2.0 * rate - then, then)
    moved = delay - at
    return q[channel] - rise - then * moved - share * lag * (then + bend * moved)


def filtered(channel: str, q: Quantities) -> Any:
    return q[channel] - q[f"{channel}_lag"] * q.get(f"{channel}_rate", 0.0)


def _ahead(lead: Any, risen: list[Any], rate: Any) -> tuple[Any, Any, Any]:
    """Return by how much a channel rises within some time, and its rate and the change of that then.

    `risen` is what it rises up to each of 0 and `LEADS`; between them it is a cubic, with the rate that three
    of them tell at each.
    """
    knots = (0.0, *LEADS)
    place = np.searchsorted(knots, lead, side="right") - 1
    lowest, highest = int(np.min(place)), int(np.max(place))
    steep = [(risen[k + 1] - risen[k]) / (knots[k + 1] - knots[k]) for k in range(len(LEADS))]
    found: tuple[Any, Any, Any] = (0.0, 0.0, 0.0)
    for k in range(lowest, highest + 1):
        here = _rate_at(k, steep, risen, rate)
        x = lead - knots[k]
        if k == len(LEADS):
            own = (risen[k] + here * x, here, 0.0)
        else:
            h, there = knots[k + 1] - knots[k], _rate_at(k + 1, steep, risen, rate)
            square, cube = (3.0 * steep[k] - 2.0 * here - there) / h, (here + there - 2.0 * steep[k]) / h**2
            own = (
                risen[k] + x * (here + x * (square + x * cube)),
                here + x * (2.0 * square + x * 3.0 * cube),
                2.0 * square + 6.0 * cube * x,
            )
        each = zip(own, found, strict=True)
        found = own if lowest == highest else tuple(np.where(place == k, *pair) for pair in each)
    return found


def _rate_at(k: int, steep: list[Any], risen: list[Any], rate: Any) -> Any:
    knots = (0.0, *LEADS)
    if k == 0:
        return rate
    if k == len(LEADS):
        return risen[k] / knots[k]
    before, after = knots[k] - knots[k - 1], knots[k + 1] - knots[k]
    return (after * steep[k - 1] + before * steep[k]) / (before + after)


late_torque, late_drawbar_pull = partial(late, "torque"), partial(late, "drawbar_pull")
late_sinkage = partial(late, "sinkage")
filtered_torque, filtered_drawbar_pull = partial(filtered, "torque"), partial(filtered, "drawbar_pull")


def sinkage_late_on_the_way(q: Quantities) -> Any:
    """Take the rate from the slope of the rut: at one speed a distance is a time, and nothing else."""
    if "rut_slope" not in q or "velocity" not in q:
        return filtered("sinkage", q)
    return q["sinkage"] - q["sinkage_lag"] * np.absolute(q["velocity"]) * q["rut_slope"]


def sinkage_of_the_place_before(q: Quantities) -> Any:
    """Show what was true a distance earlier, as a sensor does a time: at one speed that is the same."""
    if "velocity" not in q or f"sinkage_rate_{LEADS[0]:g}" not in q:
        return q["sinkage"] - q["length"] * q["rut_slope"]
    # A wheel that stands shows what it did as it came.
    pace = np.maximum(np.absolute(q["velocity"]), _SLOW * q["wheel_radius"])
    return shown_late("sinkage", q["length"] / pace, 0.0, q)
