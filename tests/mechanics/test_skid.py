"""A wheel that skids: j = R (θ1 − θ) − V/ω (sin θ1 − sin θ) with V/(rω) = 1/(1 + i), against the wheel."""

from __future__ import annotations

import numpy as np
import pytest
from simulator import SNOW, SOILS, Wheel
from simulator import wheel as exact
from simulator.effects import base_contact

from terrain_cli.mechanics.wheel_model import Model, WheelGeometry, predict

WHEEL = Wheel(radius=0.1, width=0.1)
GEOMETRY = WheelGeometry(WHEEL.radius, WHEEL.width)
SLIP = np.array([-0.95, -0.7, -0.4, -0.2, -0.1, -0.05, -0.01])
CARRYING = [soil for soil in SOILS.values() if soil is not SNOW]


def values_of(soil):
    return {
        "cohesion": soil.cohesion,
        "tan_phi": soil.tan_phi,
        "shear_modulus": soil.shear_modulus,
        "stiffness": soil.stiffness(WHEEL.width),
        "sinkage_exponent": soil.exponent,
    }


def truth(soil, sinkage, base="wong-reece"):
    def no_effect(ground, stage):
        """Without laws the wheel refuses to skid."""

    found = [exact.forces(base_contact(soil), WHEEL, sinkage, i, base, no_effect) for i in SLIP]
    return np.array([[one.load, one.torque, one.pull] for one in found]).T


@pytest.mark.parametrize("soil", CARRYING, ids=lambda soil: soil.name)
@pytest.mark.parametrize("sinkage", [0.002, 0.01, 0.03])
def test_forces_are_those_of_the_wheel(soil, sinkage):
    load, torque, pull = truth(soil, sinkage)
    channels = {"sinkage": np.full(len(SLIP), sinkage), "slip": SLIP}
    # Where the shear turns round its slope has a kink: nodes without end follow it, few nearly do.
    for order, allowed in ((150, 1e-6), (None, 1e-5)):
        found = predict(Model(), GEOMETRY, channels, values_of(soil), order=order)
        np.testing.assert_allclose(found.load, load, rtol=allowed)
        np.testing.assert_allclose(found.torque, torque, atol=allowed * load.max() * WHEEL.radius)
        np.testing.assert_allclose(found.drawbar_pull, pull, atol=allowed * load.max())
    assert torque[0] < 0.0


@pytest.mark.parametrize("soil", CARRYING, ids=lambda soil: soil.name)
def test_triangular_stresses_are_those_of_the_wheel(soil):
    load, torque, pull = truth(soil, 0.02, "linear")
    channels = {"sinkage": np.full(len(SLIP), 0.02), "slip": SLIP, "load": load}
    found = predict(Model("linear"), GEOMETRY, channels, values_of(soil))
    np.testing.assert_allclose(found.torque, torque, rtol=1e-9)
    np.testing.assert_allclose(found.drawbar_pull, pull, atol=1e-9 * load.max())
