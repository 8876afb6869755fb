"""A rover's bag for the benchmarks: fifteen topics, at full size ten minutes, 385 k messages and 83 MB.

Written with rosbags' own writers. Six wheels drive over four soils; torque, load, sinkage and slip
obey the linearised model with 1 % of noise, so that `terrain-est estimate` has something to find.
"""

from __future__ import annotations

from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from rosbags.rosbag1 import Writer as Ros1Writer
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin
from rosbags.rosbag2 import Writer as Ros2Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from terrain_cli.mechanics import linear

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

CONTAINERS = (
    *(("ros1", compression) for compression in ("none", "lz4", "bz2")),
    *(("mcap", compression) for compression in ("none", "zstd")),
    ("db3", "none"),
)
WHEELS = ("front_left", "front_right", "middle_left", "middle_right", "rear_left", "rear_right")
GEOMETRY = {"radius": 0.1, "width": 0.1, "shear_modulus": 0.018}
#: c in Pa and φ in degrees, one after the other.
SOILS = ((800.0, 37.2), (3000.0, 25.0), (1600.0, 33.0), (600.0, 29.0))
START = 1_700_000_000_000_000_000
#: Bytes of a chunk: rosbag's and mcap's defaults.
CHUNK = {"ros1": 768 << 10, "mcap": 1 << 20}
CUSTOM = {
    "rover_msgs/msg/WheelSinkage": "std_msgs/Header header\nstring[] name\nfloat64[] sinkage\n",
    "rover_msgs/msg/Power": "std_msgs/Header header\nstring state\nfloat32[] cell_voltage\nfloat32 current\nbool charging\n",
}
ROVER = """[wheel]
radius = 0.1
width = 0.1

[soil]
shear_modulus = 0.018

""" + "\n".join(
    f"""[wheels.{name}.channels]
torque = {{ topic = "/joint_states", field = "effort", name = "{name}", unit = "N m" }}
angular_velocity = {{ topic = "/joint_states", field = "velocity", name = "{name}", unit = "rad/s" }}
sinkage = {{ topic = "/sinkage", field = "sinkage", name = "{name}", unit = "m" }}
load = {{ topic = "/{name}/wrench", field = "wrench.force.z", unit = "N" }}
"""
    for name in WHEELS
)


class Topic(NamedTuple):
    name: str
    type: str
    rate: float


TOPICS = (
    Topic("/joint_states", "sensor_msgs/msg/JointState", 100.0),
    Topic("/imu", "sensor_msgs/msg/Imu", 100.0),
    Topic("/odom", "nav_msgs/msg/Odometry", 50.0),
    *(Topic(f"/{wheel}/wrench", "geometry_msgs/msg/WrenchStamped", 50.0) for wheel in WHEELS),
    Topic("/sinkage", "rover_msgs/msg/WheelSinkage", 50.0),
    Topic("/tf", "geometry_msgs/msg/TransformStamped", 20.0),
    Topic("/temperature", "sensor_msgs/msg/Temperature", 10.0),
    Topic("/power", "rover_msgs/msg/Power", 5.0),
    Topic("/gps", "sensor_msgs/msg/NavSatFix", 5.0),
    Topic("/status", "diagnostic_msgs/msg/DiagnosticStatus", 1.0),
)


def drive(seconds: float, rate: float) -> dict[str, Any]:
    """Return the truth of the drive: times in s, and channels of shape (n, wheels)."""
    rng = np.random.default_rng(7)
    time = np.arange(round(seconds * rate)) / rate
    n, wheels = len(time), len(WHEELS)
    soil = np.minimum((time / seconds * len(SOILS)).astype(int), len(SOILS) - 1)
    cohesion, phi = np.array(SOILS)[soil].T
    phase = rng.uniform(0.0, 2.0 * np.pi, wheels)
    wave = np.sin(time[:, None] * 0.9 + phase)
    load = 100.0 + 45.0 * np.sin(time[:, None] * 2.3 + phase) * (1.0 + 0.2 * wave)
    sinkage = 0.012 + 0.005 * wave
    slip = np.broadcast_to(0.3 + 0.12 * np.sin(0.31 * time)[:, None], (n, wheels))
    torque = np.stack(
        [
            linear.torque(
                load[:, j], sinkage[:, j], slip[:, j], cohesion, np.tan(np.radians(phi)), **GEOMETRY
            )
            for j in range(wheels)
        ],
        axis=1,
    )

    def noisy(values):
        return values * (1.0 + 0.01 * rng.standard_normal(values.shape))

    speed = np.full(n, 0.05)
    return {
        "time": time,
        "load": noisy(load),
        "sinkage": noisy(sinkage),
        "torque": noisy(torque),
        "angular_velocity": speed[:, None] / (GEOMETRY["radius"] * (1.0 - slip)),
        "speed": speed,
        "changes": np.flatnonzero(np.diff(soil)) + 1,
    }


class Messages:
    """Builds the messages of every topic with the classes of one typestore."""

    def __init__(self, seconds: float, *, ros1: bool) -> None:
        self.ros1 = ros1
        self.store = get_typestore(Stores.ROS1_NOETIC if ros1 else Stores.ROS2_HUMBLE)
        for name, text in CUSTOM.items():
            self.store.register(get_types_from_msg(text, name))
        self.seconds = seconds
        self.fast, self.slow = drive(seconds, 100.0), drive(seconds, 50.0)
        # Sensors are noisy, or compression would be better than it is on a rover.
        self.noise = 1e-3 * np.random.default_rng(3).standard_normal((round(100.0 * seconds), 10))

    def __call__(self, topic: Topic) -> Iterator[tuple[int, bytes]]:
        """Yield log time and payload."""
        for row in range(round(self.seconds * topic.rate)):
            stamp = START + round(row * 1e9 / topic.rate)
            message = self._message(topic, row, stamp)
            serialise = self.store.serialize_ros1 if self.ros1 else self.store.serialize_cdr
            # The log is 0.2 to 0.9 ms late.
            yield (
                stamp + 200_000 + (7919 * row + 104_729 * len(topic.name)) % 700_000,
                bytes(serialise(message, topic.type)),
            )

    def _make(self, type_name: str, *members: Any) -> Any:
        return self.store.types[type_name](*members)

    def _header(self, stamp: int, row: int, frame: str) -> Any:
        time = self._make("builtin_interfaces/msg/Time", *divmod(stamp, 10**9))
        return self._make("std_msgs/msg/Header", *([row] if self.ros1 else []), time, frame)

    def _vector(self, *values: float) -> Any:
        return self._make("geometry_msgs/msg/Vector3", *values)

    def _pose(self, row: int) -> Any:
        angle = 1e-4 * row + self.noise[row, 0]
        quaternion = self._make("geometry_msgs/msg/Quaternion", 0.0, 0.0, np.sin(angle), np.cos(angle))
        return self._make(
            "geometry_msgs/msg/Pose", self._make("geometry_msgs/msg/Point", 1e-3 * row, 0.5, 0.0), quaternion
        )

    def _message(self, topic: Topic, row: int, stamp: int) -> Any:  # noqa: PLR0911 - one for each type
        header = self._header(stamp, row, "base_link")
        kind = topic.type.rpartition("/")[2]
        if kind == "JointState":
            truth = self.fast
            return self._make(
                topic.type,
                header,
                list(WHEELS),
                0.5 * truth["time"][row] + self.noise[row, :6],
                truth["angular_velocity"][row],
                truth["torque"][row],
            )
        if kind == "Imu":
            turn = self._pose(row).orientation
            rates, acceleration = (
                self._vector(*self.noise[row, 1:4]),
                self._vector(*(self.noise[row, 4:7] + (0.1, 0.2, 9.81))),
            )
            return self._make(
                topic.type, header, turn, np.ones(9), rates, np.ones(9), acceleration, np.ones(9)
            )
        if kind == "Odometry":
            pose = self._make("geometry_msgs/msg/PoseWithCovariance", self._pose(row), np.zeros(36))
            moving = self._make(
                "geometry_msgs/msg/Twist",
                self._vector(self.slow["speed"][row], *self.noise[row, 2:4]),
                self._vector(*self.noise[row, 4:7]),
            )
            twist = self._make("geometry_msgs/msg/TwistWithCovariance", moving, np.zeros(36))
            return self._make(topic.type, header, "base_link", pose, twist)
        if kind == "WrenchStamped":
            wheel = WHEELS.index(topic.name.split("/")[1])
            force = self._vector(*self.noise[row, 4:6], self.slow["load"][row, wheel])
            wrench = self._make("geometry_msgs/msg/Wrench", force, self._vector(*self.noise[row, 6:9]))
            return self._make(topic.type, header, wrench)
        if kind == "WheelSinkage":
            return self._make(topic.type, header, list(WHEELS), self.slow["sinkage"][row])
        if kind == "TransformStamped":
            turn = self._make(
                "geometry_msgs/msg/Transform", self._vector(1e-3 * row, 0.0, 0.0), self._pose(row).orientation
            )
            return self._make(topic.type, header, "odom", turn)
        if kind == "Temperature":
            return self._make(topic.type, header, 20.0 + 1e-3 * row, 0.1)
        if kind == "Power":
            # As long as it likes: the fields behind it begin elsewhere in each message.
            cells = np.linspace(3.3, 3.6, 3 + row % 4, dtype=np.float32)
            return self._make(
                topic.type, header, "charging" if row % 7 else "idle", cells, 1.5 + 1e-3 * row, row % 7 > 0
            )
        if kind == "NavSatFix":
            status = self._make("sensor_msgs/msg/NavSatStatus", 0, 1)
            return self._make(topic.type, header, status, 4.5, 137.4 + 1e-7 * row, -4500.0, np.zeros(9), 0)
        return self._make(
            topic.type, row % 3, f"motor {row % 6}", "all well" if row % 3 else "warm", "rover", []
        )


def payloads(seconds: float, *, ros1: bool) -> list[tuple[int, int, bytes]]:
    """Return log time, place of the topic and payload of all messages, by time."""
    messages = Messages(seconds, ros1=ros1)
    return sorted((time, place, data) for place, topic in enumerate(TOPICS) for time, data in messages(topic))


def write(
    folder: Path, seconds: float, containers: tuple[tuple[str, str], ...] = CONTAINERS
) -> dict[tuple[str, str], Path]:
    """Write the bag into each container that is not there yet, and rover.toml beside them."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "rover.toml").write_text(ROVER, encoding="utf-8")
    paths = {
        (kind, compression): folder
        / (f"run-{compression}.bag" if kind == "ros1" else f"run-{compression}.{kind}")
        for kind, compression in containers
    }
    for ros1 in (True, False):
        missing = [c for c, path in paths.items() if (c[0] == "ros1") == ros1 and not path.exists()]
        rows = payloads(seconds, ros1=ros1) if missing else []
        for container in missing:
            (_write_ros1 if ros1 else _write_ros2)(paths[container], rows, container)
    return paths


def _write_ros1(path: Path, rows: list[tuple[int, int, bytes]], container: tuple[str, str]) -> None:
    part = path.with_suffix(".part")
    part.unlink(missing_ok=True)
    writer = Ros1Writer(part)
    if container[1] != "none":
        writer.set_compression(Ros1Writer.CompressionFormat[container[1].upper()])
    writer.chunk_threshold = CHUNK["ros1"]
    store = Messages(0.1, ros1=True).store
    with writer:
        connections = [writer.add_connection(topic.name, topic.type, typestore=store) for topic in TOPICS]
        for time, place, data in rows:
            writer.write(connections[place], time, data)
    part.rename(path)


def _write_ros2(path: Path, rows: list[tuple[int, int, bytes]], container: tuple[str, str]) -> None:
    kind, compression = container
    with TemporaryDirectory(dir=path.parent) as scratch:
        folder = path.parent / scratch / "run"
        plugin = StoragePlugin.MCAP if kind == "mcap" else StoragePlugin.SQLITE3
        writer = Ros2Writer(folder, version=9, storage_plugin=plugin)
        if compression == "zstd":
            writer.set_compression(CompressionMode.STORAGE, CompressionFormat.ZSTD)
        store = Messages(0.1, ros1=False).store
        with writer:
            connections = [writer.add_connection(topic.name, topic.type, typestore=store) for topic in TOPICS]
            for time, place, data in rows:
                writer.write(connections[place], time, data)
                if kind == "mcap" and writer.storage.chunk.bio.tell() > CHUNK["mcap"]:
                    writer.storage.close_chunk()
        next(file for file in folder.iterdir() if file.name != "metadata.yaml").rename(path)
