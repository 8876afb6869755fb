"""Messages straight from the pages of SQLite are those that SQLite gives."""

from __future__ import annotations

import sqlite3
from contextlib import closing

import numpy as np
import pytest
from bags import typestore, write_ros2
from hypothesis import given
from hypothesis import strategies as st
from profiles import examples

from formats.rosbag.bag_source import BagSource
from formats.rosbag.storage import db3_rows
from formats.rosbag.storage.db3 import Db3File
from formats.table import LOG_TIME

TABLES = """
CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT, type TEXT, serialization_format TEXT);
CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER NOT NULL, timestamp INTEGER NOT NULL,
                      data BLOB NOT NULL);
CREATE INDEX timestamp_idx ON messages (timestamp ASC);
"""
#: Integers that SQLite writes in 0 to 8 bytes.
WHOLE = [0, 1, -1, 127, 128, -129, 40_000, 1 << 20, -(1 << 23), 1 << 31, 1 << 40, -(1 << 47), 1 << 62]
TOPICS = [t for t in WHOLE if t >= 0]


def database(path, rows, settings="", tables=TABLES, after=""):
    """Write (id, topic, time, data) as a recorder does."""
    with closing(sqlite3.connect(path)) as file:
        file.executescript(settings)
        file.executescript(tables)
        file.executemany("INSERT INTO topics VALUES (?, ?, 'x/msg/X', 'cdr')", [(t, f"/{t}") for t in TOPICS])
        file.executemany("INSERT INTO messages(id, topic_id, timestamp, data) VALUES (?, ?, ?, ?)", rows)
        file.commit()
        file.executescript(after)
        file.commit()
    return path


def by_sqlite(path):
    with closing(sqlite3.connect(path)) as file:
        return file.execute(
            "SELECT topic_id, timestamp, data FROM messages ORDER BY timestamp, id"
        ).fetchall()


def by_reader(path, wanted=TOPICS, size=1 << 23, *, plain=True):
    """Return what `Db3File` gives, in the order in which it gives it within each topic."""
    file = Db3File(path)
    file.open()
    assert (file._leaves is not None) == plain
    found = []
    for run in file.runs(wanted, size):
        joined = [
            (int(time), int(order), topic, messages.payload(row))
            for topic, messages in run.items()
            for row, (time, order) in enumerate(zip(messages.times, messages.order, strict=True))
        ]
        found += [(topic, time, data) for time, _, topic, data in sorted(joined)]
    counts = {connection.id: connection.msgcount for connection in file.connections}
    spans = file.spans
    file.close()
    return found, counts, spans


def assert_same(path, **how):
    rows = by_sqlite(path)
    found, counts, spans = by_reader(path, **how)
    assert found == rows
    assert {t: n for t, n in counts.items() if n} == {
        t: len([r for r in rows if r[0] == t]) for t, *_ in rows
    }
    for topic, span in spans.items():
        times = [time for t, time, _ in rows if t == topic]
        assert span == (min(times), max(times))


@examples(50)
@given(st.data())
def test_any_rows_in_any_pages(tmp_path_factory, data):
    """Ids with gaps, times that run back, integers of every width, payloads that go on in further pages."""
    page = data.draw(st.sampled_from([512, 1024, 4096, 65536]))
    vacuum = data.draw(st.sampled_from([0, 1, 2]))
    seed = data.draw(st.integers(0, 2**32))
    largest = data.draw(st.sampled_from([0, 40, 700, 3 * page]))
    random = np.random.default_rng(seed)
    numbers = np.cumsum(
        random.integers(1, data.draw(st.sampled_from([2, 300])), size=random.integers(0, 400))
    )
    share = data.draw(st.sampled_from([0.0, 0.6]))
    gone = [int(number) for number in numbers if random.random() < share]
    left = np.isin(numbers, gone, invert=True)
    # A time far from both of its neighbours is refused, so each is there twice.
    pair = np.minimum((np.cumsum(left) - 1) // 2, max(np.count_nonzero(left) // 2 - 1, 0))
    jumps = random.choice(WHOLE, len(numbers)), random.random(len(numbers)) < 0.3
    rows = [
        (
            int(number),
            int(random.choice(TOPICS)),
            int(jumps[0][pair[k]]) if jumps[1][pair[k]] else 1_700_000_000_000_000_000 + 1000 * k,
            random.bytes(int(random.integers(0, largest + 1))),
        )
        for k, number in enumerate(numbers)
    ]
    path = database(
        tmp_path_factory.mktemp("bag") / "run.db3",
        rows,
        f"PRAGMA page_size = {page}; PRAGMA auto_vacuum = {vacuum};",
        after=f"DELETE FROM messages WHERE id IN ({','.join(map(str, gone))});",  # noqa: S608  only numbers
    )
    assert_same(path, size=data.draw(st.sampled_from([1, 5_000, 1 << 23])))


def rows(n, size=50):
    return [(k + 1, TOPICS[k % 3], 10**18 + k, bytes([k % 256]) * size) for k in range(n)]


def test_a_part_of_the_topics(tmp_path):
    path = database(tmp_path / "run.db3", rows(9_000))
    found, _, _ = by_reader(path, [TOPICS[1], 77])
    assert found == [row for row in by_sqlite(path) if row[0] == TOPICS[1]]
    assert by_reader(path, [77])[0] == []


def test_no_messages(tmp_path):
    assert_same(database(tmp_path / "run.db3", []))


def test_long_messages_are_read_only_where_they_are_wanted(tmp_path):
    short, long = TOPICS[:2]
    mixed = [(k + 1, (short, long)[k % 2], k, bytes((k % 2) * 20_000 + 8)) for k in range(60)]
    path = database(tmp_path / "run.db3", mixed)
    assert_same(path)
    with closing(sqlite3.connect(path)) as file:
        ((root,),) = file.execute("SELECT rootpage FROM sqlite_master WHERE name = 'messages'")
    with path.open("rb") as file:
        table = db3_rows.Leaves(file, root, pytest.fail)
        assert sum(len(run[short]) for run in table.runs([short], 1 << 20)) == 30


def test_a_closed_write_ahead_log(tmp_path):
    """The header says WAL, and nothing is left in it."""
    path = database(tmp_path / "run.db3", rows(500), "PRAGMA journal_mode = WAL;")
    assert path.read_bytes()[18:20] == b"\x02\x02"
    assert_same(path)


@pytest.mark.parametrize(
    ("tables", "after"),
    [
        (TABLES.replace("data BLOB", "data TEXT"), ""),
        (TABLES.replace("data BLOB NOT NULL", "data BLOB NOT NULL, extra INTEGER DEFAULT 7"), ""),
        (TABLES.replace("id INTEGER PRIMARY KEY, topic_id", "id INT PRIMARY KEY, topic_id"), ""),
        (TABLES.replace("NOT NULL);", "NOT NULL) WITHOUT ROWID;"), ""),
        (TABLES, "UPDATE messages SET data = 'text' WHERE id = 40"),
        (TABLES, "UPDATE messages SET topic_id = 'none' WHERE id = 40"),
    ],
    ids=["text", "further column", "no row id", "without row id", "text in a row", "text for a topic"],
)
def test_what_is_not_plain_is_left_to_sqlite(tmp_path, tables, after):
    path = database(tmp_path / "run.db3", rows(80), tables=tables, after=after)
    file = Db3File(path)
    file.open()
    assert file._leaves is None
    file.close()
    if not after:
        found, _, _ = by_reader(path, plain=False)
        assert found == by_sqlite(path)


@examples(100)
@given(st.data())
def test_damaged_pages_give_an_error_or_are_left_to_sqlite(tmp_path_factory, data):
    """Whatever the bytes are: no answer takes for ever, and none is of another kind."""
    folder = tmp_path_factory.mktemp("bag")
    path = database(folder / "run.db3", rows(300, 30), "PRAGMA page_size = 512;")
    contents = bytearray(path.read_bytes())
    for _ in range(data.draw(st.integers(1, 4))):
        # Pages of tables and their heads, not of the payloads alone.
        at = 512 * data.draw(st.integers(3, len(contents) // 512 - 1)) + data.draw(st.integers(0, 60))
        contents[at] = data.draw(st.sampled_from([0, 1, 5, 13, 0x7F, 0x80, 0xFF]))
    path.write_bytes(contents)
    file = Db3File(path)
    try:
        file.open()
        total = sum(len(messages) for run in file.runs(TOPICS) for messages in run.values())
    except (sqlite3.Error, ValueError, TypeError, OverflowError):
        return
    finally:
        file.close()
    assert total <= len(contents)


def test_a_tree_without_end(tmp_path):
    path = database(tmp_path / "run.db3", rows(300, 30), "PRAGMA page_size = 512;")
    with closing(sqlite3.connect(path)) as file:
        ((root,),) = file.execute("SELECT rootpage FROM sqlite_master WHERE name = 'messages'")
    contents = bytearray(path.read_bytes())
    begin = (root - 1) * 512
    assert contents[begin] == db3_rows.TABLE_NODE
    contents[begin + 3 : begin + 5] = b"\x00\x00"
    contents[begin + 8 : begin + 12] = root.to_bytes(4, "big")
    path.write_bytes(contents)
    with path.open("rb") as file, pytest.raises(db3_rows.BrokenPageError, match="circles"):
        db3_rows.Leaves(file, root, pytest.fail)


def test_a_recording_with_images(tmp_path):
    """Beside short messages some of 200 KB, as rosbags writes them."""
    image, number = "sensor_msgs/msg/Image", "std_msgs/msg/Float64"
    made = []
    for k in range(30):
        made.append(("/speed", number, 100 * k, {"data": k / 4}))
        if k % 10 == 0:
            made.append(("/image", image, 100 * k + 1, {"height": k, "data": bytes(200_000)}))
    path = write_ros2(tmp_path / "run", made, typestore(ros1=False), "db3")
    source = BagSource(str(path), "db3")
    found = {topic: [] for topic in ("/speed", "/image")}
    for topic, batch in source.read_together({"/speed": ["data"], "/image": ["height"]}):
        found[topic].append(batch)
    (speed,), images = found["/speed"], found["/image"]
    assert speed["data"].tolist() == [k / 4 for k in range(30)]
    assert [h for batch in images for h in batch["height"].tolist()] == [0, 10, 20]
    assert speed[LOG_TIME].astype(int).tolist() == [100 * k for k in range(30)]
