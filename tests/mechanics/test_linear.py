"""The linearised model against its printed equations and against integrated stresses."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from simulator import DRY_SAND, SANDY_LOAM, Wheel, forces

from terrain_cli.mechanics.linear import entry_angle, line_coordinates, sinkage_of, torque

GEOMETRY = {"radius": 0.125, "width": 0.1, "shear_modulus": 0.018}
WHEEL = Wheel(radius=0.125, width=0.1)


def printed(load, drive, sinkage, slip, radius, width, shear_modulus):
    """Return −κ1/κ4 and κ2/κ4 of equations [20] to [25], term by term."""
    th = math.acos(1.0 - sinkage / radius)
    path = th / 2.0 - (1.0 - slip) * (math.sin(th) - math.sin(th / 2.0))
    a = 1.0 - math.exp(-radius / shear_modulus * path)
    bracket = math.cos(th) - 2.0 * math.cos(th / 2.0) + 1.0
    k1 = a * (th**2 * load * radius + 4.0 * drive * math.sin(th) - 8.0 * drive * math.sin(th / 2.0))
    k2 = 4.0 * drive * bracket
    k4 = th * radius**2 * width * (bracket + 2.0 * a * math.cos(th) - 4.0 * a * math.cos(th / 2.0) + 2.0 * a)
    return -k1 / k4, k2 / k4


@pytest.mark.parametrize("sinkage", [0.001, 0.01, 0.04, 0.1])
@pytest.mark.parametrize("slip", [0.02, 0.3, 0.9])
@pytest.mark.parametrize(("load", "drive"), [(20.0, 0.2), (90.0, 4.0)])
def test_coordinates_are_those_of_the_printed_equations(load, drive, sinkage, slip):
    x, y = line_coordinates([load], [drive], [sinkage], [slip], **GEOMETRY)
    np.testing.assert_allclose((x[0], y[0]), printed(load, drive, sinkage, slip, **GEOMETRY), rtol=1e-10)


def integrated(soil, sinkages=(0.008, 0.02, 0.05), slips=(0.05, 0.3, 0.8)):
    """Return load, torque, sinkage and slip under the triangular stresses, integrated numerically."""
    rows = []
    for sinkage in sinkages:
        for slip in slips:
            force = forces(soil, WHEEL, sinkage, slip, "linear")
            rows.append((force.load, force.torque, sinkage, slip))
    return np.array(rows).T


def test_samples_of_a_frictional_soil_lie_on_its_line():
    soil = replace(DRY_SAND, cohesion=0.0)
    samples = integrated(soil)
    x, y = line_coordinates(*samples, **GEOMETRY)
    np.testing.assert_allclose(y, x * soil.tan_phi, rtol=1e-9)
    predicted = torque(samples[0], *samples[2:], 0.0, soil.tan_phi, **GEOMETRY)
    np.testing.assert_allclose(predicted, samples[1], rtol=1e-9)


def test_cohesion_is_off_the_line_by_the_dropped_term_alone():
    # With κ3 kept the samples obey y − x tan φ = c (1 + tan φ κ3/κ4): a share of c that does not depend on c.
    share = []
    for cohesion in (500.0, 5000.0):
        soil = replace(SANDY_LOAM, cohesion=cohesion)
        x, y = line_coordinates(*integrated(soil), **GEOMETRY)
        share.append((y - x * soil.tan_phi) / cohesion - 1.0)
    np.testing.assert_allclose(share[0], share[1], rtol=1e-6)
    assert np.abs(share).max() < 0.25


@given(
    load=st.floats(1.0, 500.0),
    sinkage=st.floats(1e-4, 0.12),
    slip=st.floats(0.0, 1.0),
    cohesion=st.floats(0.0, 2e4),
    tan_phi=st.floats(0.0, 1.5),
)
def test_torque_is_the_line_solved_for_the_torque(load, sinkage, slip, cohesion, tan_phi):
    drive = torque([load], [sinkage], [slip], cohesion, tan_phi, **GEOMETRY)
    x, y = line_coordinates([load], drive, [sinkage], [slip], **GEOMETRY)
    np.testing.assert_allclose(y, cohesion + x * tan_phi, rtol=1e-9, atol=1e-6)


@given(st.floats(1e-6, 0.25))
def test_entry_angle_and_sinkage_undo_each_other(sinkage):
    assert sinkage_of(entry_angle(sinkage, 0.125), 0.125) == pytest.approx(sinkage, rel=1e-12)


def test_entry_angle_of_a_wheel_sunk_to_its_axle():
    assert entry_angle(0.125, 0.125) == pytest.approx(math.pi / 2.0)


def test_long_arrays_are_sample_by_sample():
    rng = np.random.default_rng(0)
    size = 20_000
    columns = [rng.uniform(low, high, size) for low, high in ((20, 90), (1, 4), (0.005, 0.05), (0, 1))]
    x, y = line_coordinates(*columns, **GEOMETRY)
    rows = rng.integers(0, size, 50)
    for row in rows:
        one = line_coordinates(*(column[row : row + 1] for column in columns), **GEOMETRY)
        assert (x[row], y[row]) == (pytest.approx(one[0][0], rel=1e-15), pytest.approx(one[1][0], rel=1e-15))
