"""Messages of two wheels, for bags."""

from __future__ import annotations

import numpy as np

from terrain_cli import telemetry

START = 1_754_000_000
JOINTS = "sensor_msgs/msg/JointState"
FLOAT = "std_msgs/msg/Float64"
WRENCH = "geometry_msgs/msg/WrenchStamped"
ODOMETRY = "nav_msgs/msg/Odometry"
IMU = "sensor_msgs/msg/Imu"
GEOMETRY = "[wheel]\nradius = 0.125\nwidth = 0.1\n[soil]\nshear_modulus = 0.018\n"
#: The example of the contract, word for word.
CONTRACT = """
[wheel]
radius = 0.125            # m
width = 0.100             # m
grouser_count = 12        # optional
[soil]
shear_modulus = 0.018     # m, the k assumed where a method does not estimate it
[channels]                # only what the files don't already name
torque  = { topic = "/joint_states", field = "effort", name = "wheel_fl", unit = "N m" }
sinkage = { topic = "/wheel_fl/sinkage", field = "data", unit = "mm" }
load    = { constant = 81.4, unit = "N" }
"""
N = 50
TIME = np.arange(N) * 0.1
TORQUE = {"wheel_fl": 3.0 + np.sin(TIME), "wheel_fr": 2.5 + np.cos(TIME)}
OMEGA = {"wheel_fl": 1.0 + 0.1 * np.cos(TIME), "wheel_fr": 1.1 + 0.1 * np.sin(TIME)}
SINKAGE = {"wheel_fl": 0.010 + 0.002 * np.sin(TIME), "wheel_fr": 0.012 + 0.002 * np.cos(TIME)}
LOAD = {"wheel_fl": 80.0 + 5.0 * np.sin(TIME), "wheel_fr": 76.0 + 5.0 * np.cos(TIME)}
SPEED = 0.09 + 0.01 * np.sin(TIME / 2)


def ns(seconds):
    return START * 10**9 + round(seconds * 1e6) * 1000


def header(seconds):
    return {"stamp": ns(seconds)}


def joint_states(names=("wheel_fl", "wheel_fr"), *, time=TIME, order=lambda names, _: names, delay=0.0):
    for j, t in enumerate(time):
        there = order(names, j)
        values = {
            "name": there,
            "velocity": [OMEGA[w][j] for w in there],
            "effort": [TORQUE[w][j] for w in there],
        }
        yield ("/joint_states", JOINTS, ns(t + delay), {"header": header(t), **values})


def floats(topic, values, *, time=TIME, delay=0.0):
    for t, value in zip(time, values, strict=True):
        yield (topic, FLOAT, ns(t + delay), {"data": float(value)})


def wrenches(topic, values, *, time=TIME, delay=0.0):
    for t, value in zip(time, values, strict=True):
        force = {"x": 5.0, "z": float(value)}
        yield (topic, WRENCH, ns(t + delay), {"header": header(t), "wrench": {"force": force}})


def odometry(topic="/odom", *, time=TIME, delay=0.0, **twist):
    for j, t in enumerate(time):
        linear = {"x": float(SPEED[j])}
        pose = {"position": {"x": 0.1 * t, "y": -0.2 * t, "z": 0.5}, "orientation": {"w": 1.0}}
        content = {"header": header(t), "pose": {"pose": pose}}
        content["twist"] = {"twist": {"linear": linear, "angular": {"z": 0.0, **twist}}}
        yield (topic, ODOMETRY, ns(t + delay), content)


def one(path, rover):
    (samples,) = telemetry.read(path, rover)
    return samples


def expect(samples, **channels):
    for name, values in channels.items():
        np.testing.assert_allclose(samples.channels[name], values, rtol=1e-12, atol=1e-12, err_msg=name)


TWO_WHEELS = GEOMETRY + "".join(
    f"""
[wheels.{name}.channels]
torque = {{ topic = "/joint_states", field = "effort", name = "{name}", unit = "N m" }}
"""
    for name in ("wheel_fl", "wheel_fr")
)


def two_wheels(**options):
    return (
        joint_states(**options),
        *(floats(f"/{wheel}/sinkage_mm", 1e3 * values) for wheel, values in SINKAGE.items()),
        *(wrenches(f"/{wheel}/force", values) for wheel, values in LOAD.items()),
        odometry(),
    )


def assert_two_wheels(found):
    assert [samples.wheel for samples in found] == ["wheel_fl", "wheel_fr"]
    for samples in found:
        wheel = samples.wheel
        expect(samples, torque=TORQUE[wheel], angular_velocity=OMEGA[wheel], velocity=SPEED)
        expect(samples, sinkage=SINKAGE[wheel], load=LOAD[wheel])
        assert len(samples.usable) == N
