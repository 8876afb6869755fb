"""Forces on a wheel, integrated from the stresses under its rim, one number at a time.

"wong-reece" is the full model of Bekker, Janosi–Hanamoto and Wong–Reece: equations [1] to [9] of
Iagnemma, Kang, Shibly, Dubowsky 2004 (doi 10.1109/TRO.2004.829462). "linear" has the triangular
stresses of its equations [10] to [13], integrated numerically, so that the closed forms derived
from them in the paper, and in the program, are checked and not repeated.

What physical effects do to the soil, the stresses and the contact they do to `Ground`, before it
is integrated: see `effects`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from itertools import pairwise
from typing import TYPE_CHECKING, Literal, TypeAlias

from numpy.polynomial.legendre import leggauss
from scipy.optimize import brentq

if TYPE_CHECKING:
    from collections.abc import Callable

    from simulator.soils import Soil

Model = Literal["wong-reece", "linear"]
Stresses = tuple[float, float]
#: What effects do: they are called with the ground once it has its "numbers", its "angles", its "stresses".
Laws: TypeAlias = "Callable[[Ground, str], None]"

#: Deepest entry angle in rad that a sinkage is sought for: a wheel sunk to its axle is stuck.
DEEPEST = 1.45
#: Places and weights between 0 and 1: the forces are right to 1e-10.
GAUSS = [(0.5 + 0.5 * float(x), 0.5 * float(w)) for x, w in zip(*leggauss(32), strict=True)]


@dataclass(frozen=True, slots=True)
class Wheel:
    """A rigid wheel; lengths in m. Grousers count only where an effect asks for them."""

    radius: float = 0.125
    width: float = 0.100
    grouser_height: float = 0.0
    grouser_count: int = 0


@dataclass(frozen=True, slots=True)
class Forces:
    """What the soil does to the wheel: load W and drawbar pull DP in N, torque T in N m."""

    load: float
    torque: float
    pull: float


@dataclass(frozen=True, slots=True)
class Moment:
    """What else a wheel meets that the soil may answer to.

    Parameters
    ----------
    velocity : float
        V in m/s.
    pass_number : float
        0 on fresh soil.
    slip_angle : float
        β in rad.
    """

    velocity: float = 0.1
    pass_number: float = 0.0
    slip_angle: float = 0.0


@dataclass(slots=True)
class Ground:
    """All that decides the stresses under a rim; effects change it before they are integrated.

    Parameters
    ----------
    wheel : Wheel
    slip, sinkage : float
    grip : float
        V/(rω), which is 1 − i for a driving and 1/(1 + i) for a skidding wheel.
    cohesion, tan_phi, shear_modulus, stiffness, exponent : float
        SI.
    radius, shear_radius : float
        Of the rim that presses and of the surface that shears, in m.
    arm : float
        Of the shear force about the axle, in m; the shear radius where it is not set.
    entry, peak, leave : float
        Angles in rad; `peak` and `leave` are set once the entry angle is known.
    pressure : callable
        Normal stress in Pa of the depth in m.
    strength : callable
        Shear strength in Pa of the normal stress in Pa.
    mobilised : callable
        Share of the strength, of the shear displacement in m and the angle in rad.
    kinks : list of float
        Depths in m at which the pressure has a kink.
    """

    wheel: Wheel
    slip: float
    sinkage: float
    grip: float
    cohesion: float
    tan_phi: float
    shear_modulus: float
    stiffness: float
    exponent: float
    radius: float
    shear_radius: float
    arm: float = math.nan
    entry: float = math.nan
    peak: float = math.nan
    leave: float = math.nan
    pressure: Callable[[float], float] = lambda _depth: math.nan
    strength: Callable[[float], float] = lambda _stress: math.nan
    mobilised: Callable[[float, float], float] = lambda _displacement, _theta: math.nan
    kinks: list[float] = field(default_factory=list)

    def displacement(self, theta: float) -> float:
        """Return the shear displacement j in m at an angle."""
        if self.radius == self.shear_radius:
            return self.radius * (self.entry - theta - self.grip * (math.sin(self.entry) - math.sin(theta)))
        # Grousers carry the shear surface round outside the rim, over the same ground.
        return self.shear_radius * (self.entry - theta) - self.radius * self.grip * (
            math.sin(self.entry) - math.sin(theta)
        )


@dataclass(frozen=True, slots=True)
class Contact:
    """Stresses under the rim: entry, exit and maximum-stress angle in rad, and (σ, τ) in Pa of θ.

    `kinks` are angles at which a stress has a kink beside that at the maximum.
    """

    entry: float
    exit: float
    peak: float
    stresses: Callable[[float], Stresses]
    radius: float
    shear_radius: float
    arm: float
    kinks: tuple[float, ...] = ()
    nodes: list[tuple[float, float, float, float]] = field(default_factory=list, repr=False, compare=False)

    def integral(self, of: Callable[[float, float, float], float]) -> float:
        """Integrate of(σ, τ, θ) over the contact; the kink at the maximum is an end of both parts."""
        return math.fsum(weight * of(sigma, tau, theta) for weight, sigma, tau, theta in self._nodes())

    def _nodes(self) -> list[tuple[float, float, float, float]]:
        """Return weights, stresses and angles of Gauss's rule between kinks; made once."""
        if not self.nodes:
            for end, sign in ((self.exit, 1.0), (self.entry, -1.0)):
                # Stresses start at the ends like a power n of the distance: its root is what to step in.
                length = self.peak - end
                inside = [(kink - end) / length for kink in self.kinks if 0.0 < (kink - end) / length < 1.0]
                for low, high in pairwise((0.0, *sorted(map(math.sqrt, inside)), 1.0)):
                    for place, weight in GAUSS:
                        root = low + (high - low) * place
                        theta = end + length * root * root
                        share = sign * length * (high - low) * weight * 2.0 * root
                        self.nodes.append((share, *self.stresses(theta), theta))
        return self.nodes


def entry_angle(wheel: Wheel, sinkage: float) -> float:
    """Return θ1 in rad, from z = r (1 − cos θ1)."""
    return _angle_at(wheel.radius, sinkage)


def _angle_at(radius: float, sinkage: float) -> float:
    return math.acos(1.0 - sinkage / radius)


def _ground(
    soil: Soil,
    wheel: Wheel,
    sinkage: float,
    slip: float,
    model: Model,
    laws: Laws | None,
) -> Ground:
    """Put the ground together, and let effects change it: first its numbers, then angles, then stresses."""
    ground = Ground(
        wheel,
        slip,
        sinkage,
        1.0 - slip if slip >= 0.0 else 1.0 / (1.0 + slip),
        soil.cohesion,
        soil.tan_phi,
        soil.shear_modulus,
        soil.stiffness(wheel.width),
        soil.exponent,
        wheel.radius,
        wheel.radius,
    )
    if laws:
        laws(ground, "numbers")
    ground.entry = _angle_at(ground.radius, ground.sinkage)
    ground.leave = -soil.exit_ratio * ground.entry if model == "wong-reece" else 0.0
    ground.peak = (soil.c1 + soil.c2 * slip) * ground.entry if model == "wong-reece" else ground.entry / 2.0
    if laws:
        laws(ground, "angles")
    ground.pressure = lambda depth: ground.stiffness * max(depth, 0.0) ** ground.exponent
    ground.strength = lambda stress: ground.cohesion + stress * ground.tan_phi
    # Where the wheel skids, the soil is sheared the other way.
    ground.mobilised = lambda displacement, _theta: math.copysign(
        -math.expm1(-abs(displacement) / ground.shear_modulus), displacement
    )
    if laws:
        laws(ground, "stresses")
    return ground


def _depth(ground: Ground, theta: float) -> float:
    return ground.radius * (math.cos(theta) - math.cos(ground.entry))


def _wong_reece(ground: Ground) -> Contact:
    entry, peak, leave = ground.entry, ground.peak, ground.leave

    def stresses(theta: float) -> Stresses:
        front = theta if theta >= peak else entry - (theta - leave) * (entry - peak) / (peak - leave)
        sigma = ground.pressure(_depth(ground, front))
        return sigma, ground.strength(sigma) * ground.mobilised(ground.displacement(theta), theta)

    kinks = []
    for depth in ground.kinks:
        cosine = math.cos(entry) + depth / ground.radius
        if cosine < 1.0 and math.acos(cosine) > peak:
            front = math.acos(cosine)
            kinks += [front, leave + (entry - front) * (peak - leave) / (entry - peak)]
    return _made(ground, stresses, kinks)


def _linear(ground: Ground) -> Contact:
    entry, peak, leave = ground.entry, ground.peak, ground.leave
    sigma_peak = ground.pressure(_depth(ground, peak))
    tau_peak = ground.strength(sigma_peak) * ground.mobilised(ground.displacement(peak), peak)
    # Behind the maximum τ falls to the cohesion, the way the soil is sheared.
    tail = math.copysign(ground.cohesion, tau_peak)

    def stresses(theta: float) -> Stresses:
        if theta >= peak:
            share = (entry - theta) / (entry - peak)
            return share * sigma_peak, share * tau_peak
        share = (theta - leave) / (peak - leave)
        return share * sigma_peak, tail + share * (tau_peak - tail)

    return _made(ground, stresses, [])


def _made(ground: Ground, stresses: Callable[[float], Stresses], kinks: list[float]) -> Contact:
    arm = ground.shear_radius if math.isnan(ground.arm) else ground.arm
    return Contact(
        ground.entry,
        ground.leave,
        ground.peak,
        stresses,
        ground.radius,
        ground.shear_radius,
        arm,
        tuple(kinks),
    )


def contact(
    soil: Soil,
    wheel: Wheel,
    sinkage: float,
    slip: float,
    model: Model = "wong-reece",
    laws: Laws | None = None,
) -> Contact:
    """Return the stresses under the rim at a sinkage in m and a slip from −1 to 1."""
    if not (0.0 if laws is None else -1.0) <= slip <= 1.0:
        raise ValueError(f"slip {slip} is not between 0 and 1")
    ground = _ground(soil, wheel, sinkage, slip, model, laws)
    return (_wong_reece if model == "wong-reece" else _linear)(ground)


def _load(under: Contact, wheel: Wheel) -> float:
    lever = under.shear_radius / under.radius
    return (
        under.radius
        * wheel.width
        * under.integral(lambda sigma, tau, theta: sigma * math.cos(theta) + lever * tau * math.sin(theta))
    )


def forces(
    soil: Soil,
    wheel: Wheel,
    sinkage: float,
    slip: float,
    model: Model = "wong-reece",
    laws: Laws | None = None,
) -> Forces:
    """Integrate the forces at a sinkage in m and a slip."""
    under = contact(soil, wheel, sinkage, slip, model, laws)
    area, lever = under.radius * wheel.width, under.shear_radius / under.radius
    shear_area = under.shear_radius * wheel.width
    torque = under.arm * shear_area * under.integral(lambda _sigma, tau, _theta: tau)
    pull = area * under.integral(
        lambda sigma, tau, theta: lever * tau * math.cos(theta) - sigma * math.sin(theta)
    )
    return Forces(_load(under, wheel), torque, pull)


def sinkage_under(
    soil: Soil,
    wheel: Wheel,
    load: float,
    slip: float,
    model: Model = "wong-reece",
    laws: Laws | None = None,
) -> float:
    """Solve for the sinkage in m at which the soil carries a load in N.

    Raises
    ------
    ValueError
        The soil does not carry it before the wheel has sunk to its axle.
    """

    def excess(sinkage: float) -> float:
        return _load(contact(soil, wheel, sinkage, slip, model, laws), wheel) - load

    deepest = wheel.radius * (1.0 - math.cos(DEEPEST))
    if excess(deepest) < 0.0:
        raise ValueError(f"{soil.name} does not carry {load:.3g} N at slip {slip:.2f}")
    return float(brentq(excess, 1e-9, deepest, xtol=1e-15, rtol=1e-13))


def mean_stress(soil: Soil, wheel: Wheel, load: float, slip: float, model: Model = "wong-reece") -> float:
    """Average the normal stress, in Pa, over the contact under a load in N."""
    under = contact(soil, wheel, sinkage_under(soil, wheel, load, slip, model), slip, model)
    return under.integral(lambda sigma, _tau, _theta: sigma) / (under.entry - under.exit)
