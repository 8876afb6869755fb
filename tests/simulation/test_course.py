"""The way of the body and of each wheel."""

from __future__ import annotations

import math

import numpy as np
import pytest

from terrain_cli.errors import ConfigurationError
from terrain_cli.simulation import course, read
from terrain_cli.simulation.course import STEP
from terrain_cli.simulation.drive_file import PRESETS


def ride(options, wheel=0):
    scenario = read(None, options)
    return course.ride(scenario, course.plan(scenario), scenario.wheels[wheel])


def part(**profiles):
    return {"part": [{"duration": 20.0, "load": 1.0, "slip": 0.3, **profiles}]}


def test_straight_drive():
    way = course.plan(read(None, part()))
    assert way.time[-1] == pytest.approx(20.0)
    assert way.smooth["x"][-1] == pytest.approx(2.0)
    assert not way.smooth["y"].any()
    assert not way.smooth["acceleration"].any()


def test_circle_and_climb():
    turn = course.plan(read(None, part(yaw_rate=math.tau / 20.0, pitch_deg=30.0)))
    # A full circle ends where it began, but higher.
    assert math.hypot(turn.smooth["x"][-1], turn.smooth["y"][-1]) < 2e-3
    assert turn.smooth["elevation"][-1] == pytest.approx(1.0)
    radius = np.max(turn.smooth["y"]) / 2.0
    assert radius == pytest.approx(0.1 * math.cos(math.radians(30.0)) / (math.tau / 20.0), rel=1e-3)


def test_crab():
    way = course.plan(read(None, part(slip_angle_deg=10.0)))
    assert math.atan2(way.smooth["y"][-1], way.smooth["x"][-1]) == pytest.approx(-math.radians(10.0))


def test_acceleration_is_that_of_the_velocity():
    way = course.plan(read(None, {"drive": ["speed-steps"]}))
    change = np.cumsum(way.smooth["acceleration"]) * STEP
    np.testing.assert_allclose(change, way.smooth["velocity"] - way.smooth["velocity"][0], atol=5e-3)
    assert np.max(np.abs(way.smooth["acceleration"])) < 1.0


def test_wheels_on_either_side_of_a_turn():
    options = {"wheels": 2, **part(yaw_rate=0.1)}
    left, right = ride(options, 0), ride(options, 1)
    assert left.place.y == -right.place.y > 0.0
    np.testing.assert_allclose(right.smooth["velocity"] - left.smooth["velocity"], 0.06)


def test_soils_share_the_track():
    options = {"soil": ["snow", "dry-sand", "snow", "clayey-soil"], "load": 3.0, **part()}
    soil = ride(options).soil
    np.testing.assert_allclose(np.bincount(soil) / len(soil), 0.25, atol=1e-3)
    assert np.all(np.diff(soil) >= 0)


def test_rear_wheel_meets_a_soil_later():
    options = {"soil": ["dry-sand", "sandy-loam"], "wheels": 4, **part()}
    front, rear = (np.argmax(ride(options, wheel).soil) * STEP for wheel in (0, 2))
    assert rear - front == pytest.approx(0.40 / 0.1, abs=0.05)


def test_on_the_way_back_the_soils_come_in_turn_again():
    soil = ride({"drive": ["reverse"], "soil": ["dry-sand", "sandy-loam"]}).soil
    assert soil[np.flatnonzero(np.diff(soil, prepend=-1))].tolist() == [0, 1, 0]


def test_several_soils_need_a_way():
    with pytest.raises(ConfigurationError, match="goes nowhere"):
        ride({"soil": ["dry-sand", "snow"], "load": 3.0, **part(speed=0.0)})


class TestPasses:
    def test_one_wheel(self):
        passes = ride({"drive": ["passes"]}).pass_number
        assert passes[np.flatnonzero(np.diff(passes, prepend=-1))].tolist() == [0, 1, 2]

    def test_rear_wheels_follow(self):
        options = {"wheels": 6, **part()}
        front, middle, rear = (ride(options, wheel).pass_number for wheel in (0, 2, 4))
        assert not front.any()
        # At first they stand on fresh ground, where no wheel has been.
        assert (middle[0], middle[-1]) == (0, 1)
        assert (rear[0], rear[-1]) == (0, 2)
        assert np.argmax(middle) * STEP == pytest.approx(4.0, abs=0.05)

    def test_in_reverse_the_rear_leads(self):
        options = {"wheels": 4, "drive": ["reverse"]}
        front, rear = (ride(options, wheel).pass_number for wheel in (0, 2))
        middle_of_way_back = round(50.0 / STEP)
        assert (rear[middle_of_way_back], front[middle_of_way_back]) == (2, 3)

    def test_left_wheels_leave_the_right_track_alone(self):
        options = {"wheels": 2, **part()}
        assert not ride(options, 0).pass_number.any()
        assert not ride(options, 1).pass_number.any()


@pytest.mark.parametrize("preset", PRESETS)
def test_presets_drive(preset):
    here = ride({"drive": [preset]})
    assert here.time[-1] == pytest.approx(60.0)
    assert -0.9 < here.smooth["slip"].min() < here.smooth["slip"].max() < 0.95
    assert here.smooth["load"].min() > 10.0
    assert np.ptp(here.smooth["slip"]) > 0.01
    assert np.ptp(here.smooth["load"]) > 10.0
