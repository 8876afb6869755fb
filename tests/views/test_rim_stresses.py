"""Stresses along the rim at one moment against those of the simulator."""

from __future__ import annotations

import numpy as np
import pytest
from simulator import wheel as exact
from simulator.effects import base_contact
from simulator.soils import SANDY_LOAM

from terrain_cli.mechanics.effect import Effect, Parameter
from terrain_cli.mechanics.wheel_model import Model, WheelGeometry
from terrain_cli.views.shown_segments import Moment

WHEEL = exact.Wheel(radius=0.125, width=0.1)
SOIL = base_contact(SANDY_LOAM)
VALUES = {
    "cohesion": SOIL.cohesion,
    "tan_phi": SOIL.tan_phi,
    "shear_modulus": SOIL.shear_modulus,
    "stiffness": SOIL.stiffness(WHEEL.width),
    "sinkage_exponent": SOIL.exponent,
}
GEOMETRY = WheelGeometry(WHEEL.radius, WHEEL.width)
SINKAGE, SLIP = 0.025, 0.6
CHANNELS = {"sinkage": np.array([SINKAGE]), "slip": np.array([SLIP])}


@pytest.mark.parametrize(("sinkage", "slip"), [(0.012, 0.2), (SINKAGE, SLIP)])
def test_stresses_are_those_of_the_simulator(sinkage, slip):
    channels = {"sinkage": np.array([sinkage]), "slip": np.array([slip])}
    angle, normal, shear = Moment("", Model(), GEOMETRY, channels, VALUES).stresses
    assert np.all(np.diff(angle) > 0.0)
    under = exact.contact(SOIL, WHEEL, sinkage, slip)
    expected = np.array([under.stresses(theta) for theta in np.radians(angle)])
    np.testing.assert_allclose(1e3 * normal, expected[:, 0], rtol=1e-9, atol=1e-6)
    np.testing.assert_allclose(1e3 * shear, expected[:, 1], rtol=1e-9, atol=1e-6)


def test_stresses_reach_from_the_exit_to_the_entry_angle():
    angle, *_ = Moment("", Model(), GEOMETRY, CHANNELS, VALUES).stresses
    np.testing.assert_allclose(angle[-1], np.degrees(np.arccos(1.0 - SINKAGE / WHEEL.radius)), rtol=0.01)
    np.testing.assert_allclose(angle[0], 0.0, atol=0.5)


def test_stresses_show_what_effects_do():
    half = Effect(
        id="half-strength",
        title="The shear stress is halved",
        kind="stress",
        parameters=(Parameter("share", "1", 1.0, 0.5),),
        laws={"shear_stress": lambda q: q["shear_stress"] * q["share"]},
    )
    _, normal, shear = Moment("", Model(), GEOMETRY, CHANNELS, VALUES).stresses
    values = {**VALUES, "half-strength.share": 0.5}
    _, same, halved = Moment("", Model(effects=(half,)), GEOMETRY, CHANNELS, values).stresses
    np.testing.assert_allclose(halved, 0.5 * shear)
    np.testing.assert_allclose(same, normal)
