from __future__ import annotations

import subprocess
import sys

import pytest

from terrain_cli.errors import ConfigurationError
from terrain_cli.rover import Motor, Rover, SensorNoise, Vehicle, find, load
from terrain_cli.telemetry import rover_advice

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
drawbar_pull = { column = "Fx_tractive_N" }
"""

FOUR_WHEELS = """
[wheel]
radius = 0.1
width = 0.08
[channels]
velocity = "speed_kmh"
terrain = { constant = "dune" }
[motor]
torque_constant = 0.03
gear_ratio = 50
[vehicle]
mass = 40
centre_of_mass = [0.0, 0, 0.3]
suspension = "rocker"
rocker_pivot = [0.1, 0.2]
[sampling]
max_gap = 0.2
[estimate]
method = "ridge"
min-samples = 20
window-distance = 0.5
where = "slip > 0"
[wheels.front-left]
position = [0.5, 0.4, 0.0]
[wheels.rear-left]
radius = 0.12
grouser_height = 0.01
position = [-0.5, 0.4, 0.0]
[wheels.rear-left.channels]
torque = { column = "T_rl", unit = "mN m", scale = 2, offset = -1.5 }
velocity = "speed_rear"
[wheels.rear-left.motor]
gear_ratio = 60
"""


@pytest.fixture
def write(tmp_path):
    def write(text, name="rover.toml"):
        path = tmp_path / name
        path.write_text(text, encoding="utf-8")
        return path

    return write


def test_the_minimum_of_the_contract(write):
    rover = load(write(CONTRACT))
    wheel = rover.wheel()
    assert (wheel.radius, wheel.width) == (0.125, 0.1)
    assert (wheel.grouser_count, wheel.grouser_height) == (12, 0.0)
    assert rover.soil_shear_modulus() == 0.018
    torque, sinkage, weight, pull = (
        wheel.channels[name] for name in ("torque", "sinkage", "load", "drawbar_pull")
    )
    assert (torque.topic, torque.field, torque.name) == ("/joint_states", "effort", "wheel_fl")
    assert (torque.unit.symbol, sinkage.unit.symbol) == ("N m", "mm")
    assert (weight.constant, weight.unit.symbol) == (81.4, "N")
    assert (pull.column, pull.unit, pull.scale, pull.offset) == ("Fx_tractive_N", None, 1.0, 0.0)
    assert torque.place.endswith("rover.toml: channels.torque")


def test_a_wheel_takes_what_it_does_not_give_from_the_defaults(write):
    rover = load(write(FOUR_WHEELS))
    front, rear = rover.wheel("front-left"), rover.wheel("rear-left")
    assert list(rover.wheels) == ["front-left", "rear-left"]
    assert (front.radius, front.width) == (0.1, 0.08)
    assert (rear.radius, rear.width) == (0.12, 0.08)
    assert (front.grouser_height, rear.grouser_height) == (0.0, 0.01)
    assert front.motor == Motor(torque_constant=0.03, gear_ratio=50.0)
    assert rear.motor == Motor(torque_constant=0.03, gear_ratio=60.0)
    assert {name: entry.column for name, entry in front.channels.items()} == {
        "velocity": "speed_kmh", "terrain": None,
    }  # fmt: skip
    assert rear.channels["velocity"].column == "speed_rear"
    assert rear.channels["terrain"].constant == "dune"
    torque = rear.channels["torque"]
    assert (torque.column, torque.unit.symbol, torque.scale, torque.offset) == ("T_rl", "mN m", 2.0, -1.5)
    assert rover.positions() == {"front-left": (0.5, 0.4, 0.0), "rear-left": (-0.5, 0.4, 0.0)}
    assert rover.vehicle == Vehicle(
        mass=40.0,
        centre_of_mass=(0.0, 0.0, 0.3),
        gravity=9.80665,
        suspension="rocker",
        rocker_pivot=(0.1, 0.2),
    )
    assert rover.max_gap == 0.2
    assert rover.estimate == {
        "method": "ridge", "min-samples": 20, "window-distance": 0.5, "where": "slip > 0",
    }  # fmt: skip


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[wheel]\nraduis = 0.1", "wheel.raduis: unknown key; did you mean radius?"),
        ("[weel]\n", "weel: unknown key; did you mean wheel?"),
        ("radius = 0.1", "radius: unknown key"),
        ("[wheel]\nradius = 0", "wheel.radius: must be a positive length in m, from 0.001 to 5, not 0"),
        ("[wheel]\nradius = -0.1", "wheel.radius: must be a positive length"),
        ("[wheel]\nradius = 125", "wheel.radius: must be a positive length in m, from 0.001 to 5, not 125"),
        ("[wheel]\nwidth = nan", "wheel.width: must be a positive length"),
        ("[wheel]\nwidth = true", "wheel.width: must be a positive length in m, from 0.001 to 5, not True"),
        (
            '[wheel]\nwidth = "0.1 m"',
            "wheel.width: must be a positive length in m, from 0.001 to 5, not '0.1 m'",
        ),
        ("[wheel]\nwidth = 1" + "0" * 400, "wheel.width: must be a positive length"),
        ("[wheel]\ngrouser_count = 1.5", "wheel.grouser_count: must be a whole number"),
        ("wheel = 3", "wheel: must be a table, not 3"),
        ("[wheels]\nfl = 0.1", "wheels.fl: must be a table, not 0.1"),
        ("[wheels.fl]\nposition = [1, 2]", "wheels.fl.position: must be [x, y, z] in m, not [1, 2]"),
        ('[wheels.fl]\nposition = [1, 2, "3"]', "wheels.fl.position[2]: must be a number of metres"),
        ("[wheels.fl.channels]\ntorq = 'T'", "wheels.fl.channels.torq: unknown key; did you mean torque?"),
        (
            "[soil]\nshear_modulus = 18",
            "soil.shear_modulus: must be a positive length in m, from 0.0001 to 1, not 18",
        ),
        ("[channels]\ntorque = 3.0", "channels.torque: must be a column or a table such as"),
        ("[channels]\ntorque = ''", "channels.torque: must be text"),
        ("[channels]\ntorque = { colum = 'T' }", "channels.torque.colum: unknown key; did you mean column?"),
        ("[channels]\ntorque = {}", "channels.torque: give one of topic, column and constant, not 0"),
        (
            "[channels]\ntorque = { column = 'T', topic = '/t' }",
            "channels.torque: give one of topic, column and constant, not 2",
        ),
        (
            "[channels]\ntorque = { column = 'T', field = 'effort' }",
            "channels.torque: field belongs to a topic, not to a column",
        ),
        (
            "[channels]\ntorque = { topic = '/j', field = 'effort', name = 'fl', index = 0, unit = 'N m' }",
            "channels.torque: give name or index, not both",
        ),
        (
            "[channels]\ntorque = { topic = '/j', field = 'effort', name = 'fl' }",
            "channels.torque: unit is missing, and field 'effort' has none",
        ),
        (
            "[channels]\nsinkage = { topic = '/z', field = 'sample.data' }",
            "channels.sinkage: unit is missing, and field 'data' has none",
        ),
        ("[channels]\nload = { constant = 81.4 }", "channels.load: unit is missing, and a constant has none"),
        (
            "[channels]\nload = { constant = 'W', unit = 'N' }",
            "channels.load.constant: must be a number, not 'W'",
        ),
        (
            "[channels]\ntorque = { column = 'T', unit = 'mm' }",
            "channels.torque.unit: 'mm' is a unit of length; torque takes N m, kN m",
        ),
        (
            "[channels]\ntorque = { column = 'T', unit = 'MN m' }",
            "channels.torque.unit: 'MN m' is not a known unit; torque takes N m, kN m",
        ),
        (
            "[channels]\ntorque = { column = 'T', scale = '2' }",
            "channels.torque.scale: must be a number from 1e-15 to 1e15",
        ),
        (
            "[channels]\nterrain = { column = 'x', unit = 'm' }",
            "channels.terrain: terrain is a label and has no unit",
        ),
        ("[motor]\ngear_ratio = 5", "motor: torque_constant is missing"),
        ("[wheels.fl.motor]\ngear_ratio = 5", "wheels.fl.motor: torque_constant is missing"),
        (
            "[motor]\ntorque_constant = 1\nefficiency = 85",
            "motor.efficiency: must be a positive number up to 1",
        ),
        (
            "[motor]\ntorque_constant = 1\ntemperature_coefficient = -0.11",
            "motor.temperature_coefficient: must be in 1/K, from -0.02 to 0.02, not -0.11",
        ),
        ("[vehicle]\nmass = 10", "vehicle: centre_of_mass is missing"),
        (
            "[vehicle]\ncenter_of_mass = [0, 0, 0]",
            "vehicle.center_of_mass: unknown key; did you mean centre_of_mass?",
        ),
        (
            "[vehicle]\nmass = 10\ncentre_of_mass = [0, 0, 0]\nsuspension = 'bogie'",
            "vehicle.suspension: must be one of rigid, rocker, rocker-bogie, not 'bogie'",
        ),
        (
            "[vehicle]\nmass=1\ncentre_of_mass = [0,0,0]\nrocker_pivot = [0,0]\nsuspension = 'rocker-bogie'",
            "vehicle: bogie_pivot is missing",
        ),
        (
            "[vehicle]\nmass = 10\ncentre_of_mass = [0, 0, 0]\nrocker_pivot = [0, 0]",
            "vehicle: a rigid suspension has no rocker_pivot",
        ),
        ("[noise]\ntorq = { relative = 0.1 }", "noise.torq: unknown key; did you mean torque?"),
        ("[noise]\npitch = { relative = 0.1 }", "noise.pitch: unknown key"),
        ("[noise]\ntorque = 0.1", "noise.torque: must be a table, not 0.1"),
        ("[noise]\ntorque = {}", "noise.torque: give relative, absolute, offset or gain"),
        ("[noise]\ntorque = { relative = 2 }", "noise.torque.relative: must be a share from 0 to 1, not 2"),
        (
            "[noise]\ntorque = { absolute = -1 }",
            "noise.torque.absolute: must be a number from 0 to 1e20",
        ),
        ("[noise]\ntorque = { absolute = 1 }", "noise.torque: unit of absolute is missing"),
        (
            "[noise]\ntorque = { absolute = 1, unit = 'mm' }",
            "noise.torque.unit: 'mm' is a unit of length; torque takes N m, kN m",
        ),
        ("[estimate]\nrobust = 1", "estimate.robust: must be true or false, not 1"),
        (
            "[sampling]\nmax_gap = 0",
            "sampling.max_gap: must be a positive number of seconds, from 1e-6 to 1e9",
        ),
        ("[estimate]\nmin_samples = 3", "estimate.min_samples: unknown key; did you mean min-samples?"),
        ("[estimate]\nmethod = 'ols'", "estimate.method: must be one of auto, least-squares"),
        (
            "[wheel]\nradius 0.1",
            "not TOML: Expected '=' after a key in a key/value pair (at line 2, column 8)",
        ),
    ],
)
def test_what_is_wrong_is_told_with_its_place(write, text, message):
    path = write(text)
    with pytest.raises(ConfigurationError) as error:
        load(path)
    assert str(error.value).startswith(f"{path}: {message}")
    assert "\n" not in str(error.value)
    assert error.value.exit_code == 78


def test_noise_is_in_si_units(write):
    noise = load(
        write(
            """
            [noise]
            load = { relative = 0.01, gain = 0.05 }
            torque = { relative = 0.02, absolute = 50, unit = "mN m" }
            slip = { absolute = 0.01 }
            sinkage = { offset = 2, unit = "mm" }
            """
        )
    ).noise
    assert noise == {
        "load": SensorNoise(0.01, 0.0, gain=0.05),
        "torque": SensorNoise(0.02, 0.05),
        "slip": SensorNoise(0.0, 0.01),
        "sinkage": SensorNoise(offset=0.002, known=False),
    }


def test_a_model_file_lies_beside_it(write):
    path = write('[estimate]\nmodel = "models/sand.toml"\nrobust = true')
    assert load(path).estimate == {"model": str(path.parent / "models" / "sand.toml"), "robust": True}
    assert load(write('[estimate]\nmodel = "wong-reece"')).estimate == {"model": "wong-reece"}
    assert load(write('[estimate]\nplaces = "places.csv"')).estimate == {
        "places": str(path.parent / "places.csv")
    }


@pytest.mark.parametrize(
    "entry",
    [
        "slip = { topic = '/slip', field = 'data' }",
        "slip = { constant = 0.2 }",
        "terrain = { topic = '/label', field = 'data' }",
        "load = { topic = '/ft', field = 'wrench.force.z' }",
        "torque = { topic = '/joint_states', field = 'effort', index = 2, unit = 'mN m' }",
        "sinkage = { topic = '/z', unit = 'mm' }",
        "torque = { column = 'T' }",
    ],
)
def test_entries_that_need_no_more(write, entry):
    (channel,) = load(write(f"[channels]\n{entry}")).default.channels
    assert entry.startswith(channel)


def test_windows_text_is_read(tmp_path):
    path = tmp_path / "rover.toml"
    path.write_bytes(b"\xef\xbb\xbf[soil]\r\nshear_modulus = 0.01\r\n")
    assert load(path).shear_modulus == 0.01


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda _: None, "no such file$"),
        (lambda path: path.mkdir(), "is a folder"),
        (lambda path: path.write_bytes(b"[wheel]\n# \xff"), "not text in UTF-8"),
    ],
)
def test_a_file_that_cannot_be_read(tmp_path, make, message):
    path = tmp_path / "rover.toml"
    make(path)
    with pytest.raises(ConfigurationError, match=message):
        load(path)


def test_without_a_file_the_missing_lines_are_named():
    rover = load(None)
    assert rover == Rover()
    geometry, _ = rover_advice.settings(rover.wheel("fl"), rover)
    assert geometry.because == "the radius and width of the wheel"
    assert geometry.lines == ("[wheel]", "radius = …  # m", "width = …  # m")
    with pytest.raises(ConfigurationError) as error:
        rover.soil_shear_modulus()
    assert error.value.hint.endswith("\n[soil]\nshear_modulus = …  # m")


def test_with_a_file_only_what_it_lacks_is_named(write):
    path = write("[wheel]\nradius = 0.1\n[wheels.fl]\n")
    rover = load(path)
    geometry, _ = rover_advice.settings(rover.wheel("fl"), rover)
    assert (geometry.because, geometry.lines) == ("the width of the wheel", ("[wheel]", "width = …  # m"))
    with pytest.raises(ConfigurationError) as error:
        rover.positions()
    assert error.value.hint == f"add to {path}:\n[wheels.fl]\nposition = [x, y, z]  # m"


def test_a_wheel_that_the_file_does_not_list(write):
    rover = load(write(FOUR_WHEELS))
    with pytest.raises(ConfigurationError, match="did you mean front-left"):
        rover.wheel("front_left")
    with pytest.raises(ConfigurationError, match="which of the wheels front-left, rear-left"):
        rover.wheel()
    assert load(write("[wheels.only]\nradius = 0.1")).wheel().name == "only"
    assert load(write("[wheel]\nradius = 0.1")).wheel("any").name == "any"


def test_the_file_is_found_beside_the_input_then_here(tmp_path, monkeypatch):
    here, there, bag = tmp_path / "here", tmp_path / "there", tmp_path / "there" / "bag"
    bag.mkdir(parents=True)
    here.mkdir()
    monkeypatch.chdir(here)
    first = str(there / "run.csv")
    assert find(None, first) is None
    (here / "rover.toml").touch()
    assert find(None, first).resolve() == here / "rover.toml"
    assert find(None, "-").resolve() == here / "rover.toml"
    assert find(None, None).resolve() == here / "rover.toml"
    (there / "rover.toml").touch()
    assert find(None, first) == there / "rover.toml"
    assert find(None, str(bag)) == there / "rover.toml"
    (bag / "rover.toml").touch()
    assert find(None, str(bag)) == bag / "rover.toml"
    assert str(find("other.toml", first)) == "other.toml"


def test_reading_it_imports_nothing_heavy():
    code = "import terrain_cli.rover, sys; print('numpy' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "False\n"


def test_the_shear_modulus_may_be_given_within_a_factor(tmp_path):
    path = tmp_path / "rover.toml"
    path.write_text("[soil]\nshear_modulus = { value = 0.018, factor = 1.5 }\n")
    assert (load(path).shear_modulus, load(path).shear_modulus_factor) == (0.018, 1.5)
    path.write_text("[soil]\nshear_modulus = 0.018\n")
    assert (load(path).shear_modulus, load(path).shear_modulus_factor) == (0.018, 2.0)
    for wrong in (
        "{ factor = 1.5 }",
        "{ value = 0.018, factor = 0.9 }",
        "{ value = 18 }",
        "{ value = 0.018, se = 1 }",
    ):
        path.write_text(f"[soil]\nshear_modulus = {wrong}\n")
        with pytest.raises(ConfigurationError, match=r"soil\.shear_modulus"):
            load(path)
