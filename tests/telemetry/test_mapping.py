from __future__ import annotations

import re

import pytest

from formats import Field
from terrain_cli.errors import ConfigurationError, InputError
from terrain_cli.rover import Rover
from terrain_cli.telemetry.mapping import plan

#: The example of the contract, word for word.
CONTRACT = """
[wheel]
radius = 0.125            # m
width = 0.100             # m
grouser_count = 12        # optional
[soil]
shear_modulus = 0.018     # m, the k assumed where a method does not estimate it
[channels]                # only what the files don't already name
torque  = { topic = "/joint_states", field = "effort", name = "wheel_fl", unit = "N m" }
sinkage = { topic = "/wheel_fl/sinkage", field = "data", unit = "mm" }
load    = { constant = 81.4, unit = "N" }
# in a table: drawbar_pull = { column = "Fx_tractive_N" }, with unit, scale, offset where needed
"""
TAKEN = "odometry taken as the true speed, not the wheels' own"
FLOAT = ("std_msgs/msg/Float64", [Field("data", "number")])
WRENCH = (
    "geometry_msgs/msg/WrenchStamped",
    [Field(f"wrench.{part}.{axis}", "number") for part in ("force", "torque") for axis in "xyz"],
)
ODOMETRY = (
    "nav_msgs/msg/Odometry",
    [
        Field(name, "number")
        for name in ("twist.twist.linear.x", "twist.twist.angular.z", "pose.pose.position.x")
    ],
)
IMU = (
    "sensor_msgs/msg/Imu",
    [Field(f"orientation.{axis}", "number") for axis in "xyzw"] + [Field("angular_velocity.z", "number")],
)


def number(*names):
    return [Field(name, "number") for name in names]


def joints(*names):
    lists = [Field(name, "numbers", names) for name in ("position", "velocity", "effort")]
    return ("sensor_msgs/msg/JointState", [Field("name", "texts", names), *lists])


def words(feeds):
    return {channel: str(feed) for channel, feed in feeds.items()}


def test_a_table_names_its_channels(table):
    layout = plan(
        table(*number("time", "W", "torque_mNm", "sinkage [mm]", "slip", "curL"), Field("run", "text")),
        Rover(),
    )
    assert words(layout.shared) == {
        "time": "time in s",
        "load": "W in N (recognised by its name)",
        "torque": "torque_mNm in mN m (converted)",
        "sinkage": "sinkage [mm] in mm (converted)",
        "slip": "slip",
        "run": "run",
    }
    assert layout.extras == ("curL",)
    assert layout.wheels == {}


def test_rover_toml_stands_above_the_names_of_a_table(table, rover_of):
    rover = rover_of(
        """
        [channels]
        load = { constant = 8.3, unit = "kgf" }
        torque = { column = "T_fl", unit = "mN m", scale = 2.0, offset = -1.5 }
        drawbar_pull = { column = "Fx_tractive_N" }
        velocity = "v"
        terrain = { constant = "dune" }
        """
    )
    source = table(*number("load", "torque", "T_fl", "Fx_tractive_N", "v"), Field("wheel", "text"))
    layout = plan(source, rover)
    assert words(layout.shared) == {
        "load": "constant 8.3 in kgf (rover.toml)",
        "torque": "T_fl · 2 -1.5 in mN m (rover.toml)",
        "drawbar_pull": "Fx_tractive_N in N (rover.toml)",
        "velocity": "v in m/s (no unit is stated: taken as m/s; rover.toml)",
        "terrain": "constant dune (rover.toml)",
    }
    assert layout.labels == {"": "wheel"}
    assert layout.extras == ("load", "torque")


def test_a_wide_table_gives_each_wheel_its_own(table, rover_of):
    rover = rover_of(
        """
        [wheels.left.channels]
        torque = { column = "T_l" , unit = "N m" }
        [wheels.right.channels]
        torque = { column = "T_r", unit = "N m" }
        load = { column = "W_r", unit = "N" }
        """
    )
    layout = plan(table(*number("T_l", "T_r", "load", "W_r", "slip")), rover)
    assert words(layout.feeds("left")) == {
        "torque": "T_l in N m (rover.toml)",
        "load": "load in N",
        "slip": "slip",
    }
    assert words(layout.feeds("right"))["load"] == "W_r in N (rover.toml)"
    assert layout.extras == ()


def test_the_example_of_the_contract(bag, rover_of):
    source = bag(
        joint_states=joints("wheel_fl", "wheel_fr", "mast"),
        wheel_fl__sinkage=FLOAT,
        wheel_fr__sinkage=FLOAT,
        odom=ODOMETRY,
    )
    layout = plan(source, rover_of(CONTRACT))
    assert list(layout.wheels) == ["wheel_fl"]
    assert words(layout.feeds("wheel_fl")) == {
        "torque": "/joint_states effort[wheel_fl] in N m (rover.toml)",
        "sinkage": "/wheel_fl/sinkage data in mm (rover.toml)",
        "load": "constant 81.4 in N (rover.toml)",
        "angular_velocity": "/joint_states velocity[wheel_fl] in rad/s",
        "velocity": f"/odom twist.twist.linear.x in m/s ({TAKEN})",
        "yaw_rate": "/odom twist.twist.angular.z in rad/s",
        "x": "/odom pose.pose.position.x in m",
    }


def test_the_example_of_the_contract_on_a_table(table, rover_of):
    layout = plan(table(*number("torque", "sinkage_mm", "load", "slip")), rover_of(CONTRACT))
    assert words(layout.shared) == {
        "torque": "torque in N m",
        "sinkage": "sinkage_mm in mm (converted)",
        "slip": "slip",
        "load": "constant 81.4 in N (rover.toml)",
    }


def test_topics_tell_the_wheels(bag):
    source = bag(
        rover1__wheel_2__load=WRENCH,
        rover1__wheel_1__load=WRENCH,
        rover1__wheel_1__sinkage_mm=FLOAT,
        rover1__wheel_2__sinkage_mm=FLOAT,
        rover1__joint_states=joints("wheel_1_joint", "wheel_2_joint", "mast_joint"),
        rover1__imu=IMU,
    )
    layout = plan(source, Rover())
    assert sorted(layout.wheels) == ["wheel_1", "wheel_2"]
    for k in "12":
        feeds = words(layout.feeds(f"wheel_{k}"))
        assert feeds["load"].startswith(f"/rover1/wheel_{k}/load wrench.force.z in N")
        assert feeds["sinkage"] == f"/rover1/wheel_{k}/sinkage_mm data in mm"
        assert feeds["angular_velocity"] == f"/rover1/joint_states velocity[wheel_{k}_joint] in rad/s"
        assert feeds["pitch"] == "/rover1/imu orientation (nose up, from the orientation)"
    assert "torque" not in feeds


def test_another_wheels_topic_is_not_taken(bag, rover_of):
    rover = rover_of(
        '[channels]\ntorque = { topic = "/js", field = "effort", name = "wheel_fl", unit = "N m" }'
    )
    kind, fields = joints("wheel_fl", "wheel_fr")
    for states in ((kind, fields), (kind, [f for f in fields if f.name != "velocity"])):
        layout = plan(bag(js=states, wheel_fr__load=WRENCH), rover)
        assert "load" not in layout.feeds("wheel_fl")


def test_the_topic_of_the_torque_names_its_wheel(bag, rover_of):
    rover = rover_of('[channels]\ntorque = { topic = "/wheel_fl/tau", field = "data", unit = "N m" }')
    source = bag(wheel_fl__tau=FLOAT, wheel_fl__sinkage=FLOAT, wheel_fr__sinkage=FLOAT)
    layout = plan(source, rover)
    assert words(layout.feeds("wheel_fl"))["sinkage"] == "/wheel_fl/sinkage data in m"


def test_of_several_sources_none_is_preferred(bag, rover_of):
    rover = rover_of('[channels]\ntorque = { topic = "/torque", unit = "N m" }')
    layout = plan(bag(torque=FLOAT, odom=ODOMETRY, odometry__filtered=ODOMETRY, imu=IMU), rover)
    assert [feed.topic for feed in layout.doubts("wheel")["velocity"]] == ["/odom", "/odometry/filtered"]
    assert "velocity" not in layout.feeds("wheel")
    # An Imu tells the yaw rate better than an odometry.
    assert layout.feeds("wheel")["yaw_rate"].topic == "/imu"


def test_what_is_called_as_a_channel_comes_first(bag, rover_of):
    rover = rover_of('[channels]\ntorque = { topic = "/torque", unit = "N m" }')
    layout = plan(bag(torque=FLOAT, odom=ODOMETRY, velocity=FLOAT, ft=WRENCH, load_kN=FLOAT), rover)
    feeds = layout.feeds("wheel")
    assert (feeds["velocity"].topic, feeds["load"].topic) == ("/velocity", "/load_kN")
    assert layout.doubts("wheel") == {}


def test_a_topic_alone_says_which_of_several(bag, rover_of):
    rover = rover_of(
        """
        [channels]
        torque = { topic = "/torque", unit = "N m" }
        velocity = { topic = "/odometry/filtered" }
        pitch = { topic = "/imu_b", scale = -1 }
        angular_velocity = { topic = "/js", name = "wheel_fr" }
        """
    )
    source = bag(
        torque=FLOAT,
        odom=ODOMETRY,
        odometry__filtered=ODOMETRY,
        imu_a=IMU,
        imu_b=IMU,
        js=joints("wheel_fl", "wheel_fr"),
    )
    feeds = words(plan(source, rover).feeds("wheel"))
    assert feeds["velocity"].startswith("/odometry/filtered twist.twist.linear.x in m/s (odometry taken")
    assert feeds["pitch"] == "/imu_b orientation · -1 (nose up, from the orientation; rover.toml)"
    assert feeds["angular_velocity"] == "/js velocity[wheel_fr] in rad/s (rover.toml)"


def test_wheels_of_rover_toml_find_their_joints(bag, rover_of):
    rover = rover_of(
        """
        [channels]
        torque = { topic = "/js", field = "effort", unit = "N m" }
        [wheels.front-left]
        [wheels.front-right.channels]
        torque = { topic = "/js", field = "effort", index = 3, unit = "N m" }
        """
    )
    layout = plan(bag(js=joints("mast", "fl_steer", "front_left_wheel", "x")), rover)
    assert layout.feeds("front-left")["torque"].fields == ("effort[front_left_wheel]",)
    assert layout.feeds("front-right")["torque"].fields == ("effort[3]",)


def test_messages_of_the_users_own(bag):
    fields = [
        *number("header.seq", "load", "torque_mNm", "sinkage.x", "temperature"),
        Field("wheel", "text"),
        Field("stamp", "time"),
        Field("terrain", "text"),
    ]
    layout = plan(bag(wheels=("rover_msgs/msg/Wheel", fields)), Rover())
    assert layout.labels == {"/wheels": "wheel"}
    assert words(layout.shared) == {
        "load": "/wheels load in N",
        "torque": "/wheels torque_mNm in mN m",
        "terrain": "/wheels terrain",
    }


def test_a_list_of_wheels_within_a_message(bag):
    fields = [
        Field(f"wheels.{name}", "numbers", ("fl", "fr")) for name in ("torque", "load", "sinkage", "slip")
    ]
    layout = plan(bag(state=("rover_msgs/msg/State", fields)), Rover())
    assert sorted(layout.wheels) == ["fl", "fr"]
    assert layout.feeds("fr")["torque"].fields == ("wheels.torque[fr]",)


def test_labels_of_topics(bag, rover_of):
    text = ("std_msgs/msg/String", [Field("data", "text")])
    layout = plan(bag(terrain=text, torque=text, load=FLOAT), Rover())
    assert words(layout.shared) == {"terrain": "/terrain data", "load": "/load data in N"}
    rover = rover_of(
        """
        [channels]
        wheel = { topic = "/w", field = "which" }
        torque = { topic = "/w", field = "t", unit = "N m" }
        """
    )
    layout = plan(bag(w=("a/msg/B", [Field("which", "text"), *number("t")])), rover)
    assert layout.labels == {"/w": "which"}
    assert list(layout.shared) == ["torque"]


@pytest.mark.parametrize(
    ("entry", "message", "hint"),
    [
        (
            'torque = { topic = "/jount_states", field = "effort", unit = "N m" }',
            "there is no topic /jount_states; did you mean /joint_states?",
            "it has /joint_states",
        ),
        (
            'torque = { topic = "/joint_states", field = "efort", unit = "N m" }',
            "topic /joint_states has no field 'efort'; did you mean effort?",
            "it has name, position",
        ),
        (
            'torque = { topic = "/joint_states", field = "effort", unit = "N m" }',
            "effort is a list",
            "add name = … or index = …; it has wheel_fl, wheel_fr",
        ),
        ('torque = { topic = "/joint_states", unit = "N m" }', "add field = …", "it has name, position"),
        (
            'load = { topic = "/odom", field = "twist.twist.linear.x" }',
            "/odom twist.twist.linear.x is in m/s, which load cannot be",
            "load takes N, kN",
        ),
        (
            'velocity = { topic = "/own", field = "v" }',
            "the unit of /own v is not known",
            "add unit = …; velocity takes m/s",
        ),
        ('load = { topic = "/own", field = "load_mm" }', "'mm' is a unit of length", "add unit = …"),
    ],
)
def test_an_entry_that_does_not_fit_a_bag(bag, rover_of, entry, message, hint):
    source = bag(
        joint_states=joints("wheel_fl", "wheel_fr"),
        odom=ODOMETRY,
        own=("a/msg/B", number("v", "load_mm", "c", "d")),
    )
    with pytest.raises(ConfigurationError, match=re.escape(message)) as error:
        plan(source, rover_of(f"[channels]\n{entry}"))
    assert "rover.toml: channels." in str(error.value)
    assert error.value.hint.startswith(hint)


def test_an_entry_that_does_not_fit_a_table(table, rover_of):
    with pytest.raises(
        ConfigurationError, match="there is no column 'Torque_fl'; did you mean torque_fl"
    ) as error:
        plan(table(*number("torque_fl", "W")), rover_of('[channels]\ntorque = "Torque_fl"'))
    assert error.value.hint == "it has torque_fl, W"


@pytest.mark.parametrize(
    ("headers", "message"),
    [
        (("load", "sinkage_kg"), "run: column 'sinkage_kg': 'kg' is a unit of mass; sinkage takes m, km"),
        (("omega", "angular_speed"), "run: columns 'omega' and 'angular_speed' can all be angular_velocity"),
    ],
)
def test_headers_that_contradict(table, headers, message):
    with pytest.raises(InputError, match=re.escape(message)):
        plan(table(*number(*headers)), Rover())


def test_a_topic_whose_name_has_a_wrong_unit(bag):
    with pytest.raises(InputError, match=re.escape("run: /fl/sinkage_kg: column 'sinkage_kg'")):
        plan(bag(fl__sinkage_kg=FLOAT), Rover())
