"""Two soils of one strength, of which the second is stiffer: no line tells them apart, sinkage does."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from functools import cache

import pytest
from changed_models import MODEL, ROVER, write_log
from simulator import DRY_SAND


def stiffer(factor):
    moduli = {name: factor * getattr(DRY_SAND, name) for name in ("cohesive_modulus", "frictional_modulus")}
    return replace(DRY_SAND, **moduli)


STIFFER = stiffer(3.0)
SECONDS = 24.0
HIDDEN = {
    "clean": {},
    "sinks": {"slip-sinkage": {"n1": 0.4}},
    "rubs": {"drivetrain-friction": {"Tc": 0.5, "Bv": 0.0}},
}


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    path = tmp_path_factory.mktemp("soils")
    (path / "rover.toml").write_text(ROVER, "utf-8")
    for seed, (name, effects) in enumerate(HIDDEN.items()):
        soils = (DRY_SAND, STIFFER)
        write_log(path / f"{name}.csv", effects, seed=30 + seed, seconds=SECONDS, soils=soils)
    return path


@pytest.fixture(scope="module")
def told(terrain_est_here, folder):
    """Return a function that returns what a verb says of one of the logs."""

    @cache
    def told(verb, name, *segments):
        done = terrain_est_here(verb, f"{name}.csv", "--segments", *segments, "--json", "-q", cwd=folder)
        assert done.returncode == 0, done.stderr
        return json.loads(done.stdout)

    return told


def steps(warnings):
    """Return when the soil is said to change, in s."""
    found = (re.search(r"the soil changes at ([\d.]+) s", text) for text in warnings)
    return [float(match[1]) for match in found if match]


def test_another_soil_is_no_missing_effect(told):
    answer = told("diagnose", "clean", "none")
    assert answer["verdict"] == "none"
    assert not answer["alarm"]["raised"]
    assert steps(answer["warnings"]) == [pytest.approx(SECONDS / 2.0, abs=2.0)]


@pytest.mark.parametrize("segments", [("auto",), ("none",), ("fixed", "--window-samples", "240")])
def test_every_verb_says_the_same_of_two_soils_that_miss_nothing(
    terrain_est_here, folder, told, tmp_path, segments
):
    said, diagnosed = (told(verb, "clean", *segments)["conclusion"] for verb in ("compare", "diagnose"))
    assert said == diagnosed
    assert said["state"] == "fits"
    assert not said["command"]
    assert said["sentence"].startswith("The model fits to within the noise with 2 soils: ")
    if segments == ("none",):
        (tmp_path / "model.toml").write_text(MODEL, "utf-8")
        adding = ("model", "add", tmp_path / "model.toml", "slip-sinkage", "--data", "clean.csv")
        added = terrain_est_here(*adding, "--segments", *segments, "--json", "-q", cwd=folder)
        after = json.loads(added.stdout)["conclusion"]["sentence"]
        assert after.startswith("The model fits to within the noise with 2 soils: ")
    when = re.search(r"The soil changes at ([\d.]+) s \(", said["sentence"])
    assert float(when[1]) == pytest.approx(SECONDS / 2.0, abs=1.0)


@pytest.mark.parametrize(("name", "effect"), [("sinks", "slip-sinkage"), ("rubs", "drivetrain-friction")])
def test_an_effect_is_found_across_both(terrain_est_here, folder, told, tmp_path, name, effect):
    answer = told("diagnose", name, "none")
    assert answer["family"][0] == effect
    assert answer["effect"] in {effect, None}
    assert steps(answer["warnings"]) == [pytest.approx(SECONDS / 2.0, abs=2.0)]

    model = tmp_path / "model.toml"
    assert terrain_est_here("model", "new", model).returncode == 0
    data = ("--data", f"{name}.csv", "--segments", "none", "--json", "-q")
    done = terrain_est_here("model", "add", model, effect, *data, cwd=folder)
    assert done.returncode == 0, done.stderr
    added = json.loads(done.stdout)
    assert added["pays"]
    for channel in added["channels"].values():
        assert channel["heldout_after"] < 1.15 * channel["noise"]


def test_an_effect_that_explains_much_besides_does_not_make_two_soils_one(terrain_est_here, folder, tmp_path):
    effects = {"drawbar-bias": {"offset": 8.0}}
    write_log(tmp_path / "pulled.csv", effects, seed=41, seconds=SECONDS, soils=(DRY_SAND, stiffer(1.5)))
    (tmp_path / "rover.toml").write_text(ROVER, "utf-8")
    rows = len((tmp_path / "pulled.csv").read_text("utf-8").splitlines()) - 1
    halves = ("--segments", "fixed", "--window-samples", str(rows // 2))
    done = terrain_est_here("diagnose", "pulled.csv", *halves, "--json", "-q", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    first = found["candidates"][0]
    assert first["effect"] == "drawbar-bias"
    assert first["heldout_rmse"]["sinkage"] < 1.2 * found["channels"]["sinkage"]["noise"]


def test_a_pass_that_passes_for_another_soil_is_named_and_pays(terrain_est_here, folder, tmp_path):
    header, *rows = (folder / "clean.csv").read_text("utf-8").splitlines()
    drove = [f"{row},{int(2 * k >= len(rows))}" for k, row in enumerate(rows)]
    (tmp_path / "passes.csv").write_text("\n".join([f"{header},pass_number", *drove, ""]), "utf-8")
    (tmp_path / "rover.toml").write_text(ROVER, "utf-8")
    halves = ("--segments", "fixed", "--window-samples", str(len(rows) // 2))

    def said(*command):
        done = terrain_est_here(*command, cwd=tmp_path)
        assert done.returncode == 0, done.stderr
        return done.stdout

    last = said("compare", "passes.csv", *halves, "-q").splitlines()[-1]
    assert "but only with 2 soils; with multi-pass, fewer may be enough. Next: " in last
    last = said("diagnose", "passes.csv", *halves, "-q").splitlines()[-1]
    assert "with 1 soil instead of 2, the held-out error is " in last
    assert "multi-pass explains it. A soil that changes at 12 s (" in last
    assert "drive beside this track in the opposite direction" in last
    said("model", "new", "model.toml")
    data = ("--data", "passes.csv", *halves, "--json", "-q")
    added = json.loads(said("model", "add", "model.toml", "multi-pass", *data))
    assert added["pays"]
    sinkage = added["channels"]["sinkage"]
    assert sinkage["heldout_after"] < 0.5 * sinkage["heldout_before"]
    compared = json.loads(said("compare", "passes.csv", "--model", "model.toml", *halves, "--json", "-q"))
    assert added["conclusion"]["sentence"] == compared["conclusion"]["sentence"]
    # Nor does the second soil take its place where it is tried without, as a loop does at its end.
    removed = json.loads(said("model", "remove", "model.toml", "multi-pass", *data))
    assert not removed["pays"]
    assert removed["channels"]["sinkage"]["heldout_after"] > 2.0 * sinkage["heldout_after"]
    assert "with multi-pass, 1 soil is enough; both models are compared on 1 soil" in removed["warnings"]
