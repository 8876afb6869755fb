"""Standard ROS messages: the units of their fields, and the fields that can mean only one channel.

Units and axes (x forward, y left, z up) are those of REP 103. What a message leaves open is not
guessed: the `effort` of a JointState may be a torque or a current, the velocity of a TwistStamped
may be commanded.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    Array = NDArray[np.float64]

JOINT_STATE = "sensor_msgs/msg/JointState"
_STANDARD = re.compile(
    r"(std|sensor|geometry|nav|diagnostic|tf2|rosgraph|rcl_interfaces|visualization)_msgs/msg/"
)

#: Fields of standard messages whose unit the message's definition fixes.
_UNITS = (
    (r"JointState", r"velocity", "rad/s"),
    (r"JointState", r"position", "rad"),
    (r"(Wrench|WrenchStamped)", r"(wrench\.)?force\.[xyz]", "N"),
    (r"(Wrench|WrenchStamped)", r"(wrench\.)?torque\.[xyz]", "N m"),
    (r"(Odometry|Pose.*|Point.*)", r"(.*\.)?(position|point)\.[xyz]", "m"),
    (r"Point", r"[xyz]", "m"),
    (r"(Odometry|Twist.*)", r"(.*\.)?linear\.[xyz]", "m/s"),
    (r"(Odometry|Twist.*)", r"(.*\.)?angular\.[xyz]", "rad/s"),
    (r"(Imu|Accel.*)", r"(.*\.)?(linear_acceleration|linear)\.[xyz]", "m/s²"),
    (r"Imu", r"angular_velocity\.[xyz]", "rad/s"),
    (r"NavSatFix", r"(longitude|latitude)", "deg"),
    (r"NavSatFix", r"altitude", "m"),
    (r"Temperature", r"temperature", "°C"),
)


def pitch(x: Array, y: Array, z: Array, w: Array) -> Array:
    """Pitch (rad) of a unit quaternion, positive nose up (REP 103's rotation about y: nose down)."""
    return -np.arcsin(np.clip(2.0 * (w * y - z * x), -1.0, 1.0))


def roll(x: Array, y: Array, z: Array, w: Array) -> Array:
    """Roll (rad) of a unit quaternion, positive left side up."""
    return np.arctan2(2.0 * (w * x + y * z), 1.0 - 2.0 * (x**2 + y**2))


@dataclass(frozen=True, slots=True, kw_only=True)
class Meaning:
    """A channel that a standard message carries."""

    channel: str
    #: What it is read from.
    fields: tuple[str, ...]
    #: Function of those fields; without it there is one, taken as it is.
    combine: Callable[..., Array] | None = None
    #: What was taken for granted.
    note: str = ""
    #: Of two messages with one channel the lower rank is used.
    rank: int = 0
    #: Of the origin of the body, not of each wheel.
    of_body: bool = False


def _attitude(prefix: str, rank: int) -> tuple[Meaning, ...]:
    quaternion = tuple(f"{prefix}orientation.{axis}" for axis in "xyzw")
    return (
        Meaning(
            channel="pitch", fields=quaternion, combine=pitch, note="nose up, from the orientation", rank=rank
        ),
        Meaning(
            channel="roll",
            fields=quaternion,
            combine=roll,
            note="left side up, from the orientation",
            rank=rank,
        ),
    )


_AXES = "the sensor's axes taken as x forward, z up"
_MEANINGS = {
    "nav_msgs/msg/Odometry": (
        Meaning(
            channel="velocity",
            fields=("twist.twist.linear.x",),
            note="odometry taken as the true speed, not the wheels' own",
            of_body=True,
        ),
        Meaning(channel="yaw_rate", fields=("twist.twist.angular.z",), rank=1),
        Meaning(channel="x", fields=("pose.pose.position.x",)),
        Meaning(channel="y", fields=("pose.pose.position.y",)),
        Meaning(channel="elevation", fields=("pose.pose.position.z",)),
        *_attitude("pose.pose.", 1),
    ),
    "sensor_msgs/msg/Imu": (Meaning(channel="yaw_rate", fields=("angular_velocity.z",)), *_attitude("", 0)),
    "sensor_msgs/msg/NavSatFix": (
        Meaning(channel="longitude", fields=("longitude",)),
        Meaning(channel="latitude", fields=("latitude",)),
    ),
    "geometry_msgs/msg/WrenchStamped": (
        Meaning(channel="load", fields=("wrench.force.z",), note=_AXES),
        Meaning(channel="drawbar_pull", fields=("wrench.force.x",), note=_AXES),
    ),
    "geometry_msgs/msg/Wrench": (
        Meaning(channel="load", fields=("force.z",), note=_AXES),
        Meaning(channel="drawbar_pull", fields=("force.x",), note=_AXES),
    ),
}


def is_standard(message_type: str) -> bool:
    """Tell whether a type belongs to the packages that come with ROS."""
    return _STANDARD.match(message_type) is not None


def unit_symbol(message_type: str, field: str) -> str | None:
    """Return the unit that a standard message fixes for a field, unless its definition leaves it open."""
    if not is_standard(message_type):
        return None
    name = message_type.rpartition("/")[2]
    bare = field.partition("[")[0]
    for types, fields, symbol in _UNITS:
        if re.fullmatch(types, name) and re.fullmatch(fields, bare):
            return symbol
    return None


def meanings(message_type: str) -> tuple[Meaning, ...]:
    """Return the channels that a standard message carries."""
    return _MEANINGS.get(message_type, ())
