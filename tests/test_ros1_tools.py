"""ROS 1's own tools, as Debian has them, read the bags that are written and the sample drive."""

from __future__ import annotations

import json
import subprocess
from pathlib import Path

import numpy as np
import pytest
from ruamel.yaml import YAML

from terrain_cli import rover as rovers
from terrain_cli import telemetry

pytestmark = pytest.mark.real("rosbag")

SAMPLE = Path(__file__).resolve().parent.parent / "sample_data" / "run.bag"
#: Decodes messages, of a type of our own, by the definitions in the bag.
READ = """
import json, sys, rosbag
with rosbag.Bag(sys.argv[1]) as bag:
    seen = [(m.header.stamp.to_sec(), m.data) for _, m, _ in bag.read_messages("/wheel/sinkage")]
print(json.dumps(seen))
"""


def printed(*command):
    done = subprocess.run([*map(str, command)], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")
    return done.stdout


def info(path):
    return YAML(typ="safe").load(printed("rosbag", "info", "--yaml", path))


@pytest.fixture
def bag(terrain_est_here, tmp_path):
    done = terrain_est_here("simulate", "-o", tmp_path / "run.bag", "--duration", "20", "--noise", "3%")
    assert done.returncode == 0, done.stderr
    return tmp_path / "run.bag"


def test_rosbag_says_what_is_inside(bag):
    found = info(bag)
    assert found["indexed"] is True
    assert 19.5 < found["duration"] <= 20.0
    topics = {topic["topic"]: topic for topic in found["topics"]}
    assert topics["/joint_states"]["type"] == "sensor_msgs/JointState"
    assert topics["/joint_states"]["messages"] == 400
    assert topics["/wheel/sinkage"]["type"] == "terrain_est_msgs/Float64Stamped"
    assert found["messages"] == sum(topic["messages"] for topic in topics.values())


def test_its_messages_have_the_values(bag):
    # The tools are those of the system's Python.
    seen = np.array(json.loads(printed("/usr/bin/python3", "-c", READ, bag)))
    (wheel,) = telemetry.read(str(bag), rovers.load(bag.with_name("rover.toml")))
    at = np.interp(wheel.time + wheel.origin, *seen.T)
    inside = (wheel.time + wheel.origin <= seen[-1, 0]) & np.isfinite(wheel.channels["sinkage"])
    assert inside.sum() > 300
    np.testing.assert_allclose(at[inside], wheel.channels["sinkage"][inside], rtol=0, atol=2e-5)


def test_sample_drive_is_read():
    found = info(SAMPLE)
    assert (found["indexed"], found["messages"]) == (True, 7050)
