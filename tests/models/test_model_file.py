"""Model files: read strictly."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest
from own_effects import CABLE

from terrain_cli import models
from terrain_cli.errors import ConfigurationError
from terrain_cli.mechanics import wheel_model as mechanics
from terrain_cli.models import ModelFile, Prior
from terrain_cli.vocabulary import choices

HEAD = 'format = "terrain-est/model/1"\n'
CONTRACT = """
format = "terrain-est/model/1"
base = "wong-reece"                # or "linear"
effects = ["slip-sinkage"]         # ids of the catalogue, or paths of effect files, beside this file
[fixed]                            # parameters held, with their values; the rest are estimated
shear_modulus = 0.018
[[history]]                        # written by model add / remove --data
added = "slip-sinkage"
before = { torque = 0.41, sinkage = 0.002 }
"""


def test_the_example_of_the_contract(write):
    file = models.load(write(CONTRACT))
    assert file.model.base == "wong-reece"
    assert [effect.id for effect in file.model.effects] == ["slip-sinkage"]
    assert file.fixed == {"shear_modulus": 0.018}
    assert file.history == ({"added": "slip-sinkage", "before": {"torque": 0.41, "sinkage": 0.002}},)


def test_a_file_may_say_no_more_than_its_base(write):
    file = models.load(write(HEAD + 'base = "linear"'))
    assert (file.model.base, file.effects, file.fixed, file.history) == ("linear", (), {}, ())
    assert file.plain
    assert not models.load(write(HEAD + 'base = "wong-reece"')).plain
    assert not models.load(write(HEAD + 'base = "linear"\n[fixed]\ntan_phi = 0.5')).plain


@pytest.mark.parametrize(
    "fixed",
    [
        '[fixed]\n"slip-sinkage.n1" = 0.4',
        "[fixed]\nslip-sinkage.n1 = 0.4",
        "[fixed.slip-sinkage]\nn1 = 0.4",
        "[fixed]\nslip-sinkage = { n1 = 0.4 }",
        'fixed."slip-sinkage.n1" = 0.4',
    ],
)
def test_parameters_of_effects_are_named_in_any_way_that_toml_has(write, fixed):
    file = models.load(write(f'{HEAD}base = "wong-reece"\neffects = ["slip-sinkage"]\n{fixed}\n'))
    assert file.fixed == {"slip-sinkage.n1": 0.4}


def test_effects_of_a_user_lie_beside_the_file(write, tmp_path, monkeypatch):
    (tmp_path / "own").mkdir()
    write(CABLE, "own/cable.toml")
    path = write(f'{HEAD}base = "wong-reece"\neffects = ["own/cable.toml"]\n[fixed]\ncable-drag.cd = 12\n')
    monkeypatch.chdir("/")
    file = models.load(path)
    assert file.model.needs == ("yaw_rate",)
    assert file.fixed == {"cable-drag.cd": 12.0}
    assert file.units["cable-drag.cd"] == "N s/rad"


def test_what_is_right_under_some_wheel_is_read(write):
    """A file is read without a log: under a wheel of 98 N friction is below 500 N m."""
    friction = 'effects = ["drivetrain-friction"]\n[fixed]\ndrivetrain-friction.Tc = 4e4\n'
    prior = "[priors]\ndrivetrain-friction.Bv = { mean = 2000, sd = 1e-6 }\n"
    file = models.load(write(f'{HEAD}base = "wong-reece"\n{friction}{prior}'))
    assert file.fixed == {"drivetrain-friction.Tc": 4e4}
    assert file.priors == {"drivetrain-friction.Bv": models.Prior(2000.0, 1e-6)}


def test_values_are_in_the_unit_of_the_parameter(write, tmp_path):
    write(CABLE.replace('"N s/rad"', '"N s/deg"'), "cable.toml")
    text = f'{HEAD}base = "wong-reece"\neffects = ["cable.toml"]\n'
    file = models.load(write(text + "[fixed]\ncable-drag.cd = 0.5\n"))
    assert file.fixed["cable-drag.cd"] == pytest.approx(0.5 * 180.0 / math.pi)
    models.save(replace(file, fixed={"cable-drag.cd": 0.25 * 180.0 / math.pi}), tmp_path / "model.toml")
    assert "cable-drag.cd = 0.25" in (tmp_path / "model.toml").read_text("utf-8")
    prior = models.load(write(text + "[priors]\ncable-drag.cd = { mean = 0.5, sd = 0.1 }\n")).priors
    assert prior["cable-drag.cd"].sd == pytest.approx(0.1 * 180.0 / math.pi)


def test_priors_and_shared_parameters(write):
    text = f"""{HEAD}base = "wong-reece"
        effects = ["slip-sinkage"]
        shared = ["shear_modulus"]
        [priors]
        cohesion = {{ mean = 1000, sd = 500 }}
        slip-sinkage.n1 = {{ mean = 0.4, sd = 0.2 }}
        [priors.sinkage_exponent]
        mean = 1.1
        sd = 0.1
        """
    file = models.load(write(text))
    assert file.shared == ("shear_modulus",)
    assert file.priors == {
        "cohesion": Prior(1000.0, 500.0),
        "slip-sinkage.n1": Prior(0.4, 0.2),
        "sinkage_exponent": Prior(1.1, 0.1),
    }


WR = HEAD + 'base = "wong-reece"\n'


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "is not a model file: the key format is missing"),
        ('format = "terrain-est/model/2"\nbase = "linear"', "format is 'terrain-est/model/2'"),
        ("format = 1", "format is 1"),
        (HEAD, "base is missing"),
        (
            HEAD + 'base = "wong-rece"',
            "base: must be one of linear, wong-reece, not 'wong-rece'; did you mean wong-reece?",
        ),
        (HEAD + "base = 3", "base: must be one of linear, wong-reece, not 3"),
        (WR + 'efects = ["slip-sinkage"]', "efects: unknown key; did you mean effects?"),
        (WR + 'effects = "slip-sinkage"', "effects: must be a list, not 'slip-sinkage'"),
        (WR + "effects = [1]", "effects[0]: must be text, not 1"),
        (WR + 'effects = ["slip-sinkag"]', "effects[0]: "),
        (WR + 'effects = ["gone.toml"]', "effects[0]: "),
        (WR + 'effects = ["slip-sinkage", "slip-sinkage"]', "effect slip-sinkage is in the model twice"),
        (
            HEAD + 'base = "linear"\neffects = ["slip-sinkage"]',
            "effect slip-sinkage changes the sinkage exponent, which the base linear does not have",
        ),
        (WR + "fixed = 3", "fixed: must be a table, not 3"),
        (
            WR + "[fixed]\nshear_module = 0.018",
            "fixed.shear_module: the model has no parameter 'shear_module'; did you mean shear_modulus?",
        ),
        (
            HEAD + 'base = "linear"\n[fixed]\nstiffness = 1e6',
            "fixed.stiffness: the model has no parameter 'stiffness'",
        ),
        (
            WR + 'effects = ["slip-sinkage"]\n[fixed.slip-sinkage]\nn3 = 0.4',
            "fixed.slip-sinkage.n3: the model has no parameter 'slip-sinkage.n3'; did you mean slip-sink",
        ),
        (WR + "[fixed]\nslip-sinkage.n1 = 0.4", "fixed.slip-sinkage.n1: the model has no parameter"),
        (
            WR + "[fixed]\nshear_modulus = 18",
            "fixed.shear_modulus: must be a number in m from 0.0001 to 1, not 18",
        ),
        (
            WR + "[fixed]\nstiffness = 0",
            "fixed.stiffness: must be a number in Pa/m^n from 1000 to 1e+10, not 0",
        ),
        (
            WR + '[fixed]\ncohesion = "1 kPa"',
            "fixed.cohesion: must be a number in Pa from -1e+06 to 1e+06, not '1 kPa'",
        ),
        (WR + "[fixed]\ncohesion = nan", "fixed.cohesion: must be a number in Pa from -1e+06"),
        (
            WR + "[fixed]\ntan_phi = 1e9",
            "fixed.tan_phi: must be a number from 0 to 1.73205, not 1000000000.0",
        ),
        (
            WR + "[fixed]\nsinkage_exponent = 5",
            "fixed.sinkage_exponent: must be a number from 0.1 to 3, not 5",
        ),
        (
            WR + 'effects = ["slip-sinkage"]\n[fixed]\nslip-sinkage.n1 = 1e9',
            "fixed.slip-sinkage.n1: must be a number from ",
        ),
        (
            WR + 'effects = ["gear-efficiency"]\n[fixed]\ngear-efficiency.eta = 0.0',
            "fixed.gear-efficiency.eta: must be a number from 0.2 to 1.1, not 0.0",
        ),
        (
            WR + 'effects = ["drivetrain-friction"]\n[fixed]\ndrivetrain-friction.Tc = 1e12',
            "fixed.drivetrain-friction.Tc: must be a number in N m from ",
        ),
        (WR + "priors = 3", "priors: must be a table, not 3"),
        (WR + "[priors]\nphi = { mean = 3, sd = 1 }", "priors.phi: the model has no parameter 'phi'"),
        (
            WR + "[priors]\nshear_modulus = { mean = 18, sd = 5 }",
            "priors.shear_modulus.mean: must be a number in m from 0.0001 to 1, not 18.0",
        ),
        (
            WR + '[priors]\nshear_modulus = { mean = 18, sd = 5, unit = "mm" }',
            "priors.shear_modulus.unit: unknown key",
        ),
        (
            WR + "[priors]\ntan_phi = { mean = inf, sd = 1 }",
            "priors.tan_phi.mean: must be a number, not inf",
        ),
        (
            WR + "[priors]\ntan_phi = { mean = 0.5, sd = -1 }",
            "priors.tan_phi.sd: must be a standard deviation from ",
        ),
        (WR + "[priors]\ntan_phi = { mean = 0.5, sd = nan }", "priors.tan_phi.sd: must be a number"),
        (
            WR + "[priors]\ntan_phi = { mean = 0.5, sd = 1e-300 }",
            "priors.tan_phi.sd: must be a standard deviation from ",
        ),
        (
            WR + "[priors]\nstiffness = { mean = 1e6, sd = 1e300 }",
            "priors.stiffness.sd: must be a standard deviation in Pa/m^n from 10 to 1e+13, not 1e+300",
        ),
        (WR + "[priors]\ncohesion = 3", "priors.cohesion: must be a table, not 3"),
        (WR + "[priors]\ncohesion = { mean = 3 }", "priors.cohesion: sd is missing"),
        (
            WR + "[priors]\ncohesion = { mean = 3, sd = 0 }",
            "priors.cohesion.sd: must be a standard deviation",
        ),
        (
            WR + "[priors]\ncohesion = { mean = 3, std = 1 }",
            "priors.cohesion.std: unknown key; did you mean sd?",
        ),
        (
            WR + "[fixed]\ncohesion = 3\n[priors]\ncohesion = { mean = 3, sd = 1 }",
            "priors.cohesion: is held by [fixed]",
        ),
        (
            WR + 'shared = ["shear_module"]',
            "shared[0]: the model has no parameter 'shear_module'; did you mean shear_modulus?",
        ),
        (WR + "history = 3", "history: must be a list, not 3"),
        (WR + "history = [3]", "history[0]: must be a table, not 3"),
        (WR + "base = ", "not TOML: "),
    ],
)
def test_what_is_wrong_is_told_with_its_place(write, text, message):
    path = write(text)
    with pytest.raises(ConfigurationError) as error:
        models.load(path)
    assert str(error.value).startswith(f"{path}: {message}")
    assert "\n" not in str(error.value)
    assert error.value.exit_code == 78


def test_an_unknown_effect_names_the_nearest(write):
    with pytest.raises(ConfigurationError) as error:
        models.load(write(WR + 'effects = ["slip-sinkag"]'))
    assert "did you mean slip-sinkage?" in str(error.value)


def test_a_base_is_a_model():
    assert models.resolve("linear").plain
    assert models.resolve("wong-reece") == ModelFile()
    with pytest.raises(ConfigurationError, match="wong-rece: no such model file; did you mean wong-reece"):
        models.resolve("wong-rece")


def test_options_and_models_have_the_same_bases():
    assert set(choices.BASES) == set(mechanics.BASES)
