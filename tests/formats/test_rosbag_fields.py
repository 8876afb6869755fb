"""Topics, fields, elements, and what is told of a name that is not there."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from bags import message, typestore, write_ros1, write_ros2
from rosbags.rosbag1 import Writer as Ros1Writer
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Ros2Writer

from formats.errors import DamagedError, FormatError
from formats.rosbag.bag_source import BagSource
from formats.table import LOG_TIME, STAMP, Labels

JOINTS, FLOAT = "sensor_msgs/msg/JointState", "std_msgs/msg/Float64"
ROVER, WHEEL = "rover_msgs/msg/Rover", "rover_msgs/msg/Wheel"
CUSTOM = {
    WHEEL: "string name\nstring soil\nfloat32 torque\nContact contact\nfloat64[] raw\n",
    "rover_msgs/msg/Contact": "float64 sinkage\nint8 state\n",
    ROVER: (
        "Wheel[] wheels\ngeometry_msgs/Vector3[2] axles\nuint8[] image\nint8[4] code\nfloat64[9] covariance\n"
        "string[] notes\nfloat32[] ranges\nContact body\nuint8 class\n"
    ),
}


def bag(tmp_path, rows, kind="ros1", custom=None, **options):
    store = typestore(custom, ros1=kind == "ros1")
    if kind == "ros1":
        return BagSource(str(write_ros1(tmp_path / "run.bag", rows, store, **options)), kind)
    return BagSource(str(write_ros2(tmp_path / "run", rows, store, kind, **options)), kind)


kinds = pytest.mark.parametrize("kind", ["ros1", "mcap", "db3"])


def joints(names, effort, **more):
    return {"name": names, "effort": effort, **more}


def fields(opened, topic):
    stream = next(stream for stream in opened.streams() if stream.topic == topic)
    return {field.name: (field.kind, field.elements) for field in stream.fields}


@kinds
def test_joint_states_by_name_and_by_place(tmp_path, kind):
    rows = [
        ("/joints", JOINTS, 1, joints(["fl", "fr"], [1.0, 2.0], position=[0.1, 0.2])),
        ("/joints", JOINTS, 2, joints(["fr", "fl"], [2.5, 1.5], position=[0.3, 0.4])),
        ("/joints", JOINTS, 3, joints(["fr", "arm [2]"], [2.75, 9.0])),
        ("/joints", JOINTS, 4, joints([], [])),
    ]
    opened = bag(tmp_path, rows, kind)
    found = fields(opened, "/joints")
    assert found["effort"] == ("numbers", ("fl", "fr"))
    assert found["position"] == ("numbers", ("fl", "fr"))
    assert found["velocity"] == ("numbers", ())
    assert found["name"] == ("texts", ("0", "1"))
    asked = ["effort[fl]", "effort[fr]", "effort[1]", "position[fl]", "effort[arm [2]]", "name[0]"]
    (batch,) = opened.read("/joints", asked)
    nan = np.nan
    np.testing.assert_array_equal(batch["effort[fl]"], [1, 1.5, nan, nan])
    np.testing.assert_array_equal(batch["effort[fr]"], [2, 2.5, 2.75, nan])
    np.testing.assert_array_equal(batch["effort[1]"], [2, 1.5, 9, nan])
    np.testing.assert_array_equal(batch["position[fl]"], [0.1, 0.4, nan, nan])
    np.testing.assert_array_equal(batch["effort[arm [2]]"], [nan, nan, 9, nan])
    assert batch["name[0]"].names == ("fl", "fr")
    assert batch["name[0]"].codes.tolist() == [0, 1, 1, -1]


@kinds
def test_names_that_are_digits_are_names(tmp_path, kind):
    rows = [
        ("/joints", JOINTS, 1, joints(["1", "0"], [1.0, 2.0])),
        ("/joints", JOINTS, 2, joints(["0"], [2.5])),
    ]
    opened = bag(tmp_path, rows, kind)
    (batch,) = opened.read("/joints", ["effort[1]", "effort[0]"])
    np.testing.assert_array_equal(batch["effort[1]"], [1, np.nan])
    np.testing.assert_array_equal(batch["effort[0]"], [2, 2.5])


def test_several_publishers_each_with_joints_of_its_own(tmp_path):
    rows = [
        (
            "/joints",
            JOINTS,
            10 * i,
            joints([["fl", "fr"], ["arm"]][i % 2], [[i, -i], [i]][i % 2]),
            f"node{i % 2}",
        )
        for i in range(6)
    ]
    opened = bag(tmp_path, rows)
    (stream,) = opened.streams()
    assert (stream.count, stream.start, stream.end) == (6, 0, 50)
    batches = list(opened.read("/joints", ["effort[fr]", "effort[arm]"], 4))
    assert [len(batch[LOG_TIME]) for batch in batches] == [4, 2]
    nan = np.nan
    np.testing.assert_array_equal(
        np.concatenate([batch["effort[fr]"] for batch in batches]), [0, nan, -2, nan, -4, nan]
    )
    np.testing.assert_array_equal(
        np.concatenate([batch["effort[arm]"] for batch in batches]), [nan, 1, nan, 3, nan, 5]
    )


@kinds
def test_custom_type_with_lists_of_messages(tmp_path, kind):
    def wheel(name, torque, soil):
        return {
            "name": name,
            "torque": torque,
            "soil": soil,
            "contact": {"sinkage": torque / 4},
            "raw": [1.0],
        }

    values = {"image": list(range(200)) * 50, "notes": ["a", "b"], "covariance": range(9), "class": 3}
    rows = [
        ("/rover", ROVER, 1, {"wheels": [wheel("fl", 1, "sand"), wheel("fr", 2, "rock")], **values}),
        ("/rover", ROVER, 2, {"wheels": [wheel("fr", 3, "rock"), wheel("fl", 4, "clay")], **values}),
        ("/rover", ROVER, 3, {"wheels": [wheel("fl", 5, "clay")], **values, "ranges": [7.0] * 999}),
    ]
    opened = bag(tmp_path, rows, kind, CUSTOM)
    assert fields(opened, "/rover") == {
        "wheels.name": ("texts", ("0", "1")),
        "wheels.soil": ("texts", ("fl", "fr")),
        "wheels.torque": ("numbers", ("fl", "fr")),
        "wheels.contact.sinkage": ("numbers", ("fl", "fr")),
        "wheels.contact.state": ("numbers", ("fl", "fr")),
        "axles.x": ("numbers", ("0", "1")),
        "axles.y": ("numbers", ("0", "1")),
        "axles.z": ("numbers", ("0", "1")),
        "covariance": ("numbers", tuple("012345678")),
        "notes": ("texts", ("0", "1")),
        "ranges": ("numbers", ()),
        "body.sinkage": ("number", ()),
        "body.state": ("number", ()),
        "class": ("number", ()),
    }
    asked = [
        "wheels.torque[fl]",
        "wheels.contact.sinkage[1]",
        "wheels.soil[fl]",
        "covariance[8]",
        "class",
        "ranges[998]",
    ]
    (batch,) = opened.read("/rover", asked)
    np.testing.assert_array_equal(batch["wheels.torque[fl]"], [1, 4, 5])
    np.testing.assert_array_equal(batch["wheels.contact.sinkage[1]"], [0.5, 1, np.nan])
    soil = batch["wheels.soil[fl]"]
    assert isinstance(soil, Labels)
    assert [soil.names[code] for code in soil.codes] == ["sand", "clay", "clay"]
    assert (batch["covariance[8]"] == 8).all()
    assert (batch["class"] == 3).all()
    np.testing.assert_array_equal(batch["ranges[998]"], [np.nan, np.nan, 7])
    assert np.isnat(batch[STAMP]).all()


def test_long_lists_are_told_in_part_and_read_in_full(tmp_path):
    rows = [("/scan", "sensor_msgs/msg/LaserScan", 1, {"ranges": np.arange(720)})]
    opened = bag(tmp_path, rows)
    assert fields(opened, "/scan")["ranges"][1] == tuple(str(i) for i in range(256))
    (batch,) = opened.read("/scan", ["ranges[719]"])
    assert batch["ranges[719]"].tolist() == [719]


@kinds
def test_names_that_do_not_fit_their_list_do_not_name_it(tmp_path, kind):
    rows = [("/joints", JOINTS, 1, joints(["a", "b"], [1.0, 2.0, 3.0], position=[1.0], velocity=[5.0, 6.0]))]
    opened = bag(tmp_path, rows, kind)
    found = fields(opened, "/joints")
    assert found["effort"][1] == ("0", "1", "2")
    assert found["position"][1] == ("0",)
    assert found["velocity"][1] == ("a", "b")
    (batch,) = opened.read("/joints", ["effort[2]", "effort[b]"])
    assert (batch["effort[2]"].item(), batch["effort[b]"].item()) == (3, 2)


def test_two_definitions_of_one_type(tmp_path):
    """Recorded before and after the type was changed: each message with its own definition."""
    old = typestore({"x_msgs/msg/T": "float32 torque\nfloat64 sinkage\nstring note\n"}, ros1=True)
    new = typestore(
        {"x_msgs/msg/T": "float64 sinkage\nuint8 mode\nfloat64 torque\nfloat32 note\n"}, ros1=True
    )
    with Ros1Writer(tmp_path / "run.bag") as writer:
        ids = [writer.add_connection("/x", "x_msgs/msg/T", typestore=store) for store in (old, new)]
        for i in range(8):
            store = (old, new)[i % 2]
            make = store.types["x_msgs/msg/T"]
            one = make(float(i), i / 8, "n") if i % 2 == 0 else make(i / 8, 3, float(i), 9.0)
            writer.write(ids[i % 2], 10 * i, store.serialize_ros1(one, "x_msgs/msg/T"))
    opened = BagSource(str(tmp_path / "run.bag"), "ros1")
    assert set(fields(opened, "/x")) == {"torque", "sinkage", "note", "mode"}
    (batch,) = opened.read("/x", ["torque", "sinkage", "mode", "note"])
    assert batch["torque"].tolist() == list(range(8))
    assert batch["sinkage"].tolist() == [i / 8 for i in range(8)]
    np.testing.assert_array_equal(batch["mode"], [np.nan, 3] * 4)
    assert batch["note"].codes.tolist() == [0, -1] * 4
    assert batch[LOG_TIME].astype(int).tolist() == list(range(0, 80, 10))
    assert "note is text to one publisher and number to another" in opened.remarks[0]


@kinds
def test_empty_messages_and_no_fields(tmp_path, kind):
    rows = [("/tick", "std_msgs/msg/Empty", 5 * i, {}) for i in range(7)]
    opened = bag(tmp_path, rows, kind)
    assert fields(opened, "/tick") == {}
    batches = list(opened.read("/tick", [], 3))
    assert [len(batch[LOG_TIME]) for batch in batches] == [3, 3, 1]
    assert set(batches[0]) == {LOG_TIME, STAMP}


def test_a_stamp_is_that_of_a_header_at_the_beginning(tmp_path):
    late = {"x_msgs/msg/Late": "float64 a\nHeader header\n"}
    rows = [("/late", "x_msgs/msg/Late", 5, {"header": {"stamp": 3 * 10**9}})]
    opened = bag(tmp_path, rows, custom=late)
    (batch,) = opened.read("/late", ["header.stamp"])
    assert np.isnat(batch[STAMP]).all()
    assert batch["header.stamp"].astype(int).tolist() == [3 * 10**9]


@pytest.fixture
def joint_bag(tmp_path):
    rows = [("/joint_states", JOINTS, i, joints(["wheel_fl", "wheel_fr"], [1.0, np.nan])) for i in range(5)]
    return bag(tmp_path, [*rows, ("/speed", FLOAT, 1, {"data": 1.0})])


@pytest.mark.parametrize(
    ("topic", "field", "said", "hint"),
    [
        ("/joint_state", "effort[0]", "has no topic '/joint_state'", "did you mean /joint_states?"),
        ("/zzz", "data", "has no topic '/zzz'", "its topics: /joint_states, /speed"),
        ("/joint_states", "efort[0]", "/joint_states has no field 'efort[0]'", "did you mean effort?"),
        ("/joint_states", "effort[0", "/joint_states has no field 'effort[0'", "did you mean effort?"),
        (
            "/joint_states",
            "effort",
            "effort is a list",
            "ask for one element of it, such as effort[wheel_fl]",
        ),
        ("/speed", "data[0]", "data is one value, not a list", "ask for data"),
        ("/speed", "", "/speed has no field ''", "its fields: data"),
    ],
)
def test_unknown_names_are_told_at_once(joint_bag, topic, field, said, hint):
    with pytest.raises(FormatError) as caught:
        joint_bag.read(topic, [field])
    assert said in str(caught.value)
    assert caught.value.hint == hint
    assert caught.value.exit_code == 65


def test_an_element_no_message_has_is_told_at_the_end(joint_bag):
    reading = joint_bag.read("/joint_states", ["effort[wheel_rl]", "effort[wheel_fr]"])
    assert np.isnan(next(reading)["effort[wheel_rl]"]).all()
    with pytest.raises(FormatError, match=r"no message has the element 'wheel_rl' of effort") as caught:
        next(reading)
    assert caught.value.hint.startswith("did you mean wheel_f")
    with pytest.raises(FormatError, match="the element 7 of effort"):
        list(joint_bag.read("/joint_states", ["effort[7]"]))


def test_an_element_that_is_always_nan_is_there(joint_bag):
    (batch,) = joint_bag.read("/joint_states", ["effort[wheel_fr]"])
    assert np.isnan(batch["effort[wheel_fr]"]).all()


def test_no_definition_in_a_ros1_bag(tmp_path):
    store = typestore(ros1=True)
    payload = store.serialize_ros1(store.types[FLOAT](2.5), FLOAT)
    _, md5 = store.generate_msgdef(FLOAT)
    with Ros1Writer(tmp_path / "run.bag") as writer:
        for topic, type_name, hash_ in (
            ("/known", FLOAT, md5),
            ("/other", FLOAT, "0" * 32),
            ("/any", "x_msgs/msg/Any", "*"),
        ):
            connection = writer.add_connection(topic, type_name, msgdef="", md5sum=hash_)
            writer.write(connection, 1, payload)
    opened = BagSource(str(tmp_path / "run.bag"), "ros1")
    (batch,) = opened.read("/known", ["data"])
    assert batch["data"].tolist() == [2.5]
    assert [len(stream.fields) for stream in opened.streams()] == [1, 0, 0]
    for topic in ("/other", "/any"):
        with pytest.raises(
            FormatError, match=f"{topic} cannot be read: .*: the file has no definition of it"
        ):
            opened.read(topic, ["data"])
    assert opened.remarks == [
        "/other cannot be read: std_msgs/msg/Float64: the file has no definition of it",
        "/any cannot be read: x_msgs/msg/Any: the file has no definition of it",
        "no definition in the file of std_msgs/msg/Float64: read as ROS 1 Noetic defines it",
    ]


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("float64 [[[\n", "cannot be parsed"),
        ("Missing m\n", "the definition of x_msgs/msg/Missing is missing"),
        ("wstring w\n", "the definition of x_msgs/msg/wstring is missing"),
        ("T again\n", "contains itself"),
    ],
)
def test_definitions_that_cannot_be_used(tmp_path, text, reason):
    with Ros1Writer(tmp_path / "run.bag") as writer:
        connection = writer.add_connection("/x", "x_msgs/msg/T", msgdef=text, md5sum="1" * 32)
        writer.write(connection, 1, bytes(8))
        store = typestore(ros1=True)
        good = writer.add_connection("/good", FLOAT, typestore=store)
        writer.write(good, 1, store.serialize_ros1(store.types[FLOAT](2.5), FLOAT))
    opened = BagSource(str(tmp_path / "run.bag"), "ros1")
    assert len(opened.streams()) == 2
    with pytest.raises(FormatError, match=reason):
        opened.read("/x", [])
    (batch,) = opened.read("/good", ["data"])
    assert batch["data"].tolist() == [2.5]


IDL = """\
================================================================================
IDL: x_msgs/msg/Soil
module x_msgs { module msg { struct Soil {
  std_msgs::msg::Header header;
  double sinkage;
  sequence<float> torque;
  string terrain;
}; }; };
================================================================================
IDL: std_msgs/msg/Header
module std_msgs { module msg { struct Header {
  builtin_interfaces::msg::Time stamp;
  string frame_id;
}; }; };
================================================================================
IDL: builtin_interfaces/msg/Time
module builtin_interfaces { module msg { struct Time { int32 sec; uint32 nanosec; }; }; };
"""


@pytest.mark.parametrize("kind", ["mcap", "db3"])
def test_a_definition_in_idl(tmp_path, kind):
    text = "std_msgs/Header header\nfloat64 sinkage\nfloat32[] torque\nstring terrain\n"
    store = typestore({"x_msgs/msg/Soil": text}, ros1=False)
    values = {"header": {"stamp": 7}, "sinkage": 0.02, "torque": [1.5, 2.5], "terrain": "sand"}
    plugin = StoragePlugin.MCAP if kind == "mcap" else StoragePlugin.SQLITE3
    with Ros2Writer(tmp_path / "run", version=9, storage_plugin=plugin) as writer:
        connection = writer.add_connection("/soil", "x_msgs/msg/Soil", msgdef=IDL, rihs01="RIHS01_0")
        payload = store.serialize_cdr(message(store, "x_msgs/msg/Soil", values), "x_msgs/msg/Soil")
        writer.write(connection, 5, payload)
    opened = BagSource(str(tmp_path / "run"), kind)
    assert opened.remarks == []
    assert fields(opened, "/soil")["torque"] == ("numbers", ("0", "1"))
    (batch,) = opened.read("/soil", ["sinkage", "torque[1]", "terrain"])
    assert (batch["sinkage"].item(), batch["torque[1]"].item()) == (0.02, 2.5)
    assert batch["terrain"].names == ("sand",)
    assert batch[STAMP].astype(int).tolist() == [7]


@kinds
def test_a_message_that_does_not_fit_is_named_by_its_number(tmp_path, kind):
    rows = [("/x", FLOAT, i, {"data": i + 0.5}) for i in range(10)]
    path = tmp_path / "run.bag"
    store = typestore(ros1=kind == "ros1")
    if kind == "ros1":
        with Ros1Writer(path) as writer:
            connection = writer.add_connection("/x", FLOAT, typestore=store)
            for i, _ in enumerate(rows):
                writer.write(connection, i, bytes(8 if i != 6 else 7))
    else:
        serialize = store.serialize_cdr
        count = itertools.count()
        store.serialize_cdr = lambda *a, **k: serialize(*a, **k)[: 12 if next(count) != 6 else 11]
        path = write_ros2(tmp_path / "run", rows, store, kind)
    reading = BagSource(str(path), kind).read("/x", ["data"], 4)
    assert len(next(reading)["data"]) == 4
    with pytest.raises(DamagedError, match="/x: message 7 does not fit its definition") as caught:
        next(reading)
    assert "\n" not in str(caught.value)
    assert caught.value.hint
