from __future__ import annotations

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from terrain_cli import effects
from terrain_cli.rover import Rover
from terrain_cli.telemetry import effect_inputs, rover_advice
from terrain_cli.telemetry.wheel_samples import NEEDED, Raw

VEHICLE = """
[wheel]
radius = 0.125
width = 0.1
[vehicle]
mass = 40.0
centre_of_mass = [0.0, 0.0, 0.25]
[motor]
torque_constant = 0.03
temperature_coefficient = -0.001
[wheels.a]
position = [0.5, 0.4, 0.0]
[wheels.b]
position = [0.5, -0.4, 0.0]
[wheels.c]
position = [-0.5, 0.0, 0.0]
"""


def ways(available, rover, name=""):
    return rover_advice.routes(set(available.split()), rover.wheel(name), rover)


def test_what_is_there_needs_no_way():
    assert ways("load torque sinkage slip", Rover()) == ({}, [])


def test_every_way_there_is(rover_of):
    derived, lacks = ways(
        "pitch roll motor_current motor_temperature entry_angle angular_velocity velocity",
        rover_of(VEHICLE),
        "a",
    )
    assert derived == {
        "load": "the quasi-static balance of the vehicle, pitch and roll",
        "torque": "motor current and temperature",
        "sinkage": "entry angle",
        "slip": "angular velocity and velocity",
    }
    assert lacks == []


def test_velocity_comes_from_a_recorded_slip():
    derived, lacks = ways("load torque sinkage slip angular_velocity", Rover())
    assert (derived, lacks) == ({"velocity": "angular velocity and slip"}, [])
    assert ways("load torque sinkage slip angular_velocity velocity", Rover()) == ({}, [])


def test_wheel_speed_comes_from_a_recorded_slip():
    derived, lacks = ways("load torque sinkage slip velocity", Rover())
    assert (derived, lacks) == ({"angular_velocity": "velocity and slip"}, [])


def test_without_temperature_coefficient_the_current_is_enough(rover_of):
    text = VEHICLE.replace("temperature_coefficient", "no_load_current").replace("-0.001", "0.1")
    assert ways("motor_current", rover_of(text), "a")[0]["torque"] == "motor current"


@pytest.mark.parametrize(
    ("available", "what", "ask"),
    [
        ("", "load", ("pitch",)),
        ("roll", "load", ("pitch",)),
        ("", "torque", ("torque",)),
        ("motor_current", "torque", ("motor_temperature",)),
        ("", "sinkage", ("sinkage",)),
        ("", "slip", ("angular_velocity", "velocity")),
        ("velocity", "slip", ("angular_velocity",)),
    ],
)
def test_what_is_lacking_is_asked_for(rover_of, available, what, ask):
    _, lacks = ways(available, rover_of(VEHICLE), "a")
    (lack,) = (lack for lack in lacks if lack.what == what)
    assert lack.ask == ask


def test_what_only_rover_toml_can_say(rover_of):
    _, lacks = ways("motor_current pitch", Rover())
    by_name = {lack.what: lack for lack in lacks}
    assert by_name["load"].ask == ("load",)
    assert by_name["torque"].lines == ("[motor]", "torque_constant = …  # N m/A", "gear_ratio = …")
    placeless = rover_of(VEHICLE + '[wheels."mid left"]\n')
    _, lacks = ways("pitch", placeless, "mid left")
    assert lacks[0].lines == ('[wheels."mid left"]', "position = [x, y, z]  # m")


def test_what_the_catalogue_reads_is_read_for_an_estimate_as_for_a_comparison():
    # The drawbar pull is read with every full model. Without the others, the errors of c and φ would be those
    # of fewer effects than in `compare`.
    channels, _ = effect_inputs.read(map(effects.find, effects.NAMES))
    assert channels <= {*rover_advice.SOURCES, "drawbar_pull"}


def test_settings(rover_of):
    rover = rover_of(VEHICLE)
    (lack,) = rover_advice.settings(rover.wheel("a"), rover)
    assert (lack.what, lack.lines[0]) == ("shear modulus", "[soil]")
    lacks = rover_advice.settings(Rover().wheel(), Rover())
    assert [lack.what for lack in lacks] == ["geometry", "shear modulus"]
    assert [line.split(" ")[0] for line in lacks[0].lines] == ["[wheel]", "radius", "width"]
    rover = rover_of("[wheel]\nradius = 0.1\n[soil]\nshear_modulus = 0.01\n")
    assert rover_advice.settings(rover.wheel(), rover)[0].because == "the width of the wheel"


columns = st.sampled_from([0.0, 1.0, -1.0, 1e300, float("nan"), float("inf"), -float("inf")])


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.lists(st.tuples(*[columns] * 7), min_size=1, max_size=6))
def test_no_number_is_too_wild_to_be_derived_from(rover_of, rows):
    names = (
        "pitch",
        "roll",
        "motor_current",
        "motor_temperature",
        "entry_angle",
        "angular_velocity",
        "velocity",
    )
    rover = rover_of(VEHICLE)
    channels = {name: np.array([row[j] for row in rows]) for j, name in enumerate(names)}
    raw = Raw(wheel="a", origin=0.0, time=None, channels=channels, labels={}, extras={}, feeds={})
    origins = rover_advice.complete(raw, rover.wheel("a"), rover)
    assert all(origins[name].startswith("derived from ") for name in NEEDED)
    assert all(len(raw.channels[name]) == len(rows) for name in NEEDED)
