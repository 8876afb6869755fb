"""Bags that are written: what this program and rosbags read of them, and the same bytes each time."""

from __future__ import annotations

import os
import subprocess

import numpy as np
import pytest
from rosbags.highlevel import AnyReader
from rosbags.rosbag2 import Reader

from formats import CannotWriteError, open_source
from formats.output.bag_writer import Topic, write_bag

KINDS = {"ros1": "bag", "mcap": "mcap", "db3": "db3"}
#: A day after 2026 began, in ns.
T0 = 1_767_312_000_000_000_000
NUMBER = "test_msgs/msg/Number"
DEFINITION = "std_msgs/Header header\nfloat64 data\nstring[] words\nbool good\n"


def topics():
    times = T0 + np.arange(5, dtype=np.int64) * 100_000_000
    speeds = np.arange(10.0).reshape(5, 2)
    return [
        Topic(
            "/joints",
            "sensor_msgs/msg/JointState",
            times,
            {"name": ["a", "b"], "velocity": speeds, "effort": speeds + 0.5},
        ),
        Topic(
            "/number",
            NUMBER,
            times[::2] + 50,
            {"data": np.array([1.5, np.nan, -2.5]), "header.frame_id": "here", "words": ["x", "yz"]},
            DEFINITION,
        ),
        Topic(
            "/odom",
            "nav_msgs/msg/Odometry",
            times,
            {"pose.pose.position.x": np.arange(5.0), "pose.pose.orientation.w": 1.0},
        ),
    ]


@pytest.fixture(params=KINDS, ids=KINDS.get)
def bag(request, tmp_path):
    path = tmp_path / f"run.{KINDS[request.param]}"
    write_bag(topics(), str(path), request.param)
    return path


def column(path, topic, field):
    return np.concatenate([batch[field] for batch in open_source(str(path)).read(topic, [field])])


def test_reads_back(bag):
    assert column(bag, "/joints", "effort[b]").tolist() == [1.5, 3.5, 5.5, 7.5, 9.5]
    assert column(bag, "/odom", "pose.pose.position.x").tolist() == [0.0, 1.0, 2.0, 3.0, 4.0]
    np.testing.assert_array_equal(column(bag, "/number", "data"), [1.5, np.nan, -2.5])
    (batch,) = open_source(str(bag)).read("/number", ["data"])
    assert batch["@stamp"].astype(np.int64).tolist() == batch["@log"].astype(np.int64).tolist()
    assert batch["@stamp"].astype(np.int64)[1] == T0 + 200_000_050


def test_rosbags_reads_the_same(bag):
    with AnyReader([bag]) as reader:
        messages = [
            (connection.topic, time, reader.deserialize(raw, connection.msgtype))
            for connection, time, raw in reader.messages()
        ]
    assert [time for _, time, _ in messages] == sorted(time for _, time, _ in messages)
    # At one time in the order of the topics.
    assert [topic for topic, _, _ in messages[:3]] == ["/joints", "/odom", "/number"]
    number = next(message for topic, _, message in messages if topic == "/number")
    assert (number.data, number.header.frame_id, number.words, number.good) == (
        1.5,
        "here",
        ["x", "yz"],
        False,
    )
    odometry = next(message for topic, _, message in messages if topic == "/odom")
    assert odometry.pose.pose.orientation.w == 1.0
    assert odometry.pose.covariance.shape == (36,)


def test_same_bytes_whatever_the_name_is(bag, tmp_path):
    (kind,) = (kind for kind, ending in KINDS.items() if bag.suffix == f".{ending}")
    other = tmp_path / f"another-name{bag.suffix}"
    write_bag(topics(), str(other), kind)
    assert other.read_bytes() == bag.read_bytes()


def test_replaces_a_file(bag):
    (kind,) = (kind for kind, ending in KINDS.items() if bag.suffix == f".{ending}")
    before = bag.read_bytes()
    write_bag(topics()[:1], str(bag), kind)
    assert bag.read_bytes() != before
    assert [path.name for path in bag.parent.iterdir()] == [bag.name]


@pytest.mark.parametrize("kind", ["mcap", "db3"])
def test_folder_with_metadata(kind, tmp_path):
    write_bag(topics(), f"{tmp_path}/run/", kind)
    with Reader(tmp_path / "run") as reader:
        assert reader.message_count == 13
    assert column(tmp_path / "run", "/joints", "velocity[a]").tolist() == [0.0, 2.0, 4.0, 6.0, 8.0]
    with pytest.raises(CannotWriteError, match="is there already"):
        write_bag(topics(), f"{tmp_path}/run/", kind)
    assert [path.name for path in tmp_path.iterdir()] == ["run"]


@pytest.mark.parametrize("place", ["missing/run.bag", "missing/run/"])
def test_no_such_folder(place, tmp_path):
    with pytest.raises(CannotWriteError, match="no such folder"):
        write_bag(topics(), f"{tmp_path}/{place}", "mcap" if place.endswith("/") else "ros1")
    assert list(tmp_path.iterdir()) == []


def test_a_failure_leaves_the_old_file(tmp_path):
    path = tmp_path / "run.bag"
    write_bag(topics(), str(path), "ros1")
    before = path.read_bytes()
    broken = Topic("/bad", "sensor_msgs/msg/JointState", np.array([T0]), {"effort": np.array(["x"])})
    with pytest.raises((ValueError, TypeError)):
        write_bag([broken], str(path), "ros1")
    assert path.read_bytes() == before
    assert list(tmp_path.iterdir()) == [path]


def test_a_pipe_gets_the_whole_bag(tmp_path):
    pipe, path = tmp_path / "pipe.bag", tmp_path / "run.bag"
    os.mkfifo(pipe)
    with subprocess.Popen(["cat", str(pipe)], stdout=subprocess.PIPE) as reader:
        try:
            write_bag(topics(), str(pipe), "ros1")
            got, _ = reader.communicate(timeout=30)
        finally:
            # Nothing else ends it where the pipe was never opened.
            reader.kill()
    write_bag(topics(), str(path), "ros1")
    assert got == path.read_bytes()
