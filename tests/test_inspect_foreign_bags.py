"""What `inspect` shows of bags that are not of a rover's wheels: all that is there, then what is wrong."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parent / "formats"))
from bags import typestore, write_ros1, write_ros2
from wheel_table import ROVER

JOINTS = "sensor_msgs/msg/JointState"
OWN = "acme_msgs/msg/WheelTelemetry"
DEFINITIONS = {OWN: "float64 tau\nfloat32 depth_mm\nstring label\n"}
ARM = ("shoulder", "elbow", "wrist")


def joints(names, count=3):
    for j in range(20):
        values = {"name": list(names), "position": [0.1 * j] * count, "velocity": [0.2] * count}
        yield ("/joint_states", JOINTS, j * 10**8 + 10**18, values)


def own():
    for j in range(20):
        yield ("/wheel", OWN, j * 10**8 + 10**18, {"tau": 1.0 * j, "depth_mm": 10.0, "label": "a"})


@pytest.fixture(params=["ros1", "db3", "mcap"])
def inspected(request, tmp_path, terrain_est_here):
    """Return a function that writes a bag of one kind and inspects it."""

    def inspected(rows, rover=ROVER):
        (tmp_path / "rover.toml").write_text(rover)
        store = typestore(DEFINITIONS, ros1=request.param == "ros1")
        path = tmp_path / ("b.bag" if request.param == "ros1" else "b")
        if request.param == "ros1":
            write_ros1(path, rows, store)
        else:
            path = write_ros2(path, rows, store, request.param)
        return terrain_est_here("inspect", path.relative_to(tmp_path), cwd=tmp_path)

    return inspected


ASKS_FOR_ARM = (
    '[channels]\ntorque = { topic = "/joint_states", field = "effort", name = "wheel", unit = "N m" }\n'
)


def test_joints_of_an_arm_are_shown(inspected):
    done = inspected(joints(ARM))
    assert (done.returncode, done.stderr) == (0, "")
    assert "/joint_states  sensor_msgs/msg/JointState  20" in done.stdout
    for joint in ARM:
        assert f"velocity[{joint}]" in done.stdout
    # There is no effort in these messages.
    assert "effort" not in done.stdout


def test_joints_without_names_are_shown_by_number(inspected):
    done = inspected(joints(()))
    assert (done.returncode, done.stderr) == (0, "")
    assert all(f"/joint_states velocity[{number}]" in done.stdout for number in range(3))


@pytest.mark.parametrize("names", [ARM, ()])
def test_a_joint_that_is_not_there_is_refused_after_what_is(inspected, names):
    done = inspected(joints(names), ROVER + ASKS_FOR_ARM)
    assert done.returncode == 65
    assert f"position[{', '.join(names or '012')}]" in done.stdout
    assert "has the element 'wheel' of effort" in done.stderr


def test_fields_of_an_unknown_type_are_shown_and_only_numbers_proposed(inspected):
    done = inspected(own())
    assert (done.returncode, done.stderr) == (0, "")
    assert "/wheel: tau, depth_mm, label (text)" in done.stdout
    proposed = [line.partition("# one of: ")[2] for line in done.stdout.splitlines() if "# one of:" in line]
    assert proposed
    assert set(proposed) == {"/wheel tau, /wheel depth_mm"}


def test_a_field_that_the_type_lacks_is_refused_after_those_it_has(inspected):
    rover = ROVER + '[channels]\ntorque = { topic = "/wheel", field = "effort", unit = "N m" }\n'
    done = inspected(own(), rover)
    assert done.returncode == 78
    assert "/wheel: tau, depth_mm, label (text)" in done.stdout
    assert "topic /wheel has no field 'effort'\n  it has tau, depth_mm, label" in done.stderr
