"""Integrals over the contact against adaptive integration, their derivatives against differences."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from simulator import Soil, Wheel
from simulator import wheel as exact

from terrain_cli.mechanics.contact import NAMES, Contact, forces, order_for

WHEEL = Wheel(radius=0.1, width=0.1)


def draws(n, seed=0, *, steepest=1.396):
    """Draw contacts: soils that enclose published ones, any θ2 ≤ 0 < θ1 and θm between them, skidding too."""
    rng = np.random.default_rng(seed)
    entry = rng.uniform(0.05, steepest, n)
    leave = -rng.choice([0.0, 1.0], n) * rng.uniform(0.0, 0.6, n) * entry
    shared = rng.random(n)
    return Contact(
        entry_angle=entry,
        max_stress_angle=leave + rng.uniform(0.05, 0.95, n) * (entry - leave),
        exit_angle=leave,
        slip=rng.uniform(0.0, 1.0, n),
        cohesion=rng.uniform(0.5e3, 10e3, n),
        tan_phi=np.tan(np.radians(rng.uniform(15.0, 40.0, n))),
        shear_modulus=rng.uniform(0.01, 0.03, n),
        stiffness=rng.uniform(0.9e3, 15e3, n) / WHEEL.width + rng.uniform(0.5e6, 1.6e6, n),
        sinkage_exponent=rng.uniform(0.5, 1.2, n),
        radius=np.full(n, WHEEL.radius),
        shear_radius=WHEEL.radius * np.where(shared < 0.5, 1.0, 1.0 + 0.3 * shared),
    )


def adaptive(contact, j):
    """Integrate one contact with the simulator."""
    at = {name: float(getattr(contact, name)[j]) for name in NAMES}
    soil = Soil(
        "drawn",
        at["cohesion"],
        math.atan(at["tan_phi"]),
        at["shear_modulus"],
        0.0,
        at["stiffness"],
        at["sinkage_exponent"],
    )

    def laws(ground, phase):
        if phase == "numbers":
            ground.radius, ground.shear_radius = at["radius"], at["shear_radius"]
            ground.grip = 1.0 / (1.0 + at["slip"]) if at["slip"] < 0.0 else 1.0 - at["slip"]
        elif phase == "angles":
            ground.entry, ground.peak, ground.leave = (
                at[name] for name in ("entry_angle", "max_stress_angle", "exit_angle")
            )

    found = exact.forces(soil, WHEEL, 0.01, at["slip"], laws=laws)
    return np.array([found.load, found.torque, found.pull])


def moved(contact, name, step):
    return replace(contact, **{name: getattr(contact, name) + step})


def errors(found, truth):
    """Errors of W, T, DP as shares: of DP, which crosses zero, as a share of the load."""
    return np.abs(found - truth) / np.abs(np.array([truth[0], truth[1], truth[0]]))


def longest_arc(contact):
    """Return the longer arc as a multiple of the shear modulus: what decides how many nodes are enough."""
    front = contact.entry_angle - contact.max_stress_angle
    rear = contact.max_stress_angle - contact.exit_angle
    return np.maximum(front, rear) * contact.shear_radius / contact.shear_modulus


@pytest.mark.parametrize("reach", [4.0, 8.0, 20.0])
def test_integrals_are_right_to_a_hundred_millionth(reach):
    contact = draws(400)
    found, slopes = forces(contact, WHEEL.width, order=order_for(reach))
    assert found.shape == (3, 400)
    assert slopes == {}
    within = np.flatnonzero(longest_arc(contact) <= reach)[:100]
    assert len(within) > 80
    worst = max(errors(found[:, j], adaptive(contact, j)).max() for j in within)
    assert worst <= 1e-8


@pytest.mark.parametrize("exponent", [0.5, 0.8, 1.2])
@pytest.mark.parametrize("entry", [0.02, 0.3, 0.9, 1.396])
def test_integrals_hold_at_the_ends_of_the_ranges(exponent, entry):
    ends = replace(
        draws(8),
        entry_angle=np.full(8, entry),
        max_stress_angle=entry * np.array([0.1, 0.5, 0.9, 0.5, 0.1, 0.5, 0.9, 0.5]),
        exit_angle=-entry * np.array([0.0, 0.0, 0.0, 0.5, 0.5, 0.5, 0.0, 0.0]),
        slip=np.array([0.0, 0.0, 0.0, 0.0, 1.0, 1.0, 1.0, 1.0]),
        shear_modulus=np.array([0.01, 0.03] * 4),
        sinkage_exponent=np.full(8, exponent),
    )
    found, _ = forces(ends, WHEEL.width, order=18)
    for j in range(8):
        truth = adaptive(ends, j)
        # The torque at slip 0 is a small part of what the load brings: as a share of that.
        allowed = 1e-8 * np.array([truth[0], max(truth[1], 1e-3 * truth[0] * 0.1), truth[0]])
        assert np.all(np.abs(found[:, j] - truth) <= allowed)


def test_a_skidding_wheel_is_sheared_the_other_way():
    contact = replace(draws(20, seed=3), slip=np.linspace(-0.6, -0.05, 20))
    found, _ = forces(contact, WHEEL.width)
    for j in range(20):
        truth = adaptive(contact, j)
        # Where the shear turns round its slope has a kink, which nodes on whole arcs cannot follow.
        assert np.abs(found[:, j] - truth).max() <= 1e-4 * np.abs(truth).max()
    assert found[1].min() < 0.0


@pytest.mark.parametrize("name", NAMES)
def test_derivatives_are_those_of_the_truth(name):
    # Fourth-order differences of the adaptive integrals themselves.
    contact = draws(12, seed=1)
    contact = replace(contact, slip=np.clip(contact.slip, 0.02, 0.98))
    _, slopes = forces(contact, WHEEL.width, by=[name])
    assert list(slopes) == [name]
    step = 2e-3 * np.maximum(np.abs(getattr(contact, name)), 0.1 if name != "exit_angle" else 0.05)
    if name in {"shear_modulus", "radius", "shear_radius"}:
        step = 2e-3 * getattr(contact, name)
    for j in range(12):
        near, far = (
            (adaptive(moved(contact, name, m * step), j) - adaptive(moved(contact, name, -m * step), j))
            / (2 * m)
            for m in (1.0, 2.0)
        )
        truth = (4.0 * near - far) / (3.0 * step[j])
        load, torque, _ = adaptive(contact, j)
        scale = np.maximum(np.abs(truth), 1e-3 * np.array([load, torque, load]) / step[j])
        np.testing.assert_array_less(np.abs(slopes[name][:, j] - truth), 1e-6 * scale)


def test_derivatives_are_those_of_the_sums():
    # Of the quadrature, not of the integral: to rounding, which a complex step or differences
    # over small steps could not tell apart from its error.
    contact = draws(400, seed=2)
    values, slopes = forces(contact, WHEEL.width, by=NAMES)
    assert set(slopes) == set(NAMES)
    for name in NAMES:
        size = np.maximum(np.abs(getattr(contact, name)), 1e-2)
        step = 1e-3 * size
        terms = [
            (
                forces(moved(contact, name, m * step), WHEEL.width)[0]
                - forces(moved(contact, name, -m * step), WHEEL.width)[0]
            )
            / (2 * m * step)
            for m in (1.0, 2.0, 3.0)
        ]
        differences = 1.5 * terms[0] - 0.6 * terms[1] + 0.1 * terms[2]
        allowed = 2e-8 * (np.abs(differences) + np.abs(values[[0, 1, 0]]) / size)
        inside = np.ones(400, dtype=bool)
        if name == "exit_angle":
            inside = contact.max_stress_angle - contact.exit_angle > 10 * step
        if name == "slip":
            inside = contact.slip > 4 * step
        assert np.all(np.abs(slopes[name] - differences)[:, inside] <= allowed[:, inside]), name
