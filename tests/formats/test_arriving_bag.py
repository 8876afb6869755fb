"""Bags that are still being recorded: what they hold so far is what they hold when they are finished."""

from __future__ import annotations

import os
import sqlite3
import struct
import subprocess
import sys
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest
from bags import MCAP, ROS1, typestore, write_ros1, write_ros2
from mcap.reader import make_reader
from mcap.writer import Writer

import formats
from formats.rosbag.arriving_bag import ArrivingBag

JOINTS, FLOAT = "sensor_msgs/msg/JointState", "std_msgs/msg/Float64"
WANTED = {"/joints": ["effort[left]", "velocity[right]"], "/depth": ["data"]}
KINDS = [("ros1", packing) for packing in ROS1] + [("mcap", packing) for packing in MCAP]


def rows(count=60, start=1_754_000_000):
    """Return messages of two topics, the second of which begins late and is slower."""
    for n in range(count):
        time = start * 10**9 + n * 50_000_000
        values = {"name": ["left", "right"], "effort": [n + 0.1, 2.0], "velocity": [1.0, n + 0.2]}
        yield ("/joints", JOINTS, time, {"header": {"stamp": time - 1_000_000}, **values})
        if n % 5 == 4:
            yield ("/depth", FLOAT, time + 1, {"data": float(n)})


def finished(folder, kind, packing="none", some=None):
    store = typestore(ros1=kind == "ros1")
    some = list(rows() if some is None else some)
    if kind == "ros1":
        return write_ros1(folder / "whole.bag", some, store, packing, chunk=2000)
    return write_ros2(folder / "whole", some, store, kind, packing, chunk=2000)


def joined(batches):
    return {name: np.concatenate([np.asarray(batch[name]) for batch in batches]) for name in batches[0]}


def whole(path):
    found = {}
    for topic, batch in formats.open_source(str(path)).read_together(WANTED):
        found.setdefault(topic, []).append(batch)
    return {topic: joined(batches) for topic, batches in found.items()}


def boundary(data):
    """Return where a record of an MCAP begins, behind its middle."""
    at = 8
    while at < len(data) // 2 or data[at] != 0x06:
        at += 9 + struct.unpack_from("<Q", data, at + 1)[0]
    return at


class Recorder:
    """A file that is appended to, and what is read of it."""

    def __init__(self, path, kind):
        self.path, self._kind = path, kind
        self.bag, self.found, self._begun = None, {}, False

    def append(self, data):
        with self.path.open("ab") as file:
            file.write(data)
        self.look()

    def append_all(self, data, step):
        for begin in range(0, len(data), step):
            self.append(data[begin : begin + step])

    def look(self):
        """Take what is there; the file is opened once its first bytes tell what it is."""
        if self.bag is None and self.path.stat().st_size >= 16:
            self.bag = ArrivingBag(str(self.path), self._kind)
        if self.bag is None or not (self._begun or self.bag.prepare(b"", hurry=False)):
            return
        if not self._begun:
            self._begun, self.bag.wanted = True, WANTED
        for topic, batch in (self.bag.take() or {}).items():
            self.found.setdefault(topic, []).append(batch)

    @property
    def messages(self):
        return {topic: joined(batches) for topic, batches in self.found.items()}


def assert_same(found, expected):
    assert found.keys() == expected.keys()
    for topic, columns in expected.items():
        for name, values in columns.items():
            np.testing.assert_array_equal(found[topic][name], values, name)


@pytest.mark.parametrize(("kind", "packing"), KINDS)
def test_messages_come_as_they_are_appended(kind, packing, tmp_path):
    path = finished(tmp_path, kind, packing)
    data, recorder = path.read_bytes(), Recorder(tmp_path / "growing", kind)
    if kind == "ros1":
        # Its header names the index only when it is there.
        at = data.index(b"index_pos=") + 10
        data, index = data[:at] + bytes(8) + data[at + 8 :], data[at : at + 8]
    counts = []
    for begin in range(0, len(data), 333):
        assert not recorder.bag or not recorder.bag.ended
        recorder.append(data[begin : begin + 333])
        counts.append(recorder.bag.count if recorder.bag else 0)
    if kind == "ros1":
        assert not recorder.bag.ended
        with recorder.path.open("r+b") as file:
            file.seek(at)
            file.write(index)
        recorder.look()
    assert recorder.bag.ended
    assert len(set(counts)) > 3
    assert recorder.bag.count == len(list(rows()))
    assert recorder.bag.faults() == []
    assert_same(recorder.messages, whole(path))


@pytest.mark.parametrize("kind", ["ros1", "mcap"])
def test_a_byte_at_a_time(kind, tmp_path):
    path = finished(tmp_path, kind, some=rows(25))
    data, recorder = path.read_bytes(), Recorder(tmp_path / "growing", kind)
    recorder.append(data[:4000])
    recorder.append_all(data[4000:9000], 1)
    recorder.append(data[9000:])
    assert recorder.bag.ended
    assert_same(recorder.messages, whole(path))


def test_messages_in_no_chunk_and_checksums(tmp_path):
    """As the profile `fastwrite` of rosbag2 writes them, and as the library of MCAP does."""
    path = finished(tmp_path, "mcap")
    for chunked in (False, True):
        copy = tmp_path / f"copy-{chunked}.mcap"
        with path.open("rb") as source, copy.open("wb") as target:
            writer = Writer(target, use_chunking=chunked, chunk_size=2000)
            writer.start("ros2")
            channels = {}
            for schema, channel, message in make_reader(source).iter_messages():
                if channel.topic not in channels:
                    number = writer.register_schema(schema.name, schema.encoding, schema.data)
                    channels[channel.topic] = writer.register_channel(channel.topic, "cdr", number)
                writer.add_message(channels[channel.topic], message.log_time, message.data, message.log_time)
            writer.finish()
        recorder = Recorder(tmp_path / f"growing-{chunked}", "mcap")
        recorder.append_all(copy.read_bytes(), 100)
        assert recorder.bag.ended
        assert recorder.bag.faults() == []
        assert_same(recorder.messages, whole(path))


@pytest.mark.parametrize("kind", ["ros1", "mcap"])
def test_a_recorder_that_was_killed(kind, tmp_path):
    """What is whole was taken, and what is not is waited for, and told at the end."""
    path = finished(tmp_path, kind)
    recorder = Recorder(tmp_path / "growing", kind)
    data = path.read_bytes()
    cut = data.rindex(b"\x06" if kind == "mcap" else b"compression=", 0, len(data) * 2 // 3)
    recorder.append(data[: cut + 300])
    expected = formats.open_source(str(recorder.path), salvage=True)
    assert 0 < recorder.bag.count <= expected.recovery.read < len(list(rows()))
    assert not recorder.bag.ended
    assert "are no whole record" in recorder.bag.faults()[-1]


def test_ros_1_writes_its_open_chunk_message_by_message(tmp_path):
    """As rosbag does: the head of a chunk gets its size when it is closed, and is of nothing before."""
    data = finished(tmp_path, "ros1").read_bytes()
    at = data.index(b"size=") + 5
    size = struct.unpack_from("<I", data, at)[0]
    begin = data.index(struct.pack("<I", size), at + 4)
    blank = data[:at] + bytes(4) + data[at + 4 : begin] + bytes(4) + data[begin + 4 :]
    recorder = Recorder(tmp_path / "growing", "ros1")
    for end in range(4400, begin + size, 200):
        recorder.append(blank[recorder.path.stat().st_size if recorder.path.exists() else 0 : end])
    assert recorder.bag.count > 5
    recorder.path.write_bytes(data)
    recorder.look()
    recorder.look()
    assert recorder.bag.count == len(list(rows()))
    assert_same(recorder.messages, whole(tmp_path / "whole.bag"))


def test_a_packed_chunk_is_waited_for_until_it_is_closed(tmp_path):
    data = finished(tmp_path, "ros1", "bz2").read_bytes()
    at = data.index(b"size=") + 5
    stored = data.index(b"BZh") - 4
    blank = data[:at] + bytes(4) + data[at + 4 : stored] + bytes(4) + data[stored + 4 :]
    recorder = Recorder(tmp_path / "growing", "ros1")
    recorder.append(blank[: stored + 500])
    assert recorder.bag.count == 0
    recorder.path.write_bytes(data)
    while not recorder.bag.ended:
        recorder.look()
    assert_same(recorder.messages, whole(tmp_path / "whole.bag"))


def test_a_publisher_that_joins_later(tmp_path):
    some = [(*row, "late" if n > 50 else "early") for n, row in enumerate(rows())]
    path = finished(tmp_path, "ros1", some=some)
    recorder = Recorder(tmp_path / "growing", "ros1")
    recorder.append_all(path.read_bytes(), 1000)
    assert_same(recorder.messages, whole(path))


@pytest.mark.parametrize("kind", ["ros1", "mcap"])
def test_a_file_that_is_longer_than_what_is_in_it(kind, tmp_path):
    """As file systems show it that set space aside, or write pages in another order."""
    path = finished(tmp_path, kind)
    data, recorder = path.read_bytes(), Recorder(tmp_path / "growing", kind)
    cut = boundary(data) if kind == "mcap" else 13 + 4096
    recorder.append(data[:cut] + bytes(len(data) - cut))
    early = recorder.bag.count
    recorder.path.write_bytes(data)
    for _ in range(3):
        recorder.look()
    assert early < recorder.bag.count == len(list(rows()))
    assert_same(recorder.messages, whole(path))


@pytest.mark.parametrize("kind", ["ros1", "mcap"])
def test_damage_is_passed_over_and_told(kind, tmp_path):
    path = finished(tmp_path, kind)
    data, recorder = path.read_bytes(), Recorder(tmp_path / "growing", kind)
    begin = data.index(b"op=\x05", len(data) // 2) - 30 if kind == "ros1" else boundary(data)
    damaged = data[:begin] + b"\xff" * 60 + data[begin + 60 :]
    recorder.append_all(damaged, 1000)
    expected = formats.open_source(str(recorder.path), salvage=True)
    assert 0 < len(list(rows())) - recorder.bag.count < 40
    assert recorder.bag.count == expected.recovery.read
    assert any("are damaged, and passed over" in said for said in recorder.bag.faults())


@pytest.mark.parametrize("kind", ["ros1", "mcap"])
def test_damage_without_an_end_is_told_in_one_line(kind, tmp_path):
    data = finished(tmp_path, kind).read_bytes()
    recorder = Recorder(tmp_path / "growing", kind)
    recorder.append(data[: len(data) // 2] + b"\xff" * 100_000)
    assert recorder.bag.count > 0
    with pytest.raises(formats.DamagedError, match="corrupt or cut off"):
        recorder.append(b"\xff" * (17 << 20))


OPEN = "import os, sqlite3, sys; f = sqlite3.connect(sys.argv[1], isolation_level=None)"
WRITER = """
import sqlite3, sys
source, target, mode = sys.argv[1:]
rows = sqlite3.connect(source)
file = sqlite3.connect(target, timeout=0, isolation_level=None)
file.execute(f"PRAGMA journal_mode={mode}")
for (sql,) in rows.execute("SELECT sql FROM sqlite_master WHERE sql IS NOT NULL"):
    file.execute(sql)
tables = [("topics", 10), ("message_definitions", 10), ("messages", 7)]
steps = [(table, rows.execute(f"SELECT * FROM {table}"), count) for table, count in tables]
for table, found, count in steps:
    while some := found.fetchmany(count):
        file.execute("BEGIN")
        file.executemany(f"INSERT INTO {table} VALUES ({','.join('?' * len(some[0]))})", some)
        print("wrote", flush=True); input()
        file.execute("COMMIT")
        print("committed", flush=True); input()
print("done", flush=True); input()
file.close()
"""


@pytest.mark.parametrize("mode", ["wal", "delete", "memory", "truncate", "persist"])
def test_rows_of_a_database_that_another_process_writes(mode, tmp_path):
    """Whose commits never fail: it does not wait for a lock."""
    path = finished(tmp_path, "db3")
    target = tmp_path / "growing.db3"
    recorder, counts = Recorder(target, "db3"), []
    with subprocess.Popen(
        [sys.executable, "-c", WRITER, path, target, mode],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    ) as writer:
        for said in writer.stdout:
            before = counts[-1] if counts else 0
            if target.exists():
                recorder.look()
            counts.append(recorder.bag.count if recorder.bag else 0)
            # What is not committed is not there.
            assert counts[-1] == before or said != "wrote\n"
            writer.stdin.write("\n")
            writer.stdin.flush()
    assert writer.returncode == 0
    recorder.look()
    assert recorder.bag.count == len(list(rows()))
    assert len(set(counts)) > 5
    assert not recorder.bag.ended
    assert_same(recorder.messages, whole(path))
    # SQLite's own journal, emptied.
    assert {file.name for file in tmp_path.iterdir()} <= {"whole", "growing.db3", "growing.db3-journal"}


def test_a_database_is_read_as_it_is_written(tmp_path):
    """However often it is looked at while another process commits: nothing twice, nothing lost, no lock."""
    path = finished(tmp_path, "db3", some=list(rows(2000)))
    target = tmp_path / "growing.db3"
    quick = WRITER.replace("; input()", "").replace("print(", "(lambda *a, **k: None)(")
    recorder = Recorder(target, "db3")
    with subprocess.Popen([sys.executable, "-c", quick, path, target, "memory"]) as writer:
        while writer.poll() is None:
            if target.exists():
                recorder.look()
    assert writer.returncode == 0
    recorder.look()
    assert_same(recorder.messages, whole(path))


def test_a_recorder_that_died_within_a_commit(tmp_path):
    """Its journal undoes what it wrote last; nothing is read that is perhaps half of it."""
    path = finished(tmp_path, "db3")
    code = "f.execute('PRAGMA synchronous=OFF'); f.execute('BEGIN'); f.execute('DELETE FROM messages')"
    subprocess.run([sys.executable, "-c", f"{OPEN}; {code}; os.kill(os.getpid(), 9)", path], check=False)
    recorder = Recorder(path, "db3")
    for _ in range(5):
        recorder.look()
    assert recorder.bag.count == 0
    assert recorder.bag.faults() == [f"its recorder died while it wrote: {path.name}-journal undoes that"]


def test_a_row_without_a_message_is_passed_over_and_told(tmp_path):
    path = finished(tmp_path, "db3")
    with closing(sqlite3.connect(path)) as database, database:
        database.execute("CREATE TABLE loose (id INTEGER PRIMARY KEY, topic_id, timestamp, data)")
        database.execute("INSERT INTO loose SELECT * FROM messages")
        database.execute("DROP TABLE messages")
        database.execute("ALTER TABLE loose RENAME TO messages")
        database.execute("UPDATE messages SET data = NULL WHERE id = 30")
    recorder = Recorder(path, "db3")
    for _ in range(5):
        recorder.look()
    assert recorder.bag.count == len(list(rows()))
    assert recorder.bag.faults() == ["1 message set aside, which contradicts itself"]


def test_a_commit_that_is_going_on_is_waited_for(tmp_path):
    path = finished(tmp_path, "db3")
    with closing(sqlite3.connect(path, isolation_level=None)) as file:
        code = f"{OPEN}; f.execute('BEGIN EXCLUSIVE'); print(1, flush=True); input()"
        with subprocess.Popen(
            [sys.executable, "-c", code, path], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        ) as writer:
            assert writer.stdout.readline() == "1\n"
            recorder = Recorder(path, "db3")
            recorder.look()
            assert recorder.bag.count == 0
            writer.stdin.write("\n")
        assert file.execute("SELECT count(*) FROM messages").fetchone() == (len(list(rows())),)
    recorder.look()
    assert recorder.bag.count == len(list(rows()))


@pytest.mark.parametrize("kind", ["mcap", "db3"])
def test_a_recording_that_is_split_goes_on_in_the_next_file(kind, tmp_path, monkeypatch):
    clock = [100.0]
    monkeypatch.setattr("formats.rosbag.arriving_bag.time.monotonic", lambda: clock[0])
    every, day = list(rows()), tmp_path / "day"
    day.mkdir()
    expected = whole(finished(tmp_path, kind))
    parts = []
    for some in (every[:40], every[40:]):
        folder = tmp_path / f"part {len(parts)}"
        folder.mkdir()
        parts.append(finished(folder, kind, some=some))
    parts[0].rename(day / f"day_9.{kind}")
    recorder = Recorder(day, kind)
    recorder.look()
    assert not recorder.bag.ended
    # No whole beginning of a file is none.
    following = day / f"day_10.{kind}"
    following.write_bytes(b"\x89MC")
    recorder.look()
    assert not recorder.bag.full
    following.unlink()
    parts[1].rename(following)
    assert recorder.bag.full
    for _ in range(3):
        recorder.look()
    assert_same(recorder.messages, expected)
    # Of many files one is open.
    held = {os.path.realpath(entry) for entry in Path("/proc/self/fd").iterdir()}
    assert str(day / f"day_9.{kind}") not in held
    assert str(following) in held
    assert recorder.bag.faults() == []
    clock[0] += 3.0
    assert recorder.bag.ended == (kind == "mcap")
