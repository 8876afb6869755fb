"""Physical effects on the forces on a wheel, on its slip, and on what sensors show.

As in `effects`, "catalogue" is the law by which the program knows an effect, and "other" another
law of the same thing.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from simulator.effects import Frozen, Numbers
    from simulator.profiles import Profile
    from simulator.soils import Soil
    from simulator.wheel import Wheel

    Array = NDArray[np.float64]
    Channels = dict[str, Array]

GRAVITY = 9.80665
#: kg/m³, of loose dry soil.
DENSITY = 1600.0
#: Steps in s by which a first-order lag is filtered and the wheel's angle summed.
FILTER_STEP = 0.005
ANGLE_STEP = 0.002


# Loads and forces


def felt_load(
    effects: Frozen, load: Array, channels: Channels, pull_under: Callable[[Array], Array]
) -> Array:
    """Return the load in N that the soil feels, of the load that the drive gives.

    Parameters
    ----------
    effects : Frozen
    load : ndarray, shape (n,)
        N, of the wheel on the flat and at rest.
    channels : dict of str to ndarray, shape (n,)
        With "pitch" and "acceleration".
    pull_under : callable
        The drawbar pull that sensors show, in N, under a load felt.
    """
    if not changes_load(effects):
        return load
    flat, felt = load, load
    for _ in range(200):
        pull, before = pull_under(felt), felt
        felt = flat
        for name, form, numbers in effects:
            p = dict(numbers)
            if name == "slope":
                felt = felt * (1.0 + p["factor"] * (np.cos(channels["pitch"]) - 1.0))
            elif name == "load-transfer":
                # In the other form the wheels pull as much as the slope takes, whatever they could.
                held = flat * np.sin(channels["pitch"]) if form == "other" else pull
                felt = felt + p["ratio"] * (held + flat / GRAVITY * channels["acceleration"])
                felt = felt + p["slope_ratio"] * flat * np.sin(channels["pitch"])
        if np.allclose(felt, before, rtol=1e-10, atol=0.0):
            return felt
    raise ArithmeticError("load and pull do not come to rest")


def net_pull(
    effects: Frozen,
    soil: Soil,
    wheel: Wheel,
    sinkage: Array,
    soil_pull: Array,
    flat_load: Array,
    channels: Channels,
) -> Array:
    """Return the drawbar pull in N that is left of what the soil gives."""
    pull = soil_pull
    for name, form, numbers in effects:
        p = dict(numbers)
        if name == "slope":
            pull = pull - p["factor"] * flat_load * np.sin(channels["pitch"])
        elif name == "bulldozing":
            pull = pull - p["factor"] * wall(soil, wheel.width, sinkage, loose=form == "other")
    return pull


def wall(soil: Soil, width: float, depth: Array, *, loose: bool = False) -> Array:
    """Resistance in N of the soil heaped up before a wheel (Bekker 1969), by Terzaghi's factors.

    `loose` takes the factors of Terzaghi's local shear: two thirds of c and tan φ.
    """
    c, phi = soil.cohesion, soil.friction_angle
    if loose:
        c, phi = 2.0 / 3.0 * c, math.atan(2.0 / 3.0 * math.tan(phi))
    n_q = math.exp((1.5 * math.pi - phi) * math.tan(phi)) / (2.0 * math.cos(math.pi / 4.0 + phi / 2.0) ** 2)
    n_c = (n_q - 1.0) / math.tan(phi)
    n_gamma = 2.0 * (n_q + 1.0) * math.tan(phi) / (1.0 + 0.4 * math.sin(4.0 * phi))
    k_c = (n_c - math.tan(phi)) * math.cos(phi) ** 2
    k_gamma = (2.0 * n_gamma / math.tan(phi) + 1.0) * math.cos(phi) ** 2
    return np.asarray(width * (c * k_c * depth + 0.5 * DENSITY * GRAVITY * k_gamma * depth**2))


# Slip and wheel speed


def rolling_radius(effects: Frozen, wheel: Wheel) -> float:
    """Radius in m on which the wheel truly rolls: slip is the soil's, of this radius."""
    radius = wheel.radius
    for name, _form, numbers in effects:
        p = dict(numbers)
        if name == "wheel-radius":
            radius *= 1.0 + p["relative_error"]
        elif name == "flexible-wheel":
            radius *= 1.0 - p["deflection"]
    return radius


def angular_velocity(effects: Frozen, wheel: Wheel, velocity: Array, slip: Array) -> Array:
    """Return ω in rad/s: i = 1 − V/(rω) driving, rω/V − 1 skidding."""
    grip = np.where(slip >= 0.0, 1.0 - slip, 1.0 / (1.0 + slip))
    return np.asarray(velocity / (rolling_radius(effects, wheel) * grip))


def computed_slip(wheel: Wheel, velocity: Array, omega: Array) -> Array:
    """Slip as it is computed with the stated radius."""
    with np.errstate(divide="ignore", invalid="ignore"):
        rim = wheel.radius * omega
        return np.where(rim >= velocity, 1.0 - velocity / rim, rim / velocity - 1.0)


def turned(omega: Profile, time: Array) -> Array:
    """Angle in rad through which the wheel has turned since the start."""
    end = float(time.max(initial=0.0))
    grid = np.linspace(0.0, end, max(2, math.ceil(end / ANGLE_STEP) + 1))
    middle = 0.5 * (grid[1:] + grid[:-1])
    angle = np.concatenate([[0.0], np.cumsum(omega(middle) * np.diff(grid))])
    return np.asarray(np.interp(time, grid, angle))


# Sensors


def shown(
    effects: Frozen,
    time: Array,
    at: Callable[[Array], Channels],
    omega: Profile,
    wheel: Wheel,
) -> Channels:
    """Return what sensors without noise show.

    Parameters
    ----------
    effects : Frozen
        In the order in which they act.
    time : ndarray, shape (n,)
        In s since the start.
    at : callable
        The truth at times in s.
    omega : callable
        The wheel speed in rad/s at times in s.
    wheel : Wheel
    """
    true = at(time)
    channels = dict(true)
    channels["slip"] = computed_slip(wheel, true["velocity"], true["angular_velocity"])
    channels["load"] = true["flat_load"] if changes_load(effects) else true["load"]
    for place, (name, form, numbers) in enumerate(effects):
        p, other = dict(numbers), form == "other"

        def before(moved: Array, so_far: Frozen = effects[:place]) -> Channels:
            return shown(so_far, moved, at, omega, wheel)

        if name == "sensor-lag":
            for channel in ("torque", "drawbar_pull", "sinkage"):
                if p[f"{channel}_lag"]:
                    share = 1.0 - p["filtered"] if other else p["filtered"]
                    channels[channel] = late(before, channel, time, p[f"{channel}_lag"], filtered=share)
        elif name == "sinkage-relaxation":
            channels["sinkage"] = rolled_on(before, time, p["length"], shifted=other)
        elif name == "grouser-ripple":
            ripple(channels, p, wheel.grouser_count * turned(omega, time), true["load"], wheel, other=other)
        elif name in SENSORS:
            SENSORS[name](channels, p, other, omega, time)
    return channels


def ripple(channels: Channels, p: Numbers, phase: Array, load: Array, wheel: Wheel, *, other: bool) -> None:
    """Add to the forces and the sinkage what goes up and down with every grouser."""
    for key, channel, size in (
        ("torque", "torque", load * wheel.radius),
        ("pull", "drawbar_pull", load),
        ("sinkage", "sinkage", channels["sinkage"]),
    ):
        wave = p[f"{key}_sine"] * np.sin(phase) + p[f"{key}_cosine"] * np.cos(phase)
        if other:
            # Not a sine: its second harmonic is there too.
            wave = wave + 0.3 * (
                p[f"{key}_sine"] * np.sin(2.0 * phase) + p[f"{key}_cosine"] * np.cos(2.0 * phase)
            )
        channels[channel] = channels[channel] + size * wave


def changes_load(effects: Frozen) -> bool:
    """Whether the load that sensors show is not the one on the soil."""
    return any(name in {"slope", "load-transfer"} for name, _, _ in effects)


def late(at: Callable[[Array], Channels], channel: str, time: Array, lag: float, *, filtered: float) -> Array:
    """Return a channel that is late: delayed, and then through a first-order filter, by shares of the lag.

    The filter obeys shown + lag · d(shown)/dt = delayed; it starts settled.
    """
    delay, lag = (1.0 - filtered) * lag, filtered * lag
    if not lag:
        return at(np.maximum(time - delay, 0.0))[channel]
    if lag < 0.0:
        raise ValueError("a first-order filter is never early: use the form other")
    end = float(time.max(initial=0.0)) + FILTER_STEP
    grid = np.linspace(0.0, end, math.ceil(end / FILTER_STEP) + 1)
    true = at(np.maximum(grid - delay, 0.0))[channel]
    step = grid[1] / lag
    keep = math.exp(-step)
    # Exact for a truth that is straight between the points of the grid.
    ahead = 1.0 - (1.0 - keep) / step
    filtered = true.copy()
    for j in range(1, len(grid)):
        filtered[j] = keep * filtered[j - 1] + (1.0 - keep - ahead) * true[j - 1] + ahead * true[j]
    return np.asarray(np.interp(time, grid, filtered))


def rolled_on(at: Callable[[Array], Channels], time: Array, length: float, *, shifted: bool) -> Array:
    """Return the sinkage of a wheel that sinks only as it rolls on, from a start at which it has settled.

    Each step of the way takes away its share of what is lacking; or the sinkage is that of the place a
    `length` back, where it is `shifted`.
    """
    end = float(time.max(initial=0.0)) + FILTER_STEP
    grid = np.linspace(0.0, end, math.ceil(end / FILTER_STEP) + 1)
    true = at(grid)
    steady, pace = true["sinkage"].tolist(), np.abs(true["velocity"]).tolist()
    way, depths = [0.0], [steady[0]]
    for j in range(1, len(grid)):
        moved = 0.5 * (pace[j - 1] + pace[j]) * (grid[j] - grid[j - 1])
        way.append(way[-1] + moved)
        # Half a step before and after: the implicit midpoint rule for length · dz/ds = steady − z.
        share = moved / (length + 0.5 * moved) if length > 0.0 or moved > 0.0 else 0.0
        lacking = 0.5 * (steady[j - 1] + steady[j]) - depths[-1]
        depths.append(depths[-1] + share * lacking if length > 0.0 else steady[j])
    if shifted:
        here = np.interp(time, grid, way)
        return np.asarray(np.interp(np.maximum(here - length, 0.0), way, steady))
    return np.asarray(np.interp(time, grid, depths))


def _friction(channels: Channels, p: Numbers, other: bool, _omega: Profile, _time: Array) -> None:
    # Torque counts positive the way the wheel turns. In the other form it sticks at low speed (Stribeck).
    omega = channels["angular_velocity"]
    dry = np.tanh(omega / 0.05) * (1.0 + 0.3 * np.exp(-((omega / 0.3) ** 2))) if other else np.sign(omega)
    channels["torque"] = channels["torque"] + p["Tc"] * np.abs(dry) + p["Bv"] * np.abs(omega)


def _efficiency(channels: Channels, p: Numbers, other: bool, _omega: Profile, _time: Array) -> None:
    # A light load is carried less well, in the other form.
    torque = channels["torque"]
    eta = 1.0 - (1.0 - p["eta"]) * (1.0 + 0.5 * np.exp(-np.abs(torque))) if other else p["eta"]
    channels["torque"] = np.where(torque >= 0.0, torque / eta, torque * eta)


def _temperature(channels: Channels, p: Numbers, other: bool, _omega: Profile, _time: Array) -> None:
    warmth = p["alpha"] * (channels["motor_temperature"] - 25.0)
    channels["torque"] = channels["torque"] * (np.exp(-warmth) if other else 1.0 / (1.0 + warmth))


def _load_bias(channels: Channels, p: Numbers, _other: bool, _omega: Profile, _time: Array) -> None:
    channels["load"] = p["gain"] * channels["load"] + p["offset"]


def _sinkage_bias(channels: Channels, p: Numbers, other: bool, _omega: Profile, _time: Array) -> None:
    # A camera that looks at an angle misses a share of it, in the other form.
    channels["sinkage"] = (0.97 if other else 1.0) * channels["sinkage"] + p["offset"]


def _drawbar_bias(channels: Channels, p: Numbers, other: bool, _omega: Profile, _time: Array) -> None:
    # Guides that stick a little more under a light load, in the other form.
    more = 0.5 + 0.5 * np.mean(channels["load"]) / channels["load"] if other else 1.0
    channels["drawbar_pull"] = channels["drawbar_pull"] + p["offset"] * more


def _carried_away(channels: Channels, p: Numbers, other: bool, _omega: Profile, _time: Array) -> None:
    # Lyasko 2010 in the other form: soil is carried away without bearing more.
    slip = np.abs(channels["slip"])
    below = 1.0 - 0.5 * p["S"] * slip if other else 1.0
    channels["sinkage"] = channels["sinkage"] * (1.0 + p["S"] * slip) / below


def _acceleration(channels: Channels, p: Numbers, _other: bool, omega: Profile, time: Array) -> None:
    step = 1e-3
    rate = (omega(time + step) - omega(time - step)) / (2.0 * step)
    channels["torque"] = channels["torque"] + p["J"] * np.where(omega(time) < 0.0, -rate, rate)


SENSORS: dict[str, Callable[[Channels, Numbers, bool, Profile, Array], None]] = {
    "slip-sinkage": _carried_away,
    "drivetrain-friction": _friction,
    "gear-efficiency": _efficiency,
    "motor-temperature": _temperature,
    "load-bias": _load_bias,
    "sinkage-bias": _sinkage_bias,
    "drawbar-bias": _drawbar_bias,
    "acceleration-torque": _acceleration,
}
