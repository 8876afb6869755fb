"""Stresses along the rim against those of the simulator."""

from __future__ import annotations

import numpy as np
import pytest
from simulator import wheel as exact
from simulator.effects import base_contact
from simulator.soils import SANDY_LOAM

from terrain_cli.errors import ConfigurationError
from terrain_cli.mechanics.effect import Effect, Parameter
from terrain_cli.mechanics.stresses import stresses
from terrain_cli.mechanics.wheel_model import Model, WheelGeometry

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
SINKAGE, SLIP = np.array([0.012, 0.025]), np.array([0.2, 0.6])


def test_are_those_of_the_simulator():
    angle, normal, shear = stresses(Model(), GEOMETRY, {"sinkage": SINKAGE, "slip": SLIP}, VALUES)
    assert np.all(np.diff(angle, axis=0) > 0.0)
    for j, (z, i) in enumerate(zip(SINKAGE, SLIP, strict=True)):
        under = exact.contact(SOIL, WHEEL, z, i)
        expected = np.array([under.stresses(theta) for theta in angle[:, j]])
        np.testing.assert_allclose(normal[:, j], expected[:, 0], rtol=1e-9, atol=1e-6)
        np.testing.assert_allclose(shear[:, j], expected[:, 1], rtol=1e-9, atol=1e-6)


def test_reach_from_the_exit_to_the_entry_angle():
    angle, *_ = stresses(Model(), GEOMETRY, {"sinkage": SINKAGE, "slip": SLIP}, VALUES)
    entry = np.arccos(1.0 - SINKAGE / WHEEL.radius)
    np.testing.assert_allclose(angle[-1], entry, rtol=0.01)
    np.testing.assert_allclose(angle[0], 0.0, atol=0.01)


def test_show_what_effects_do():
    half = Effect(
        id="half-strength",
        title="The shear stress is halved",
        kind="stress",
        parameters=(Parameter("share", "1", 1.0, 0.5),),
        laws={"shear_stress": lambda q: q["shear_stress"] * q["share"]},
    )
    channels = {"sinkage": SINKAGE, "slip": SLIP}
    _, normal, shear = stresses(Model(), GEOMETRY, channels, VALUES)
    _, same, halved = stresses(
        Model(effects=(half,)), GEOMETRY, channels, {**VALUES, "half-strength.share": 0.5}
    )
    np.testing.assert_allclose(halved, 0.5 * shear)
    np.testing.assert_allclose(same, normal)


def test_more_samples_than_the_model_takes_at_once():
    n = 2500
    found = stresses(
        Model(), GEOMETRY, {"sinkage": np.full(n, 0.012), "slip": np.linspace(0.1, 0.9, n)}, VALUES
    )
    assert {part.shape for part in found} == {(80, n)}


def test_the_linear_base_has_none():
    with pytest.raises(ConfigurationError, match="linear"):
        stresses(Model("linear"), GEOMETRY, {"sinkage": SINKAGE, "slip": SLIP, "load": SLIP}, VALUES)
