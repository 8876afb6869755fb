"""Models and options that `terrain-est estimate` does not take together, or not of this log."""

from __future__ import annotations

from pathlib import Path

import pytest
from wheel_table import ROVER, good, text

MODEL = 'format = "terrain-est/model/1"\nbase = "wong-reece"\n'


@pytest.fixture
def here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "rover.toml").write_text(ROVER)
    (tmp_path / "run.csv").write_text(text(good()))


@pytest.mark.usefixtures("here")
@pytest.mark.parametrize(
    ("options", "code", "message"),
    [
        (
            ["--model", "linear", "--method", "wong-reece"],
            2,
            "--method wong-reece is not for the base linear",
        ),
        (["--model", "wong-reece", "--method", "ridge"], 2, "--method ridge is an estimator of the line"),
        (
            ["--model", "wong-reece", "--method", "recursive"],
            2,
            "--method recursive is an estimator of the line",
        ),
        (["--robust", "--method", "ridge"], 2, "--robust is for the full model"),
        (["--model", "gone.toml"], 78, "gone.toml: no such model file"),
        (["--model", "bad.toml"], 78, "bad.toml: is not a model file: the key format is missing"),
        (
            ["--model", "lateral.toml"],
            65,
            "run.csv: effect side-slip needs slip_angle, which is neither measured nor derived",
        ),
        (["--model", "grousers.toml"], 78, "effect grousers needs grouser_height of rover.toml"),
    ],
)
def test_what_does_not_go_together(terrain_est_here, options, code, message):
    Path("bad.toml").write_text('base = "linear"\n', "utf-8")
    Path("lateral.toml").write_text(MODEL + 'effects = ["side-slip"]\n', "utf-8")
    Path("grousers.toml").write_text(MODEL + 'effects = ["grousers"]\n', "utf-8")
    done = terrain_est_here("estimate", "run.csv", *options)
    assert (done.returncode, done.stdout) == (code, "")
    assert message in done.stderr.splitlines()[0]


@pytest.mark.usefixtures("here")
def test_the_hint_says_how_to_supply_a_channel(terrain_est_here):
    Path("lateral.toml").write_text(MODEL + 'effects = ["side-slip"]\n', "utf-8")
    done = terrain_est_here("estimate", "run.csv", "--model", "lateral.toml")
    assert 'slip_angle = { column = "…", unit = "rad" }' in done.stderr
