"""Bags of real robots, which are not in the repository."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from rosbags.highlevel import AnyReader

from formats.rosbag.bag_source import BagSource
from formats.table import LOG_TIME, STAMP, Labels

BAGS = Path(__file__).parents[2] / ".." / "shared" / "data" / "bags"
pytestmark = pytest.mark.skipif(not BAGS.is_dir(), reason="the measured bags are not here")


def peer(path, topic, take):
    """Read a topic with rosbags alone."""
    with AnyReader([path]) as reader:
        connections = [connection for connection in reader.connections if connection.topic == topic]
        return [
            (time, take(reader.deserialize(payload, connection.msgtype)))
            for connection, time, payload in reader.messages(connections)
        ]


def stamp(message):
    return message.header.stamp.sec * 10**9 + message.header.stamp.nanosec


def columns(opened, topic, fields):
    batches = list(opened.read(topic, fields, 1_000))
    assert len(batches) > 1 or topic == "/fix"
    return {name: np.concatenate([batch[name] for batch in batches]) for name in [*fields, LOG_TIME, STAMP]}


def test_husky():
    path = BAGS / "robot_localization_test1.bag"
    opened = BagSource(str(path), "ros1")
    streams = {stream.topic: stream for stream in opened.streams()}
    assert {topic: (stream.type, stream.count) for topic, stream in streams.items()} == {
        "/imu/data": ("sensor_msgs/msg/Imu", 11_865),
        "/husky_velocity_controller/odom": ("nav_msgs/msg/Odometry", 3_952),
        "/fix": ("sensor_msgs/msg/NavSatFix", 989),
    }
    odom = "/husky_velocity_controller/odom"
    got = columns(opened, odom, ["twist.twist.linear.x", "pose.covariance[35]"])
    wanted = peer(path, odom, lambda m: (m.twist.twist.linear.x, m.pose.covariance[35], stamp(m)))
    np.testing.assert_array_equal(got[LOG_TIME].astype(int), [time for time, _ in wanted])
    np.testing.assert_array_equal(got["twist.twist.linear.x"], [x for _, (x, _, _) in wanted])
    np.testing.assert_array_equal(got["pose.covariance[35]"], [x for _, (_, x, _) in wanted])
    np.testing.assert_array_equal(got[STAMP].astype(int), [x for _, (_, _, x) in wanted])
    assert (streams[odom].start, streams[odom].end) == (wanted[0][0], wanted[-1][0])

    got = columns(opened, "/imu/data", ["angular_velocity.z"])
    wanted = peer(path, "/imu/data", lambda m: m.angular_velocity.z)
    np.testing.assert_array_equal(got["angular_velocity.z"], [x for _, x in wanted])

    got = columns(opened, "/fix", ["latitude", "status.status", "position_covariance[8]"])
    wanted = peer(path, "/fix", lambda m: (m.latitude, m.status.status, m.position_covariance[8]))
    for i, name in enumerate(("latitude", "status.status", "position_covariance[8]")):
        np.testing.assert_array_equal(got[name], [values[i] for _, values in wanted])


def test_joint_states():
    path = BAGS / "plotjuggler_fake_joint_state.bag"
    opened = BagSource(str(path), "ros1")
    (stream,) = opened.streams()
    elements = {field.name: field.elements for field in stream.fields}
    assert elements["position"] == tuple(f"joint_{i}" for i in range(6))
    got = columns(opened, stream.topic, ["position[joint_3]", "velocity[5]"])
    wanted = peer(path, stream.topic, lambda m: (m.position[m.name.index("joint_3")], m.velocity[5]))
    np.testing.assert_array_equal(got["position[joint_3]"], [x for _, (x, _) in wanted])
    np.testing.assert_array_equal(got["velocity[5]"], [x for _, (_, x) in wanted])
    (names,) = opened.read(stream.topic, ["name[0]"])
    assert isinstance(names["name[0]"], Labels)
    assert names["name[0]"].names == ("joint_0",)


@pytest.mark.parametrize("share", [0.02, 0.4, 0.8, 0.99])
@pytest.mark.parametrize("name", ["robot_localization_test1.bag", "plotjuggler_fake_joint_state.bag"])
def test_cut_off(tmp_path, name, share):
    data = (BAGS / name).read_bytes()
    path = tmp_path / name
    path.write_bytes(data[: int(len(data) * share)])
    with pytest.raises(Exception, match="its index is missing") as caught:
        BagSource(str(path), "ros1")
    assert "rosbag reindex" in caught.value.hint
