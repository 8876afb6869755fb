"""A log as the messages that a rover publishes."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from formats.output.bag_writer import Topic
from terrain_cli.simulation.scenario import JOINTS, identifier, joint
from terrain_cli.simulation.simulated_log import TOGETHER

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from numpy.typing import NDArray

    from terrain_cli.simulation.simulated_log import SimulatedLog, SimulatedSeries

    Array = NDArray[np.float64]

#: One stamped number; the name of the topic says of what.
NUMBER = "terrain_est_msgs/msg/Float64Stamped"
NUMBER_DEFINITION = "std_msgs/Header header\nfloat64 data\n"


def topics(log: SimulatedLog) -> list[Topic]:
    """Return the messages of a log.

    Joint states carry torque (effort, N m) and wheel speed, a WrenchStamped for each wheel load
    (force.z) and drawbar pull (force.x), Odometry and Imu what is of the body. A Float64Stamped
    carries any other number, in SI units, under the name of its channel.
    """
    return [*_joint_states(log), *_of_wheels(log), *_of_body(log)]


def _joint_states(log: SimulatedLog) -> Iterator[Topic]:
    efforts = {name: measured["torque"] for name, measured in log.wheels.items()}
    speeds = [measured["angular_velocity"].values for measured in log.wheels.values()]
    time = next(iter(efforts.values())).time
    effort, velocity = np.column_stack([e.values for e in efforts.values()]), np.column_stack(speeds)
    yield _topic(
        log,
        JOINTS,
        "sensor_msgs/msg/JointState",
        time,
        {"velocity": velocity, "effort": effort, "name": [joint(name) for name in efforts]},
        np.hstack([effort, velocity]),
    )


def _of_wheels(log: SimulatedLog) -> Iterator[Topic]:
    for wheel, measured in log.wheels.items():
        place = f"/{identifier(wheel)}"
        numbers = ["sinkage", "motor_temperature", "pass_number"]
        load, pull = measured["load"], measured.get("drawbar_pull")
        if pull is None:
            numbers.insert(0, "load")
        else:
            columns = {"header.frame_id": identifier(wheel), "wrench.force.x": pull.values}
            columns["wrench.force.z"] = load.values
            known = np.column_stack([load.values, pull.values])
            yield _topic(log, f"{place}/force", "geometry_msgs/msg/WrenchStamped", load.time, columns, known)
        for name in numbers:
            yield _number(log, f"{place}/{name}", measured[name])


def _of_body(log: SimulatedLog) -> Iterator[Topic]:
    body = log.body
    odometry = {name: body[name] for name in TOGETHER["odometry"][0]}
    time = odometry["velocity"].time
    yield _topic(
        log,
        "/odom",
        "nav_msgs/msg/Odometry",
        time,
        {
            "header.frame_id": "site",
            "child_frame_id": "body",
            "twist.twist.linear.x": odometry["velocity"].values,
            "pose.pose.position.x": odometry["x"].values,
            "pose.pose.position.y": odometry["y"].values,
            "pose.pose.position.z": odometry["elevation"].values,
            "pose.pose.orientation.w": 1.0,
        },
        np.column_stack([series.values for series in odometry.values()]),
    )
    pitch, roll, yaw_rate = (body[name] for name in TOGETHER["attitude"][0])
    columns = {"header.frame_id": "body", "angular_velocity.z": yaw_rate.values}
    columns |= _orientation(pitch.values, roll.values)
    known = np.column_stack([pitch.values, roll.values, yaw_rate.values])
    yield _topic(log, "/imu", "sensor_msgs/msg/Imu", pitch.time, columns, known)
    for name in ("acceleration", "slip_angle"):
        yield _number(log, f"/{name}", body[name])


def _number(log: SimulatedLog, name: str, series: SimulatedSeries) -> Topic:
    known = series.values[:, np.newaxis]
    return _topic(log, name, NUMBER, series.time, {"data": series.values}, known, NUMBER_DEFINITION)


def _topic(
    log: SimulatedLog,
    name: str,
    message_type: str,
    time: Array,
    columns: Mapping[str, Any],
    known: Array,
    definition: str = "",
) -> Topic:
    """Keep the messages in which anything is known."""
    kept = ~np.isnan(known).all(axis=1)
    # Whole microseconds, which a double in seconds since 1970 only nearly holds.
    stamps = np.round((log.scenario.start + time[kept]) * 1e6).astype(np.int64) * 1000
    cut = {path: c[kept] if isinstance(c, np.ndarray) else c for path, c in columns.items()}
    return Topic(name, message_type, stamps, cut, definition)


def _orientation(pitch: Array, roll: Array) -> dict[str, Array]:
    """Quaternion of an attitude, of REP 103: about y it is positive nose down."""
    down, side = -0.5 * pitch, 0.5 * roll
    return {
        "orientation.w": np.cos(down) * np.cos(side),
        "orientation.x": np.cos(down) * np.sin(side),
        "orientation.y": np.sin(down) * np.cos(side),
        "orientation.z": -np.sin(down) * np.sin(side),
    }
