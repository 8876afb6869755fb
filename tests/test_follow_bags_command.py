"""`estimate --follow` of bags that other processes record, and into one that grows."""

from __future__ import annotations

import csv
import io
import shutil
import signal
import sqlite3
import subprocess
import sys
import time
from contextlib import closing
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from mcap.reader import make_reader
from mcap.writer import Writer
from rosbags.highlevel import AnyReader

import formats

ROOT = Path(__file__).resolve().parent.parent
SAMPLE = ROOT / "sample_data"
ROVER = ["--rover", str(SAMPLE / "rover.toml")]
FAST = ["--method", "recursive", "--segments", "fixed", "--window-samples", "100"]
KEY = ("wheel", "segment", "t_start_s", "t_end_s", "n_samples", "n_rejected", "status")
#: Appends a file to another, some bytes at a time, and waits to be killed where it is told to.
RECORDER = """
import sys, time
source, target, size, end = sys.argv[1:]
data = open(source, "rb").read()
with open(target, "ab", buffering=0) as file:
    for begin in range(0, int(float(end) * len(data)), int(size)):
        file.write(data[begin : begin + int(size)])
        time.sleep(0.003)
if float(end) < 1.0:
    print("here", flush=True); time.sleep(600)
"""
#: Commits the messages of a bag to another database, with a log beside it.
COMMITTER = """
import sqlite3, sys, time
source, target = (sqlite3.connect(path, isolation_level=None) for path in sys.argv[1:])
target.execute("PRAGMA journal_mode=wal")
for (sql,) in source.execute("SELECT sql FROM sqlite_master WHERE sql IS NOT NULL"):
    target.execute(sql)
for table in ("topics", "message_definitions", "messages"):
    rows = source.execute(f"SELECT * FROM {table}")
    while some := rows.fetchmany(200):
        target.execute("BEGIN")
        target.executemany(f"INSERT INTO {table} VALUES ({','.join('?' * len(some[0]))})", some)
        target.execute("COMMIT")
        time.sleep(0.01)
target.close()
"""


def rows_of(text):
    return sorted(
        tuple(float(r[k]) if k.startswith(("t_", "n_")) else r[k] for k in KEY)
        for r in csv.DictReader(io.StringIO(text))
    )


@pytest.fixture(scope="module")
def expected(terrain_est_here, tmp_path_factory):
    folder = tmp_path_factory.mktemp("whole")
    done = terrain_est_here(
        "estimate", SAMPLE / "run.mcap", "--csv", *FAST, "--rover", SAMPLE / "rover.toml", cwd=folder
    )
    return rows_of(done.stdout)


@pytest.mark.parametrize("name", ["run.mcap", "run.bag"])
def test_a_bag_that_another_process_records(name, start, expected, tmp_path):
    """It ends by itself, as soon as the recorder has ended the file."""
    growing = tmp_path / "growing"
    growing.touch()
    if name == "run.bag":
        # Of a whole file that is copied the header tells of the index at once.
        data = bytearray((SAMPLE / name).read_bytes())
        at = data.index(b"index_pos=") + 10
        index = bytes(data[at : at + 8])
        data[at : at + 8] = bytes(8)
        (tmp_path / "source").write_bytes(data)
    source = tmp_path / "source" if name == "run.bag" else SAMPLE / name
    process = start(growing, *FAST)
    subprocess.run([sys.executable, "-c", RECORDER, source, growing, "2000", "1"], check=True)
    if name == "run.bag":
        # A name that is gone before the file was opened is a file that is not there.
        while str(growing) not in Path(f"/proc/{process.pid}/maps").read_text("utf-8"):
            assert process.poll() is None
            time.sleep(0.05)
        assert process.poll() is None
        with growing.open("r+b") as file:
            # As rosbag does with run.bag.active.
            growing.rename(tmp_path / "closed")
            file.seek(at)
            file.write(index)
    out, said = process.communicate(timeout=60)
    assert process.returncode == 0, said
    assert rows_of(out) == expected
    assert said.splitlines()[-1] == f"messages: 7050, late: 0, repeated: 0; segments: {len(expected)}"


def test_a_recorder_that_is_killed(start, expected, tmp_path):
    growing = tmp_path / "growing.mcap"
    growing.touch()
    process = start(growing, *FAST, "--idle-timeout", "1s")
    with subprocess.Popen(
        [sys.executable, "-c", RECORDER, SAMPLE / "run.mcap", growing, "1000", "0.6"],
        stdout=subprocess.PIPE,
    ) as recorder:
        recorder.stdout.readline()
        recorder.send_signal(signal.SIGKILL)
    out, said = process.communicate(timeout=60)
    assert process.returncode == 0
    found = rows_of(out)
    # The last segment of each wheel is cut.
    whole = [row for row in found if row in expected]
    assert len(found) - 2 <= len(whole) < len(expected)
    assert "are no whole record, and left out" in said


def test_a_signal_ends_it_while_the_recorder_goes_on(start, expected, tmp_path):
    growing = tmp_path / "growing.mcap"
    growing.touch()
    process = start(growing, *FAST)
    with subprocess.Popen(
        [sys.executable, "-c", RECORDER, SAMPLE / "run.mcap", growing, "200", "1"]
    ) as recorder:
        head = process.line() + process.line()
        process.send_signal(signal.SIGTERM)
        out, said = process.communicate(timeout=60)
        recorder.kill()
    assert process.returncode == 0
    assert rows_of(head + out)[0] == expected[0]
    assert "late: 0" in said


def test_a_database_that_another_process_writes(start, expected, tmp_path):
    source, growing = tmp_path / "source.db3", tmp_path / "growing.db3"
    with AnyReader([SAMPLE / "run.mcap"]) as reader:
        copied(reader, source)
    growing.touch()
    process = start(growing, *FAST, "--idle-timeout", "1500ms")
    subprocess.run([sys.executable, "-c", COMMITTER, source, growing], check=True)
    out, _ = process.communicate(timeout=60)
    assert process.returncode == 0
    assert rows_of(out) == expected


def copied(reader, path):
    """Write the messages of a bag as a database of rosbag2."""
    with closing(sqlite3.connect(path)) as file:
        file.executescript(
            "CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT NOT NULL, type TEXT NOT NULL,"
            " serialization_format TEXT NOT NULL, offered_qos_profiles TEXT NOT NULL);"
            "CREATE TABLE message_definitions(id INTEGER PRIMARY KEY, topic_type TEXT NOT NULL,"
            " encoding TEXT NOT NULL, encoded_message_definition TEXT NOT NULL);"
            "CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER NOT NULL,"
            " timestamp INTEGER NOT NULL, data BLOB NOT NULL);"
        )
        for c in reader.connections:
            file.execute("INSERT INTO topics VALUES (?, ?, ?, 'cdr', '')", (c.id, c.topic, c.msgtype))
        for c in {c.msgtype: c for c in reader.connections}.values():
            file.execute(
                "INSERT INTO message_definitions VALUES (NULL, ?, 'ros2msg', ?)", (c.msgtype, c.msgdef.data)
            )
        file.executemany(
            "INSERT INTO messages VALUES (NULL, ?, ?, ?)",
            [(c.id, time, bytes(data)) for c, time, data in reader.messages()],
        )
        file.commit()


def test_rows_become_messages_while_it_goes_on(start, expected, tmp_path):
    """What they hold so far can be read without an index, and in the end with one."""
    growing, soil = tmp_path / "growing.mcap", tmp_path / "soil.mcap"
    growing.touch()
    process = start(growing, "-o", soil, *FAST)
    with subprocess.Popen(
        [sys.executable, "-c", RECORDER, SAMPLE / "run.mcap", growing, "1000", "0.7"],
        stdout=subprocess.PIPE,
    ) as recorder:
        recorder.stdout.readline()
        deadline = time.monotonic() + 60
        while not (soil.exists() and soil.stat().st_size > 4000):
            assert time.monotonic() < deadline
            time.sleep(0.05)
        early = formats.open_source(str(soil), salvage=True)
        assert early.recovery.read >= 2
        assert early.recovery.aside == 0
        recorder.kill()
    with growing.open("ab") as file:
        file.write((SAMPLE / "run.mcap").read_bytes()[growing.stat().st_size :])
    assert process.communicate(timeout=60)[0] == ""
    assert process.returncode == 0
    segments = 0
    for stream in formats.open_source(str(soil)).streams():
        assert stream.type == "terrain_est_msgs/msg/Segment"
        for batch in formats.open_source(str(soil)).read(stream.topic, ["end", "n_samples", "t_start_s"]):
            first = ~batch["end"].astype(bool)
            segments += np.count_nonzero(first)
            wheel = stream.topic.split("/")[2].replace("_", "-")
            known = {(row[2], row[4]) for row in expected if row[0] == wheel}
            pairs = zip(batch["t_start_s"][first], batch["n_samples"][first], strict=True)
            assert set(pairs) == known
    assert segments == len(expected)


@pytest.mark.parametrize("name", ["run.mcap", "run.bag"])
def test_a_bag_in_a_pipe_is_refused_in_one_line(name, terrain_est):
    with (SAMPLE / name).open("rb") as file:
        done = terrain_est("estimate", "--follow", "-", "--rover", SAMPLE / "rover.toml", stdin=file)
    assert (done.returncode, done.stdout) == (65, "")
    assert "which can be followed in its file, not in a pipe" in done.stderr


def test_a_bag_is_not_written_over(terrain_est_here, tmp_path):
    data = (SAMPLE / "run.mcap").read_bytes()
    (tmp_path / "run.mcap").write_bytes(data)
    args = ["estimate", "--follow", "run.mcap", "-o", "run.mcap", "--force"]
    done = terrain_est_here(*args, "--rover", SAMPLE / "rover.toml", cwd=tmp_path)
    assert done.returncode == 2
    assert (tmp_path / "run.mcap").read_bytes() == data


def test_a_bag_that_lacks_something_is_refused_as_by_estimate(terrain_est_here, tmp_path):
    (tmp_path / "rover.toml").write_text(
        "[wheel]\nradius = 0.125\nwidth = 0.1\n[channels]\nload = { topic = '/none' }\n"
    )
    args = ["estimate", SAMPLE / "run.mcap", "--rover", tmp_path / "rover.toml"]
    done, whole = (terrain_est_here(*args, *more, cwd=tmp_path) for more in (["--follow"], []))
    assert done.returncode == whole.returncode == 78
    assert done.stderr == whole.stderr


def table_of(text):
    """Return a table, without where it is from and in an order that does not depend on what came when."""
    table = pd.read_csv(io.StringIO(text)).drop(columns=["source", "WKT"])
    return table.sort_values(["wheel", "segment"], ignore_index=True)


def split(bag, folder, count):
    """Write the messages of a bag into so many files, named as rosbag2 names those of a recording."""
    with bag.open("rb") as file:
        messages = list(make_reader(file).iter_messages())
    for part in range(count):
        with (folder / f"day_{part}.mcap").open("wb") as file:
            writer, channels = Writer(file), {}
            writer.start("ros2")
            begin, end = (len(messages) * k // count for k in (part, part + 1))
            for schema, channel, message in messages[begin:end]:
                if channel.topic not in channels:
                    number = writer.register_schema(schema.name, schema.encoding, schema.data)
                    channels[channel.topic] = writer.register_channel(channel.topic, "cdr", number)
                writer.add_message(
                    channels[channel.topic], message.log_time, message.data, message.publish_time
                )
            writer.finish()


def test_a_recording_in_a_folder_is_followed_through_its_files(tmp_path, terrain_est_here):
    """The second and third file appear as the one before is closed; then no other does."""
    day, later = tmp_path / "day", tmp_path / "later"
    day.mkdir()
    later.mkdir()
    split(SAMPLE / "run.mcap", later, 3)
    (later / "day_0.mcap").rename(day / "day_0.mcap")
    command = [sys.executable, "-m", "terrain_cli", "estimate", "--follow", day, "--method", "recursive"]
    with subprocess.Popen(
        [*command, *ROVER], cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.PIPE
    ) as run:
        for part in (1, 2):
            time.sleep(0.7)
            assert run.poll() is None
            (later / f"day_{part}.mcap").rename(day / f"day_{part}.mcap")
        out, errors = run.communicate(timeout=60)
    assert run.returncode == 0, errors
    whole = terrain_est_here("estimate", "--follow", SAMPLE / "run.mcap", "--method", "recursive", *ROVER)
    found, expected = (table_of(text) for text in (out.decode(), whole.stdout))
    assert list(found["n_samples"]) == list(expected["n_samples"])
    pd.testing.assert_frame_equal(found, expected, rtol=1e-9)
    assert b"messages: 7050, late: 0" in errors
    # All are there from the start.
    again = terrain_est_here("estimate", "--follow", day, "--method", "recursive", *ROVER)
    pd.testing.assert_frame_equal(table_of(again.stdout), expected, rtol=1e-9)


def test_a_recording_beside_other_logs_is_not_chosen(tmp_path, terrain_est_here):
    shutil.copy(SAMPLE / "run.mcap", tmp_path / "day_0.mcap")
    shutil.copy(SAMPLE / "run.csv", tmp_path / "other.csv")
    done = terrain_est_here("estimate", "--follow", tmp_path, *ROVER)
    assert done.returncode == 2
    assert "--follow takes one input, not 2" in done.stderr
