"""Bags cut at any byte, with any byte changed, without index: what is left is right, or is not there."""

from __future__ import annotations

import sqlite3
import struct
from pathlib import Path

import numpy as np
import pytest
from bags import typestore, write_ros1, write_ros2
from hypothesis import HealthCheck, given
from hypothesis import strategies as st
from profiles import examples
from rosbags.rosbag1 import Reader as Ros1Reader
from rosbags.rosbag2.storage_mcap import McapReader
from salvage_cases import CASES, FLOAT, JOINTS, START, N, opened, samples, told, write

from formats.errors import DamagedError, FormatError
from formats.limits import TooMuchError
from formats.rosbag.storage.ros1 import checksum
from formats.sqlite_pages import Pages

#: Every byte of these is under a checksum, but for the places of chunks and what is not read.
CHECKED = [("ros1", "bz2"), ("mcap", "crc")]
cases = pytest.mark.parametrize(("kind", "compression"), CASES)
any_case = st.sampled_from(CASES)
often = examples(80, suppress_health_check=list(HealthCheck))


class Whole:
    """A whole bag: its bytes, every sample of it, and which of them are complete before a byte."""

    def __init__(self, folder, kind, compression):
        self.path = write(folder, kind, compression)
        self.kind = kind
        self.data = self.path.read_bytes()
        self.samples = samples(opened(self.path, kind, salvage=False))
        assert len(self.samples) == 2 * N

    def complete(self, cut):
        """Return what must be read of the first bytes, told by other means than those under test."""
        if self.kind == "db3":
            return self._in_pages(cut)
        spans = []
        if self.kind == "mcap":
            reader = McapReader(self.path)
            reader.open()
            for chunk in reader.chunks:
                end = chunk.chunk_start_offset + chunk.chunk_length
                spans.append((chunk.message_start_time, chunk.message_end_time, end))
            reader.close()
        else:
            with Ros1Reader(self.path) as reader:
                for info in reader.chunk_infos:
                    chunk = reader.chunks[info.pos]
                    spans.append((info.start_time, info.end_time - 1, chunk.datapos + chunk.datasize))
        return {
            key
            for key in self.samples
            if any(start <= key[1] <= last and end <= cut for start, last, end in spans)
        }

    def _in_pages(self, cut):
        (page,) = struct.unpack_from(">H", self.data, 16)
        whole = cut // page * page
        with sqlite3.connect(self.path) as base:
            rows = base.execute(
                "SELECT name, timestamp, data FROM messages JOIN topics ON topics.id = topic_id"
            ).fetchall()
            texts = base.execute("SELECT encoded_message_definition FROM message_definitions").fetchall()
        base.close()
        # Without the pages of the topics and of their definitions nothing has a name.
        needed = [b"/joints", b"/speed", *(text[-60:].encode() for (text,) in texts)]
        if any(self.data.find(text) + len(text) > whole for text in needed):
            return set()
        return {(name, time) for name, time, data in rows if self.data.index(data) + len(data) <= whole}


@pytest.fixture(scope="module")
def wholes(tmp_path_factory):
    return {case: Whole(tmp_path_factory.mktemp("whole"), *case) for case in CASES}


@pytest.fixture(scope="module")
def place(tmp_path_factory):
    return tmp_path_factory.mktemp("damaged") / "bag"


def salvaged(place, kind, data):
    """Return what can be read of some bytes; nothing where one line says that it is nothing."""
    place.write_bytes(data)
    try:
        source = opened(place, kind)
        return source, samples(source)
    except FormatError as error:
        text = str(error)
    assert text.startswith(f"{place}: ")
    assert "\n" not in text
    return None, {}


@cases
def test_a_whole_bag_is_read_as_ever(wholes, kind, compression):
    whole = wholes[kind, compression]
    source = opened(whole.path, kind)
    assert samples(source) == whole.samples
    assert source.remarks == opened(whole.path, kind, salvage=False).remarks
    recovery = source.recovery
    assert (recovery.damaged, recovery.fraction, recovery.lost, recovery.read) == (False, 1.0, [], 2 * N)
    assert recovery.checked == ((kind, compression) in CHECKED)


@often
@given(st.data(), any_case)
def test_cut_at_any_byte(wholes, place, data, case):
    whole = wholes[case]
    cut = data.draw(st.integers(1, len(whole.data) - 1))
    complete = whole.complete(cut)
    source, found = salvaged(place, case[0], whole.data[:cut])
    if source is None:
        assert not complete
        return
    assert complete <= found.keys()
    assert found.items() <= whole.samples.items()
    text = told(source)
    assert f"cut off at byte {cut:,}" in text
    assert f"salvaged: {len(found):,} messages" in text
    if len(found) < 2 * N:
        assert "lost: " in text
    for start, _ in source.recovery.lost:
        assert start is None or start in {time for _, time in found}


@examples(150, parent=often)
@given(st.data(), st.sampled_from(CHECKED))
def test_changed_bytes_under_a_checksum(wholes, place, data, case):
    """Each sample is as it was, or not there, and the loss is told."""
    whole = wholes[case]
    broken = bytearray(whole.data)
    for _ in range(data.draw(st.integers(1, 4))):
        broken[data.draw(st.integers(0, len(broken) - 1))] = data.draw(st.integers(0, 255))
    source, found = salvaged(place, case[0], broken)
    assert found.items() <= whole.samples.items()
    if source is not None and len(found) < 2 * N:
        assert source.recovery.damaged or any("cannot be read" in remark for remark in source.remarks)
        told(source)


@examples(150, parent=often)
@given(st.data(), any_case)
def test_any_damage_at_all(wholes, place, data, case):
    """No crash and no hang; without checksums a value may be another, a time or a place may not."""
    whole = wholes[case]
    broken = bytearray(whole.data)
    for _ in range(data.draw(st.integers(1, 4))):
        at = data.draw(st.integers(0, len(broken) - 1))
        match data.draw(st.integers(0, 3)):
            case 0:
                broken[at] ^= 1 << data.draw(st.integers(0, 7))
            case 1:
                broken[at : at + 16] = data.draw(st.binary(max_size=32))
            case 2:
                del broken[at:]
            case 3:
                broken[at : at + 4096] = bytes(min(4096, len(broken) - at))
        if not broken:
            return
    source, found = salvaged(place, case[0], broken)
    assert len(found) <= 2 * N
    if source is not None:
        told(source)


@pytest.mark.parametrize("case", [("ros1", "none"), ("mcap", "none"), ("db3", "none")])
def test_changed_times_are_seen_without_checksums(wholes, place, case):
    """The log time stands twice in each container: a message whose two differ is set aside."""
    whole = wholes[case]
    kind = case[0]
    time = START + 7 * 10**8
    code = {
        "ros1": struct.pack("<II", time // 10**9, time % 10**9),
        "mcap": struct.pack("<Q", time),
        "db3": struct.pack(">Q", time),
    }[kind]
    places = [at for at in range(len(whole.data)) if whole.data.startswith(code, at)]
    assert len(places) >= 2
    for at in places:
        broken = bytearray(whole.data)
        broken[at + 1] ^= 2
        _, found = salvaged(place, kind, broken)
        assert found.items() <= whole.samples.items()
        assert len(found) >= 2 * N - 1


@pytest.mark.parametrize("case", [case for case in CASES if case[0] != "db3"])
def test_what_follows_a_hole_is_found(wholes, place, case):
    whole = wholes[case]
    middle = len(whole.data) // 2
    broken = bytearray(whole.data)
    broken[middle : middle + 300] = bytes(300)
    source, found = salvaged(place, case[0], broken)
    assert found.items() <= whole.samples.items()
    last = max(time for _, time in whole.samples)
    assert {time for _, time in found} >= {START, last}
    assert 0.5 < len(found) / (2 * N) < 1.0
    (stretch,) = source.recovery.lost
    gone = {time for _, time in whole.samples.keys() - found.keys()}
    assert all(stretch[0] <= time <= stretch[1] for time in gone)
    assert source.recovery.expected == 2 * N
    text = told(source)
    assert f"{len(found)} messages of {2 * N}" in text
    assert "in 1 stretch of the log" in text


def test_a_ros1_bag_that_was_never_closed(wholes, place):
    """The last chunk has no length yet, and its messages stand as records of the file."""
    whole = wholes["ros1", "none"]
    with Ros1Reader(whole.path) as reader:
        at, chunk = max(reader.chunks.items())
    data = bytearray(whole.data[: chunk.datapos + chunk.datasize])
    index = data.index(b"index_pos=") + 10
    data[index : index + 8] = bytes(8)
    data[chunk.datapos - 4 : chunk.datapos] = bytes(4)
    source, found = salvaged(place, "ros1", data)
    assert found == whole.samples
    assert "its index is missing: the recording was not closed properly" in told(source)
    assert at < chunk.datapos


def test_a_db3_with_long_messages(tmp_path, place):
    """Those that go on in further pages are there if all of these are."""
    store = typestore(ros1=False)
    lengths = [10, 3_000, 5_000, 40_000, 9, 12_000]
    rows = [("/j", JOINTS, START + i, {"position": [i] * (n // 8)}) for i, n in enumerate(lengths * 4)]
    path = write_ros2(tmp_path / "run", rows, store, "db3")
    data, whole = path.read_bytes(), samples(opened(path, "db3", salvage=False))
    counts = []
    for cut in range(20_480, len(data), 4096):
        _, found = salvaged(place, "db3", data[:cut])
        assert found.items() <= whole.items()
        counts.append(len(found))
    assert counts == sorted(counts)
    assert counts[-1] >= len(whole) - 4
    assert len(set(counts)) > 10


@pytest.mark.parametrize("kind", ["ros1", "mcap"])
def test_messages_that_do_not_follow_their_definition_are_set_aside(tmp_path, kind):
    def rows():
        for i in range(N):
            yield "/joints", JOINTS, START + i, {"name": ["fl", "fr"], "effort": [i, -i]}

    store = typestore(ros1=kind == "ros1")
    if kind == "ros1":
        path = write_ros1(tmp_path / "a.bag", rows(), store)
    else:
        path = write_ros2(tmp_path / "run", rows(), store, kind)
    data = bytearray(path.read_bytes())
    name = b"\x02\0\0\0fl" if kind == "ros1" else b"\x03\0\0\0fl\0"
    # One name is no text any more, of another message a name is longer than the message.
    first = data.index(name)
    data[first + 4] = 0xFF
    second = data.index(name, first + 60)
    data[second + 2] = 0xFF
    path.write_bytes(data)
    source = opened(path, kind)
    found = samples(source)
    assert len(found) == N - 2
    assert source.recovery.aside == 2
    assert "2 messages set aside" in told(source)
    with pytest.raises(DamagedError, match="does not fit its definition"):
        samples(opened(path, kind, salvage=False))


def test_salvage_of_what_is_no_bag(tmp_path):
    for kind in ("ros1", "mcap", "db3"):
        path = tmp_path / kind
        path.write_text("time,torque\n0,1\n" * 20)
        with pytest.raises(FormatError):
            opened(path, kind)
        path.write_bytes(b"")
        with pytest.raises(DamagedError, match="empty"):
            opened(path, kind)


def test_the_judge_sees_what_is_there(wholes):
    """The measure of the test of cuts: all of a whole file, nothing of nothing, more of more."""
    for whole in wholes.values():
        assert whole.complete(len(whole.data)) == whole.samples.keys()
        assert whole.complete(50) == set()
        counts = [len(whole.complete(cut)) for cut in range(0, len(whole.data), len(whole.data) // 9)]
        assert counts == sorted(counts)
        assert np.unique(counts).size > 3
    assert FLOAT != JOINTS
    assert Path(__file__).exists()


@pytest.mark.parametrize("type_name", ["sensor_msgs/msg/JointState", "nav_msgs/msg/Odometry"])
def test_a_definition_that_has_another_checksum(wholes, place, type_name):
    """ROS 1 notes the checksum of each definition: of two that differ, the right one is known."""
    whole = wholes["ros1", "none"]
    text = b"float64[] effort"
    places = [at for at in range(len(whole.data)) if whole.data.startswith(text, at)]
    assert len(places) >= 2
    for changed in (places[:1], places[1:], places):
        broken = bytearray(whole.data)
        for at in changed:
            broken[at : at + len(text)] = b"float32[] effort"
        source, found = salvaged(place, "ros1", broken)
        # A standard type is known by its checksum too.
        assert found == whole.samples
        assert ("the definition of /joints is not" in told(source)) == (changed == places)
    store = typestore(ros1=True)
    definition, digest = store.generate_msgdef(type_name)
    assert checksum(definition, type_name) == digest
    assert checksum(definition.replace("float64", "float32", 1), type_name) != digest
    assert checksum("float32 A=1.50\nint8 x\n", "a/msg/B") is None
    assert checksum("C c\n", "a/msg/B") is None


def test_checksums_of_every_standard_type():
    store = typestore(ros1=True)
    for type_name in store.fielddefs:
        definition, digest = store.generate_msgdef(type_name)
        assert checksum(definition, type_name) in {digest, None}


@pytest.mark.parametrize(
    ("case", "damage", "says"),
    [
        (
            ("mcap", "crc"),
            slice(None, 9_000),
            "cut off at byte 9,000: the end of the file and with it the index",
        ),
        (("mcap", "crc"), 6_000, "checksum"),
        (("ros1", "none"), slice(None, 9_000), "cut off: its index is missing .* the file ends at 9,000"),
        (("ros1", "bz2"), 7_000, "corrupt or cut off"),
        (("db3", "none"), slice(None, 9_000), "cut off: 9,000 of 45,056 bytes are there"),
    ],
)
def test_the_damage_is_named(wholes, place, case, damage, says):
    """Without salvage, in the one line that also names the remedy."""
    data = bytearray(wholes[case].data)
    if isinstance(damage, slice):
        data = data[damage]
    else:
        data[damage : damage + 9] = bytes(9)
    place.write_bytes(data)
    with pytest.raises(DamagedError, match=says) as caught:
        samples(opened(place, case[0], salvage=False))
    assert "--salvage" in caught.value.hint


def test_rows_of_a_database_that_share_their_pages(tmp_path):
    """Each page of a long row is walked once: rows that all name the same ones would take for ever."""
    store = typestore(ros1=False)
    rows = [("/j", JOINTS, START + i, {"position": [i] * 5_000}) for i in range(3)]
    data = write_ros2(tmp_path / "run", rows, store, "db3").read_bytes()
    pages = Pages(data)
    leaf = next(page for page in range(2, pages.count) if any(cell.overflow for cell in cells(pages, page)))
    (cell, *_) = pages.cells(leaf)
    walked = pages.overflow(cell)
    with pytest.raises(TooMuchError, match="share their pages"):
        [pages.overflow(cell) for _ in range(10_000)]
    pages.budget = None
    assert pages.overflow(cell) == walked


def cells(pages, page):
    return list(pages.cells(page)) if pages.code(page) == 13 else []


def test_a_damaged_header_loses_nothing(wholes, place):
    """The profile of an MCAP file says nothing that its channels do not."""
    whole = wholes["mcap", "crc"]
    at = whole.data.index(b"ros2")
    _, found = salvaged(place, "mcap", whole.data[:at] + b"roz2" + whole.data[at + 4 :])
    assert found == whole.samples
    other = whole.data.replace(b"\x03\0\0\0cdr", b"\x03\0\0\0xyz")
    source, found = salvaged(place, "mcap", other)
    assert (source, found) == (None, {})


@pytest.mark.parametrize("name", [b"/speed", b"effort", b"stamp"])
def test_a_name_changed_in_the_summary_is_refused(tmp_path, name):
    path = write(tmp_path, "mcap", "crc")
    samples(opened(path, "mcap", salvage=False))
    data = bytearray(path.read_bytes())
    data[data.rindex(name) + 2] ^= 1
    path.write_bytes(data)
    with pytest.raises(DamagedError, match="checksum of the summary is wrong"):
        opened(path, "mcap", salvage=False)
