"""Forces on a rigid wheel from the stresses under its rim, with their exact derivatives.

Normal stress of Bekker and of Wong & Reece, shear stress of Janosi & Hanamoto: equations [1] to
[9] of Iagnemma et al. 2004 (doi 10.1109/TRO.2004.829462).

The arc in front of the angle of maximum stress θm and the one behind it carry the same normal
stress at the same share u of their length, counted from where the rim meets the surface: one power
serves both. Angles enter through half their distance to θ1, so that nothing cancels at small θ1.

At u = 0 the stress starts like a power n of u, and n is no whole number: Gauss–Legendre would
converge slowly in u. With u = s³ the integrand is smooth enough in s.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from functools import cache, cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Collection

    from numpy.typing import NDArray

    Array = NDArray[np.float64]

ORDER = 14
#: Nodes on each arc that give the forces to 1e-8 of themselves, by the longest way along an arc in
#: terms of k: that is what the shear stress changes over.
_ORDERS = ((4.0, 12), (8.0, ORDER), (20.0, 18))
_MOST = 24
_POWER = 3


def order_for(reach: float) -> int:
    """Return how many nodes on each arc give the forces to 1e-8; `reach` is angle · R / k of the longer."""
    return next((order for most, order in _ORDERS if reach <= most), _MOST)


@cache
def nodes(order: int = ORDER) -> tuple[Array, Array]:
    """Nodes and weights on (0, 1) for functions that start like a fractional power of u at 0.

    With u and w of shape (order, 1), ∫ f(u) du ≈ Σ w f(u).
    """
    x, weights = np.polynomial.legendre.leggauss(order)
    s = 0.5 * (x + 1.0)
    u = s**_POWER
    w = 0.5 * weights * _POWER * s ** (_POWER - 1)
    return u[:, None], w[:, None]


@dataclass(frozen=True, slots=True, kw_only=True)
class Contact:
    """What the forces follow from: each a number, or one value per sample."""

    # entry_angle, max_stress_angle, exit_angle: θ1 > θm > θ2 in rad, from the vertical, positive forward
    entry_angle: Array
    max_stress_angle: Array
    exit_angle: Array
    slip: Array  # i; negative where the wheel skids, which turns the shear stress round
    # cohesion, tan_phi, shear_modulus: c in Pa, tan φ, k in m
    cohesion: Array
    tan_phi: Array
    shear_modulus: Array
    # stiffness, sinkage_exponent: keq = kc/b + kφ in Pa/m^n, and n
    stiffness: Array
    sinkage_exponent: Array
    # radius, shear_radius: of the rim that presses and of the surface that shears, in m
    radius: Array
    shear_radius: Array


NAMES = tuple(f.name for f in fields(Contact))
#: 1 + i of a wheel that skids with its brakes on.
_LOCKED = 1e-3
_LEAST_RATIO = 1e-9


def rolling(slip: Any) -> Any:
    """Return V/(r ω): 1 − i of a wheel that drives, 1/(1 + i) of one that skids (i < 0)."""
    return np.where(slip < 0.0, 1.0 / np.maximum(1.0 + slip, _LOCKED), 1.0 - slip)


def slip_of_radius(slip: Any, share: Any) -> Any:
    """Slip with another rolling radius, whose share of r is given, for driving and for skidding.

    Driving i = 1 − V/(r ω), skidding i = r ω/V − 1, so V/(r ω) is changed.
    """
    ratio = rolling(slip) / share
    return np.where(ratio > 1.0, 1.0 / np.maximum(ratio, _LEAST_RATIO) - 1.0, 1.0 - ratio)


def forces(
    contact: Contact, width: float, *, by: Collection[str] = (), order: int = ORDER
) -> tuple[Array, dict[str, Array]]:
    """Integrate the stresses over the contact.

    W = b (r ∫ σ cos θ + R ∫ τ sin θ), T = R² b ∫ τ, DP = b (R ∫ τ cos θ − r ∫ σ sin θ), with the
    shear radius R, and σ = keq (r (cos θe − cos θ1))^n, τ = (c + σ tan φ)(1 − exp(−j/k)),
    j = R (θ1 − θ) − V/ω (sin θ1 − sin θ).

    Parameters
    ----------
    width : float
        b in m.
    by : collection of str
        Names of `Contact` by which derivatives are wanted.
    order : int
        Nodes on each arc.

    Returns
    -------
    values : ndarray, shape (3, n)
        W in N, T in N m, DP in N.
    slopes : dict of str to ndarray, shape (3, n)
        Their derivatives.
    """
    rim = _Rim(contact, width, order)
    return rim.values, {name: getattr(rim, f"by_{name}")() for name in NAMES if name in by}


class _Rim:
    """Stresses at the nodes, the forces they add up to, and how these change."""

    def __init__(self, contact: Contact, width: float, order: int) -> None:
        u, w = nodes(order)
        one, two = contact.entry_angle, contact.exit_angle
        r, R, k = contact.radius, contact.shear_radius, contact.shear_modulus
        front, rear = one - contact.max_stress_angle, contact.max_stress_angle - two
        half = np.empty((2, order, len(front)))
        np.multiply(0.5 * u, front, out=half[0])
        np.subtract(0.5 * (one - two), 0.5 * u * rear, out=half[1])
        sine = np.sin(half)
        square = sine * sine
        mixed = np.sqrt(1.0 - square)
        mixed *= sine
        s1, c1 = np.sin(one), np.cos(one)
        # cos θ − cos θ1 and sin θ1 − sin θ.
        rise, run = 2.0 * s1 * mixed, 2.0 * c1 * mixed
        rise -= 2.0 * c1 * square
        run += 2.0 * s1 * square
        cos, sin = c1 + rise, s1 - run

        log_depth = np.log(r * rise[0])
        sigma = np.exp(contact.sinkage_exponent * log_depth)
        sigma *= contact.stiffness
        advance = rolling(contact.slip)
        travel = 2.0 * R * half
        travel -= advance * r * run
        fade = np.abs(travel)
        fade *= -1.0 / k
        np.exp(fade, out=fade)
        mobilised = 1.0 - fade
        np.copysign(mobilised, travel, out=mobilised)
        strength = contact.tan_phi * sigma
        strength += contact.cohesion
        tau = strength * mobilised

        weight = np.empty_like(half)
        np.multiply(w, front, out=weight[0])
        np.multiply(w, rear, out=weight[1])
        w_cos, w_sin = weight * cos, weight * sin
        both_cos, both_sin = w_cos[0] + w_cos[1], w_sin[0] + w_sin[1]
        press = _sum(both_cos, sigma), _sum(both_sin, sigma)
        shear = _sum(weight, tau), _sum(w_cos, tau), _sum(w_sin, tau)
        self.values = width * np.array(
            [r * press[0] + R * shear[2], R * R * shear[0], R * shear[1] - r * press[1]]
        )
        self.contact, self.width, self.u, self.w = contact, width, u, w
        self.advance = advance
        self.half, self.s1, self.c1, self.rise, self.run = half, s1, c1, rise, run
        self.cos, self.sin, self.w_cos, self.w_sin, self.weight = cos, sin, w_cos, w_sin, weight
        self.both_cos, self.both_sin, self.press, self.shear = both_cos, both_sin, press, shear
        self.log_depth, self.sigma, self.travel, self.tau = log_depth, sigma, travel, tau
        self.strength, self.fade, self.mobilised = strength, fade, mobilised

    @cached_property
    def grips(self) -> tuple[Array, Array, Array]:
        """What c + σ tan φ of a node adds to ∫ τ, ∫ τ cos θ and ∫ τ sin θ."""
        parts = (w * self.mobilised for w in (self.weight, self.w_cos, self.w_sin))
        plain, cos, sin = (part[0] + part[1] for part in parts)
        return plain, cos, sin

    @cached_property
    def steep(self) -> Array:
        """How τ changes with j, weighted."""
        steep = self.strength * self.fade
        steep *= self.weight
        steep /= self.contact.shear_modulus
        return np.asarray(steep)

    @cached_property
    def bend(self) -> Array:
        """How j changes with the angle of a node."""
        return np.asarray(self.advance * self.contact.radius * self.cos - self.contact.shear_radius)

    @cached_property
    def per_depth(self) -> Array:
        """How σ changes with its depth in radii."""
        return np.asarray(self.contact.sinkage_exponent * self.sigma / self.rise[0])

    def of_shear(self, unit: Array | None = None) -> Array:
        """Change of the forces with c + σ tan φ, shape (order, n); by 1 everywhere if not given."""
        R = self.contact.shear_radius
        plain, cos, sin = (part.sum(axis=0) if unit is None else _sum(part, unit) for part in self.grips)
        return self.width * np.array([R * sin, R * R * plain, R * cos])

    def of_sigma(self, change: Array) -> Array:
        """Change of the forces with σ, shape (order, n)."""
        total = self.of_shear(self.contact.tan_phi * change)
        total[0] += self.width * self.contact.radius * _sum(self.both_cos, change)
        total[2] -= self.width * self.contact.radius * _sum(self.both_sin, change)
        return total

    def of_travel(self, change: Array) -> Array:
        """Change of the forces with j, shape (2, order, n)."""
        part, R = self.steep * change, self.contact.shear_radius
        return self.width * np.array(
            [R * _sum(part, self.sin), R * R * part.sum(axis=(0, 1)), R * _sum(part, self.cos)]
        )

    def of_turning(self, arc: int, angle: Array) -> Array:
        """Change of the forces as the nodes of an arc turn, their stresses kept."""
        r, R = self.contact.radius, self.contact.shear_radius
        sin, cos = self.w_sin[arc] * angle, self.w_cos[arc] * angle
        load = R * _sum(cos, self.tau[arc]) - r * _sum(sin, self.sigma)
        pull = -R * _sum(sin, self.tau[arc]) - r * _sum(cos, self.sigma)
        return self.width * np.array([load, np.zeros_like(load), pull])

    def of_length(self, arc: int) -> Array:
        """Change of the forces as an arc gets longer, its nodes and their stresses kept."""
        r, R = self.contact.radius, self.contact.shear_radius
        cos, sin, tau = self.w * self.cos[arc], self.w * self.sin[arc], self.tau[arc]
        return self.width * np.array(
            [
                r * _sum(cos, self.sigma) + R * _sum(sin, tau),
                R * R * (self.w * tau).sum(axis=0),
                R * _sum(cos, tau) - r * _sum(sin, self.sigma),
            ]
        )

    def by_entry_angle(self) -> Array:
        u, contact = self.u, self.contact
        start = contact.shear_radius - self.advance * contact.radius * self.c1
        travel = np.stack([start + (1.0 - u) * self.bend[0], np.broadcast_to(start, self.bend[1].shape)])
        return (
            self.of_sigma(self.per_depth * (self.s1 - (1.0 - u) * self.sin[0]))
            + self.of_travel(travel)
            + self.of_turning(0, 1.0 - u)
            + self.of_length(0)
        )

    def by_max_stress_angle(self) -> Array:
        turning = self.of_turning(0, self.u) + self.of_turning(1, self.u)
        return (
            self.of_sigma(-self.per_depth * self.u * self.sin[0])
            + self.of_travel(self.u * self.bend)
            + turning
            - self.of_length(0)
            + self.of_length(1)
        )

    def by_exit_angle(self) -> Array:
        travel = np.zeros_like(self.bend)
        np.multiply(1.0 - self.u, self.bend[1], out=travel[1])
        return self.of_travel(travel) + self.of_turning(1, 1.0 - self.u) - self.of_length(1)

    def by_slip(self) -> Array:
        steep = np.where(self.contact.slip < 0.0, self.advance**2, 1.0)
        return self.of_travel(steep * self.contact.radius * self.run)

    def by_cohesion(self) -> Array:
        return self.of_shear()

    def by_tan_phi(self) -> Array:
        return self.of_shear(self.sigma)

    def by_shear_modulus(self) -> Array:
        return self.of_travel(-self.travel / self.contact.shear_modulus)

    def by_stiffness(self) -> Array:
        return self.of_sigma(self.sigma / self.contact.stiffness)

    def by_sinkage_exponent(self) -> Array:
        return self.of_sigma(self.sigma * self.log_depth)

    def by_radius(self) -> Array:
        contact = self.contact
        total = self.of_sigma(contact.sinkage_exponent * self.sigma / contact.radius)
        total += self.of_travel(-self.advance * self.run)
        total[0] += self.width * self.press[0]
        total[2] -= self.width * self.press[1]
        return total

    def by_shear_radius(self) -> Array:
        plain, cos, sin = self.shear
        own = np.array([sin, 2.0 * self.contact.shear_radius * plain, cos])
        return self.of_travel(2.0 * self.half) + self.width * own


def _sum(a: Array, b: Array) -> Array:
    """Sum a product over the nodes without writing it down."""
    subscripts = "aqn,aqn->n" if a.ndim == 3 else "qn,qn->n"
    return np.asarray(np.einsum(subscripts, a, b), dtype=float)
