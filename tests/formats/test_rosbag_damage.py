"""Bags that are cut off, corrupt or never closed: one line that says so, and never a wrong number."""

from __future__ import annotations

import contextlib
import shutil
import sqlite3

import numpy as np
import pytest
from bags import MCAP, ROS1, typestore, write_ros1, write_ros2
from hypothesis import HealthCheck, given
from hypothesis import strategies as st
from profiles import examples

from formats.errors import DamagedError, FormatError
from formats.rosbag.bag_source import BagSource

JOINTS, FLOAT = "sensor_msgs/msg/JointState", "std_msgs/msg/Float64"
N = 120
TOOLS = {"ros1": "rosbag reindex", "mcap": "mcap recover", "db3": "sqlite3"}


def rows():
    for i in range(N):
        yield "/joints", JOINTS, 10 * i, {"name": ["fl", "fr"], "effort": [i / 8, -i]}
        yield "/speed", FLOAT, 10 * i + 1, {"data": i / 4}


def write(folder, kind, compression="none"):
    store = typestore(ros1=kind == "ros1")
    if kind == "ros1":
        return write_ros1(folder / "run.bag", rows(), store, compression, chunk=3_000)
    return write_ros2(folder / "run", rows(), store, kind, compression, chunk=3_000)


CASES = [("ros1", c) for c in ROS1] + [("mcap", c) for c in MCAP] + [("db3", "none")]


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    made = {}
    for kind, compression in CASES:
        made[kind, compression] = write(tmp_path_factory.mktemp("whole"), kind, compression).read_bytes()
    return made


def read_all(path, kind):
    opened = BagSource(str(path), kind)
    columns = {}
    for stream in opened.streams():
        for field in stream.fields:
            asked = [f"{field.name}[{element}]" for element in field.elements] or [field.name]
            if field.kind in {"number", "text", "time"} or field.elements:
                for batch in opened.read(stream.topic, asked, 50):
                    columns.setdefault((stream.topic, field.name), []).append(batch)
    return columns


def expect_damage(path, kind, match):
    with pytest.raises(DamagedError, match=match) as caught:
        read_all(path, kind)
    assert str(caught.value).startswith(f"{path}: ")
    assert "\n" not in str(caught.value)
    assert caught.value.hint
    assert caught.value.exit_code == 65
    return caught.value


kinds = pytest.mark.parametrize("kind", ["ros1", "mcap", "db3"])


@kinds
def test_nothing_in_it(tmp_path, kind):
    path = tmp_path / "empty"
    path.write_bytes(b"")
    expect_damage(path, kind, "the file is empty")


@kinds
def test_something_else(tmp_path, kind):
    path = tmp_path / "run.bag"
    path.write_text("time,torque\n0,1\n" * 20)
    with pytest.raises(DamagedError, match="it begins with b'time,torque"):
        BagSource(str(path), kind)


@pytest.mark.parametrize("share", [0.00005, 0.002, 0.03, 0.3, 0.6, 0.9, 0.97, 0.9999])
@pytest.mark.parametrize(("kind", "compression"), CASES)
def test_cut_off(tmp_path, whole, kind, compression, share):
    data = whole[kind, compression]
    path = tmp_path / "cut"
    path.write_bytes(data[: max(3, int(len(data) * share))])
    expect_damage(path, kind, "cut off")


def test_the_hint_names_the_tool(tmp_path, whole):
    for kind, tool in TOOLS.items():
        path = tmp_path / f"cut.{kind}"
        path.write_bytes(whole[kind, "none"][:-200])
        assert tool in expect_damage(path, kind, "cut off").hint


def test_ros1_cut_off_before_and_in_its_index(tmp_path, whole):
    data = whole["ros1", "none"]
    index = int.from_bytes(data[(at := data.index(b"index_pos=") + 10) : at + 8], "little")
    path = tmp_path / "cut.bag"
    path.write_bytes(data[:index])
    expect_damage(path, "ros1", f"its index is missing .it should begin at byte {index:,}, the file ends at")
    path.write_bytes(data[: index + 100])
    expect_damage(path, "ros1", "corrupt or cut off")


def test_ros1_that_was_never_closed(tmp_path, whole):
    data = bytearray(whole["ros1", "none"])
    at = data.index(b"index_pos=") + 10
    data[at : at + 8] = bytes(8)
    path = tmp_path / "run.bag.active"
    path.write_bytes(data)
    expect_damage(path, "ros1", "its index is missing: the recording was not closed properly")


def test_ros1_of_an_older_version(tmp_path, whole):
    path = tmp_path / "old.bag"
    path.write_bytes(whole["ros1", "none"].replace(b"V2.0", b"V1.2", 1))
    expect_damage(path, "ros1", "is not a ROS 1 bag .version 2.0.")


FRAMES = {"bz2": b"BZh9", "lz4": b"\x04\x22\x4d\x18", "zstd": b"\x28\xb5\x2f\xfd"}


@pytest.mark.parametrize(("kind", "compression"), [case for case in CASES if case[1] != "none"])
def test_corrupt_chunk(tmp_path, whole, kind, compression):
    """The other chunks are fine: what comes before the damage is right, then the error comes."""
    data = bytearray(whole[kind, compression])
    chunks = [at for at in range(len(data)) if data.startswith(FRAMES[compression], at)]
    assert len(chunks) > 3
    data[chunks[2] : chunks[2] + 9] = bytes(9)
    path = tmp_path / "run"
    path.write_bytes(data)
    reading = BagSource(str(path), kind).read("/speed", ["data"], 4)
    got = []

    def collect():
        for batch in reading:
            got.extend(batch["data"].tolist())

    with pytest.raises(DamagedError, match="corrupt or cut off") as caught:
        collect()
    assert caught.value.hint
    assert 0 < len(got) < N
    assert got == [i / 4 for i in range(len(got))]


@pytest.mark.parametrize("kind", ["mcap", "db3"])
@pytest.mark.parametrize("compression", ["file", "message"])
def test_corrupt_compressed_folder(tmp_path, kind, compression):
    file = write(tmp_path, kind, compression)
    data = bytearray(file.read_bytes())
    at = len(data) // 2 if compression == "file" else data.rindex(b"\x28\xb5\x2f\xfd")
    data[at : at + 9] = bytes(9)
    file.write_bytes(data)
    with pytest.raises(DamagedError, match="cut off"):
        read_all(tmp_path / "run", kind)


@pytest.mark.parametrize(
    "text",
    ["", "a: [", "rosbag2_bagfile_information: 3", "rosbag2_bagfile_information: {}", "\x00\x01", "- 1"],
)
def test_corrupt_metadata(tmp_path, text):
    write(tmp_path, "mcap")
    (tmp_path / "run" / "metadata.yaml").write_text(text)
    with pytest.raises(DamagedError, match=r"metadata\.yaml: corrupt or cut off"):
        BagSource(str(tmp_path / "run"), "mcap")


def test_mcap_that_states_more_messages_than_can_be_found(tmp_path, whole):
    """A chunk that no index mentions would otherwise be missing without a word."""
    data = bytearray(whole["mcap", "none"])
    # In the first chunk index, behind its opcode, its length, four numbers and the length of the
    # map: pairs of channel and offset.
    at = data.index(b"\x08", data.rindex(b"\x0f" + (4).to_bytes(8, "little")))
    while int.from_bytes(data[at + 1 : at + 9], "little") != 8 * 4 + 4 + 2 * 10 + 8 + 4 + 16:
        at = data.index(b"\x08", at + 1)
    channel = at + 9 + 32 + 4
    assert int.from_bytes(data[channel + 10 : channel + 12], "little") == 2
    data[channel + 10] = 9
    path = tmp_path / "run.mcap"
    path.write_bytes(data)
    expect_damage(path, "mcap", r"/speed: the file states 120 messages, \d+ can be found")


@pytest.mark.parametrize("ending", ["-wal", "-journal"])
def test_db3_that_was_never_closed(tmp_path, ending):
    path = write(tmp_path, "db3")
    (tmp_path / "run" / (path.name + ending)).write_bytes(bytes(32))
    hint = expect_damage(
        path, "db3", f"the recording was not closed: messages are left in run.db3{ending}"
    ).hint
    assert f"sqlite3 {path} 'PRAGMA journal_mode=DELETE'" in hint


def test_db3_whose_last_messages_are_in_a_log_beside_it(tmp_path):
    """The hint does what it says."""
    path = write(tmp_path, "db3")
    copy = tmp_path / "copy.db3"
    with sqlite3.connect(path) as database:
        database.execute("PRAGMA journal_mode=WAL")
        database.execute("UPDATE messages SET timestamp = timestamp + 7")
        database.commit()
        shutil.copy(path, copy)
        shutil.copy(f"{path}-wal", f"{copy}-wal")
    database.close()
    hint = expect_damage(copy, "db3", "messages are left in copy.db3-wal").hint
    with sqlite3.connect(copy) as database:
        database.execute(hint.partition("'")[2].rstrip("'"))
    database.close()
    (batch,) = BagSource(str(copy), "db3").read("/speed", ["data"])
    assert batch["@log"].astype(int).tolist() == [10 * i + 8 for i in range(N)]


def test_db3_without_the_tables_of_a_bag(tmp_path):
    path = tmp_path / "other.db3"
    with sqlite3.connect(path) as database:
        database.execute("CREATE TABLE x (y)")
    database.close()
    expect_damage(path, "db3", "no such table: messages")


@examples(120, suppress_health_check=list(HealthCheck))
@given(st.data(), st.sampled_from(CASES))
def test_any_damage_gives_an_error_of_ours_or_none(tmp_path_factory, whole, data, case):
    """Whatever rosbags, lz4, bz2, zstd or SQLite raise, a person reads one line."""
    broken = bytearray(whole[case])
    for _ in range(data.draw(st.integers(1, 4))):
        at = data.draw(st.integers(0, len(broken) - 1))
        if data.draw(st.booleans()):
            broken[at] = data.draw(st.integers(0, 255))
        else:
            broken[at : at + 16] = data.draw(st.binary(max_size=16))
    path = tmp_path_factory.mktemp("broken") / "run"
    path.write_bytes(broken)
    with contextlib.suppress(FormatError):
        for batches in read_all(path, case[0]).values():
            assert all(len(set(map(len, batch.values()))) == 1 for batch in batches)


@kinds
def test_the_undamaged_ones_read(tmp_path, kind):
    """The measure of the tests above."""
    columns = read_all(write(tmp_path, kind), kind)
    effort = np.concatenate([batch["effort[fl]"] for batch in columns["/joints", "effort"]])
    assert effort.tolist() == [i / 8 for i in range(N)]
