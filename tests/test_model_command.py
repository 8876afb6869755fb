"""`terrain-est model new` and `terrain-est model show`, as users run them."""

from __future__ import annotations

import json

import pytest
from own_effects import CABLE

from terrain_cli import effects, models


@pytest.fixture
def here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_a_new_file_is_a_model(terrain_est, here):
    done = terrain_est("model", "new", "model.toml")
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")
    assert models.load("model.toml").model.base == "wong-reece"
    # As every verb it takes -q, though it has nothing to be quiet about.
    assert terrain_est("model", "new", "line.toml", "--base", "linear", "-q").returncode == 0
    assert models.load("line.toml").plain


def test_effects_and_values_may_be_given_at_once(terrain_est_here, here):
    (here / "cable.toml").write_text(CABLE, "utf-8")
    (here / "models").mkdir()
    options = ("--effect", "slip-sinkage", "--effect", "cable.toml", "--fix", "shear_modulus=0.018")
    done = terrain_est_here("model", "new", "models/a.toml", *options, "--fix", "slip-sinkage.n1 = 0.4")
    assert (done.returncode, done.stderr) == (0, "")
    file = models.load("models/a.toml")
    assert file.effects == ("slip-sinkage", "../cable.toml")
    assert file.fixed == {"shear_modulus": 0.018, "slip-sinkage.n1": 0.4}


def test_a_file_that_is_there_stays(terrain_est_here, here):
    (here / "model.toml").write_text("mine", "utf-8")
    done = terrain_est_here("model", "new", "model.toml")
    assert done.returncode == 73
    assert done.stderr.splitlines() == [
        "terrain-est: model.toml: is there already",
        "  --force replaces it",
    ]
    assert (here / "model.toml").read_text("utf-8") == "mine"
    assert terrain_est_here("model", "new", "model.toml", "--force").returncode == 0
    assert models.load("model.toml").model.base == "wong-reece"


@pytest.mark.parametrize(
    ("options", "code", "message"),
    [
        (["--effect", "slip-sinkag"], 78, "did you mean slip-sinkage?"),
        (["--effect", "gone.toml"], 78, "gone.toml"),
        (["--fix", "shear_modulus"], 2, "--fix shear_modulus: is not NAME=VALUE"),
        (["--fix", "shear_modulus=thick"], 2, "--fix shear_modulus=thick: is not NAME=VALUE"),
        (["--fix", "shear_modulus=18"], 78, "shear_modulus: must be a number in m from 0.0001 to 1, not 18"),
        (["--fix", "shear_module=1"], 78, "no parameter 'shear_module'; did you mean shear_modulus?"),
        (["--base", "wong"], 2, "'wong' is not one of 'linear', 'wong-reece'"),
        (["--base", "linear", "--effect", "slip-sinkage"], 78, "which the base linear does not have"),
    ],
)
def test_what_is_wrong_writes_nothing(terrain_est_here, here, options, code, message):
    done = terrain_est_here("model", "new", "model.toml", *options)
    assert (done.returncode, done.stdout) == (code, "")
    assert message in done.stderr
    assert not list(here.iterdir())


def test_a_folder_that_is_not_there(terrain_est_here, here):
    done = terrain_est_here("model", "new", "gone/model.toml")
    assert (done.returncode, done.stdout) == (73, "")
    assert "gone/model.toml: no such folder" in done.stderr


def test_show_says_what_is_held_and_what_is_needed(terrain_est_here, here):
    options = ("--effect", "slip-sinkage", "--effect", "drivetrain-friction", "--fix", "shear_modulus=0.018")
    assert terrain_est_here("model", "new", "model.toml", *options).returncode == 0
    with (here / "model.toml").open("a", encoding="utf-8") as file:
        file.write('[priors]\ncohesion = { mean = 1000, sd = 500 }\n[[history]]\nadded = "slip-sinkage"\n')
    shown = terrain_est_here("model", "show", "model.toml")
    assert (shown.returncode, shown.stderr) == (0, "")
    assert shown.stdout.startswith("model.toml: base wong-reece\n  + slip-sinkage (")
    assert "held at 0.018" in shown.stdout
    assert "estimated for each segment, known as 1000 ± 500" in shown.stdout
    assert "slip-sinkage.n1" in shown.stdout
    assert "channels that the effects use: angular_velocity (if there)" in shown.stdout
    assert "  1. added slip-sinkage" in shown.stdout

    document = json.loads(terrain_est_here("model", "show", "model.toml", "--json").stdout)
    assert document["format"] == "terrain-est/model-description/1"
    assert [effect["id"] for effect in document["effects"]] == ["slip-sinkage", "drivetrain-friction"]
    assert document["parameters"]["shear_modulus"]["held"] == 0.018
    assert document["parameters"]["slip-sinkage.n1"]["per"] == "wheel"
    assert document["parameters"]["cohesion"]["prior"] == {"mean": 1000.0, "sd": 500.0}
    assert document["uses"] == list(effects.find("drivetrain-friction").reads)
    assert document["history"] == [{"added": "slip-sinkage"}]


def test_show_takes_a_base(terrain_est_here):
    document = json.loads(terrain_est_here("model", "show", "linear", "--json").stdout)
    assert (document["base"], document["effects"]) == ("linear", [])
    assert list(document["parameters"]) == ["cohesion", "tan_phi", "shear_modulus"]


def test_show_of_what_is_no_model(terrain_est_here, here):
    done = terrain_est_here("model", "show", "gone.toml")
    assert (done.returncode, done.stdout) == (78, "")
    assert "gone.toml: no such model file" in done.stderr
    (here / "bad.toml").write_text('format = "terrain-est/model/1"\nbase = "linear"\nefects = []\n')
    done = terrain_est_here("model", "show", "bad.toml")
    assert done.returncode == 78
    assert done.stderr.splitlines()[0] == "terrain-est: bad.toml: efects: unknown key; did you mean effects?"
