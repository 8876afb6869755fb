"""Whole files in bulk give bit for bit what rosbags gives message by message."""

from __future__ import annotations

import sqlite3
from collections import Counter

import numpy as np
import pytest
from bags import typestore, write_ros1, write_ros2
from drawn import Values, types
from hypothesis import HealthCheck, Phase, given
from hypothesis import strategies as st
from plain_decoding import decoder, extract
from profiles import examples
from rosbags.rosbag1 import Reader as Ros1Reader
from rosbags.rosbag1 import Writer as Ros1Writer
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin
from rosbags.rosbag2 import Writer as Ros2Writer
from rosbags.rosbag2.storage_mcap import McapReader
from rosbags.typesys import Stores, get_typestore
from test_bulk_extraction import requests

from formats.errors import FormatError
from formats.rosbag.bag_source import BagSource
from formats.rosbag.definitions import define
from formats.rosbag.storage import chunks, mcap, ros1
from formats.table import LOG_TIME, Labels

CONTAINERS = [("ros1", c) for c in ("none", "bz2", "lz4")] + [("mcap", c) for c in ("none", "zstd")]
CONTAINERS.append(("db3", "none"))
FLOAT, JOINTS = "std_msgs/msg/Float64", "sensor_msgs/msg/JointState"


def write(folder, container, publishers, log, chunk):
    """Write messages of (topic, type, typestore), given as (place of the publisher, time, message)."""
    kind, compression = container
    if kind == "ros1":
        path = folder / "run.bag"
        writer = Ros1Writer(path)
        if compression != "none":
            writer.set_compression(Ros1Writer.CompressionFormat[compression.upper()])
        writer.chunk_threshold = chunk
    else:
        plugin = StoragePlugin.MCAP if kind == "mcap" else StoragePlugin.SQLITE3
        writer = Ros2Writer(folder / "run", version=9, storage_plugin=plugin)
        if compression == "zstd":
            writer.set_compression(CompressionMode.STORAGE, CompressionFormat.ZSTD)
    with writer:
        connections = []
        for place, (topic, name, store) in enumerate(publishers):
            extra = {"callerid": f"/node{place}"} if kind == "ros1" else {}
            connections.append(writer.add_connection(topic, name, typestore=store, **extra))
        for place, time, message in log:
            _, name, store = publishers[place]
            serialise = store.serialize_ros1 if kind == "ros1" else store.serialize_cdr
            writer.write(connections[place], time, bytes(serialise(message, name)))
            if kind == "mcap" and writer.storage.chunk.bio.tell() > chunk:
                writer.storage.close_chunk()
    return path if kind == "ros1" else next(f for f in (folder / "run").iterdir() if f.suffix != ".yaml")


def one_by_one(path, kind):
    """Return (connection, time, payload) of every message by log time, ties as in the file."""
    if kind == "db3":
        with sqlite3.connect(path) as database:
            rows = database.execute("SELECT topic_id, timestamp, data FROM messages ORDER BY timestamp, id")
            found = rows.fetchall()
        database.close()
        return found
    reader = (Ros1Reader if kind == "ros1" else McapReader)(path)
    reader.open()
    found = [(c.id, time, bytes(data)) for c, time, data in reader.messages(list(reader.connections))]
    reader.close()
    return found


def joined(batches):
    names = batches[0].keys() if batches else ()
    columns = {}
    for name in names:
        pieces = [batch[name] for batch in batches]
        if isinstance(pieces[0], Labels):
            pieces = [np.array([*p.names, None], dtype=object)[p.codes] for p in pieces]
        columns[name] = np.concatenate(pieces)
    return columns


def expected_of(source, path, kind):
    """Return every column of every topic that has messages, as rosbags decodes them."""
    places = {c.id: c for c in source._container.connections}
    definitions = {number: define(c, ros1=kind == "ros1") for number, c in places.items()}
    decoded = {number: decoder(definition) for number, definition in definitions.items()}
    by_topic = {}
    for number, time, data in one_by_one(path, kind):
        topic = by_topic.setdefault(places[number].topic, [])
        topic.append((definitions[number], time, decoded[number](data)))
    expected = {}
    for topic, messages in by_topic.items():
        first = next(number for number, c in places.items() if c.topic == topic)
        times = np.array([time for _, time, _ in messages], dtype=np.int64)
        expected[topic] = {LOG_TIME: times.view("datetime64[ns]")}
        for leaf, request in requests(definitions[first]):
            column, present = plainly(messages, leaf, request)
            if present:
                expected[topic][request.asked] = column
    return expected


def plainly(messages, leaf, request):
    """Take one value from each message, whatever its publisher calls by that name."""
    parts, present = [], False
    for definition, _, message in messages:
        own = definition.leaves.get(leaf.name)
        if own is None or own.kind != leaf.kind:
            parts.append(request.blank(1))
            continue
        value, there = extract([message], own, request)
        parts.append(value)
        present = present or there
    return np.concatenate(parts), present


def assert_same(path, kind, batch_rows):
    """Compare every field of every topic with rosbags' decoding; return the columns by topic."""
    source = BagSource(str(path), kind)
    expected = expected_of(source, path, kind)
    for stream in source.streams():
        assert stream.count == len(expected.get(stream.topic, {LOG_TIME: ()})[LOG_TIME])
    asked = {topic: [name for name in columns if name != LOG_TIME] for topic, columns in expected.items()}
    together = {topic: [] for topic in asked}
    for topic, batch in source.read_together(asked, batch_rows):
        assert 0 < len(batch[LOG_TIME]) <= batch_rows
        together[topic].append(batch)
    for topic, columns in expected.items():
        alone = list(source.read(topic, asked[topic], batch_rows))
        assert [len(b[LOG_TIME]) for b in alone] == [len(b[LOG_TIME]) for b in together[topic]]
        for found in (joined(alone), joined(together[topic])):
            for name, column in columns.items():
                equal_to_the_bit(found[name], column, f"{topic} {name}")
    return expected


def equal_to_the_bit(found, column, name):
    assert found.dtype == column.dtype, name
    if column.dtype == float:  # −0.0 is not 0.0
        np.testing.assert_array_equal(np.signbit(found), np.signbit(column), err_msg=name)
    np.testing.assert_array_equal(found, column, err_msg=name)


@examples(120, suppress_health_check=list(HealthCheck), phases=[Phase.generate])
@given(st.data())
def test_any_definitions_in_any_container(tmp_path_factory, data):
    """Ragged messages, several publishers and definitions of a topic, times that tie and run back."""
    container = data.draw(st.sampled_from(CONTAINERS))
    publishers, makers = [], []
    for topic in data.draw(st.lists(st.sampled_from(["/a", "/a", "/b"]), min_size=1, max_size=3)):
        made = data.draw(types())
        store = get_typestore(Stores.EMPTY)
        store.register(made)
        name = list(made)[-1]
        if container[0] != "ros1" and name in {other for _, other, _ in publishers}:
            # rosbags writes one definition for all types of a name into a file of ROS 2.
            continue
        publishers.append((topic, name, store))
        makers.append(
            Values(
                store,
                data.draw(st.integers(0, 2**32)),
                even_numbers=data.draw(st.booleans()),
                even_items=data.draw(st.booleans()),
            )
        )
    step = data.draw(st.sampled_from([0, 1, 5]))
    log = []
    for i in range(data.draw(st.integers(1, 30))):
        place = data.draw(st.integers(0, len(publishers) - 1))
        time = 10**9 + 3 * i + (data.draw(st.integers(-step, step)) if step else 0) - (i % 2 if step else 0)
        log.append((place, time, makers[place].message(publishers[place][1])))
    chunk = data.draw(st.sampled_from([1, 200, 2_000, 1 << 20]))
    path = write(tmp_path_factory.mktemp("bag"), container, publishers, log, chunk)
    size = data.draw(st.sampled_from([1, 300, 1 << 23]))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("formats.rosbag.containers.Container.runs.__defaults__", (size,))
        assert_same(path, container[0], data.draw(st.sampled_from([1, 4, 65_536])))


def rows(n=200):
    for i in range(n):
        yield "/joints", JOINTS, 100 * i, {"name": ["fl", "fr"], "effort": [i / 8, -i]}
        yield "/speed", FLOAT, 100 * i + 1, {"data": i / 4}


@pytest.mark.parametrize("container", CONTAINERS, ids="-".join)
def test_one_pass_over_all_topics(tmp_path, container, monkeypatch):
    """Each chunk is unpacked once however many topics are read."""
    kind, compression = container
    store = typestore(ros1=kind == "ros1")
    if kind == "ros1":
        path = write_ros1(tmp_path / "run.bag", rows(), store, compression, chunk=3_000)
    else:
        path = write_ros2(tmp_path / "run", rows(), store, kind, compression, chunk=3_000)
    source = BagSource(str(path), kind)
    source.streams()
    read = Counter()
    plain = chunks._read
    monkeypatch.setattr(
        chunks, "_read", lambda file, position, size: read.update([position]) or plain(file, position, size)
    )
    found = {"/joints": [], "/speed": []}
    for topic, batch in source.read_together({"/joints": ["effort[fl]"], "/speed": ["data"]}):
        found[topic].append(batch)
    assert set(read.values()) <= {1}
    assert joined(found["/joints"])["effort[fl]"].tolist() == [i / 8 for i in range(200)]
    assert joined(found["/speed"])["data"].tolist() == [i / 4 for i in range(200)]


def test_topics_that_begin_together_are_listed_together(tmp_path, monkeypatch):
    """What lists hold stands in first messages: a chunk is read once for all that begin in it."""
    joints = [
        (f"/joints{k}", JOINTS, 1_000 * (k // 4) + i, {"name": [f"wheel{k}"], "effort": [0.5]})
        for k in range(12)
        for i in range(60)
    ]
    joints.sort(key=lambda row: row[2])
    path = write_ros2(tmp_path / "run", joints, typestore(ros1=False), "mcap", "zstd", chunk=15_000)
    taken = []
    plain = chunks._read
    monkeypatch.setattr(
        chunks,
        "_read",
        lambda file, position, size: taken.append(position) or plain(file, position, size),
    )
    source = BagSource(str(path), "mcap")
    elements = {s.topic: f.elements for s in source.streams() for f in s.fields if f.name == "effort"}
    assert elements == {f"/joints{k}": (f"wheel{k}",) for k in range(12)}
    begins = {chunk.position for chunk in source._container._readers[0][0].chunks}
    assert len(begins) > 3
    assert len([position for position in taken if position in begins]) <= 6


def test_fields_of_ros1_headers_in_any_order(tmp_path):
    """Each second message has the fields of its header the other way round, of equal length."""
    path = write_ros1(tmp_path / "run.bag", rows(), typestore(ros1=True), chunk=1 << 20)
    data = bytearray(path.read_bytes())
    reader = Ros1Reader(path)
    reader.open()
    (chunk,) = reader.chunks.values()
    entries = sorted(entry for index in reader.indexes.values() for entry in index)
    reader.close()
    turned = 0
    for entry in entries[::2]:
        at = chunk.datapos + entry.offset
        length = int.from_bytes(data[at : at + 4], "little")
        header, fields = bytes(data[at + 4 : at + 4 + length]), []
        while header:
            size = 4 + int.from_bytes(header[:4], "little")
            fields.append(header[:size])
            header = header[size:]
        data[at + 4 : at + 4 + length] = b"".join(fields[::-1])
        turned += 1
    assert turned == 200
    path.write_bytes(data)
    expected = assert_same(path, "ros1", 64)
    assert expected["/speed"]["data"][-1] == 199 / 4


def test_an_index_that_points_at_the_connection_before_its_message(tmp_path):
    """As some writers of ROS 1 leave it."""
    path = write_ros1(tmp_path / "run.bag", rows(40), typestore(ros1=True), chunk=1 << 20)
    data = bytearray(path.read_bytes())
    reader = Ros1Reader(path)
    reader.open()
    (chunk,) = reader.chunks.values()
    firsts = [index[0] for index in reader.indexes.values()]
    reader.close()
    changed = 0
    for entry in firsts:
        begin = at = 0
        while at < entry.offset:
            begin = at
            for _ in ("header", "data"):
                start = chunk.datapos + at
                at += 4 + int.from_bytes(data[start : start + 4], "little")
        old = (entry.time // 10**9).to_bytes(4, "little") + (entry.time % 10**9).to_bytes(4, "little")
        where = data.index(old + entry.offset.to_bytes(4, "little"), chunk.datapos + chunk.datasize)
        data[where + 8 : where + 12] = begin.to_bytes(4, "little")
        changed += 1
    assert changed == 2
    path.write_bytes(data)
    assert_same(path, "ros1", 64)


def test_mcap_chunks_without_an_index_are_walked(tmp_path):
    """As `ros2 bag record` with noMessageIndex leaves them; rosbags reads nothing of those."""
    folder, store = tmp_path / "run", typestore(ros1=False)
    whole = write_ros2(tmp_path / "whole", rows(), store, "mcap", chunk=3_000)
    writer = Ros2Writer(folder, version=9, storage_plugin=StoragePlugin.MCAP)
    with writer:
        connections = {}
        for topic, kind, *_ in rows(1):
            connections[topic] = writer.add_connection(topic, kind, typestore=store)
        reader = McapReader(whole)
        reader.open()
        for connection, time, data in reader.messages(list(reader.connections)):
            writer.write(connections[connection.topic], time, data)
            writer.storage.chunk.msgs.clear()
            if writer.storage.chunk.bio.tell() > 3_000:
                writer.storage.close_chunk()
        reader.close()
    a, b = BagSource(str(whole), "mcap"), BagSource(str(folder / "run.mcap"), "mcap")
    assert [stream.count for stream in b.streams()] == [200, 200]
    for topic, name in (("/joints", "effort[fr]"), ("/speed", "data")):
        first, second = (joined(list(source.read(topic, [name]))) for source in (a, b))
        np.testing.assert_array_equal(first[name], second[name])
        np.testing.assert_array_equal(first[LOG_TIME], second[LOG_TIME])


@pytest.mark.parametrize("container", CONTAINERS[:5], ids="-".join)
def test_an_index_that_lies(tmp_path, container):
    """Its entries of one connection name the messages of another: an error, never their numbers."""
    kind, compression = container
    store = typestore(ros1=kind == "ros1")
    pair = [
        ("/x", FLOAT, i // 2, {"data": float(i)}) if i % 2 else ("/y", FLOAT, i // 2, {"data": -1.0})
        for i in range(80)
    ]
    if kind == "ros1":
        path = write_ros1(tmp_path / "run.bag", pair, store, compression)
    else:
        path = write_ros2(tmp_path / "run", pair, store, kind, compression)
    data = bytearray(path.read_bytes())
    file = (ros1.Ros1File if kind == "ros1" else mcap.McapFile)(path)
    file.open()
    file.close()
    (first, count), (second, _) = (place for chunk in file.chunks for place in chunk.index.values())
    size = count * file.entry.itemsize
    data[first : first + size], data[second : second + size] = (
        data[second : second + size],
        data[first : first + size],
    )
    path.write_bytes(data)
    with pytest.raises(FormatError, match="corrupt or cut off"):
        list(BagSource(str(path), kind).read("/x", ["data"]))
