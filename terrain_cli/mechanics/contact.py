"""Forces on a rigid wheel from the stresses under its rim, with their exact derivatives.

Normal stress of Bekker and of Wong & Reece, shear stress of Janosi & Hanamoto: equations [1] to
[9] of Iagnemma et al. 2004 (doi 10.1109/TRO.2004.829462).

The arc in front of the angle of maximum stress θm and the one behind it carry the same normal
stress at the same share u of their length, counted from where the rim meets the surface: one power
serves both. Angles enter through half their distance to θ1, so that nothing cancels at small θ1.

At u = 0 the stress starts like a power n of u, and n is no whole number: Gauss–Legendre would
converge slowly in u. With u = s³ the integrand is smooth enough in s.
"""

from collections.abc import Collection
from dataclasses import dataclass, fields
from functools import cache, cached_property
from typing import Any

import numpy as np

from terrain_cli.vocabulary.arrays import Array

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


@cache
def _sums(order: int) -> tuple[Array, Array]:
    """Return what sums values at the nodes, times 1 and times u: as an integral, and plainly; (2, order)."""
    u, w = nodes(order)
    return np.stack([w[:, 0], (w * u)[:, 0]]), np.stack([np.ones(order), u[:, 0]])


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


def half_angle(half: Any) -> tuple[Any, Any]:
    """Return sin² and sin cos of angles within a quarter turn.

    By the tangent, which NumPy computes for many values at a time: sine and cosine take eight times as long.
    """
    tangent = np.tan(half)
    mixed = tangent / (1.0 + tangent * tangent)
    return tangent * mixed, mixed


def forces(
    contact: Contact, width: float, *, by: Collection[str] = (), order: int = ORDER
) -> tuple[Array, dict[str, Array]]:
    """Integrate the stresses over the contact.

    W = b (r ∫ σ cos θ + R ∫ τ sin θ), T = R² b ∫ τ, DP = b (R ∫ τ cos θ − r ∫ σ sin θ), with the shear radius
    R, and σ = keq (r (cos θe − cos θ1))^n, τ = (c + σ tan φ)(1 − exp(−j/k)), j = R (θ1 − θ) − V/ω (sin θ1 −
    sin θ).

    Returns W in N, T in N m and DP in N, shape (3, n), and their derivatives by the names of `Contact` in
    `by`. `width` is b in m, `order` the nodes on each arc.
    """
    rim = _Rim(contact, width, order)
    return rim.values, {name: rim.by(name) for name in NAMES if name in by}


class _Rim:
    """Stresses at the nodes, the forces they add up to, and how these change.

    Arrays of forces begin with W, T, DP; those of nodes end with (arc, order, n), or (order, n) where
    both arcs have the same.
    """

    def __init__(self, contact: Contact, width: float, order: int) -> None:
        u, w = nodes(order)
        one, two = contact.entry_angle, contact.exit_angle
        r, R, k = contact.radius, contact.shear_radius, contact.shear_modulus
        front, rear = one - contact.max_stress_angle, contact.max_stress_angle - two
        half = np.empty((2, order, len(front)))
        np.multiply(0.5 * u, front, out=half[0])
        np.subtract(0.5 * (one - two), 0.5 * u * rear, out=half[1])
        square, mixed = half_angle(half)
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

        # σ cos θ, σ sin θ, τ, τ cos θ, τ sin θ.
        stresses = np.empty((5, *half.shape))
        np.multiply(sigma, cos, out=stresses[0])
        np.multiply(sigma, sin, out=stresses[1])
        tau = np.multiply(strength, mobilised, out=stresses[2])
        np.multiply(tau, cos, out=stresses[3])
        np.multiply(tau, sin, out=stresses[4])
        integral, self.plain_sum = _sums(order)
        self.sums = (integral @ stresses).transpose(2, 0, 1, 3)
        self.lengths = np.stack([front, rear])
        press, shear = self.sums[0, :2], self.sums[0, 2:]
        #: Change of the forces as an arc gets longer, its nodes and their stresses kept.
        self.of_length = width * np.array(
            [r * press[0] + R * shear[2], R * R * shear[0], R * shear[1] - r * press[1]]
        )
        self.values = self.of_length[:, 0] * front + self.of_length[:, 1] * rear
        self.contact, self.width, self.w = contact, width, w
        self.advance, self.half, self.s1, self.c1 = advance, half, s1, c1
        self.rise, self.run, self.cos, self.sin = rise, run, cos, sin
        self.log_depth, self.sigma, self.travel = log_depth, sigma, travel
        self.strength, self.fade, self.mobilised = strength, fade, mobilised

    @cached_property
    def per_strength(self) -> Array:
        """How the forces change with c + σ tan φ of a node, shape (3, order, n)."""
        R = self.contact.shear_radius
        grip = self.mobilised * self.lengths[:, None]
        change = np.empty((3, *grip.shape[1:]))
        for place, part in enumerate((grip * self.sin, R * grip, grip * self.cos)):
            np.add(part[0], part[1], out=change[place])
        change *= self.width * R * self.w
        return change

    @cached_property
    def per_pressure(self) -> Array:
        """How the forces change with σ of a node, shape (3, order, n)."""
        change = self.contact.tan_phi * self.per_strength
        share = self.width * self.contact.radius * self.w
        change[0] += share * np.add(*(self.lengths[:, None] * self.cos))
        change[2] -= share * np.add(*(self.lengths[:, None] * self.sin))
        return np.asarray(change)

    @cached_property
    def per_travel(self) -> Array:
        """How the forces change with j of a node, shape (3, 2, order, n)."""
        R = self.contact.shear_radius
        steep = self.strength * self.fade
        steep *= self.lengths[:, None] * (self.width * R / self.contact.shear_modulus)
        steep *= self.w
        change = np.empty((3, *steep.shape))
        for place, factor in enumerate((self.sin, R, self.cos)):
            np.multiply(steep, factor, out=change[place])
        return change

    @cached_property
    def with_pressure(self) -> Array:
        """Change of the forces with the logarithm of σ everywhere."""
        return _sum(self.per_pressure, self.sigma)

    @cached_property
    def with_run(self) -> Array:
        """Change of the forces as j grows by the way that a node has run."""
        return _sum(self.per_travel, self.run)

    @cached_property
    def deepened(self) -> Array:
        """How the forces change as a node gets deeper, in radii, shape (3, order, n)."""
        return np.asarray(self.per_pressure * (self.contact.sinkage_exponent * self.sigma / self.rise[0]))

    @cached_property
    def turned(self) -> Array:
        """Change of the forces as the nodes of an arc turn, all by 1 or each by its u, shape (2, 3, 2, n)."""
        r, R = self.contact.radius, self.contact.shear_radius
        bend = self.advance * r * self.cos - R
        change = (self.plain_sum @ (self.per_travel * bend)).transpose(2, 0, 1, 3)
        share = self.width * self.lengths
        change[:, 0] += share * (R * self.sums[:, 3] - r * self.sums[:, 1])
        change[:, 2] -= share * (R * self.sums[:, 4] + r * self.sums[:, 0])
        # The pressure behind θm is that in front of it, so that only those nodes change it.
        change[:, :, 0] -= (self.plain_sum @ (self.deepened * self.sin[0])).transpose(1, 0, 2)
        return np.asarray(change)

    def by(self, name: str) -> Array:  # noqa: C901 - one for each quantity
        """Return how the forces change with one of `NAMES`, shape (3, n)."""
        contact, r, R = self.contact, self.contact.radius, self.contact.shear_radius
        change: Any
        match name:
            case "entry_angle":
                start = R - self.advance * r * self.c1
                moved = self.s1 * self.deepened.sum(axis=1) + start * self.per_travel.sum(axis=(1, 2))
                change = moved + self.turned[0, :, 0] - self.turned[1, :, 0] + self.of_length[:, 0]
            case "max_stress_angle":
                change = self.turned[1].sum(axis=1) + self.of_length[:, 1] - self.of_length[:, 0]
            case "exit_angle":
                change = self.turned[0, :, 1] - self.turned[1, :, 1] - self.of_length[:, 1]
            case "slip":
                change = np.where(contact.slip < 0.0, self.advance**2, 1.0) * r * self.with_run
            case "cohesion":
                change = self.per_strength.sum(axis=1)
            case "tan_phi":
                change = _sum(self.per_strength, self.sigma)
            case "shear_modulus":
                change = _sum(self.per_travel, self.travel) / -contact.shear_modulus
            case "stiffness":
                change = self.with_pressure / contact.stiffness
            case "sinkage_exponent":
                change = _sum(self.per_pressure, self.sigma * self.log_depth)
            case "radius":
                change = contact.sinkage_exponent / r * self.with_pressure - self.advance * self.with_run
                press = self.width * (self.sums[0, :2] * self.lengths).sum(axis=1)
                change[0] += press[0]
                change[2] -= press[1]
            case "shear_radius":
                plain, cos, sin = (self.sums[0, 2:] * self.lengths).sum(axis=1)
                own = np.array([sin, 2.0 * R * plain, cos])
                change = _sum(self.per_travel, 2.0 * self.half) + self.width * own
        return np.asarray(change)


def _sum(change: Array, by: Array) -> Array:
    """Sum over the nodes what changes the forces, without writing the product down."""
    subscripts = "faqn,aqn->fn" if by.ndim == 3 else "fqn,qn->fn"
    return np.asarray(np.einsum(subscripts, change, by), dtype=float)
