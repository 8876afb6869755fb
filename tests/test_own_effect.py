"""An effect of a user's own, from its file to its parameter: checked, simulated, missed, found."""

from __future__ import annotations

import json

import pytest
from own_effects import CABLE

SIZE = 60.0


@pytest.fixture
def run(terrain_est_here):
    def succeed(*args):
        done = terrain_est_here(*args)
        assert done.returncode == 0, done.stderr
        return done.stdout

    return succeed


def test_from_file_to_parameter(tmp_path, run):
    effect, log, model = tmp_path / "cable-drag.toml", tmp_path / "run.bag", tmp_path / "model.toml"
    effect.write_text(CABLE)
    assert "nothing is wrong" in run("effects", "check", effect)
    drive = ["--drive", "mixed", "--duration", "60", "--noise", "2%", "--seed", "5"]
    run("simulate", "-o", log, *drive, "--effect", f"{effect}:cd={SIZE}", "-q")

    found = json.loads(run("compare", log, "--segments", "none", "--json", "-q"))
    first = found["failures"][0]
    assert (first["channel"], first["driver"]) == ("drawbar_pull", "yaw_rate")

    run("model", "new", model, "--effect", effect)
    summary = tmp_path / "soil.json"
    run("estimate", log, "--model", model, "--segments", "none", "--summary", summary, "-q")
    (wheel,) = json.loads(summary.read_text())["inputs"][0]["wheels"]
    size = wheel["model"]["parameters"]["cable-drag.cd"]
    assert size["fixed_by_data"]
    assert size["unit"] == "N s/rad"
    assert size["value"] == pytest.approx(SIZE, abs=4.0 * size["se"])
    assert size["se"] < SIZE / 10.0

    models = ["--model", "wong-reece", "--model", model]
    found = json.loads(run("compare", log, "--segments", "none", "--json", "-q", *models))
    (pull,) = (d for d in found["differences"] if d["name"] == "drawbar_pull")
    assert pull["moved"]
    assert pull["second"] < pull["first"]
    assert found["against"]["failures"] == []
