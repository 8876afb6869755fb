"""Every container and compression gives back what was written."""

from __future__ import annotations

import itertools
import os
import shutil
import sqlite3
from pathlib import Path

import numpy as np
import pytest
from bags import FOLDER, MCAP, ROS1, typestore, write_ros1, write_ros2
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Ros2Writer

from formats.errors import FormatError, NotFoundError
from formats.rosbag.bag_source import BagSource
from formats.table import LOG_TIME, STAMP, Labels

WRENCH, SOIL = "geometry_msgs/msg/WrenchStamped", "rover_msgs/msg/Soil"
CUSTOM = {SOIL: "string terrain\nfloat32 moisture\ntime stamp\nduration age\nbool wet\n"}
CUSTOM_ROS2 = {
    SOIL: CUSTOM[SOIL]
    .replace("time stamp", "builtin_interfaces/Time stamp")
    .replace("duration age", "builtin_interfaces/Duration age")
}
START = 1_700_000_000_000_000_000
N = 60


def rows():
    for i in range(N):
        time = START + 20_000_000 * i
        stamp = 0 if i == 7 else time - 3_000_001
        force = {"x": 0.1 * i, "y": -1e300, "z": 1 / (i + 1)}
        yield (
            "/wrench",
            WRENCH,
            time,
            {"header": {"stamp": stamp, "frame_id": "w"}, "wrench": {"force": force}},
        )
        if i % 3 == 0:
            terrain = ("sand", "gravel", "Kies ä")[i % 9 // 3]
            yield (
                "/soil",
                SOIL,
                time + 1,
                {
                    "terrain": terrain,
                    "moisture": 0.25 * i,
                    "stamp": time,
                    "age": 300_000_000 * i,
                    "wet": i % 2 == 0,
                },
            )


@pytest.fixture(
    params=[("ros1", c) for c in ROS1] + [("mcap", c) for c in MCAP] + [("db3", "none")], ids="-".join
)
def bag(request, tmp_path):
    kind, compression = request.param
    if kind == "ros1":
        return write_ros1(
            tmp_path / "run.bag", rows(), typestore(CUSTOM, ros1=True), compression, chunk=900
        ), kind
    store = typestore(CUSTOM_ROS2, ros1=False)
    return write_ros2(tmp_path / "run", rows(), store, kind, compression, chunk=900), kind


def check(path, kind):
    source = BagSource(str(path), kind)
    streams = {stream.topic: stream for stream in source.streams()}
    assert list(streams) == ["/wrench", "/soil"]
    assert (source.path, source.kind) == (str(path), kind)
    assert streams["/wrench"].type == WRENCH
    assert (streams["/wrench"].count, streams["/soil"].count) == (N, N // 3)
    assert (streams["/wrench"].start, streams["/wrench"].end) == (START, START + 20_000_000 * (N - 1))
    kinds = {field.name: field.kind for field in streams["/soil"].fields}
    assert kinds == {
        "terrain": "text",
        "moisture": "number",
        "stamp": "time",
        "age": "number",
        "wet": "number",
    }

    batches = list(source.read("/wrench", ["wrench.force.z", "wrench.force.y", "header.frame_id"], 25))
    assert [len(batch[LOG_TIME]) for batch in batches] == [25, 25, 10]
    assert set(batches[0]) == {"wrench.force.z", "wrench.force.y", "header.frame_id", LOG_TIME, STAMP}
    log = np.concatenate([batch[LOG_TIME] for batch in batches])
    assert log.dtype == "datetime64[ns]"
    np.testing.assert_array_equal(log.astype(int), START + 20_000_000 * np.arange(N))
    stamp = np.concatenate([batch[STAMP] for batch in batches])
    assert np.flatnonzero(np.isnat(stamp)).tolist() == [7]
    np.testing.assert_array_equal(np.delete(stamp, 7).astype(int), np.delete(log, 7).astype(int) - 3_000_001)
    force = np.concatenate([batch["wrench.force.z"] for batch in batches])
    assert force.dtype == np.float64
    np.testing.assert_array_equal(force, [1 / (i + 1) for i in range(N)])
    assert (batches[1]["wrench.force.y"] == -1e300).all()
    assert batches[2]["header.frame_id"].names == ("w",)

    (soil,) = source.read("/soil", ["terrain", "moisture", "stamp", "age", "wet"])
    assert isinstance(soil["terrain"], Labels)
    assert soil["terrain"].names == ("sand", "gravel", "Kies ä")
    np.testing.assert_array_equal(soil["terrain"].codes, np.arange(N // 3) % 3)
    np.testing.assert_array_equal(soil["moisture"], 0.75 * np.arange(N // 3))
    np.testing.assert_array_equal(soil["stamp"].astype(int), soil[LOG_TIME].astype(int) - 1)
    np.testing.assert_array_equal(soil["age"], [9 * i / 10 for i in range(N // 3)])
    np.testing.assert_array_equal(soil["wet"], np.arange(N // 3) % 2 == 0)
    assert np.isnat(soil[STAMP]).all()
    return source


def test_single_file(bag):
    assert check(*bag).remarks == []


def test_kind_is_not_told_by_the_ending(bag, tmp_path):
    path, kind = bag
    odd = tmp_path / "what #1? 100%"
    shutil.copy(path, odd)
    check(odd, kind)


@pytest.mark.parametrize("compression", FOLDER)
@pytest.mark.parametrize("kind", ["mcap", "db3"])
def test_folder(tmp_path, kind, compression):
    write_ros2(tmp_path / "run", rows(), typestore(CUSTOM_ROS2, ros1=False), kind, compression, chunk=900)
    assert check(tmp_path / "run", kind).remarks == []


@pytest.mark.parametrize("kind", ["mcap", "db3"])
def test_folder_of_an_interrupted_recording(tmp_path, kind):
    write_ros2(tmp_path / "run", rows(), typestore(CUSTOM_ROS2, ros1=False), kind)
    (tmp_path / "run" / "metadata.yaml").unlink()
    assert "metadata.yaml is missing" in check(tmp_path / "run", kind).remarks[0]


@pytest.mark.parametrize("kind", ["mcap", "db3"])
def test_folder_split_into_files(tmp_path, kind):
    store = typestore(CUSTOM_ROS2, ros1=False)
    whole = tmp_path / "run"
    whole.mkdir()
    everything = list(rows())
    names = []
    for i, part in enumerate((everything[:30], everything[30:70], everything[70:])):
        file = write_ros2(tmp_path / f"part{i}", part, store, kind)
        names.append(f"run_{9 + i}.{kind}")  # "run_10" sorts before "run_9" as a text
        shutil.move(file, whole / names[-1])
    storage = {"mcap": "mcap", "db3": "sqlite3"}[kind]
    (whole / "metadata.yaml").write_text(
        "rosbag2_bagfile_information:\n"
        f"  version: 4\n  storage_identifier: {storage}\n  compression_mode: ''\n"
        f"  relative_file_paths: [{', '.join(f'run/{name}' for name in names)}]\n"
    )
    check(whole, kind)
    (whole / "metadata.yaml").unlink()
    check(whole, kind)


def test_folder_with_a_file_missing(tmp_path):
    file = write_ros2(tmp_path / "run", rows(), typestore(CUSTOM_ROS2, ros1=False), "mcap")
    file.unlink()
    with pytest.raises(NotFoundError, match=r"not there: run\.mcap"):
        BagSource(str(tmp_path / "run"), "mcap")


def test_folder_in_an_unknown_compression(tmp_path):
    write_ros2(tmp_path / "run", rows(), typestore(CUSTOM_ROS2, ros1=False), "mcap")
    metadata = tmp_path / "run" / "metadata.yaml"
    text = metadata.read_text().replace("compression_mode: ''", "compression_mode: FILE")
    metadata.write_text(text.replace("compression_format: ''", "compression_format: lzma"))
    with pytest.raises(FormatError, match="compressed with 'lzma'"):
        BagSource(str(tmp_path / "run"), "mcap")


def test_no_such_file(tmp_path):
    with pytest.raises(NotFoundError, match=r"nothing\.bag: no such file"):
        BagSource(str(tmp_path / "nothing.bag"), "ros1")
    with pytest.raises(NotFoundError, match=r"neither metadata\.yaml nor a db3 file"):
        BagSource(str(tmp_path), "db3")


def test_no_permission(bag):
    path, kind = bag
    path.chmod(0)
    root = os.geteuid() == 0
    if root:
        os.seteuid(65_534)  # root may read anything
    try:
        with pytest.raises(NotFoundError, match="Permission denied"):
            BagSource(str(path), kind)
    finally:
        if root:
            os.seteuid(0)


def test_two_topics_read_by_turns(bag):
    source = BagSource(str(bag[0]), bag[1])
    turns = zip(
        source.read("/wrench", ["wrench.force.x"], 3), source.read("/soil", ["moisture"], 1), strict=True
    )
    force, moisture = [], []
    for first, second in turns:
        force += first["wrench.force.x"].tolist()
        moisture += second["moisture"].tolist()
    assert force == [0.1 * i for i in range(N)]
    assert moisture == [0.75 * i for i in range(N // 3)]


def test_mcap_without_chunks(tmp_path):
    """As `ros2 bag record --storage-preset-profile fastwrite` leaves it; not quite in order of time."""
    path = write_ros2(tmp_path / "run", list(rows()), typestore(CUSTOM_ROS2, ros1=False), "mcap")
    flat = tmp_path / "flat.mcap"
    data = path.read_bytes()
    # Header record, the contents of the one chunk, an end of data, a footer without a summary.
    begin = 8 + 9 + int.from_bytes(data[9:17], "little")
    size = int.from_bytes(data[begin + 9 + 16 : begin + 9 + 24], "little")
    records = data[begin + 9 + 40 : begin + 9 + 40 + size]
    end = b"\x0f" + (4).to_bytes(8, "little") + bytes(4) + b"\x02" + (20).to_bytes(8, "little") + bytes(20)
    flat.write_bytes(data[:begin] + records + end + data[:8])
    source = BagSource(str(flat), "mcap")
    assert [(stream.count, stream.start) for stream in source.streams()] == [(N, None), (N // 3, None)]
    wrench, soil = source.read("/wrench", ["wrench.force.z"], 7), source.read("/soil", ["moisture"], 7)
    force = [
        float(x) for first, second in itertools.zip_longest(wrench, soil) for x in first["wrench.force.z"]
    ]
    assert force == [1 / (i + 1) for i in range(N)]


def test_mcap_of_another_profile(tmp_path):
    path = write_ros2(tmp_path / "run", list(rows()), typestore(CUSTOM_ROS2, ros1=False), "mcap")
    path.write_bytes(path.read_bytes().replace(b"ros2", b"ros1", 1))
    with pytest.raises(FormatError, match="profile is 'ros1'") as caught:
        BagSource(str(path), "mcap")
    assert caught.value.exit_code == 65


@pytest.mark.parametrize("kind", ["mcap", "db3"])
def test_two_publishers_of_one_topic(tmp_path, kind):
    store = typestore(ros1=False)
    with Ros2Writer(
        tmp_path / "run",
        version=9,
        storage_plugin=StoragePlugin.MCAP if kind == "mcap" else StoragePlugin.SQLITE3,
    ) as writer:
        ids = [
            writer.add_connection("/x", "std_msgs/msg/Float64", typestore=store, serialization_format=fmt)
            for fmt in ("cdr", "CDR")
        ]
        for i in range(20):
            payload = store.serialize_cdr(
                store.types["std_msgs/msg/Float64"](float(i)), "std_msgs/msg/Float64"
            )
            writer.write(ids[i % 3 == 0], 100 * i, payload)
    (file,) = (tmp_path / "run").glob(f"*.{kind}")
    for path in (file, tmp_path / "run"):
        source = BagSource(str(path), kind)
        assert [stream.count for stream in source.streams()] == [20]
        (batch,) = source.read("/x", ["data"])
        assert batch["data"].tolist() == list(range(20))


def test_db3_with_a_type_that_has_no_definition(tmp_path):
    """Recorders write an empty definition where they cannot find one; the rest stays readable."""
    path = write_ros2(tmp_path / "run", rows(), typestore(CUSTOM_ROS2, ros1=False), "db3")
    with sqlite3.connect(path) as database:
        database.execute(
            "UPDATE message_definitions SET encoding='', encoded_message_definition='' WHERE topic_type=?",
            (SOIL,),
        )
    database.close()
    source = BagSource(str(path), "db3")
    soil = source.streams()[1]
    assert (soil.type, soil.fields, soil.count) == (SOIL, (), N // 3)
    assert source.remarks == [f"/soil cannot be read: {SOIL}: the file has no definition of it"]
    with pytest.raises(FormatError, match="/soil cannot be read") as caught:
        source.read("/soil", [])
    assert caught.value.hint
    (batch,) = source.read("/wrench", ["wrench.force.x"])
    assert len(batch["wrench.force.x"]) == N


OTHER = CUSTOM_ROS2[SOIL].replace("string terrain\nfloat32 moisture", "string moisture\nfloat32 terrain")


def insert_definition(database, type_hash, text):
    columns = ("topic_type", "encoding", "encoded_message_definition", "type_description_hash")
    database.execute(
        f"INSERT INTO message_definitions ({', '.join(columns)}) VALUES (?, ?, ?, ?)",  # noqa: S608
        (SOIL, "ros2msg", text, type_hash),
    )


def test_db3_with_two_definitions_of_a_type_is_read_by_that_of_the_topics_hash(tmp_path):
    path = write_ros2(tmp_path / "run", rows(), typestore(CUSTOM_ROS2, ros1=False), "db3")
    with sqlite3.connect(path) as database:
        insert_definition(database, "RIHS01_other", OTHER)
    database.close()
    (batch,) = BagSource(str(path), "db3").read("/soil", ["moisture"])
    assert batch["moisture"].tolist() == [0.25 * i for i in range(0, N, 3)]


@pytest.mark.parametrize(("text", "read"), [(OTHER, False), (CUSTOM_ROS2[SOIL], True)], ids=["other", "same"])
def test_db3_where_nothing_says_which_definition_holds_is_not_guessed(tmp_path, text, read):
    path = write_ros2(tmp_path / "run", rows(), typestore(CUSTOM_ROS2, ros1=False), "db3")
    with sqlite3.connect(path) as database:
        definition = "encoded_message_definition"
        ((known,),) = database.execute(
            f"SELECT {definition} FROM message_definitions WHERE topic_type=?",  # noqa: S608
            (SOIL,),
        )
        database.execute("UPDATE message_definitions SET type_description_hash=''")
        insert_definition(database, "", known if read else text)
        database.execute("UPDATE topics SET type_description_hash=''")
    database.close()
    source = BagSource(str(path), "db3")
    if read:
        (batch,) = source.read("/soil", ["moisture"])
        assert len(batch["moisture"]) == N // 3
        return
    with pytest.raises(FormatError, match="/soil cannot be read"):
        source.read("/soil", ["moisture"])


def test_mcap_with_a_topic_that_is_not_of_ros(tmp_path):
    """Foxglove's JSON beside it: that topic is told of, the others are read."""
    from mcap_ros2.writer import Writer

    path = tmp_path / "run.mcap"
    with path.open("wb") as file:
        writer = Writer(file)
        schema = writer.register_msgdef("std_msgs/msg/Float64", "float64 data")
        own = writer._writer.register_schema("foxglove.Log", "jsonschema", b"{}")
        channel = writer._writer.register_channel("/log", "json", own)
        for i in range(20):
            writer.write_message("/x", schema, {"data": float(i)}, log_time=100 * i)
            writer._writer.add_message(channel, 100 * i, b"{}", 100 * i)
        writer.finish()
    source = BagSource(str(path), "mcap")
    assert [stream.topic for stream in source.streams() if stream.fields] == ["/x"]
    assert source.remarks == ["/log cannot be read: foxglove.Log: the file has no definition of it"]
    (batch,) = source.read("/x", ["data"])
    assert batch["data"].tolist() == list(range(20))


@pytest.mark.parametrize("schema", [1, 2, 4])
def test_db3_as_older_recorders_wrote_it(tmp_path, schema):
    """Without definitions; before version 4 without hashes, before version 2 without profiles."""
    path = write_ros2(tmp_path / "run", rows(), typestore(CUSTOM_ROS2, ros1=False), "db3")
    with sqlite3.connect(path) as database:
        database.execute("DELETE FROM message_definitions")
        if schema < 4:
            database.execute("DROP TABLE message_definitions")
            database.execute("DROP TABLE schema")
            database.execute("ALTER TABLE topics DROP COLUMN type_description_hash")
        if schema < 2:
            database.execute("ALTER TABLE topics DROP COLUMN offered_qos_profiles")
    database.close()
    source = BagSource(str(path), "db3")
    (batch,) = source.read("/wrench", ["wrench.force.z"])
    assert batch["wrench.force.z"][1] == 0.5
    assert f"no definition in the file of {WRENCH}: read as ROS 2 Humble defines it" in source.remarks


def test_a_standard_type_that_differs_from_the_recorded_hash_is_not_guessed(tmp_path):
    path = write_ros2(tmp_path / "run", rows(), typestore(CUSTOM_ROS2, ros1=False), "db3")
    with sqlite3.connect(path) as database:
        database.execute("DELETE FROM message_definitions")
        database.execute("UPDATE topics SET type_description_hash='RIHS01_0'")
    database.close()
    with pytest.raises(FormatError, match="the file has no definition of it"):
        BagSource(str(path), "db3").read("/wrench", ["wrench.force.z"])


def open_in(folder):
    """Return the files in a folder that this process holds open (Linux only, else none)."""
    links = Path("/proc/self/fd").glob("*")
    # The descriptor that lists the folder is gone by now.
    names = (os.path.realpath(link) for link in links)
    return [name for name in names if name.startswith(str(folder))]


def test_many_open_and_dropped_leave_no_file_open(bag):
    for _ in range(5):
        BagSource(str(bag[0]), bag[1]).streams()
    assert not open_in(bag[0].parent)
