from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import terrain_cli as terrain
from terrain_cli.rover.vehicle import Motor
from terrain_cli.telemetry import derived_channels

# A brushed motor: Kt = 0.03 N m/A at 25 °C, −0.1 %/K, gear 50:1 at 80 %, 0.2 A without load.
MOTOR = Motor(
    torque_constant=0.03,
    gear_ratio=50.0,
    efficiency=0.8,
    temperature_coefficient=-0.001,
    reference_temperature=25.0,
    no_load_current=0.2,
)


@pytest.mark.parametrize(
    ("omega", "velocity", "expected"),
    [
        # r = 0.125 m: at ω = 0.8 rad/s the rim moves at 0.1 m/s.
        (0.8, 0.08, 0.2),  # 1 − 0.08/0.1
        (0.8, 0.1, 0.0),
        (0.8, 0.0, 1.0),  # spins on the spot
        (0.8, 0.125, -0.2),  # skids: 0.1/0.125 − 1
        (0.8, -0.02, 1.2),  # slides back: 1 + 0.02/0.1
        (-0.8, -0.08, 0.2),
        (-0.8, -0.125, -0.2),
        (0.0, 0.0, math.nan),
        (0.0, 0.1, math.nan),
        (5e-4, 0.1, math.nan),
        (math.nan, 0.1, math.nan),
        (0.8, math.nan, math.nan),
    ],
)
def test_slip(omega, velocity, expected):
    assert derived_channels.slip([omega], [velocity], 0.125) == pytest.approx(
        [expected], abs=1e-15, nan_ok=True
    )


@given(st.floats(0.01, 10.0), st.floats(-2.0, 2.0))
def test_slip_is_the_same_in_reverse_and_never_below_minus_one(omega, velocity):
    forward = derived_channels.slip(omega, velocity, 0.1)
    assert forward == derived_channels.slip(-omega, -velocity, 0.1)
    assert forward >= -1.0


@given(st.floats(0.01, 10.0), st.floats(-0.99, 2.0), st.sampled_from([1.0, -1.0]))
def test_velocity_is_what_slip_was_made_of(omega, slip, direction):
    velocity = derived_channels.velocity(direction * omega, slip, 0.1)
    assert derived_channels.slip(direction * omega, velocity, 0.1) == pytest.approx(slip, abs=1e-12)


def test_velocity_of_no_possible_slip():
    assert np.isnan(derived_channels.velocity(np.ones(2), np.array([-1.0, -2.0]), 0.1)).all()


@pytest.mark.parametrize(
    ("current", "temperature", "omega", "expected"),
    [
        # 0.8 · 50 · 0.03 = 1.2 N m/A at 25 °C
        (2.2, None, None, 2.4),  # 1.2 · (2.2 − 0.2)
        (2.2, 25.0, 1.0, 2.4),
        (2.2, 75.0, 1.0, 2.28),  # 2.4 · (1 − 0.001 · 50)
        (2.2, -25.0, 1.0, 2.52),  # 2.4 · (1 + 0.001 · 50)
        (-2.2, None, None, -2.4),  # in reverse
        (-2.2, None, -1.0, -2.4),
        (0.1, None, None, 0.0),  # less than it needs without load
        (0.1, None, 1.0, -0.12),  # the soil drives: 1.2 · (0.1 − 0.2)
        (2.2, None, -1.0, 2.88),  # rolls back against the motor: 1.2 · (2.2 + 0.2)
        (2.2, math.nan, 1.0, math.nan),
    ],
)
def test_torque_from_current(current, temperature, omega, expected):
    torque = derived_channels.torque_from_current(
        np.array([current]), MOTOR, temperature=temperature, angular_velocity=omega
    )
    assert torque == pytest.approx([expected], rel=1e-12, abs=1e-15, nan_ok=True)


def test_a_wheel_stands_where_its_speed_is_noise():
    rng = np.random.default_rng(79_935_900)
    there = np.repeat([0.0, 2.0, 0.0, 2.0], 200)
    noisy = there + 0.01 * rng.standard_normal(len(there))
    assert np.array_equal(derived_channels.stands(noisy), there == 0.0)
    spiked = np.where(np.arange(len(there)) == 300, 65_535.0, noisy)
    assert np.array_equal(derived_channels.stands(spiked), there == 0.0)
    # One that creeps is told from 0, and so is one with a coarse encoder that drives all the time.
    creeping = np.repeat([0.05, 2.0], 200)
    assert not derived_channels.stands(creeping + 0.005 * rng.standard_normal(400)).any()
    assert not derived_channels.stands(2.0 + 0.6 * rng.standard_normal(400)).any()


def test_torque_of_a_bare_motor_is_its_constant_times_the_current():
    np.testing.assert_allclose(
        derived_channels.torque_from_current(
            np.array([1.0, -2.0]), Motor(torque_constant=0.03), temperature=np.array([20.0, 80.0])
        ),
        [0.03, -0.06],
    )


def test_wheel_velocity_inside_and_outside_of_a_curve():
    # v = 0.1 m/s, turning left at 0.05 rad/s: 0.4 m to the left, 0.1 − 0.02; to the right, 0.1 + 0.02.
    assert derived_channels.wheel_velocity(0.1, 0.05, 0.4) == pytest.approx(0.08)
    assert derived_channels.wheel_velocity(0.1, 0.05, -0.4) == pytest.approx(0.12)


def test_distance_from_velocity_is_the_trapezoidal_sum():
    time = [0.0, 1.0, 3.0, 3.0, 2.0, 4.0]
    velocity = [0.0, 0.2, -0.4, 0.4, 0.4, 0.4]
    # 0.1·1, 0.3·2, nothing while time stands or runs back, 0.4·2
    np.testing.assert_allclose(
        derived_channels.distance_from_velocity(time, velocity), [0, 0.1, 0.7, 0.7, 0.7, 1.5]
    )


def test_distance_stands_where_nothing_is_known():
    time = [0.0, 1.0, 2.0, 3.0, 60.0, 61.0]
    velocity = [np.nan, 0.1, np.nan, 0.3, 0.3, 0.3]
    # from 1 s to 3 s at (0.1 + 0.3)/2; the gap of 57 s counts only if it may
    np.testing.assert_allclose(
        derived_channels.distance_from_velocity(time, velocity, max_gap=5.0), [0, 0, 0, 0.4, 0.4, 0.7]
    )
    np.testing.assert_allclose(
        derived_channels.distance_from_velocity(time, velocity)[-1], 0.4 + 57 * 0.3 + 0.3
    )


def test_distance_along_a_track():
    x, y = [0.0, 3.0, np.nan, 3.0, 3.0], [0.0, 4.0, 9.0, 4.0, 5.0]
    np.testing.assert_allclose(derived_channels.distance_from_track(x, y), [0.0, 5.0, 5.0, 5.0, 6.0])


@pytest.mark.parametrize(
    "distance", [derived_channels.distance_from_velocity, derived_channels.distance_from_track]
)
def test_distance_of_next_to_nothing(distance):
    assert distance([], []).shape == (0,)
    assert list(distance([1.0], [1.0])) == [0.0]
    assert list(distance([np.nan, np.nan], [1.0, 1.0])) == [0.0, 0.0]


@given(st.lists(st.floats(-5.0, 5.0), min_size=2, max_size=30))
def test_distance_of_a_constant_speed_is_speed_times_time(velocity):
    time = np.arange(len(velocity)) * 0.1
    steady = np.full(len(velocity), velocity[0])
    np.testing.assert_allclose(
        derived_channels.distance_from_velocity(time, steady), abs(velocity[0]) * time, rtol=1e-9, atol=1e-12
    )
    assert np.all(np.diff(derived_channels.distance_from_velocity(time, velocity)) >= 0.0)


@pytest.mark.parametrize(
    ("column", "stated", "gain"),
    [("motor_current", "", 0.1), ("motor_current", ", gain = 0.03", 0.03), ("torque", "", 0.0)],
)
def test_the_gain_of_a_torque_from_a_current_is_known_to_a_tenth(rover_of, column, stated, gain):
    import pandas as pd

    rover = rover_of(
        "[wheel]\nradius = 0.1\nwidth = 0.1\n[soil]\nshear_modulus = 0.02\n[motor]\ntorque_constant = 1.0\n"
        f"[noise]\ntorque = {{ relative = 0.02{stated} }}\n"
    )
    table = pd.DataFrame({"time": np.arange(9.0), "load": 50.0, "sinkage": 0.01, "slip": 0.3, column: 2.0})
    (samples,) = terrain.from_frame(table, rover)
    assert samples.noise["torque"].gain == gain
    assert samples.noise["torque"].relative == 0.02
    assert any("torque from a current" in remark for remark in samples.remarks) == (gain == 0.1)
