"""Channels derived from others, as section II-B of Iagnemma et al. 2004 describes.

The paper (doi 10.1109/TRO.2004.829462) takes the load from a quasi-static analysis of the
forces on the rover, the torque from the motor current with its thermal effect, and the slip
from wheel speed and travel. Axes are those of the body: x forward, y left, z up. Pitch is
positive nose up and roll is positive left side up; the body is taken as parallel to the ground.
"""

import numpy as np
from numpy.typing import ArrayLike

from terrain_cli.errors import ConfigurationError
from terrain_cli.rover.vehicle import Motor, Vehicle
from terrain_cli.vocabulary.arrays import Array, Mask

STANDING = 1e-3  # rad/s. Below it a wheel stands, whatever its encoder's last digit does.
#: A wheel that is faster than this share of a speed that it seldom exceeds drives, however noisy its encoder
#: is; that speed is a quantile, on which no spike has weight. Judged.
_SLOW, _TYPICAL = 0.1, 0.9
#: Standard deviation of the gain of a torque from a current, where rover.toml tells none. Torque constants
#: are within 10 % of the data sheet (HIWIN, torque motors TM-2108, section 8.1), and a gear at part of its
#: load loses up to 10 % more than at its rated one (Harmonic Drive 1021387, section 4.4).
CURRENT_GAIN = 0.1
#: Standard deviations that no sample of a standing wheel exceeds: one of 16,000 of normal noise.
_NOISE = 4.0
_BLOCK = 8192


def slip(angular_velocity: Array, velocity: Array, radius: float) -> Array:
    """Slip of a wheel: i = 1 − V/(rω) driving, rω/V − 1 skidding; NaN where the wheel stands.

    Wong, *Theory of Ground Vehicles*, chapter 1; ω in rad/s, V of the wheel centre in m/s, r in m. The same
    in reverse, where both ω and V are negative. Above 1 where the wheel rolls back against its rotation.
    """
    turning = np.where(np.abs(angular_velocity) > STANDING, angular_velocity, np.nan)
    ratio = velocity / (radius * turning)
    return np.where(ratio > 1.0, 1.0 / np.maximum(ratio, 1.0) - 1.0, 1.0 - ratio)


def stands(angular_velocity: Array) -> Mask:
    """Tell where a wheel stands: where ω (rad/s) is not told from 0 by the noise that it has when slow."""
    speed = np.abs(angular_velocity)
    known = speed[np.isfinite(speed)]
    slow = speed <= _SLOW * (np.quantile(known, _TYPICAL) if len(known) else 0.0)
    with np.errstate(invalid="ignore"):
        # Of what is infinite there is no difference, and it is not slow.
        jitter = np.diff(angular_velocity, 2)[slow[2:] & slow[1:-1] & slow[:-2]]
    # White noise σ makes second differences of 1.65 σ in the median.
    limit = _NOISE * float(np.median(np.abs(jitter))) / 1.65 if len(jitter) else 0.0
    return np.asarray((speed <= STANDING) | (slow & (speed <= limit)))


def velocity(angular_velocity: Array, slip: Array, radius: float) -> Array:
    """Forward velocity of a wheel: V = (1 − i) rω driving, rω/(1 + i) skidding; `slip` solved for V.

    NaN where the slip is −1 or less, which no wheel that turns forward has.
    """
    share = np.where(slip < 0.0, 1.0 / np.where(slip > -1.0, 1.0 + slip, np.nan), 1.0 - slip)
    return np.asarray(share * radius * angular_velocity)


def angular_velocity(velocity: Array, slip: Array, radius: float) -> Array:
    """Wheel speed (rad/s) of a wheel that moves at V with a slip i: `slip` solved for ω; NaN at full slip."""
    driving = velocity / (radius * np.where(slip < 1.0, 1.0 - slip, np.nan))
    return np.asarray(np.where(slip < 0.0, velocity * (1.0 + slip) / radius, driving))


def torque_from_current(
    current: Array, motor: Motor, *, temperature: Array | None = None, angular_velocity: Array | None = None
) -> Array:
    """Torque at the wheel, T = η N Kt (1 + α (Tm − T0)) (I − I0).

    In N m, of I in A, the temperature Tm of the motor in °C (T0 if not known) and ω in rad/s. The no-load
    current I0 acts against the rotation. Without ω it is taken against the current, which then gives no
    torque until it exceeds I0. The efficiency η is that of a motor which drives.
    """
    if angular_velocity is None:
        useful = np.sign(current) * np.maximum(np.abs(current) - motor.no_load_current, 0.0)
    else:
        useful = current - motor.no_load_current * np.sign(angular_velocity)
    torque = motor.efficiency * motor.gear_ratio * motor.torque_constant * useful
    if temperature is not None:
        torque *= 1.0 + motor.temperature_coefficient * (temperature - motor.reference_temperature)
    return np.asarray(torque)


def wheel_velocity(velocity: Array, yaw_rate: Array, lateral_position: float) -> Array:
    """Forward velocity of a wheel centre, V = v − y dψ/dt, on a body that turns, y > 0 on the left."""
    return velocity - lateral_position * yaw_rate


def distance_from_velocity(time: ArrayLike, velocity: ArrayLike, *, max_gap: float = np.inf) -> Array:
    """Distance travelled since the first sample, ∫ abs(V) dt by the trapezoidal rule, in m.

    A sample without time or velocity is passed over, and so is an interval longer than `max_gap` (s).
    """
    time, speed = np.asarray(time, dtype=float), np.abs(np.asarray(velocity, dtype=float))
    known = np.isfinite(time) & np.isfinite(speed)
    time, speed = time[known], speed[known]
    steps = np.diff(time)
    counts = (steps > 0.0) & (steps <= max_gap)
    steps *= (speed[1:] + speed[:-1]) / 2.0
    steps[~counts] = 0.0
    return _accumulate(steps, known)


def distance_from_track(x: ArrayLike, y: ArrayLike) -> Array:
    """Distance travelled since the first sample along the chords of a track, in m; past NaN."""
    x, y = np.asarray(x, dtype=float), np.asarray(y, dtype=float)
    known = np.isfinite(x) & np.isfinite(y)
    return _accumulate(np.hypot(np.diff(x[known]), np.diff(y[known])), known)


def _accumulate(steps: Array, known: Mask) -> Array:
    """Sum the steps between known samples; the others stay where the last known one was."""
    distance = np.zeros(len(known))
    distance[np.flatnonzero(known)[1:]] = np.cumsum(steps)
    return np.maximum.accumulate(distance)


def wheel_loads(pitch: ArrayLike, roll: ArrayLike, vehicle: Vehicle, positions: ArrayLike) -> Array:
    """Load of each wheel normal to the ground, from the balance of a standing rover.

    On a slope gravity is m g (−sin θ, −cos θ sin ρ, −cos θ cos ρ) in body axes, and each wheel
    pulls in proportion to its load, so that every contact force points against gravity:
    N (a, b, 1) with a = tan θ / cos ρ and b = tan ρ. Its moment about any lateral axis is then
    that of N alone at ξ = x − a z, and about any longitudinal axis at η = y − b z. The equations
    ΣN = G, ΣN ξ = G ξc and ΣN η = G ηc with G = m g cos θ cos ρ hold for every rover; the
    suspension adds the others:

    - rigid: springs of equal stiffness, loads vary linearly over x and y;
    - rocker, 4 wheels: the differential gives both rockers the same moment about their pivot;
    - rocker-bogie, 6 wheels: besides, the two wheels of each bogie balance about its pivot.
      The bogie has the two wheels of its side between which its pivot lies.

    θ, positive nose up, and ρ, positive left side up, are in rad; `positions`, shape (wheels, 3), are where
    the wheels touch the ground, in m. N, shape (n, wheels), is negative where only a pull would keep the
    wheel down, which is to be set aside. ConfigurationError where the suspension does not fit the wheels.
    """
    positions = np.asarray(positions, dtype=float).reshape(-1, 3)
    pitch, roll = (np.atleast_1d(np.asarray(angle, dtype=float)) for angle in (pitch, roll))
    pitch, roll = np.broadcast_arrays(pitch, roll)
    if len(positions) < 3:
        raise ConfigurationError(f"vehicle: {len(positions)} wheels are too few for a balance of loads")
    rigid = vehicle.suspension == "rigid"
    # Springs leave three unknowns, the plane of their compressions; a mechanism leaves each load.
    basis = np.column_stack([np.ones(len(positions)), positions[:, :2]]) if rigid else np.eye(len(positions))
    arms, heights = _equations(vehicle, positions)
    if np.linalg.matrix_rank(arms @ basis) < basis.shape[1]:
        raise ConfigurationError(
            f"vehicle: wheels at these positions do not carry a {vehicle.suspension} suspension",
            hint="correct their positions in rover.toml: not all in one line, none twice",
        )
    loads = np.empty((len(pitch), len(positions)))
    for start in range(0, len(pitch), _BLOCK):
        block = slice(start, start + _BLOCK)
        loads[block] = _shares(pitch[block], roll[block], arms, heights, basis)
    return loads * (vehicle.mass * vehicle.gravity)


def _shares(pitch: Array, roll: Array, arms: Array, heights: Array, basis: Array) -> Array:
    """Load of each wheel as a share of the weight m g, at each attitude."""
    known = np.isfinite(pitch + roll)
    pitch, roll = np.where(known, pitch, 0.0), np.where(known, roll, 0.0)
    tilt = np.empty((len(pitch), len(arms), 1))
    tilt[:, :, 0] = (np.tan(pitch) / np.cos(roll))[:, None]
    tilt[:, 2, 0] = np.tan(roll)
    right = np.zeros((len(pitch), len(arms), 1))
    right[:, 0, 0] = np.where(known, np.cos(pitch) * np.cos(roll), np.nan)
    return np.asarray(np.linalg.solve((arms - tilt * heights) @ basis, right)[..., 0] @ basis.T)


def _equations(vehicle: Vehicle, positions: Array) -> tuple[Array, Array]:
    """Return the arms and heights of the rows Σ N (arm − tilt · height) = (G, 0, 0, …).

    The first row is the sum of the loads, the second and third are the moments about the
    centre of mass, lateral and longitudinal; those of the suspension follow.
    """
    x, y, z = positions.T
    centre_x, centre_y, centre_z = vehicle.centre_of_mass
    arms = [np.ones_like(x), x - centre_x, y - centre_y]
    heights = [np.zeros_like(x), z - centre_z, z - centre_z]
    if vehicle.rocker_pivot is None:
        return np.array(arms), np.array(heights)
    left = y > (y.max() + y.min()) / 2.0
    on_each = 3 if vehicle.bogie_pivot else 2
    if not left.sum() == (~left).sum() == on_each:
        raise ConfigurationError(
            f"vehicle: a {vehicle.suspension} suspension has {on_each} wheels on each side, "
            f"not {left.sum()} on the left and {(~left).sum()} on the right"
        )
    pivot_x, pivot_z = vehicle.rocker_pivot
    sign = np.where(left, 1.0, -1.0)
    arms.append(sign * (x - pivot_x))
    heights.append(sign * (z - pivot_z))
    if vehicle.bogie_pivot:
        pivot_x, pivot_z = vehicle.bogie_pivot
        for side in (left, ~left):
            bogie = side & _on_bogie(x, side, pivot_x)
            arms.append(bogie * (x - pivot_x))
            heights.append(bogie * (z - pivot_z))
    return np.array(arms), np.array(heights)


def _on_bogie(x: Array, side: Mask, pivot: float) -> Mask:
    """Tell the two of a side's three wheels that stand before and behind the pivot."""
    rear, middle, front = np.sort(x[side])
    if rear < pivot < middle:
        return np.asarray(x <= middle)
    if middle < pivot < front:
        return np.asarray(x >= middle)
    wheels = f"two wheels of a side, which are at {rear}, {middle} and {front} m"
    raise ConfigurationError(f"vehicle: bogie_pivot at x = {pivot} m is not between {wheels}")
