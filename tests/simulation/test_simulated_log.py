"""From the truth to rows and messages."""

from __future__ import annotations

import numpy as np
import pytest

from terrain_cli.simulation import read, simulate, table, truth_table
from terrain_cli.simulation.scenario import START
from terrain_cli.simulation.simulated_log import channels, rates

SHORT = {"duration": 20.0, "drive": ["mixed"]}


def test_table_has_a_row_for_each_wheel_and_time():
    log = simulate(read(None, {**SHORT, "wheels": 2, "rate": 10.0}))
    rows = table(log)
    assert list(rows)[:4] == ["time", "wheel", "load", "torque"]
    assert len(rows["time"]) == 400
    assert rows["wheel"][:3] == ["front-left", "front-right", "front-left"]
    assert rows["time"][:3].tolist() == [START, START, START + 0.1]
    assert not any(np.isnan(rows[name]).any() for name in channels(log.scenario))


def test_every_drive_has_every_channel():
    names = {"pitch", "slip_angle", "motor_temperature", "pass_number", "acceleration", "yaw_rate"}
    for drive in ("slip-sweep", "load-steps", "turns"):
        assert names <= set(table(simulate(read(None, {**SHORT, "drive": [drive]}))))


def test_truth_is_the_log_without_noise():
    log = simulate(read(None, {**SHORT, "soil": ["dry-sand", "sandy-loam"]}))
    rows, truth = table(log), truth_table(log)
    assert list(truth)[:3] == ["time", "wheel", "soil"]
    for name in channels(log.scenario):
        np.testing.assert_allclose(rows[name], truth[name], rtol=2e-10, err_msg=name)
    soils = np.array(truth["soil"])
    assert set(truth["cohesion_Pa"][soils == "dry-sand"]) == {1040.0}
    assert set(truth["cohesion_Pa"][soils == "sandy-loam"]) == {1720.0}
    (first, second) = log.stretches["wheel"]
    assert (first.soil, first.start, second.soil, second.end) == (0, 0.0, 1, 20.0)
    change = truth["time"][np.argmax(soils == "sandy-loam")] - START
    assert change == pytest.approx(second.start, abs=0.06)


@pytest.mark.parametrize("channel", ["load", "torque", "sinkage", "drawbar_pull", "slip"])
def test_share_of_noise_is_that_of_the_channel(channel):
    log = simulate(read(None, {**SHORT, "rate": 100.0, "noise": "5%"}))
    rows, truth = table(log), truth_table(log)
    shown = (
        rows[channel] if channel != "slip" else 1.0 - rows["velocity"] / (0.125 * rows["angular_velocity"])
    )
    noise = (shown - truth[channel]) / truth[channel]
    assert np.std(noise) == pytest.approx(0.05, rel=5.0 / np.sqrt(2.0 * len(noise)))
    quiet = "velocity"
    np.testing.assert_allclose(rows[quiet], truth[quiet], rtol=2e-10)


def test_noise_of_channels_is_independent():
    log = simulate(read(None, {**SHORT, "rate": 100.0, "noise": "5%", "wheels": 2}))
    rows, truth = table(log), truth_table(log)
    left = np.array(rows["wheel"]) == "front-left"
    noise = [
        (rows[name] - truth[name])[mask] / truth[name][mask]
        for name in ("load", "torque", "sinkage")
        for mask in (left, ~left)
    ]
    others = np.corrcoef(noise) - np.eye(len(noise))
    assert np.max(np.abs(others)) < 5.0 / np.sqrt(left.sum())


def test_unequal_rates_of_a_table():
    log = simulate(read(None, {**SHORT, "rate": 20.0, "rates": {"sinkage": 5.0, "pitch": 30.0}}))
    rows = table(log)
    known = {name: int(np.sum(~np.isnan(rows[name]))) for name in ("torque", "sinkage", "pitch")}
    assert known == {"torque": 400, "sinkage": 100, "pitch": 600}


def test_rates_of_a_bag():
    scenario = read(None, {**SHORT, "rate": 20.0})
    found = rates(scenario, bag=True)
    assert len(set(found.values())) >= 4
    asked = rates(read(None, {**SHORT, "rates": {"load": 7.0}}), bag=True)
    assert asked["load"] == asked["drawbar_pull"] == 7.0
    assert asked["torque"] == 20.0


def test_body_is_measured_once():
    log = simulate(read(None, {**SHORT, "wheels": 2, "noise": {"pitch": 0.01, "x": 0.01}}))
    left, right = log.wheels.values()
    for name in ("pitch", "x"):
        np.testing.assert_array_equal(left[name].values, right[name].values)
        np.testing.assert_array_equal(left[name].values, log.body[name].values)


def test_without_drawbar_pull():
    log = simulate(read(None, {**SHORT, "drawbar_pull": False}))
    assert "drawbar_pull" not in table(log)
    assert "drawbar_pull" not in log.wheels["wheel"]
