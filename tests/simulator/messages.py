"""A run as the ROS messages that a rover publishes.

Joint states carry the torques (`effort`, N m) and wheel speeds of all wheels, a WrenchStamped and
a Float64 the load and the sinkage of each, an Odometry speed and position of the body.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from rosbags.typesys import get_types_from_msg

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from rosbags.typesys.store import Typestore

    from simulator.run import Run, WheelLog

TELEMETRY = "rover_msgs/msg/WheelTelemetry"
#: One message per wheel and sample, of a type that no ROS distribution knows.
TELEMETRY_DEFINITION = """\
std_msgs/Header header
string wheel
float64 load
float64 torque
float64 sinkage
float64 angular_velocity
float64 velocity
float64 x
float64 y
"""
JOINTS = "/joint_states"
ODOMETRY = "/odom"
FIX = "/fix"
TELEMETRY_TOPIC = "/wheel_telemetry"


def identifier(wheel: str) -> str:
    """Name of a wheel as topics and joints have it: no hyphens."""
    return wheel.replace("-", "_")


def joint(wheel: str) -> str:
    """Name of a wheel's joint in the joint states."""
    return f"{identifier(wheel)}_wheel"


def load_topic(wheel: str) -> str:
    """Topic of a wheel's WrenchStamped: force.z is the load, force.x the drawbar pull or NaN."""
    return f"/{identifier(wheel)}/force"


def sinkage_topic(wheel: str) -> str:
    """Topic of a wheel's sinkage, a Float64 in m without a stamp."""
    return f"/{identifier(wheel)}/sinkage"


class Message(NamedTuple):
    stamp: int
    topic: str
    type: str
    content: Any


def messages(run: Run, store: Typestore, *, custom: bool) -> list[Message]:
    """Return the messages of a run by stamp, then in the order of the topics."""
    make = _Factory(store)
    streams = [make.telemetry(run)] if custom else make.standard(run)
    return sorted((m for stream in streams for m in stream), key=lambda m: m.stamp)


def _nanoseconds(time: float) -> int:
    # Times are whole microseconds, which a double in seconds since 1970 only nearly holds.
    return round(time * 1e6) * 1000


class _Factory:
    """Messages of one ROS generation: their headers differ."""

    def __init__(self, store: Typestore) -> None:
        self.types = store.types
        self.numbered = "seq" in {name for name, _ in store.fielddefs["std_msgs/msg/Header"][1]}
        store.register(get_types_from_msg(TELEMETRY_DEFINITION, TELEMETRY))

    def header(self, stamp: int, frame: str) -> Any:
        seconds, nanoseconds = divmod(stamp, 1_000_000_000)
        time = self.types["builtin_interfaces/msg/Time"](sec=seconds, nanosec=nanoseconds)
        numbering = {"seq": 0} if self.numbered else {}
        return self.types["std_msgs/msg/Header"](stamp=time, frame_id=frame, **numbering)

    def vector(self, x: float = 0.0, y: float = 0.0, z: float = 0.0) -> Any:
        return self.types["geometry_msgs/msg/Vector3"](x=x, y=y, z=z)

    def standard(self, run: Run) -> Iterator[Iterator[Message]]:
        logs = list(run.wheels.values())
        yield self.joint_states(logs)
        for log in logs:
            yield self.wrenches(log)
            yield self.sinkages(log)
        yield self.odometry(logs[0], run.drive.heading)
        if run.drive.origin:
            yield self.fixes(logs[0])

    def joint_states(self, logs: Sequence[WheelLog]) -> Iterator[Message]:
        type_name = "sensor_msgs/msg/JointState"
        names = [joint(log.name) for log in logs]
        velocity = np.column_stack([log.measured["angular_velocity"].values for log in logs])
        effort = np.column_stack([log.measured["torque"].values for log in logs])
        for time, omega, torque in zip(logs[0].measured["torque"].time, velocity, effort, strict=True):
            stamp = _nanoseconds(time)
            content = self.types[type_name](
                header=self.header(stamp, ""), name=names, position=np.zeros(0), velocity=omega, effort=torque
            )
            yield Message(stamp, JOINTS, type_name, content)

    def wrenches(self, log: WheelLog) -> Iterator[Message]:
        type_name = "geometry_msgs/msg/WrenchStamped"
        load = log.measured["load"]
        pull = log.measured.get("drawbar_pull")
        pulls = pull.values if pull else np.full(len(load.time), np.nan)
        for time, force, drawbar in zip(load.time, load.values, pulls, strict=True):
            stamp = _nanoseconds(time)
            wrench = self.types["geometry_msgs/msg/Wrench"](
                force=self.vector(x=float(drawbar), z=float(force)), torque=self.vector()
            )
            content = self.types[type_name](header=self.header(stamp, identifier(log.name)), wrench=wrench)
            yield Message(stamp, load_topic(log.name), type_name, content)

    def sinkages(self, log: WheelLog) -> Iterator[Message]:
        type_name = "std_msgs/msg/Float64"
        sinkage = log.measured["sinkage"]
        for time, value in zip(sinkage.time, sinkage.values, strict=True):
            content = self.types[type_name](data=float(value))
            yield Message(_nanoseconds(time), sinkage_topic(log.name), type_name, content)

    def odometry(self, log: WheelLog, heading: float) -> Iterator[Message]:
        type_name, package = "nav_msgs/msg/Odometry", "geometry_msgs/msg/"
        velocity, x, y = (log.measured[channel] for channel in ("velocity", "x", "y"))
        facing = self.types[f"{package}Quaternion"](
            x=0.0, y=0.0, z=float(np.sin(heading / 2.0)), w=float(np.cos(heading / 2.0))
        )
        unknown = np.zeros(36)
        for time, speed, east, north in zip(velocity.time, velocity.values, x.values, y.values, strict=True):
            stamp = _nanoseconds(time)
            pose = self.types[f"{package}Pose"](
                position=self.types[f"{package}Point"](x=float(east), y=float(north), z=0.0),
                orientation=facing,
            )
            twist = self.types[f"{package}Twist"](linear=self.vector(x=float(speed)), angular=self.vector())
            content = self.types[type_name](
                header=self.header(stamp, "site"),
                child_frame_id="body",
                pose=self.types[f"{package}PoseWithCovariance"](pose=pose, covariance=unknown),
                twist=self.types[f"{package}TwistWithCovariance"](twist=twist, covariance=unknown),
            )
            yield Message(stamp, ODOMETRY, type_name, content)

    def fixes(self, log: WheelLog) -> Iterator[Message]:
        type_name = "sensor_msgs/msg/NavSatFix"
        longitude, latitude = log.measured["longitude"], log.measured["latitude"]
        for time, east, north in zip(longitude.time, longitude.values, latitude.values, strict=True):
            stamp = _nanoseconds(time)
            content = self.types[type_name](
                header=self.header(stamp, "antenna"),
                status=self.types["sensor_msgs/msg/NavSatStatus"](status=0, service=1),
                latitude=float(north),
                longitude=float(east),
                altitude=0.0,
                position_covariance=np.zeros(9),
                position_covariance_type=0,
            )
            yield Message(stamp, FIX, type_name, content)

    def telemetry(self, run: Run) -> Iterator[Message]:
        table = run.columns()
        fields = ("load", "torque", "sinkage", "angular_velocity", "velocity", "x", "y")
        for row, time in enumerate(table["time"]):
            stamp = _nanoseconds(time)
            values = {name: float(table[name][row]) for name in fields}
            content = self.types[TELEMETRY](
                header=self.header(stamp, "site"), wheel=table["wheel"][row], **values
            )
            yield Message(stamp, TELEMETRY_TOPIC, TELEMETRY, content)
