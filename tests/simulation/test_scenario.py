"""Published soils, and those of a user."""

from __future__ import annotations

import math

import pytest
from simulator.soils import SOILS as INDEPENDENT

from terrain_cli.errors import ConfigurationError
from terrain_cli.simulation.scenario import SOILS, find, soils_rule

#: The same soils under the names that another table has for them.
OTHER_NAMES = {
    "clayey-loam": "North Gower clayey loam",
    "lete-sand": "LETE sand",
    "rubicon-sandy-loam": "Rubicon sandy loam",
}
OWN = {"cohesion": 500.0, "phi_deg": 35.0, "shear_modulus": 0.01, "sinkage_exponent": 1.0, "stiffness": 1e6}


@pytest.mark.parametrize("name", SOILS)
def test_published_values(name):
    soil, other = SOILS[name], INDEPENDENT[OTHER_NAMES.get(name, name.replace("-", " "))]
    values = soil.values(0.1)
    assert values["cohesion"] == pytest.approx(other.cohesion)
    assert values["tan_phi"] == pytest.approx(other.tan_phi)
    assert values["stiffness"] == pytest.approx(other.stiffness(0.1))
    assert values["sinkage_exponent"] == other.exponent
    assert values["shear_modulus"] == other.shear_modulus
    assert "Wong" in soil.reference


def test_of_a_user():
    soil = soils_rule({"mine": OWN}, "f: soils")["mine"]
    assert math.degrees(math.atan(soil.tan_phi)) == pytest.approx(35.0)
    assert soil.values(0.2)["stiffness"] == 1e6
    bekker = {**OWN, "cohesive_modulus": 1e4, "frictional_modulus": 2e6}
    del bekker["stiffness"]
    assert soils_rule({"mine": bekker}, "f: soils")["mine"].values(0.1)["stiffness"] == pytest.approx(2.1e6)
    assert find("mine", {"mine": soil}, "f: soil") is soil
    assert find("snow", {"mine": soil}, "f: soil") is SOILS["snow"]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"cohesion": -1.0}, r"f: soils\.mine\.cohesion: must be a cohesion in Pa, at least 0, not -1\.0"),
        ({"phi_dg": 3.0}, r"f: soils\.mine\.phi_dg: unknown key; did you mean phi_deg\?"),
        ({"tan_phi": 0.5}, "give one of tan_phi and phi_deg"),
        ({"frictional_modulus": 1e6}, "give stiffness, or cohesive_modulus and frictional_modulus"),
        ({"stiffness": None}, "stiffness"),
        ({"shear_modulus": None}, "shear_modulus is missing"),
    ],
)
def test_wrong(change, message):
    given = {key: value for key, value in (OWN | change).items() if value is not None}
    with pytest.raises(ConfigurationError, match=message):
        soils_rule({"mine": given}, "f: soils")


def test_unknown_names_the_nearest():
    with pytest.raises(ConfigurationError, match="no soil 'dry-snad'; did you mean dry-sand") as error:
        find("dry-snad", {}, "f: soil")
    assert "clayey-soil" in error.value.hint
