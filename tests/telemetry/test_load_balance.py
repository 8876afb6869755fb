"""The loads of the wheels on flat ground and on slopes, against balances done by hand.

Axes are x forward, y left, z up. On a slope with tan θ / cos ρ = a and tan ρ = b every contact
force is N (a, b, 1), so by hand all lengths are taken at ξ = x − a z and η = y − b z, and loads
in shares of G, the force normal to the ground.
"""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from terrain_cli.errors import ConfigurationError
from terrain_cli.rover import Vehicle
from terrain_cli.telemetry.derived_channels import wheel_loads

#: front left, rear left, front right, rear right
FOUR = np.array([[0.5, 0.4, 0.0], [-0.5, 0.4, 0.0], [0.5, -0.4, 0.0], [-0.5, -0.4, 0.0]])
#: front, middle, rear of the left, then of the right
SIX = np.array([[x, y, 0.0] for y in (0.4, -0.4) for x in (0.6, 0.0, -0.6)])


def vehicle(suspension="rigid", centre=(0.0, 0.0, 0.45), rocker=None, bogie=None):
    return Vehicle(
        mass=40.0,
        centre_of_mass=centre,
        gravity=10.0,
        suspension=suspension,
        rocker_pivot=rocker,
        bogie_pivot=bogie,
    )


def attitude(a, b):
    """Return pitch and roll with tan θ / cos ρ = a and tan ρ = b, and the shares' G of m g = 400 N."""
    roll = math.atan(b)
    pitch = math.atan(a * math.cos(roll))
    return pitch, roll, 400.0 * math.cos(pitch) * math.cos(roll)


def shares(of, positions, a=0.0, b=0.0):
    pitch, roll, normal = attitude(a, b)
    return wheel_loads([pitch], [roll], of, positions)[0] / normal


SUSPENSIONS = [
    (vehicle("rigid"), FOUR),
    (vehicle("rigid"), SIX),
    (vehicle("rocker", rocker=(0.1, 0.25)), FOUR),
    (vehicle("rocker-bogie", rocker=(0.2, 0.3), bogie=(-0.3, 0.2)), SIX),
]


@pytest.mark.parametrize(("of", "positions"), SUSPENSIONS)
def test_on_the_flat_a_symmetric_rover_weighs_the_same_on_every_wheel(of, positions):
    np.testing.assert_allclose(wheel_loads([0.0], [0.0], of, positions), 400.0 / len(positions), rtol=1e-12)


def test_rigid_four_wheels_up_a_slope():
    # ξc = −0.25 · 0.3 = −0.075; front − rear = −0.075/0.5 = −0.15: front 0.425, rear 0.575.
    expected = [0.2125, 0.2875, 0.2125, 0.2875]
    np.testing.assert_allclose(shares(vehicle(centre=(0, 0, 0.3)), FOUR, a=0.25), expected, rtol=1e-12)
    # in newtons: tan θ = 0.25, cos θ = 0.9701425, G = 388.0570 N
    loads = wheel_loads([math.atan(0.25)], [0.0], vehicle(centre=(0, 0, 0.3)), FOUR)
    np.testing.assert_allclose(loads, [[82.4621, 111.5664, 82.4621, 111.5664]], rtol=1e-6)


def test_rigid_four_wheels_with_the_left_side_up():
    # ηc = −0.2 · 0.3 = −0.06; left − right = −0.06/0.4 = −0.15: left 0.425, right 0.575.
    expected = [0.2125, 0.2125, 0.2875, 0.2875]
    np.testing.assert_allclose(shares(vehicle(centre=(0, 0, 0.3)), FOUR, b=0.2), expected, rtol=1e-12)


def test_rigid_six_wheels_on_equal_springs():
    # Loads 1/6 (1 + x xc / mean x²) with mean x² = 0.24 and xc = 0.1: front 1.25/6, middle 1/6, rear 0.75/6.
    expected = np.array([1.25, 1.0, 0.75, 1.25, 1.0, 0.75]) / 6.0
    np.testing.assert_allclose(shares(vehicle(centre=(0.1, 0, 0.4)), SIX), expected, rtol=1e-12)


def test_rigid_loads_are_those_of_least_norm():
    pitch, roll, normal = attitude(0.2, -0.1)
    of = vehicle(centre=(0.1, -0.05, 0.4))
    rows = np.vstack([np.ones(6), SIX[:, 0], SIX[:, 1]])
    right = [normal, normal * (0.1 - 0.2 * 0.4), normal * (-0.05 + 0.1 * 0.4)]
    least, *_ = np.linalg.lstsq(rows, right, rcond=None)
    np.testing.assert_allclose(wheel_loads([pitch], [roll], of, SIX)[0], least, rtol=1e-9)


def test_rocker_with_its_centre_of_mass_aside():
    # xc = 0.1, yc = 0.1: left 0.5 + 0.1/0.8 = 0.625, right 0.375. Each rocker has half of the body's
    # moment about the pivot at x = 0.2, (0.1 − 0.2)/2 = −0.05: 0.3 F − 0.7 R = −0.05, so
    # F = 0.7 · 0.625 − 0.05 = 0.3875, R = 0.2375; F = 0.7 · 0.375 − 0.05 = 0.2125, R = 0.1625.
    of = vehicle("rocker", centre=(0.1, 0.1, 0.45), rocker=(0.2, 0.25))
    np.testing.assert_allclose(shares(of, FOUR), [0.3875, 0.2375, 0.2125, 0.1625], rtol=1e-12)


def test_rocker_across_a_slope():
    # a = 0.2, b = 0.25: ξp = 0.2 − 0.2 · 0.25 = 0.15, ξc = −0.2 · 0.45 = −0.09, ηc = −0.25 · 0.45 = −0.1125.
    # Left 0.5 − 0.1125/0.8 = 0.359375, right 0.640625; moment of each side (−0.09 − 0.15)/2 = −0.12:
    # 0.35 F − 0.65 R = −0.12, so F = 0.65 · 0.359375 − 0.12, and F = 0.65 · 0.640625 − 0.12.
    of = vehicle("rocker", rocker=(0.2, 0.25))
    expected = [0.11359375, 0.24578125, 0.29640625, 0.34421875]
    np.testing.assert_allclose(shares(of, FOUR, a=0.2, b=0.25), expected, rtol=1e-12)


def test_rocker_bogie_up_a_slope():
    # a = 0.5: the bogie's pivot (−0.3, 0.2) is at ξ = −0.4, ξc = −0.5 · 0.4 = −0.2. With F in front and
    # B on the bogie of one side, F + B = 0.5 and 0.6 F − 0.4 B = −0.2 · 0.5: F = 0.1, B = 0.4. On the
    # bogie −0.6 R = −0.4 B: R = 4/15, M = 2/15.
    of = vehicle("rocker-bogie", centre=(0, 0, 0.4), rocker=(0.2, 0.3), bogie=(-0.3, 0.2))
    np.testing.assert_allclose(shares(of, SIX, a=0.5), [0.1, 2 / 15, 4 / 15] * 2, rtol=1e-12)


def test_rocker_bogie_with_the_bogie_in_front():
    # Pivot at x = 0.2 between front and middle: 0.4 F = 0.2 M; the centre asks F = R: 1/4, 1/2, 1/4.
    of = vehicle("rocker-bogie", rocker=(-0.2, 0.3), bogie=(0.2, 0.0))
    np.testing.assert_allclose(shares(of, SIX), [0.125, 0.25, 0.125] * 2, rtol=1e-12)


def test_rocker_bogie_across_a_slope():
    # b = 0.25: ηc = −0.1, left 0.5 − 0.1/0.8 = 0.375, right 0.625. With the rocker's pivot at x = 0.3 and
    # ξc = 0 each side has the moment −0.15 about it: 0.3 F − 0.6 B = −0.15. F = (0.6 S − 0.15)/0.9 with
    # S the side: left 1/12, B = 7/24; right 1/4, B = 3/8. Middle and rear share the bogie.
    of = vehicle("rocker-bogie", centre=(0, 0, 0.4), rocker=(0.3, 0.3), bogie=(-0.3, 0.2))
    expected = [1 / 12, 7 / 48, 7 / 48, 1 / 4, 3 / 16, 3 / 16]
    np.testing.assert_allclose(shares(of, SIX, b=0.25), expected, rtol=1e-12)


def test_a_lifted_wheel_has_a_negative_load():
    # ξc = −1.2 · 0.45 = −0.54, behind the rear axle at −0.5: front 0.5 − 0.54 = −0.04.
    expected = [-0.02, 0.52, -0.02, 0.52]
    np.testing.assert_allclose(shares(vehicle(), FOUR, a=1.2), expected, rtol=1e-9)


angles = st.floats(-0.5, 0.5)
offsets = st.floats(-0.1, 0.1)


@given(
    angles,
    angles,
    st.tuples(offsets, offsets, st.floats(0.2, 0.6)),
    st.lists(offsets, min_size=18, max_size=18),
)
@pytest.mark.parametrize("kind", ["rigid", "rocker", "rocker-bogie"])
def test_forces_and_moments_balance(kind, pitch, roll, centre, shifts):
    """The whole vectors, of gravity at the centre of mass and of every contact, on uneven wheels."""
    positions = (FOUR if kind == "rocker" else SIX).copy()
    positions += np.reshape(shifts, (6, 3))[: len(positions)]
    pivots = {"rigid": {}, "rocker": {"rocker": (0.1, 0.25)}}.get(
        kind, {"rocker": (0.2, 0.3), "bogie": (-0.3, 0.2)}
    )
    loads = wheel_loads([pitch], [roll], vehicle(kind, centre, **pivots), positions)[0]
    gravity = -400.0 * np.array(
        [math.sin(pitch), math.cos(pitch) * math.sin(roll), math.cos(pitch) * math.cos(roll)]
    )
    contacts = loads[:, None] * (gravity / gravity[2])
    np.testing.assert_allclose(contacts.sum(axis=0), -gravity, rtol=1e-9, atol=1e-9)
    moment = np.cross(positions, contacts).sum(axis=0) + np.cross(centre, gravity)
    np.testing.assert_allclose(moment[:2], 0.0, atol=1e-9)
    if kind == "rigid":
        return
    about_rocker = np.cross(positions - [pivots["rocker"][0], 0.0, pivots["rocker"][1]], contacts)[:, 1]
    half = len(positions) // 2
    assert about_rocker[:half].sum() == pytest.approx(about_rocker[half:].sum(), abs=1e-9)
    if kind == "rocker-bogie":
        about_bogie = np.cross(positions - [-0.3, 0.0, 0.2], contacts)[:, 1]
        assert about_bogie[[1, 2]].sum() == pytest.approx(0.0, abs=1e-9)
        assert about_bogie[[4, 5]].sum() == pytest.approx(0.0, abs=1e-9)


def test_the_order_of_the_wheels_does_not_matter():
    of = vehicle("rocker-bogie", (0.05, 0.02, 0.4), (0.2, 0.3), (-0.3, 0.2))
    order = [4, 0, 5, 2, 1, 3]
    loads = wheel_loads([0.2], [0.1], of, SIX)
    np.testing.assert_allclose(wheel_loads([0.2], [0.1], of, SIX[order]), loads[:, order], rtol=1e-12)


@pytest.mark.parametrize(("of", "positions"), SUSPENSIONS)
def test_unknown_attitudes_have_no_loads_and_long_runs_are_as_short_ones(of, positions):
    pitch = np.resize([0.1, np.nan, -0.2, np.inf, 0.3], 20_000)
    roll = np.resize([0.0, 0.1, np.nan, 0.2], 20_000)
    loads = wheel_loads(pitch, roll, of, positions)
    known = np.isfinite(pitch) & np.isfinite(roll)
    assert np.array_equal(np.isfinite(loads).all(axis=1), known)
    assert np.array_equal(np.isnan(loads).all(axis=1), ~known)
    np.testing.assert_allclose(loads[12_000:12_020], wheel_loads(pitch[:20], roll[:20], of, positions))


@pytest.mark.parametrize(
    ("of", "positions", "message"),
    [
        (vehicle(), FOUR[:2], "2 wheels are too few"),
        (vehicle(), FOUR[[0, 1, 0, 1]], "do not carry a rigid suspension"),
        (
            vehicle("rocker", rocker=(0.0, 0.2)),
            SIX,
            "has 2 wheels on each side, not 3 on the left and 3 on the right",
        ),
        (vehicle("rocker", rocker=(0.0, 0.2)), FOUR[[0, 0, 2, 2]], "do not carry a rocker suspension"),
        (
            vehicle("rocker-bogie", rocker=(0.0, 0.2), bogie=(0.1, 0.2)),
            FOUR,
            "has 3 wheels on each side, not 2 on the left and 2 on the right",
        ),
        (
            vehicle("rocker-bogie", rocker=(0.0, 0.2), bogie=(-0.7, 0.2)),
            SIX,
            "bogie_pivot at x = -0.7 m is not between two wheels of a side, which are at -0.6, 0.0 and 0.6 m",
        ),
    ],
)
def test_a_suspension_that_does_not_fit_its_wheels(of, positions, message):
    with pytest.raises(ConfigurationError, match=message):
        wheel_loads([0.0], [0.0], of, positions)
