"""Real bags of both generations: unequal rates, clocks, and channels derived from several topics."""

from __future__ import annotations

import math

import numpy as np
from wheel_bags import (
    CONTRACT,
    GEOMETRY,
    IMU,
    JOINTS,
    OMEGA,
    SINKAGE,
    SPEED,
    TIME,
    TORQUE,
    TWO_WHEELS,
    N,
    expect,
    floats,
    header,
    joint_states,
    ns,
    odometry,
    one,
    two_wheels,
    wrenches,
)

from terrain_cli import telemetry


def test_topics_at_unequal_rates_meet_on_the_slowest_clock(write_bag, rover_of):
    slow, fast = np.round(np.arange(0.0, 4.91, 0.3), 6), np.round(np.arange(0.0, 5.0, 0.02), 6)
    fast = fast[(fast <= 1.6) | (fast > 3.2)]
    path = write_bag(
        joint_states(),
        floats("/wheel_fl/sinkage", 10.0 + slow, time=slow),
        wrenches("/ft", 80.0 + 2.0 * fast, time=fast),
        odometry(),
    )
    samples = one(path, rover_of(CONTRACT.replace("load ", "# ")))
    np.testing.assert_allclose(samples.time, slow, atol=1e-9)
    gap = (slow > 1.6) & (slow < 3.2)
    torque = np.interp(slow, TIME, TORQUE["wheel_fl"])
    expect(
        samples, load=np.where(gap, np.nan, 80.0 + 2.0 * slow), sinkage=1e-3 * (10.0 + slow), torque=torque
    )
    assert samples.reasons() == {"no load": gap.sum()}
    # Nothing usable for a second and a half: what lies behind it is another stretch.
    assert samples.stretch[samples.usable].tolist() == [0] * 6 + [1] * (len(samples.usable) - 6)
    (remark,) = (text for text in samples.remarks if "rates of their own" in text)
    assert "sinkage has a value every 0.3 s, and its 17 messages are the samples" in remark
    wider = CONTRACT.replace("load ", "# ") + "[sampling]\nmax_gap = 2.0\n"
    assert one(path, rover_of(wider)).reasons() == {}


def test_a_topic_that_loses_messages_is_no_slower_clock(write_bag, rover_of):
    few = np.delete(TIME, np.arange(5, N, 5))
    path = write_bag(joint_states(), floats("/wheel_fl/sinkage", 10.0 + few, time=few), odometry())
    np.testing.assert_allclose(one(path, rover_of(CONTRACT)).time, TIME, atol=1e-9)


def test_a_log_clock_that_is_not_the_headers_clock(write_bag, rover_of):
    # A simulation's clock, or a recording played back ten minutes later.
    path = write_bag(
        joint_states(delay=600.004),
        floats("/wheel_fl/sinkage", 1e3 * SINKAGE["wheel_fl"], delay=600.004),
        odometry(delay=600.004),
    )
    samples = one(path, rover_of(CONTRACT))
    np.testing.assert_allclose(samples.time, TIME, atol=1e-9)
    expect(samples, sinkage=SINKAGE["wheel_fl"], velocity=SPEED)
    assert "the log's clock is +600.004 s off the headers' stamps" in samples.remarks[-1]


def test_a_late_message_is_dated_by_its_header(write_bag, rover_of):
    path = write_bag(
        joint_states(delay=0.2), floats("/wheel_fl/sinkage", 1e3 * SINKAGE["wheel_fl"]), odometry(delay=3.0)
    )
    expect(one(path, rover_of(CONTRACT)), velocity=SPEED, sinkage=SINKAGE["wheel_fl"])


def test_headers_that_tell_different_times_are_not_believed(write_bag, rover_of):
    # The odometry counts from its boot.
    booted = (
        (t, kind, log, {**content, "header": {"stamp": log - ns(-7.0)}})
        for t, kind, log, content in odometry()
    )
    path = write_bag(joint_states(), floats("/wheel_fl/sinkage", 1e3 * SINKAGE["wheel_fl"]), booted)
    samples = one(path, rover_of(CONTRACT))
    expect(samples, velocity=SPEED, torque=TORQUE["wheel_fl"])
    assert "the times are the log's" in samples.remarks[-1]


def test_headers_whose_clock_begins_anew_are_not_believed(write_bag, rover_of):
    def reset(rows):
        for topic, kind, log, content in rows:
            stamp = log - ns(0.0) if log < ns(2.5) else log - ns(2.5)
            yield topic, kind, log, {**content, "header": {"stamp": stamp + 10**9}}

    path = write_bag(
        reset(joint_states()), floats("/wheel_fl/sinkage", 1e3 * SINKAGE["wheel_fl"]), reset(odometry())
    )
    samples = one(path, rover_of(CONTRACT))
    np.testing.assert_allclose(samples.time, TIME, atol=1e-9)
    expect(samples, torque=TORQUE["wheel_fl"], velocity=SPEED)
    assert "begins anew" in samples.remarks[-1]


def test_torque_from_current_and_temperature(write_bag, rover_of):
    rover = rover_of(
        CONTRACT.replace("torque  =", "motor_current =").replace('"N m"', '"A"')
        + """
        [motor]
        torque_constant = 0.03
        gear_ratio = 50
        efficiency = 0.8
        temperature_coefficient = -0.001
        no_load_current = 0.2
        """
    )
    warm = 35.0 + 2.0 * TIME
    path = write_bag(
        joint_states(),
        floats("/wheel_fl/sinkage", 1e3 * SINKAGE["wheel_fl"]),
        floats("/wheel_fl/motor_temperature", warm),
        odometry(),
    )
    samples = one(path, rover)
    expected = 0.8 * 50 * 0.03 * (1.0 - 0.001 * (warm - 25.0)) * (TORQUE["wheel_fl"] - 0.2)
    expect(samples, torque=expected)
    assert samples.origins["torque"] == "derived from motor current and temperature"


def test_load_from_the_balance_through_the_pitch_of_an_imu(write_bag, rover_of):
    # Level, each of four wheels carries a quarter; nose up by θ, the height h of the centre of mass
    # moves m g sin θ h / (2 L) from each front wheel to the rear.
    places = {
        "wheel_fl": (0.5, 0.4),
        "wheel_fr": (0.5, -0.4),
        "wheel_rl": (-0.5, 0.4),
        "wheel_rr": (-0.5, -0.4),
    }
    text = GEOMETRY + "[vehicle]\nmass = 40.0\ngravity = 9.8\ncentre_of_mass = [0.0, 0.0, 0.25]\n"
    for name, (x, y) in places.items():
        text += f"[wheels.{name}]\nposition = [{x}, {y}, 0.0]\n[wheels.{name}.channels]\n"
        text += f'torque = {{ topic = "/joint_states", field = "effort", name = "{name}", unit = "N m" }}\n'
        text += f'sinkage = {{ topic = "/sinkage/{name[-2:]}", field = "data", unit = "m" }}\n'
    pitch = 0.2 * np.sin(TIME)
    imu = (
        (
            "/imu",
            IMU,
            ns(t),
            {"header": header(t), "orientation": {"y": math.sin(-p / 2), "w": math.cos(p / 2)}},
        )
        for t, p in zip(TIME, pitch, strict=True)
    )
    joints = (
        (
            "/joint_states",
            JOINTS,
            ns(t),
            {"header": header(t), "name": list(places), "velocity": [1.0] * 4, "effort": [3.0] * 4},
        )
        for t in TIME
    )
    sinkages = (floats(f"/sinkage/{name[-2:]}", np.full(N, 0.01)) for name in places)
    found = telemetry.read(write_bag(joints, *sinkages, imu, odometry()), rover_of(text))
    assert [samples.wheel for samples in found] == list(places)
    moved = 40.0 * 9.8 * np.sin(pitch) * 0.25 / 2.0
    for samples in found:
        sign = -1.0 if samples.wheel[-2] == "f" else 1.0
        expect(samples, load=40.0 * 9.8 * np.cos(pitch) / 4.0 + sign * moved)
        assert (
            samples.origins["load"] == "derived from the quasi-static balance of the vehicle, pitch and roll"
        )


def test_a_wheel_on_the_outside_of_a_turn_is_faster(write_bag, rover_of):
    text = (
        TWO_WHEELS
        + "[wheels.wheel_fl]\nposition = [0.5, 0.4, 0.0]\n[wheels.wheel_fr]\nposition = [0.5, -0.4, 0.0]\n"
    )
    sinkages, loads = list(two_wheels())[1:3], list(two_wheels())[3:5]
    path = write_bag(joint_states(), *sinkages, *loads, odometry(z=0.05))
    left, right = telemetry.read(path, rover_of(text))
    expect(left, velocity=SPEED - 0.4 * 0.05)
    expect(right, velocity=SPEED + 0.4 * 0.05)
    assert left.origins["velocity"].startswith("derived from /odom twist.twist.linear.x")


def test_places_on_earth(write_bag, rover_of):
    fixes = (
        (
            "/fix",
            "sensor_msgs/msg/NavSatFix",
            ns(t),
            {"header": header(t), "longitude": 11.5 + t, "latitude": 48.0},
        )
        for t in TIME
    )
    path = write_bag(
        joint_states(), floats("/wheel_fl/sinkage", 1e3 * SINKAGE["wheel_fl"]), odometry(), fixes
    )
    expect(one(path, rover_of(CONTRACT)), longitude=11.5 + TIME, latitude=np.full(N, 48.0))


def test_the_terrain_last_said(write_bag, rover_of):
    said = (
        ("/terrain", "std_msgs/msg/String", ns(t), {"data": name})
        for t, name in ((1.0, "sand"), (3.01, "rock"), (4.0, "sand"))
    )
    path = write_bag(joint_states(), floats("/wheel_fl/sinkage", 1e3 * SINKAGE["wheel_fl"]), odometry(), said)
    labels = one(path, rover_of(CONTRACT)).labels["terrain"]
    names = [None if code < 0 else labels.names[code] for code in labels.codes]
    assert names == [None] * 10 + ["sand"] * 21 + ["rock"] * 9 + ["sand"] * 10


def test_a_reversing_wheel_has_the_same_soil(write_bag, rover_of):
    back = (
        (t, k, log, {**c, "velocity": [-v for v in c["velocity"]], "effort": [-v for v in c["effort"]]})
        for t, k, log, c in joint_states()
    )
    path = write_bag(
        back,
        floats("/wheel_fl/sinkage", 1e3 * SINKAGE["wheel_fl"]),
        (
            (t, k, log, {**c, "twist": {"twist": {"linear": {"x": -c["twist"]["twist"]["linear"]["x"]}}}})
            for t, k, log, c in odometry()
        ),
    )
    samples = one(path, rover_of(CONTRACT))
    expect(samples, torque=TORQUE["wheel_fl"], slip=1.0 - SPEED / (0.125 * OMEGA["wheel_fl"]))
