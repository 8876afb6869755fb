"""Messages out of chunks: in the order of time, and without any index."""

from __future__ import annotations

from contextlib import closing
from itertools import pairwise

import numpy as np
import pytest
from bags import typestore, write_ros1
from rosbags.rosbag2.storage_mcap import McapReader

from formats import open_source
from formats.rosbag.storage import mcap, record_file, ros1

FLOAT = "std_msgs/msg/Float64"


def test_runs_are_parted_by_time(tmp_path):
    """Chunks that overlap in time: no message comes before one that was yielded earlier."""
    late = [("/x", FLOAT, 10 * i + (500 if i % 7 == 0 else 0), {"data": float(i)}) for i in range(300)]
    path = write_ros1(tmp_path / "run.bag", late, typestore(ros1=True), chunk=400)
    file = ros1.Ros1File(path)
    file.open()
    times = [run[number].times for run in file.runs({0}, 1) for number in run]
    file.close()
    assert len(times) > 10
    assert all(a[-1] <= b[0] for a, b in pairwise(times))
    assert sorted(t for _, _, t, _ in late) == np.concatenate(times).tolist()


@pytest.mark.parametrize("chunking", [True, False], ids=["chunks", "no chunks"])
@pytest.mark.parametrize("compression", ["none", "lz4", "zstd"])
@pytest.mark.parametrize("least", [40, 1 << 16])
def test_mcap_without_any_index_is_read_as_rosbags_does(tmp_path, monkeypatch, chunking, compression, least):
    from mcap.writer import CompressionType, IndexType, Writer

    path = tmp_path / "run.mcap"
    with path.open("wb") as file:
        packing = getattr(CompressionType, compression.upper())
        writer = Writer(file, 300, compression=packing, index_types=IndexType.NONE, use_chunking=chunking)
        writer.start(profile="ros2")
        types = {
            "/x": ("std_msgs/msg/Float64", b"float64 data"),
            "/name": ("std_msgs/msg/String", b"string data"),
        }
        numbers = {
            topic: writer.register_channel(topic, "cdr", writer.register_schema(name, "ros2msg", text))
            for topic, (name, text) in types.items()
        }
        for i in range(100):
            time = 1_000 - i if i % 7 == 3 else 1_000 + i
            writer.add_message(numbers["/x"], time, bytes([i]) * 12, time)
            writer.add_message(numbers["/name"], 1_000 + i, b"x" * (i * 37 % 200), 1_000 + i)
        writer.finish()
    reader = McapReader(path)
    reader.open()
    with closing(reader):
        known = [(c.topic, time, bytes(data)) for c, time, data in reader.messages_scan(reader.connections)]
    monkeypatch.setattr(record_file, "CHUNK_BYTES", least << 5)
    file = mcap.McapFile(path)
    file.open()
    topics = {c.id: c.topic for c in file.connections}
    assert set(topics.values()) == {"/x", "/name"}
    for size in (1, 500, 1 << 20):
        found = [
            (topics[number], int(time), bytes(messages.payload(row)), int(messages.order[row]))
            for run in file.runs(set(topics), size)
            for number, messages in run.items()
            for row, time in enumerate(messages.times)
        ]
        found.sort(key=lambda one: one[3])
        assert [one[:3] for one in found] == known
        (alone,) = {c for c, topic in topics.items() if topic == "/x"}
        times = np.concatenate([run[alone].times for run in file.runs({alone}, size) if run])
        assert len(times) == 100
        assert (np.diff(times) >= 0).all()
    file.close()


def test_an_mcap_without_a_summary_is_whole(tmp_path):
    """Its footer has a checksum all the same, of itself alone."""
    from mcap.writer import IndexType, Writer

    path = tmp_path / "run.mcap"
    with path.open("wb") as file:
        parts = ("use_statistics", "repeat_channels", "repeat_schemas", "use_summary_offsets")
        writer = Writer(file, index_types=IndexType.NONE, **dict.fromkeys(parts, False))
        writer.start(profile="ros2")
        schema = writer.register_schema(FLOAT, "ros2msg", b"float64 data")
        channel = writer.register_channel("/x", "cdr", schema)
        for i in range(10):
            writer.add_message(channel, i, bytes(12), i)
        writer.finish()
    for salvage in (False, True):
        source = open_source(str(path), salvage=salvage)
        assert [stream.count for stream in source.streams()] == [10]
        assert source.remarks == []
