"""Forces on a rigid wheel, integrated from the stresses under its rim, one number at a time.

"wong-reece" is the full model of Bekker, Janosi–Hanamoto and Wong–Reece: equations [1] to [9] of
Iagnemma, Kang, Shibly, Dubowsky 2004 (doi 10.1109/TRO.2004.829462). "linear" has the triangular
stresses of its equations [10] to [13], integrated numerically, so that the closed forms derived
from them in the paper, and in the program, are checked and not repeated.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

from scipy.integrate import quad
from scipy.optimize import brentq

if TYPE_CHECKING:
    from collections.abc import Callable

    from simulator.soils import Soil

Model = Literal["wong-reece", "linear"]
Stresses = tuple[float, float]

#: Deepest entry angle in rad that a sinkage is sought for: a wheel sunk to its axle is stuck.
DEEPEST = 1.45


@dataclass(frozen=True, slots=True)
class Wheel:
    """A rigid wheel; radius and width in m."""

    radius: float = 0.125
    width: float = 0.100


@dataclass(frozen=True, slots=True)
class Forces:
    """What the soil does to the wheel: load W and drawbar pull DP in N, torque T in N m."""

    load: float
    torque: float
    pull: float


@dataclass(frozen=True, slots=True)
class Contact:
    """Stresses under the rim: entry, exit and maximum-stress angle in rad, and (σ, τ) in Pa of θ."""

    entry: float
    exit: float
    peak: float
    stresses: Callable[[float], Stresses]

    def integral(self, of: Callable[[float, float, float], float]) -> float:
        """Integrate of(σ, τ, θ) over the contact; the kink at the maximum is an end of both parts."""

        def part(end: float) -> float:
            # Stresses start at the ends like a power n of the distance: its root is what to step in.
            length = self.peak - end

            def integrand(root: float) -> float:
                theta = end + length * root * root
                return of(*self.stresses(theta), theta) * 2.0 * root

            # Stresses are kilopascals: 1e-7 Pa is where a drawbar pull that crosses zero may stop.
            return float(length * quad(integrand, 0.0, 1.0, epsabs=1e-7, epsrel=1e-11, limit=200)[0])

        return part(self.exit) - part(self.entry)


def entry_angle(wheel: Wheel, sinkage: float) -> float:
    """Return θ1 in rad, from z = r (1 − cos θ1)."""
    return math.acos(1.0 - sinkage / wheel.radius)


def _shear_displacement(wheel: Wheel, entry: float, theta: float, slip: float) -> float:
    return wheel.radius * (entry - theta - (1.0 - slip) * (math.sin(entry) - math.sin(theta)))


def _pressure(soil: Soil, wheel: Wheel, entry: float, theta: float) -> float:
    depth = wheel.radius * (math.cos(theta) - math.cos(entry))
    return float(soil.stiffness(wheel.width) * max(depth, 0.0) ** soil.exponent)


def _shear(soil: Soil, sigma: float, displacement: float) -> float:
    return soil.strength(sigma) * -math.expm1(-displacement / soil.shear_modulus)


def _wong_reece(soil: Soil, wheel: Wheel, sinkage: float, slip: float) -> Contact:
    entry = entry_angle(wheel, sinkage)
    leave = -soil.exit_ratio * entry
    peak = (soil.c1 + soil.c2 * slip) * entry

    def stresses(theta: float) -> Stresses:
        front = theta if theta >= peak else entry - (theta - leave) * (entry - peak) / (peak - leave)
        sigma = _pressure(soil, wheel, entry, front)
        return sigma, _shear(soil, sigma, _shear_displacement(wheel, entry, theta, slip))

    return Contact(entry, leave, peak, stresses)


def _linear(soil: Soil, wheel: Wheel, sinkage: float, slip: float) -> Contact:
    entry = entry_angle(wheel, sinkage)
    peak = entry / 2.0
    sigma_peak = _pressure(soil, wheel, entry, peak)
    tau_peak = _shear(soil, sigma_peak, _shear_displacement(wheel, entry, peak, slip))

    def stresses(theta: float) -> Stresses:
        if theta >= peak:
            share = (entry - theta) / (entry - peak)
            return share * sigma_peak, share * tau_peak
        share = theta / peak
        return share * sigma_peak, soil.cohesion + share * (tau_peak - soil.cohesion)

    return Contact(entry, 0.0, peak, stresses)


def contact(soil: Soil, wheel: Wheel, sinkage: float, slip: float, model: Model = "wong-reece") -> Contact:
    """Return the stresses under the rim at a sinkage in m and a slip from 0 to 1."""
    if not 0.0 <= slip <= 1.0:
        raise ValueError(f"slip {slip} is not between 0 and 1")
    return (_wong_reece if model == "wong-reece" else _linear)(soil, wheel, sinkage, slip)


def _load(under: Contact, wheel: Wheel) -> float:
    return (
        wheel.radius
        * wheel.width
        * under.integral(lambda sigma, tau, theta: sigma * math.cos(theta) + tau * math.sin(theta))
    )


def forces(soil: Soil, wheel: Wheel, sinkage: float, slip: float, model: Model = "wong-reece") -> Forces:
    """Integrate the forces at a sinkage in m and a slip."""
    under = contact(soil, wheel, sinkage, slip, model)
    area = wheel.radius * wheel.width
    torque = wheel.radius * area * under.integral(lambda _sigma, tau, _theta: tau)
    pull = area * under.integral(lambda sigma, tau, theta: tau * math.cos(theta) - sigma * math.sin(theta))
    return Forces(_load(under, wheel), torque, pull)


def sinkage_under(soil: Soil, wheel: Wheel, load: float, slip: float, model: Model = "wong-reece") -> float:
    """Solve for the sinkage in m at which the soil carries a load in N.

    Raises
    ------
    ValueError
        The soil does not carry it before the wheel has sunk to its axle.
    """

    def excess(sinkage: float) -> float:
        return _load(contact(soil, wheel, sinkage, slip, model), wheel) - load

    deepest = wheel.radius * (1.0 - math.cos(DEEPEST))
    if excess(deepest) < 0.0:
        raise ValueError(f"{soil.name} does not carry {load:.3g} N at slip {slip:.2f}")
    return float(brentq(excess, 1e-9, deepest, xtol=1e-15, rtol=1e-13))


def mean_stress(soil: Soil, wheel: Wheel, load: float, slip: float, model: Model = "wong-reece") -> float:
    """Average the normal stress, in Pa, over the contact under a load in N."""
    under = contact(soil, wheel, sinkage_under(soil, wheel, load, slip, model), slip, model)
    return under.integral(lambda sigma, _tau, _theta: sigma) / (under.entry - under.exit)
