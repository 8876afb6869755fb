"""Messages that arrive are put on one clock as those of the finished bag are."""

from __future__ import annotations

import time

import numpy as np
import pytest
from bags import typestore, write_ros2
from streams import Told
from wheel_bags import FLOAT, GEOMETRY, JOINTS, ODOMETRY, TWO_WHEELS, WRENCH, header, ns

from formats.rosbag.arriving_bag import ArrivingBag
from terrain_cli import telemetry
from terrain_cli.errors import InputError
from terrain_cli.rover import rover_file
from terrain_cli.run.settings import Settings
from terrain_cli.stream import arriving_samples
from terrain_cli.stream.arriving_samples import MessageSamples
from terrain_cli.stream.follow import Follow
from terrain_cli.telemetry.long_logs import joined

ROVER = rover_file.of_text(TWO_WHEELS)
WHEELS = ("wheel_fl", "wheel_fr")
RATES = {"joints": 40, "sinkage": 20, "force": 25, "odometry": 10}


def drive(seconds=18.0, *, delay=0.0, seed=1, **rates):
    """Return messages of topics with rates of their own, at jittering times; forces come with a `delay`."""
    rng = np.random.default_rng(seed)
    rates = RATES | rates
    rows = []

    def clock(name):
        rate = rates[name]
        count = int(seconds * rate)
        return (np.arange(count) + 0.2 + rng.uniform(-0.2, 0.2, count)) / rate

    def add(topic, kind, time, content, *, stamped=True):
        late = delay if kind == WRENCH else 0.001
        stamp = {"header": header(time)} if stamped else {}
        rows.append((topic, kind, ns(time + late), stamp | content))

    for t in clock("joints"):
        speeds, torques = [1.0 + 0.1 * np.cos(t), 1.1], [3.0 + np.sin(t), 2.5 + np.cos(t)]
        add("/joint_states", JOINTS, t, {"name": list(WHEELS), "velocity": speeds, "effort": torques})
    for wheel in WHEELS:
        for t in clock("sinkage"):
            add(f"/{wheel}/sinkage_mm", FLOAT, t, {"data": float(10.0 + 2.0 * np.sin(t))}, stamped=False)
        for t in clock("force"):
            add(f"/{wheel}/force", WRENCH, t, {"wrench": {"force": {"x": 5.0, "z": 80.0 + 5.0 * np.sin(t)}}})
    for t in clock("odometry"):
        twist = {"twist": {"linear": {"x": 0.09 + 0.01 * np.sin(t)}}}
        add("/odom", ODOMETRY, t, {"pose": {"pose": {"orientation": {"w": 1.0}}}, "twist": twist})
    return sorted(rows, key=lambda row: row[2])


def moved(rows, seconds):
    """Return messages at later log times, and stamps."""
    for topic, kind, logged, content in rows:
        stamp = (
            {"header": {"stamp": content["header"]["stamp"] + seconds * 10**9}} if "header" in content else {}
        )
        yield topic, kind, logged + seconds * 10**9, content | stamp


class Arrived:
    """What came of a bag that was appended piece by piece."""

    def __init__(self, path, *, pieces=60, keep=True, rover=ROVER):
        self._rover = rover
        data = path.read_bytes()
        growing = path.with_name("growing.mcap")
        self.parts, self.samples, self.held = {}, None, []
        bag = None
        with growing.open("wb") as file:
            for piece in np.array_split(np.frombuffer(data, np.uint8), pieces):
                file.write(piece.tobytes())
                file.flush()
                bag = bag or ArrivingBag(str(growing), "mcap")
                if self.samples is None:
                    came = self._begin(bag) if bag.prepare(b"", hurry=False) else None
                else:
                    came = bag.take()
                if came:
                    self._add(self.samples.take(came), keep=keep)
                    self.held.append(sum(len(table["@log"]) for table in self.samples._held.values()))
        assert bag.ended
        self._add(self.samples.rest(), keep=keep)

    def _begin(self, bag):
        try:
            samples = MessageSamples(bag, self._rover, Settings(), None)
            came = bag.take()
            samples.check(came)
        except InputError:
            if bag.young:
                return None
            raise
        self.samples = samples
        return came

    def _add(self, parts, *, keep):
        for part in parts:
            if keep:
                self.parts.setdefault(part.wheel, []).append(part)

    def wheel(self, name):
        return joined(self.parts[name])


def written(rows, folder, chunk=4000):
    return write_ros2(folder / "whole", rows, typestore(ros1=False), "mcap", chunk=chunk)


def without(rows, topic, begin, end):
    return [row for row in rows if not (row[0].startswith(topic) and ns(begin) < row[2] < ns(end))]


#: What is driven, and without which topic from when to when.
CASES = {
    "usual": {},
    "one rate": {"joints": 20, "force": 20, "odometry": 20},
    "a slow sensor": {"sinkage": 2},
    "a slow body": {"odometry": 1},
    "late headers": {"delay": 1.5},
    "a silent sensor": {"gone": ("/wheel_fl/force", 5.0, 13.0)},
    "a silent wheel": {"gone": ("/wheel_fl", 5.0, 40.0)},
    "a pause": {"gone": ("/", 5.0, 13.0)},
    "a sensor that starts late": {"gone": ("/wheel_fl/force", -1.0, 3.0)},
}


@pytest.mark.parametrize("case", CASES)
def test_samples_are_those_of_the_finished_bag(case, tmp_path):
    gone = CASES[case].get("gone", ("none", 0.0, 0.0))
    path = written(without(drive(**{k: v for k, v in CASES[case].items() if k != "gone"}), *gone), tmp_path)
    arrived = Arrived(path)
    for expected in telemetry.read(str(path), ROVER):
        found = arrived.wheel(expected.wheel)
        assert len(expected.usable) > 15
        np.testing.assert_array_equal(found.time + found.origin, expected.time + expected.origin)
        assert found.channels.keys() == expected.channels.keys()
        for name, values in expected.channels.items():
            np.testing.assert_array_equal(found.channels[name], values, name)
        np.testing.assert_array_equal(np.diff(found.stretch) != 0, np.diff(expected.stretch) != 0)
        assert found.reasons() == expected.reasons()
        np.testing.assert_array_equal(found.usable, expected.usable)
        np.testing.assert_allclose(found.distance, expected.distance, atol=1e-9)
    assert arrived.samples.late == 0
    assert not any(len(parts) < 10 for parts in arrived.parts.values())


def test_one_type_of_message_that_names_its_wheel(tmp_path):
    """All channels of a wheel stand in one message, of two publishers or more."""
    kind = "rover_msgs/msg/WheelState"
    names = ("torque", "load", "sinkage", "angular_velocity", "velocity")
    lines = ["std_msgs/Header header", "string wheel", *(f"float64 {name}" for name in names)]
    store = typestore({kind: "\n".join(lines)}, ros1=False)
    rows = []
    for n in range(800):
        for wheel, shift in (("left", 0.0), ("right", 0.02)):
            t = 0.05 * n + shift
            values = dict(zip(names, (3.0 + np.sin(t), 80.0 + np.cos(t), 0.01, 1.0, 0.1), strict=True))
            rows.append(("/wheels", kind, ns(t + 0.001), {"header": header(t), "wheel": wheel, **values}))
    path = write_ros2(tmp_path / "whole", rows, store, "mcap", chunk=4000)
    rover = rover_file.of_text(GEOMETRY)
    arrived = Arrived(path, rover=rover)
    found = telemetry.read(str(path), rover)
    assert [samples.wheel for samples in found] == ["left", "right"]
    for expected in found:
        np.testing.assert_array_equal(arrived.wheel(expected.wheel).time, expected.time)
        np.testing.assert_array_equal(
            arrived.wheel(expected.wheel).channels["torque"], expected.channels["torque"]
        )


def test_a_recorder_that_waits_for_its_rover(tmp_path, monkeypatch):
    """The file is there long before the first message, and that before the others."""
    rows = drive()
    path = written(rows, tmp_path, chunk=1)
    now = [0.0]
    monkeypatch.setattr(time, "monotonic", lambda: now[0])
    data, growing = path.read_bytes(), tmp_path / "growing.mcap"

    def pieces():
        with growing.open("wb") as file:
            for begin in (0, 20, *range(500, 20_000, 500)):
                file.write(data[file.tell() : begin])
                file.flush()
                now[0] += 0.1 if begin > 500 else 30.0
                yield data[:begin]
            file.write(data[file.tell() :])
            file.flush()
            yield data

    told = Told()
    Follow(ROVER, Settings(method="recursive"), told, every=None).run(pieces(), str(growing))
    assert sum(told.table["n_samples"]) > 340


def test_a_clock_that_begins_anew_costs_a_few_messages(tmp_path):
    rows = drive()
    half = len(rows) // 2
    path = written([*rows[:half], *moved(rows[half:], -1000)], tmp_path)
    arrived = Arrived(path)
    found = arrived.wheel("wheel_fl")
    assert 160 < len(found.usable) <= 180
    assert (np.diff(found.time) < 0.0).sum() == 1
    assert (np.diff(found.stretch) != 0).sum() == 1
    assert 0 < arrived.samples.late < 150


def test_a_time_of_far_ahead_does_not_end_it(tmp_path):
    rows = drive()
    half = len(rows) // 2
    path = written([*rows[:half], *moved(rows[half : half + 1], 10**6), *rows[half:]], tmp_path)
    assert len(Arrived(path).wheel("wheel_fl").usable) > 165


def test_what_is_missing_is_told_once_it_cannot_come(tmp_path):
    path = written(without(drive(), "/wheel_fl/sinkage_mm", -1.0, 40.0), tmp_path)
    with pytest.raises(InputError, match="sinkage is neither measured nor derived"):
        Arrived(path)


def test_memory_is_bounded(tmp_path, monkeypatch):
    """Though one topic is silent from some time on."""
    monkeypatch.setattr(arriving_samples, "BEFORE", 64)
    rows = without(drive(50.0, joints=10, odometry=10, force=10, sinkage=10), "/wheel_fl/force", 10.0, 99.0)
    path = written(rows, tmp_path)
    held = np.array(Arrived(path, pieces=200, keep=False).held)
    assert held[len(held) // 2 :].max() <= 1.1 * held[: len(held) // 2].max()
