"""Soils to drive on: published ones, and those of a user."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from terrain_cli.errors import ConfigurationError, nearest
from terrain_cli.toml import strict

if TYPE_CHECKING:
    from collections.abc import Mapping

WONG = "Wong, Theory of Ground Vehicles, table of terrain values"
_LUNAR = "Wong, Terramechanics and Off-Road Vehicle Engineering, 2nd ed., 2010"


@dataclass(frozen=True, slots=True, kw_only=True)
class Soil:
    """What a soil is to a rigid wheel."""

    name: str
    cohesion: float  # c in Pa
    tan_phi: float  # Tangent of the internal friction angle φ
    shear_modulus: float  # k of Janosi and Hanamoto in m
    sinkage_exponent: float  # n of Bekker
    # cohesive_modulus, frictional_modulus: kc in Pa/m^(n−1) and kφ in Pa/m^n, of Bekker
    cohesive_modulus: float
    frictional_modulus: float
    reference: str = ""  # Where the values are from

    @property
    def friction_angle(self) -> float:
        """φ in rad."""
        return math.atan(self.tan_phi)

    def values(self, width: float) -> dict[str, float]:
        """Return the parameters of the model in SI units; the stiffness is kc/b + kφ, b the wheel's width."""
        return {
            "cohesion": self.cohesion,
            "tan_phi": self.tan_phi,
            "shear_modulus": self.shear_modulus,
            "stiffness": self.cohesive_modulus / width + self.frictional_modulus,
            "sinkage_exponent": self.sinkage_exponent,
        }


def _published(
    name: str, n: float, kc: float, kphi: float, c: float, phi: float, reference: str = WONG
) -> Soil:
    # Wong gives k of 10 to 25 mm for sands and less than that for clays; 18 mm serves all, since a
    # rover file has room for one.
    return Soil(
        name=name,
        cohesion=c * 1e3,
        tan_phi=math.tan(math.radians(phi)),
        shear_modulus=0.018,
        sinkage_exponent=n,
        cohesive_modulus=kc * 1e3,
        frictional_modulus=kphi * 1e3,
        reference=reference,
    )


#: By name. Arguments: n, kc in kN/m^(n+1), kφ in kN/m^(n+2), c in kPa, φ in degrees.
SOILS: dict[str, Soil] = {
    soil.name: soil
    for soil in (
        _published("dry-sand", 1.1, 0.99, 1528.43, 1.04, 28.0),
        _published("lete-sand", 0.79, 102.0, 5301.0, 1.3, 31.1),
        _published("sandy-loam", 0.7, 5.27, 1515.04, 1.72, 29.0),
        _published("upland-sandy-loam", 1.1, 74.6, 2080.0, 3.3, 33.7),
        _published("rubicon-sandy-loam", 0.66, 6.9, 752.0, 3.7, 29.8),
        _published("clayey-loam", 0.73, 41.6, 2471.0, 6.1, 26.6),
        _published("clayey-soil", 0.5, 13.19, 692.15, 4.14, 13.0),
        _published("wet-clayey-soil", 0.7, 16.03, 1262.53, 2.07, 10.0),
        _published("snow", 1.6, 4.37, 196.72, 1.03, 19.7),
        _published("lunar-soil", 1.0, 1.4, 820.0, 0.17, 35.0, _LUNAR),
    )
}

_POSITIVE = "a positive number"
_SOIL = strict.table(
    {
        "cohesion": strict.number("a cohesion in Pa, at least 0", 0.0),
        "tan_phi": strict.number("a tangent of φ, from 0 to 2", 0.0, 2.0),
        "phi_deg": strict.number("an angle in degrees, from 0 to 60", 0.0, 60.0),
        "shear_modulus": strict.number("a positive length in m, at most 1", strict.ABOVE_ZERO, 1.0),
        "sinkage_exponent": strict.number("a number from 0.1 to 3", 0.1, 3.0),
        "stiffness": strict.number(_POSITIVE, strict.ABOVE_ZERO),
        "cohesive_modulus": strict.number("a number, at least 0", 0.0),
        "frictional_modulus": strict.number(_POSITIVE, strict.ABOVE_ZERO),
    }
)


def soils_rule(value: Any, place: str) -> dict[str, Soil]:
    """Read the tables [soils.NAME] of a user."""
    return {name: _own(name, inner, where) for name, inner, where in strict.each(value, place)}


def _own(name: str, value: Any, place: str) -> Soil:
    given = _SOIL(value, place)
    strict.require(given, place, "cohesion", "shear_modulus", "sinkage_exponent")
    if ("tan_phi" in given) == ("phi_deg" in given):
        raise ConfigurationError(f"{place}: give one of tan_phi and phi_deg")
    bekker = {"cohesive_modulus", "frictional_modulus"} & given.keys()
    if ("stiffness" in given) == bool(bekker):
        raise ConfigurationError(f"{place}: give stiffness, or cohesive_modulus and frictional_modulus")
    if bekker:
        strict.require(given, place, "cohesive_modulus", "frictional_modulus")
    return Soil(
        name=name,
        cohesion=given["cohesion"],
        tan_phi=given["tan_phi"] if "tan_phi" in given else math.tan(math.radians(given["phi_deg"])),
        shear_modulus=given["shear_modulus"],
        sinkage_exponent=given["sinkage_exponent"],
        cohesive_modulus=given.get("cohesive_modulus", 0.0),
        frictional_modulus=given.get("frictional_modulus", given.get("stiffness", 0.0)),
    )


def find(name: str, own: Mapping[str, Soil], place: str) -> Soil:
    """Find a soil by its name; those of the user stand above the published ones."""
    known = {**SOILS, **own}
    if name not in known:
        raise ConfigurationError(
            f"{place}: no soil {name!r}{nearest(name, known)}", hint=f"known are {', '.join(known)}"
        )
    return known[name]
