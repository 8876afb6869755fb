"""Soils with published parameters."""

from __future__ import annotations

import math
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Soil:
    """What a soil is to a rigid wheel.

    Parameters
    ----------
    name : str
    cohesion : float
        c in Pa.
    friction_angle : float
        φ in rad.
    shear_modulus : float
        k of Janosi and Hanamoto in m.
    cohesive_modulus, frictional_modulus, exponent : float
        Bekker's kc in N/m^(n+1), kφ in N/m^(n+2), and n.
    c1, c2 : float
        Angle of maximum stress: θm = (c1 + c2 i) θ1.
    exit_ratio : float
        Contact behind the axle: θ2 = −exit_ratio · θ1.
    """

    name: str
    cohesion: float
    friction_angle: float
    shear_modulus: float
    cohesive_modulus: float
    frictional_modulus: float
    exponent: float
    c1: float = 0.43
    c2: float = 0.32
    exit_ratio: float = 0.0

    @property
    def tan_phi(self) -> float:
        return math.tan(self.friction_angle)

    def stiffness(self, width: float) -> float:
        """Bekker's kc/b + kφ in N/m^(n+2)."""
        return self.cohesive_modulus / width + self.frictional_modulus

    def strength(self, stress: float) -> float:
        """Mohr–Coulomb shear strength in Pa under a normal stress in Pa."""
        return self.cohesion + stress * self.tan_phi


#: θm = (c1 + c2 i) θ1 of Wong and Reece 1967.
LOOSE, COMPACT = (0.18, 0.32), (0.43, 0.32)


def _soil(
    name: str, *, n: float, kc: float, kphi: float, c: float, phi: float, peak: tuple[float, float] = COMPACT
) -> Soil:
    return Soil(name, c * 1e3, math.radians(phi), 0.018, kc * 1e3, kphi * 1e3, n, *peak)


# n, kc in kN/m^(n+1), kφ in kN/m^(n+2), c in kPa, φ in degrees: Wong, Theory of Ground Vehicles,
# table of terrain values; the lunar soil: Wong, Terramechanics and Off-Road Vehicle Engineering.
# One k for all, 18 mm, within the 10–25 mm that Wong gives for sand: a rover file has room for one.
DRY_SAND = _soil("dry sand", n=1.1, kc=0.99, kphi=1528.43, c=1.04, phi=28.0, peak=LOOSE)
LETE_SAND = _soil("LETE sand", n=0.79, kc=102.0, kphi=5301.0, c=1.3, phi=31.1)
SANDY_LOAM = _soil("sandy loam", n=0.7, kc=5.27, kphi=1515.04, c=1.72, phi=29.0)
UPLAND_SANDY_LOAM = _soil("upland sandy loam", n=1.1, kc=74.6, kphi=2080.0, c=3.3, phi=33.7)
RUBICON_SANDY_LOAM = _soil("Rubicon sandy loam", n=0.66, kc=6.9, kphi=752.0, c=3.7, phi=29.8)
NORTH_GOWER_CLAYEY_LOAM = _soil("North Gower clayey loam", n=0.73, kc=41.6, kphi=2471.0, c=6.1, phi=26.6)
CLAYEY_SOIL = _soil("clayey soil", n=0.5, kc=13.19, kphi=692.15, c=4.14, phi=13.0)
WET_CLAYEY_SOIL = _soil("wet clayey soil", n=0.7, kc=16.03, kphi=1262.53, c=2.07, phi=10.0)
#: Carries some 10 N on a rover's wheel before that sinks to its axle.
SNOW = _soil("snow", n=1.6, kc=4.37, kphi=196.72, c=1.03, phi=19.7)
LUNAR_SOIL = _soil("lunar soil", n=1.0, kc=1.4, kphi=820.0, c=0.17, phi=35.0)

SOILS = {
    soil.name: soil
    for soil in (
        DRY_SAND,
        LETE_SAND,
        SANDY_LOAM,
        UPLAND_SANDY_LOAM,
        RUBICON_SANDY_LOAM,
        NORTH_GOWER_CLAYEY_LOAM,
        CLAYEY_SOIL,
        WET_CLAYEY_SOIL,
        SNOW,
        LUNAR_SOIL,
    )
}
