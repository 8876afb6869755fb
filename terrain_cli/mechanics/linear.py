"""The linearised wheel–soil model of Iagnemma et al. 2004, equations [10] to [27].

Triangular stresses under the rim with their maximum at θ1/2 and no contact behind the axle
turn each sample into one point of a line, y = c + x tan φ.
"""

import numpy as np
from numpy.typing import ArrayLike

from terrain_cli.vocabulary.arrays import Array

#: Samples at a time: their intermediate results stay in the processor's cache, which is worth a factor of 3.
_BLOCK = 16_384


def entry_angle(sinkage: ArrayLike, radius: float) -> Array:
    """Angle θ1 (rad) at which the rim meets the ground, from z = r (1 − cos θ1) in m, 0 ≤ z ≤ 2 r."""
    return np.asarray(2.0 * np.arcsin(np.sqrt(np.asarray(sinkage, dtype=float) / (2.0 * radius))))


def sinkage_of(angle: ArrayLike, radius: float) -> Array:
    """Sinkage z = r (1 − cos θ1) in m of an entry angle in rad."""
    return np.asarray(2.0 * radius * np.sin(np.asarray(angle, dtype=float) / 2.0) ** 2)


def _coefficients(
    sinkage: Array, slip: Array, radius: float, width: float, shear_modulus: float
) -> tuple[Array, Array, Array, Array]:
    """Coefficients of y = y_T T and x = a (s T − w W).

    With s = sin(θ1/2) and c = cos(θ1/2), which the sinkage gives by square roots, A the share of the
    strength that is mobilised at θ1/2, and B = r² b (θ1/2) (1 + 2 A)/2:

        y_T = 1/B,  a = −A/(c B),  w = r (θ1/2)² (1 + c)/(2 s²)

    where s²/(1 + c) stands for 1 − c, which would cancel at small θ1. Written without temporary
    arrays and trigonometric functions, as every sample of a log asks for them.
    """
    ratio = sinkage * (0.5 / radius)
    s = np.sqrt(ratio)
    c = 1.0 - ratio
    np.sqrt(c, out=c)
    half = np.arcsin(s)
    a = 2.0 * c
    a -= 1.0
    a *= s
    a *= 1.0 - slip
    a -= half
    a *= radius / shear_modulus
    # Minus A.
    np.expm1(a, out=a)
    y_torque = a * -2.0
    y_torque += 1.0
    y_torque *= half
    np.divide(2.0 / (radius**2 * width), y_torque, out=y_torque)
    a /= c
    a *= y_torque
    c += 1.0
    half *= half
    half *= c
    half *= 0.5 * radius
    half /= ratio
    return y_torque, a, s, half


def line_coordinates(
    load: ArrayLike,
    torque: ArrayLike,
    sinkage: ArrayLike,
    slip: ArrayLike,
    *,
    radius: float,
    width: float,
    shear_modulus: float,
) -> tuple[Array, Array]:
    """Stresses x and y in Pa of the line y = c + x tan φ on which a soil's samples lie.

    y = κ2/κ4 and x = −κ1/κ4 of equations [20] to [25] of Iagnemma et al. 2004 (doi 10.1109/TRO.2004.829462),
    with κ3 dropped as there. W in N, T in N m, z in m (0 < z < 2 r) and i between 0 and 1, all of shape (n,);
    r, b and k in m.
    """
    load, torque, sinkage, slip = (np.asarray(q, dtype=float) for q in (load, torque, sinkage, slip))
    x, y = np.empty_like(torque), np.empty_like(torque)
    for start in range(0, len(torque), _BLOCK):
        part = slice(start, start + _BLOCK)
        y_torque, a, s, w = _coefficients(sinkage[part], slip[part], radius, width, shear_modulus)
        w *= load[part]
        s *= torque[part]
        s -= w
        np.multiply(a, s, out=x[part])
        np.multiply(y_torque, torque[part], out=y[part])
    return x, y


def torque(
    load: ArrayLike,
    sinkage: ArrayLike,
    slip: ArrayLike,
    cohesion: ArrayLike,
    tan_phi: ArrayLike,
    *,
    radius: float,
    width: float,
    shear_modulus: float,
) -> Array:
    """Torque in N m that a soil, c in Pa and tan φ, asks of the wheel: the same line solved for T."""
    load, sinkage, slip = (np.asarray(q, dtype=float) for q in (load, sinkage, slip))
    cohesion, tan_phi = (np.broadcast_to(np.asarray(q, dtype=float), load.shape) for q in (cohesion, tan_phi))
    result = np.empty_like(load)
    for start in range(0, len(load), _BLOCK):
        part = slice(start, start + _BLOCK)
        y_torque, a, s, w = _coefficients(sinkage[part], slip[part], radius, width, shear_modulus)
        a *= tan_phi[part]
        w *= load[part]
        w *= a
        result[part] = cohesion[part] - w
        a *= s
        result[part] /= y_torque - a
    return result
