"""What can be said in DRIVE.toml and on the command line, and what is refused."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from own_effects import CABLE

from terrain_cli.errors import ConfigurationError
from terrain_cli.simulation import read
from terrain_cli.simulation.drive_file import PRESETS
from terrain_cli.simulation.scenario import SOILS, START
from terrain_cli.simulation.sensors import Sensor
from terrain_cli.simulation.simulated_log import channels

PAGE = (Path(__file__).resolve().parents[2] / "docs" / "simulate.md").read_text("utf-8")

FULL = """
soil = ["mine", "sandy-loam"]
rate = 50
speed = 0.05
load = 60.0
wheels = 2
model = "wong-reece"
seed = 9
start = 1000.0
drawbar_pull = false
gravity = 3.71
rates = { sinkage = 5 }

[wheel]
radius = 0.2
width = 0.15

[soils.mine]
cohesion = 500.0
tan_phi = 0.6
shear_modulus = 0.01
stiffness = 1.5e6
sinkage_exponent = 0.9

[effects]
slip-sinkage = { n1 = 0.7 }
gear-efficiency = {}

[noise]
torque = "2%"
sinkage = { white = "1 mm", dropouts = 0.1 }

[[part]]
duration = 10
slip = [0.1, 0.5]

[[part]]
drive = "slope"
duration = 30
load = { steps = [1.0, 0.5] }
"""


@pytest.fixture
def drive(tmp_path):
    def write(text):
        path = tmp_path / "drive.toml"
        path.write_text(text, "utf-8")
        return str(path)

    return write


def test_file_says_all(drive):
    scenario = read(drive(FULL), {})
    assert [part.duration for part in scenario.parts] == [10.0, 30.0]
    assert scenario.parts[0].profiles["slip"].values == (0.1, 0.5)
    assert scenario.parts[1].profiles["load"].form == "steps"
    # What a part does not say is that of its preset.
    assert len(scenario.parts[1].profiles["pitch_deg"].values) == 5
    assert [soil.name for soil in scenario.soils] == ["mine", "sandy-loam"]
    wheel = scenario.geometry
    assert (wheel.radius, wheel.width, wheel.gravity) == (0.2, 0.15, 3.71)
    assert (scenario.rate, scenario.rates, scenario.load, scenario.seed) == (50.0, {"sinkage": 5.0}, 60.0, 9)
    assert scenario.effect_values()["slip-sinkage.n1"] == 0.7
    # The typical size of what is not said: no gear gives more than it takes.
    assert 0.5 < scenario.effect_values()["gear-efficiency.eta"] < 1.0
    assert scenario.sensors["sinkage"].dropouts == 0.1
    assert (scenario.start, scenario.drawbar_pull) == (1000.0, False)


def test_example_of_the_documentation_has_every_key(drive):
    example = re.search(r"```toml\n(.*?)```", PAGE, re.DOTALL)[1]
    scenario = read(drive(example), {})
    assert [part.duration for part in scenario.parts] == [30.0, 40.0]
    with pytest.raises(ConfigurationError) as error:
        read(drive("no_such_key = 1"), {})
    known = error.value.hint.removeprefix("known here: ").split(", ")
    assert not [key for key in known if not re.search(rf"\b{key}\b", example)]
    assert all(f"`{name}`" in PAGE for name in (*PRESETS, *SOILS, *channels(scenario), *Sensor.__slots__))


def test_nothing_is_a_drive_too():
    scenario = read(None, {})
    assert scenario.duration == 60.0
    assert [soil.name for soil in scenario.soils] == ["dry-sand"]
    assert scenario.start == START
    assert scenario.effects == ()


def test_options_stand_above_the_file(drive):
    options = {"drive": ["passes"], "duration": 22.0, "noise": {"torque": "5%"}, "effects": {"slope": {}}}
    scenario = read(drive(FULL), options)
    assert len(scenario.parts) == 1
    assert scenario.duration == 22.0
    assert scenario.sensors["torque"].white.share == 0.05
    assert scenario.sensors["sinkage"].dropouts == 0.1
    assert [chosen.effect.id for chosen in scenario.effects] == ["slip-sinkage", "gear-efficiency", "slope"]


def test_duration_stretches_the_parts(drive):
    assert [part.duration for part in read(drive(FULL), {"duration": 80.0}).parts] == [20.0, 60.0]


def test_wheels():
    names = [place.name for place in read(None, {"wheels": 6}).wheels]
    assert names == ["front-left", "front-right", "middle-left", "middle-right", "rear-left", "rear-right"]
    assert [place.name for place in read(None, {"wheels": 1}).wheels] == ["wheel"]
    assert len(read(None, {"drive": ["multi"]}).wheels) == 4
    assert len({place.name for place in read(None, {"wheels": 9}).wheels}) == 9


def test_effect_of_a_user_beside_the_file(drive, tmp_path, monkeypatch):
    (tmp_path / "cable.toml").write_text(CABLE, "utf-8")
    path = drive('[effects]\n"cable.toml" = { cd = 25.0 }\n')
    assert read(path, {}).effect_values() == {"cable-drag.cd": 25.0}
    monkeypatch.chdir(tmp_path)
    assert read(None, {"effects": {"cable.toml": {}}}).effect_values() == {"cable-drag.cd": 10.0}


def test_model_file_gives_base_and_effects(drive, tmp_path):
    (tmp_path / "model.toml").write_text(
        'format = "terrain-est/model/1"\nbase = "linear"\neffects = ["drivetrain-friction"]\n'
        "[fixed]\ndrivetrain-friction.Tc = 1.5\n",
        "utf-8",
    )
    scenario = read(drive('model = "model.toml"\n'), {})
    assert scenario.base == "linear"
    assert scenario.effect_values()["drivetrain-friction.Tc"] == 1.5


@pytest.mark.parametrize("load", [0.05, 2e5])
def test_toys_and_haul_trucks_are_simulated(load, drive):
    """What a diagnosis of their logs recommends as the next drive is simulated, too."""
    assert read(drive(f"load = {load}"), {}).load == load


def test_effects_are_as_large_as_the_wheel(drive):
    friction = "[effects]\ndrivetrain-friction = { Tc = 700 }\n"
    scenario = read(drive(f"load = 9000\n{friction}[wheel]\nradius = 0.45"), {})
    assert scenario.effect_values()["drivetrain-friction.Tc"] == 700.0
    with pytest.raises(ConfigurationError, match="Tc of drivetrain-friction must be from"):
        read(drive(f"load = 60\n{friction}"), {})


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("driv = 1", "driv: unknown key; did you mean drive"),
        ('drive = "slip-swep"', "did you mean slip-sweep"),
        ('drive = "mixed"\n[[part]]\nslip = 0.3', "give one of drive and part"),
        ("[[part]]\nslip = 1.5", r"part\[0\]\.slip: must be a slip, from -0\.9 to 0\.95, not 1\.5"),
        ("[[part]]\nslipp = 0.3", "did you mean slip"),
        ('soil = "snoww"', "no soil 'snoww'; did you mean snow"),
        ("soil = []", "names nothing"),
        ("wheels = 0", "a number of wheels"),
        ("rate = 0", "a rate in Hz"),
        ("seed = -1", "a whole number"),
        ("seed = 1.5", "a whole number"),
        ("[wheel]\nradius = 0", "a positive length"),
        ("[rates]\nslip = 5", "unknown key"),
        ("[effects]\nslip-sinkag = {}", "slip-sinkag"),
        ("[effects]\nslip-sinkage = { n3 = 1 }", "no parameter 'n3'"),
        ("[effects]\nslip-sinkage = { n1 = 99 }", "n1 of slip-sinkage must be from"),
        ("[effects]\nslip-sinkage = 3", "must be a table"),
        ('model = "wong"', "wong"),
        ('model = "linear"\n[effects]\nslip-sinkage = {}', "which the base linear does not have"),
        ("noise = 2", "a share"),
        ('[noise]\ntorque = "3 mm"', "is no amount of torque"),
        ("x = [", "not TOML"),
    ],
)
def test_refused_in_one_line(text, message, drive):
    with pytest.raises(ConfigurationError, match=message) as error:
        read(drive(text), {})
    assert "\n" not in str(error.value)


def test_no_such_file(tmp_path):
    with pytest.raises(ConfigurationError, match="no such file"):
        read(str(tmp_path / "no.toml"), {})
