"""Real bags of both generations: which topics and joints belong to which wheel."""

from __future__ import annotations

import re

import numpy as np
import pytest
from wheel_bags import (
    CONTRACT,
    GEOMETRY,
    JOINTS,
    LOAD,
    OMEGA,
    SINKAGE,
    SPEED,
    START,
    TIME,
    TORQUE,
    TWO_WHEELS,
    N,
    assert_two_wheels,
    expect,
    floats,
    header,
    joint_states,
    ns,
    odometry,
    one,
    two_wheels,
)

import formats
from terrain_cli import telemetry
from terrain_cli.errors import ConfigurationError, InputError
from terrain_cli.presentation import rover_draft
from terrain_cli.rover import Rover


def test_the_example_of_the_contract(write_bag, rover_of):
    path = write_bag(joint_states(), floats("/wheel_fl/sinkage", 1e3 * SINKAGE["wheel_fl"]), odometry())
    samples = one(path, rover_of(CONTRACT))
    assert samples.wheel == "wheel_fl"
    assert samples.geometry[:3] == (0.125, 0.1, 0.018)
    assert samples.origin == START
    np.testing.assert_allclose(samples.time, TIME, atol=1e-9)
    slip = 1.0 - SPEED / (0.125 * OMEGA["wheel_fl"])
    expect(
        samples,
        torque=TORQUE["wheel_fl"],
        sinkage=SINKAGE["wheel_fl"],
        load=np.full(N, 81.4),
        slip=slip,
        x=0.1 * TIME,
        y=-0.2 * TIME,
    )
    assert len(samples.usable) == N
    assert samples.origins["slip"] == "derived from angular velocity and velocity"
    assert samples.origins["torque"] == "/joint_states effort[wheel_fl] in N m (rover.toml)"
    travelled = np.sum(0.5 * (SPEED[1:] + SPEED[:-1]) * 0.1)
    assert samples.distance[-1] == pytest.approx(travelled, rel=1e-9)


def test_two_wheels_of_rover_toml(write_bag, rover_of):
    assert_two_wheels(telemetry.read(write_bag(*two_wheels()), rover_of(TWO_WHEELS)))


def test_the_order_of_the_joints_may_change(write_bag, rover_of):
    path = write_bag(*two_wheels(order=lambda names, j: names[:: (-1) ** j]))
    assert_two_wheels(telemetry.read(path, rover_of(TWO_WHEELS)))


def test_another_publisher_of_other_joints_on_the_topic(write_bag, rover_of):
    other = (
        (
            "/joint_states",
            JOINTS,
            ns(t + 0.03),
            {"header": header(t + 0.03), "name": ["mast"], "velocity": [0.1]},
            "b",
        )
        for t in TIME
    )
    assert_two_wheels(telemetry.read(write_bag(*two_wheels(), other), rover_of(TWO_WHEELS)))


def test_the_other_publisher_may_speak_first(write_bag, rover_of):
    content = {"header": header(-0.5), "name": ["mast"], "velocity": [0.1], "effort": [1.0]}
    other = [("/joint_states", JOINTS, ns(-0.5), content, "b")]
    assert_two_wheels(telemetry.read(write_bag(*two_wheels(), other), rover_of(TWO_WHEELS)))


def test_only_the_wheels_asked_for(write_bag, rover_of):
    path, rover = write_bag(*two_wheels()), rover_of(TWO_WHEELS)
    (samples,) = telemetry.read(path, rover, wheels=["wheel_fr"])
    assert samples.wheel == "wheel_fr"


@pytest.mark.parametrize(
    ("name", "near"),
    [("rear", ""), ("fr", "; did you mean wheel_fr?"), ("wheel-fr", "; did you mean wheel_fr?")],
)
def test_part_of_a_name_is_no_wheel(name, near, write_bag, rover_of):
    path, rover = write_bag(*two_wheels()), rover_of(TWO_WHEELS)
    with pytest.raises(InputError, match=re.escape(f"there is no wheel {name}{near}") + "$") as error:
        telemetry.read(path, rover, wheels=[name])
    assert error.value.hint == "it has wheel_fl, wheel_fr"


def test_without_rover_toml_one_error_gives_all_lines_to_add(write_bag, rover_of):
    path = write_bag(*two_wheels())
    with pytest.raises(InputError) as error:
        telemetry.read(path, Rover())
    assert str(error.value) == f"{path}: c and φ cannot be estimated: torque is neither measured nor derived"
    lines = error.value.hint.partition("\n")[2]
    for wheel in TORQUE:
        entry = f'torque = {{ topic = "/joint_states", field = "effort", name = "{wheel}", unit = "N m" }}'
        assert f"[wheels.{wheel}.channels]\n{entry}\n" in lines
    assert lines.count("[wheel]") == lines.count("[soil]") == 1
    # What it says is what it takes.
    for name, value in {"radius": "0.125", "width": "0.1", "shear_modulus": "0.018"}.items():
        lines = re.sub(rf"{name} = …", f"{name} = {value}", lines)
    assert_two_wheels(telemetry.read(path, rover_of(lines)))


def test_several_sources_of_one_channel_are_asked_about(write_bag, rover_of):
    path = write_bag(
        joint_states(),
        floats("/wheel_fl/sinkage", 1e3 * SINKAGE["wheel_fl"]),
        odometry(),
        odometry("/odometry/filtered"),
    )
    with pytest.raises(InputError, match="velocity could be any of /odom twist") as error:
        telemetry.read(path, rover_of(CONTRACT))
    line = error.value.hint.splitlines()[-1]
    assert line.startswith('velocity = { topic = "/odom", field = "twist.twist.linear.x" }  # or')
    expect(one(path, rover_of(CONTRACT + line)), velocity=SPEED)


def test_effort_is_never_taken_for_a_torque(write_bag, rover_of):
    rover = rover_of(CONTRACT.replace("torque  =", "motor_current =").replace('"N m"', '"A"'))
    path = write_bag(joint_states(), floats("/wheel_fl/sinkage", SINKAGE["wheel_fl"]), odometry())
    with pytest.raises(InputError, match="no torque: motor_current is there, but not the data") as error:
        telemetry.read(path, rover)
    assert "[motor]\ntorque_constant = …" in error.value.hint


WHEEL_MESSAGE = {
    "rover_msgs/msg/Wheel": "std_msgs/Header header\nstring wheel\nfloat64 load\nfloat64 torque_mNm\n"
    "float64 sinkage\nfloat64 slip\nfloat64 temperature\n"
}
LIST_MESSAGE = {
    "rover_msgs/msg/Wheel": "string name\nfloat64 load\nfloat64 torque\nfloat64 sinkage\nfloat64 slip\n",
    "rover_msgs/msg/Wheels": "std_msgs/Header header\nrover_msgs/Wheel[] wheels\n",
}


def drafted(path, rover_of):
    """Return the rover of a draft, filled in."""
    text, _ = rover_draft.draft(formats.open_source(path))
    for name, value in (("radius", 0.125), ("width", 0.1), ("shear_modulus", 0.018)):
        text = text.replace(f"# {name} = …", f"{name} = {value}")
    return rover_of(text)


@pytest.mark.parametrize("by_hand", [True, False])
def test_messages_that_name_their_wheel(by_hand, write_bag, rover_of):
    rows = [
        (
            "/wheels",
            "rover_msgs/msg/Wheel",
            ns(t),
            {
                "header": header(t),
                "wheel": wheel,
                "load": LOAD[wheel][j],
                "torque_mNm": 1e3 * TORQUE[wheel][j],
                "sinkage": SINKAGE[wheel][j],
                "slip": 0.3,
            },
        )
        for j, t in enumerate(TIME)
        for wheel in (list(LOAD), list(LOAD)[::-1])[j % 2]
    ]
    path = write_bag(rows, definitions=WHEEL_MESSAGE)
    found = telemetry.read(path, rover_of(GEOMETRY) if by_hand else drafted(path, rover_of))
    assert [samples.wheel for samples in found] == ["wheel_fl", "wheel_fr"]
    for samples in found:
        wheel = samples.wheel
        expect(samples, torque=TORQUE[wheel], load=LOAD[wheel], sinkage=SINKAGE[wheel], slip=np.full(N, 0.3))
        np.testing.assert_allclose(samples.time, TIME, atol=1e-9)


@pytest.mark.parametrize("by_hand", [True, False])
def test_messages_with_a_list_of_wheels(by_hand, write_bag, rover_of):
    rows = [
        (
            "/state",
            "rover_msgs/msg/Wheels",
            ns(t),
            {
                "header": header(t),
                "wheels": [
                    {
                        "name": wheel,
                        "load": LOAD[wheel][j],
                        "torque": TORQUE[wheel][j],
                        "sinkage": SINKAGE[wheel][j],
                        "slip": 0.3,
                    }
                    for wheel in (list(LOAD), list(LOAD)[::-1])[j % 2]
                ],
            },
        )
        for j, t in enumerate(TIME)
    ]
    path = write_bag(rows, definitions=LIST_MESSAGE)
    found = telemetry.read(path, rover_of(GEOMETRY) if by_hand else drafted(path, rover_of))
    assert [samples.wheel for samples in found] == ["wheel_fl", "wheel_fr"]
    for samples in found:
        expect(
            samples, torque=TORQUE[samples.wheel], load=LOAD[samples.wheel], sinkage=SINKAGE[samples.wheel]
        )


def test_a_condition_on_a_bag(write_bag, rover_of):
    path = write_bag(*two_wheels())
    rover = rover_of(TWO_WHEELS)
    found = telemetry.read(path, rover, where=telemetry.Condition(f"time > {START + 2} and load > 80"))
    for samples in found:
        kept = (TIME > 2.0) & (LOAD[samples.wheel] > 80.0)
        np.testing.assert_allclose(samples.time, TIME[kept], atol=1e-9)
    derived = telemetry.read(path, rover, where=telemetry.Condition("slip < 0.2"))
    assert all(np.all(samples.channels["slip"] < 0.2) for samples in derived)
    with pytest.raises(InputError, match=r"--where: there is no column slap; did you mean slip\?"):
        telemetry.read(path, rover, where=telemetry.Condition("slap < 0.2"))


def test_one_torque_for_two_wheels_is_asked_about(write_bag, rover_of):
    rover = rover_of(
        GEOMETRY + '[channels]\ntorque = { topic = "/t", unit = "N m" }\n[wheels.a]\n[wheels.b]\n'
    )
    path = write_bag(
        floats("/t", TORQUE["wheel_fl"]),
        floats("/sinkage", SINKAGE["wheel_fl"]),
        floats("/load", TORQUE["wheel_fl"]),
        floats("/slip", TORQUE["wheel_fl"] / 5),
    )
    with pytest.raises(ConfigurationError, match="/t data is given once for 2 wheels: a, b"):
        telemetry.read(path, rover)
    (samples,) = telemetry.read(path, rover, wheels=["b"])
    assert samples.wheel == "b"
