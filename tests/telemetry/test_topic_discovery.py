from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from rosbags.typesys import Stores, get_typestore

from terrain_cli.telemetry import topic_discovery
from terrain_cli.vocabulary import units
from terrain_cli.vocabulary.channels import CHANNELS

HALF = math.sqrt(0.5)
angles = st.floats(-1.5, 1.5)


@pytest.mark.parametrize(
    ("quaternion", "pitch", "roll"),
    [
        ((0.0, 0.0, 0.0, 1.0), 0.0, 0.0),
        # 30° about y (to the left) brings the nose down.
        ((0.0, math.sin(math.pi / 12), 0.0, math.cos(math.pi / 12)), -math.pi / 6, 0.0),
        # 30° about x (forward) brings the left side up.
        ((math.sin(math.pi / 12), 0.0, 0.0, math.cos(math.pi / 12)), 0.0, math.pi / 6),
        # Turned on the spot it stays level.
        ((0.0, 0.0, HALF, HALF), 0.0, 0.0),
    ],
)
def test_attitude_by_hand(quaternion, pitch, roll):
    x, y, z, w = (np.array([value]) for value in quaternion)
    assert topic_discovery.pitch(x, y, z, w)[0] == pytest.approx(pitch, abs=1e-12)
    assert topic_discovery.roll(x, y, z, w)[0] == pytest.approx(roll, abs=1e-12)


@given(st.floats(-3.1, 3.1), angles, angles)
def test_attitude_of_yaw_pitch_and_roll_in_turn(yaw, pitch, roll):
    """Compare with the axes of the body, turned about z, y and x."""
    forward = [math.cos(yaw) * math.cos(pitch), math.sin(yaw) * math.cos(pitch), math.sin(pitch)]
    cy, sy = math.cos(yaw / 2), math.sin(yaw / 2)
    cp, sp = math.cos(-pitch / 2), math.sin(-pitch / 2)
    cr, sr = math.cos(roll / 2), math.sin(roll / 2)
    w = cr * cp * cy + sr * sp * sy
    x = sr * cp * cy - cr * sp * sy
    y = cr * sp * cy + sr * cp * sy
    z = cr * cp * sy - sr * sp * cy
    # The nose is where the quaternion turns x to.
    np.testing.assert_allclose(
        [1 - 2 * (y * y + z * z), 2 * (x * y + w * z), 2 * (x * z - w * y)], forward, atol=1e-12
    )
    columns = [np.array([value]) for value in (x, y, z, w)]
    assert topic_discovery.pitch(*columns)[0] == pytest.approx(pitch, abs=1e-6)
    assert topic_discovery.roll(*columns)[0] == pytest.approx(roll, abs=1e-6)


def fields_of(store, name, prefix=""):
    for member, (kind, rest) in store.fielddefs[name][1]:
        if kind.name == "NAME" and not rest.startswith("builtin_interfaces"):
            yield from fields_of(store, rest, f"{prefix}{member}.")
        else:
            yield prefix + member


@pytest.mark.parametrize("version", [Stores.ROS1_NOETIC, Stores.ROS2_HUMBLE])
def test_every_field_taken_for_granted_is_in_its_message(version):
    store = get_typestore(version)
    types = [name for name in store.fielddefs if name in topic_discovery.MEANINGS]
    assert len(types) == 5
    for name in types:
        fields = set(fields_of(store, name))
        for meaning in topic_discovery.MEANINGS[name]:
            assert set(meaning.fields) <= fields
            assert meaning.channel in CHANNELS
            symbol = topic_discovery.unit_symbol(name, meaning.fields[0])
            # Either the message fixes the unit, or the function gives radians.
            assert (meaning.combine is None) == (symbol is not None)
            if symbol:
                assert units.parse(symbol, CHANNELS[meaning.channel].dimension)


@pytest.mark.parametrize(
    ("kind", "field", "unit"),
    [
        ("sensor_msgs/msg/JointState", "velocity[wheel_fl]", "rad/s"),
        ("sensor_msgs/msg/JointState", "effort[wheel_fl]", None),
        ("geometry_msgs/msg/WrenchStamped", "wrench.torque.y", "N m"),
        ("geometry_msgs/msg/TwistStamped", "twist.linear.x", "m/s"),
        ("sensor_msgs/msg/Temperature", "temperature", "°C"),
        ("sensor_msgs/msg/Temperature", "variance", None),
        ("std_msgs/msg/Float64", "data", None),
        ("my_msgs/msg/Imu", "angular_velocity.z", None),
    ],
)
def test_units_that_messages_fix(kind, field, unit):
    assert topic_discovery.unit_symbol(kind, field) == unit


def test_what_ros_brings():
    assert topic_discovery.is_standard("nav_msgs/msg/Odometry")
    assert not topic_discovery.is_standard("rover_nav_msgs/msg/Odometry")
