"""Segments as messages: what three readers of MCAP make of them."""

from __future__ import annotations

import math

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from rosbags.highlevel import AnyReader

from terrain_cli.errors import InputError
from terrain_cli.presentation import segment_files, segment_table

#: A clock in s since 1970.
T0 = 1_754_000_000.0


def table(**columns):
    """Build a table of the contract with five segments of two wheels, not in the order of time."""
    values = {
        "source": ["b.bag", "b.bag", "a.bag", "a.bag", "a.bag"],
        "wheel": ["front-left", "front-left", "front-left", "front left", "front left"],
        "segment": np.array([1, 2, 1, 1, 2]),
        "terrain": ["", "", "sand", "Böschung", ""],
        "t_start_s": T0 + np.array([100.0, 110.05, 0.0, 0.0, 10.0]),
        "t_end_s": T0 + np.array([110.0, 120.0, 9.95, 9.95, 10.0]),
        "method": ["ridge"] * 5,
        "status": ["ok", "not-separable", "ok", "ok", "ok"],
        "n_samples": np.arange(10, 15),
        "n_rejected": np.zeros(5, dtype=int),
        "c_kPa": np.array([1.5, math.nan, 0.1, 1 / 3, 2.0]),
        "WKT": [
            "LINESTRING (137.4 -4.5, 137.41 -4.51, 137.42 -4.52)",
            "",
            "POINT (137.5 -4.6)",
            None,
            "LINESTRING (179.9 0.0, -179.9 0.1)",
        ],
        "longitude_deg": np.array([137.41, math.nan, 137.5, math.nan, 180.0]),
        **columns,
    }
    nothing = np.full(5, math.nan)
    return {name: values.get(name, nothing) for name in segment_table.COLUMNS}


@pytest.fixture
def path(tmp_path):
    path = tmp_path / "out.mcap"
    segment_files.write(table(), str(path), "IAU_2015:49900")
    return path


def by_topic(path):
    messages = {}
    with AnyReader([path]) as reader:
        for connection, time, raw in reader.messages():
            message = reader.deserialize(raw, connection.msgtype)
            messages.setdefault(connection.topic, []).append((time, message))
    return messages


def test_rosbags_reads_two_messages_for_each_segment_by_time(path):
    messages = by_topic(path)
    assert {topic: len(some) for topic, some in messages.items()} == {
        "/terrain/front_left/estimate": 6,
        "/terrain/front_left/fix": 4,
        "/terrain/front_left_2/estimate": 4,
        "/terrain/front_left_2/fix": 2,
    }
    times, some = zip(*messages["/terrain/front_left/estimate"], strict=True)
    expected = T0 + np.array([0.0, 9.95, 100.0, 110.0, 110.05, 120.0])
    assert list(times) == [round(t * 1e6) * 1000 for t in expected]
    assert [m.header.stamp.sec * 10**9 + m.header.stamp.nanosec for m in some] == list(times)
    assert [(m.source, m.segment, m.end) for m in some] == [
        ("a.bag", 1, False),
        ("a.bag", 1, True),
        ("b.bag", 1, False),
        ("b.bag", 1, True),
        ("b.bag", 2, False),
        ("b.bag", 2, True),
    ]
    assert {m.header.frame_id for m in some} == {"front-left"}
    np.testing.assert_array_equal([m.c_kpa for m in some], [0.1, 0.1, 1.5, 1.5, math.nan, math.nan])
    assert [m.status for m in some][-1] == "not-separable"
    assert some[0].terrain == "sand"
    assert messages["/terrain/front_left_2/estimate"][0][1].terrain == "Böschung"


def test_every_column_is_a_field(path):
    (_, message), *_ = by_topic(path)["/terrain/front_left/estimate"]
    left_out = {"wheel", "WKT"}
    assert [name for name in vars(message) if not name.startswith("__")] == [
        "header",
        "end",
        *(name.lower() for name in segment_table.COLUMNS if name not in left_out),
    ]


def test_fixes_are_the_ends_of_tracks_where_they_are_known(path):
    fixes = by_topic(path)["/terrain/front_left/fix"]
    assert [(m.longitude, m.latitude) for _, m in fixes] == [
        (137.5, -4.6),
        (137.5, -4.6),
        (137.4, -4.5),
        (137.42, -4.52),
    ]
    assert {m.header.frame_id for _, m in fixes} == {"IAU_2015:49900"}
    assert all(math.isnan(m.altitude) and m.position_covariance_type == 0 for _, m in fixes)


def test_positions_of_a_site_frame_are_no_fixes(tmp_path):
    segment_files.write(table(), str(tmp_path / "out.mcap"), None)
    assert {topic.rpartition("/")[2] for topic in by_topic(tmp_path / "out.mcap")} == {"estimate"}


def test_the_library_of_mcap_reads_it(path):
    with path.open("rb") as file:
        summary = make_reader(file).get_summary()
    assert {schema.name: schema.encoding for schema in summary.schemas.values()} == {
        "terrain_est_msgs/msg/Segment": "ros2msg",
        "sensor_msgs/msg/NavSatFix": "ros2msg",
    }
    assert {channel.message_encoding for channel in summary.channels.values()} == {"cdr"}
    assert summary.statistics.message_start_time == int(T0) * 10**9
    # It takes the definitions from the file, with the rules that ROS 2 has for names.
    with path.open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        decoded = reader.iter_decoded_messages(topics=["/terrain/front_left_2/estimate"])
        values = [message.decoded_message.c_kpa for message in decoded]
    assert values == [1 / 3, 1 / 3, 2.0, 2.0]


def test_a_clock_from_zero_stays_one(tmp_path):
    segment_files.write(
        table(t_start_s=np.arange(5.0), t_end_s=np.arange(5) + 0.5), str(tmp_path / "out.mcap"), None
    )
    assert by_topic(tmp_path / "out.mcap")["/terrain/front_left/estimate"][1][0] == 500_000_000


def test_segments_without_time_are_refused(tmp_path):
    start = T0 + np.arange(5.0)
    start[1:3] = math.nan
    with pytest.raises(InputError, match="2 of 5 segments have no time"):
        segment_files.write(table(t_start_s=start), str(tmp_path / "out.mcap"), None)
    with pytest.raises(InputError, match="segments begin at -1 s"):
        segment_files.write(table(t_start_s=np.arange(5.0) - 1.0), str(tmp_path / "out.mcap"), None)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("wheels", "names"),
    [
        (["front-left", "front left", "front_left"], ["front_left", "front_left_2", "front_left_3"]),
        (["1", "", "--"], ["wheel_1", "wheel", "wheel_2"]),
        (["a_2", "a", "a "], ["a_2", "a", "a_3"]),
        (["Räd/hinten"], ["R_d_hinten"]),
    ],
)
def test_names_of_topics(wheels, names):
    assert segment_files._names(dict.fromkeys(wheels)) == dict(zip(wheels, names, strict=True))


def test_the_same_segments_give_the_same_bytes(path, tmp_path):
    segment_files.write(table(), str(tmp_path / "again.mcap"), "IAU_2015:49900")
    assert (tmp_path / "again.mcap").read_bytes() == path.read_bytes()
