"""`terrain-est compare` on logs of the simulator, whose misfits are known."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from simulator import CHANNELS, DRY_SAND, Drive, Sensor, Track, simulate, steps, undulation, wave
from simulator.effects import base_contact
from simulator.logs import write_csv, write_parquet

ROVER = "[wheel]\nradius = 0.125\nwidth = 0.1\n[soil]\nshear_modulus = 0.018\n"
MODEL = 'format = "terrain-est/model/1"\nbase = "wong-reece"\neffects = ["slip-sinkage"]\n'
KEYS = {"rmse", "heldout_rmse", "bias", "nrmse", "noise"}
NAMES = {"torque", "drawbar_pull", "sinkage"}


def log(effects=None, seed=1):
    track = Track(
        "wheel",
        [(base_contact(DRY_SAND), 60.0)],
        load=undulation(80.0, 0.2, 5.0, seed=5),
        slip=wave(0.35, 0.6, 9.0),
    )
    noisy = ("load", "torque", "sinkage", "slip", "drawbar_pull")
    return simulate(
        Drive(
            [track],
            rate=10.0,
            sensors={channel: Sensor(relative=0.02) for channel in noisy},
            channels=(*CHANNELS, "slip", "drawbar_pull"),
            effects=effects or {},
            speed=steps([(0.1, 30.0), (0.15, 30.0)]),
            seed=seed,
        )
    )


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Write a clean log, one with slip-sinkage, and a model that has it."""
    path = tmp_path_factory.mktemp("logs")
    (path / "rover.toml").write_text(ROVER)
    (path / "model.toml").write_text(MODEL)
    write_csv(log(), path / "clean.csv")
    write_parquet(log({"slip-sinkage": {"n1": 0.4}}, seed=2), path / "sinks.parquet")
    return path


@pytest.fixture
def compare(terrain_est_here):
    def run(*args):
        done = terrain_est_here("compare", *args, "--json", "-q")
        assert (done.returncode, done.stderr) == (0, "")
        return json.loads(done.stdout)

    return run


def test_clean_log_has_no_finding_and_errors_of_the_size_of_the_noise(folder, compare):
    found = compare(folder / "clean.csv", "--segments", "none")
    assert found["format"] == "terrain-est/comparison/1"
    assert found["model"] == {"base": "wong-reece", "effects": []}
    assert found["data"]["samples"] == 600
    assert found["data"]["segments"] == 1
    assert found["data"]["blocks"] > 7
    assert found["failures"] == []
    assert found["channels"].keys() == NAMES
    for errors in found["channels"].values():
        assert errors.keys() >= KEYS
        assert errors["rmse"] == pytest.approx(errors["noise"], rel=0.15)
        low, high = errors["heldout_interval"]
        assert low < errors["heldout_rmse"] < high
        assert errors["heldout_rmse"] == pytest.approx(errors["rmse"], rel=0.1)
        assert abs(errors["bias"]) < errors["rmse"] / 5.0
    (segment,) = found["segments"]
    assert segment["c_kPa"] == pytest.approx(1.04, abs=4.0 * segment["c_se_kPa"])
    assert segment["phi_deg"] == pytest.approx(28.0, abs=4.0 * segment["phi_se_deg"])
    assert segment.keys() >= NAMES


def test_missing_effect_is_seen_where_it_acts(folder, compare, terrain_est_here):
    found = compare(folder / "sinks.parquet", "--segments", "none")
    first = found["failures"][0]
    assert first.keys() >= {"channel", "driver", "shape", "p_value", "share"}
    # One effect, seen in every channel, but only as slip drives it.
    assert {failure["driver"] for failure in found["failures"]} == {"slip"}
    assert "sinkage" in {failure["channel"] for failure in found["failures"]}
    assert first["p_value"] < 0.05
    assert found["channels"]["sinkage"]["rmse"] > 1.5 * found["channels"]["sinkage"]["noise"]
    told = terrain_est_here("compare", folder / "sinks.parquet", "--segments", "none", "-q").stdout
    assert "held-out rmse" in told
    assert first["sentence"] in told


def test_two_models_side_by_side(folder, compare, terrain_est_here):
    models = ["--model", "wong-reece", "--model", folder / "model.toml"]
    found = compare(folder / "sinks.parquet", "--segments", "none", *models)
    assert found["against"]["model"] == {"base": "wong-reece", "effects": ["slip-sinkage"]}
    (parameters,) = found["against"]["parameters"]
    n1 = parameters["slip-sinkage.n1"]
    assert n1["value"] == pytest.approx(0.4, abs=4.0 * n1["se"])
    (sinkage,) = (d for d in found["differences"] if d["name"] == "sinkage")
    assert sinkage["moved"]
    assert sinkage["second"] < sinkage["first"] / 1.5
    assert sinkage["interval"][1] < 0.0
    told = terrain_est_here("compare", folder / "sinks.parquet", "--segments", "none", *models, "-q").stdout
    assert "B  wong-reece + slip-sinkage" in told
    # A second model may need fewer words than the first, never another table.
    assert told.count("held-out rmse") == 3


def test_linear_base_predicts_torque_and_pull(folder, compare):
    found = compare(folder / "clean.csv", "--segments", "none", "--model", "linear")
    assert found["model"]["base"] == "linear"
    assert found["channels"].keys() == {"torque", "drawbar_pull"}


@pytest.mark.parametrize(
    "absent",
    [("drawbar_pull",), ("torque", "drawbar_pull"), ("sinkage", "torque")],
)
def test_whichever_channels_are_there(folder, tmp_path, compare, absent):
    table = pd.read_csv(folder / "clean.csv").drop(columns=list(absent))
    table.to_csv(tmp_path / "run.csv", index=False)
    (tmp_path / "rover.toml").write_text(ROVER)
    found = compare(tmp_path / "run.csv")
    assert found["channels"].keys() == NAMES.difference(absent)


def test_steady_test_points_without_torque_or_time(folder, tmp_path, compare):
    table = pd.read_csv(folder / "clean.csv").drop(columns=["torque", "time"]).iloc[::10]
    table.to_csv(tmp_path / "bench.csv", index=False)
    (tmp_path / "rover.toml").write_text(ROVER)
    found = compare(tmp_path / "bench.csv")
    assert found["data"]["samples"] == 60
    assert found["channels"].keys() == {"drawbar_pull", "sinkage"}


def test_further_column_is_found_as_a_driver(folder, tmp_path, compare):
    table = pd.read_csv(folder / "clean.csv")
    heat = np.cumsum(np.random.default_rng(4).normal(size=len(table)))
    table["gearbox_heat"] = (heat - heat.min()) / np.ptp(heat)
    table["torque"] += 0.8 * table["gearbox_heat"]
    table.to_csv(tmp_path / "run.csv", index=False)
    (tmp_path / "rover.toml").write_text(ROVER)
    first = compare(tmp_path / "run.csv", "--segments", "none")["failures"][0]
    assert (first["channel"], first["driver"]) == ("torque", "gearbox_heat")


def test_several_inputs_at_once(folder, compare):
    found = compare(folder / "clean.csv", folder / "sinks.parquet", "--segments", "none")
    assert len(found["data"]["sources"]) == 2
    assert [segment["segment"] for segment in found["segments"]] == [1, 1]
    assert all(math.isfinite(segment["torque"]["rmse"]) for segment in found["segments"])


def test_same_seed_same_answer(folder, terrain_est, terrain_est_here):
    args = ("compare", folder / "sinks.parquet", "--json", "-q", "--seed", "7")
    assert terrain_est_here(*args).stdout == terrain_est(*args).stdout != ""


def test_three_models_are_refused(folder, terrain_est_here):
    done = terrain_est_here("compare", folder / "clean.csv", *["--model", "linear"] * 3)
    assert done.returncode == 2
    assert "--model is given 3 times" in done.stderr


def test_one_channel_at_least_is_asked_for(folder, tmp_path, terrain_est_here):
    table = pd.read_csv(folder / "clean.csv")
    table.drop(columns=["sinkage", "torque", "drawbar_pull"]).to_csv(tmp_path / "run.csv", index=False)
    (tmp_path / "rover.toml").write_text(ROVER)
    done = terrain_est_here("compare", tmp_path / "run.csv")
    assert (done.returncode, done.stdout) == (65, "")
    assert "sinkage" in done.stderr
    assert "torque" in done.stderr


def test_the_line_needs_sinkage(folder, tmp_path, terrain_est_here):
    pd.read_csv(folder / "clean.csv").drop(columns=["sinkage"]).to_csv(tmp_path / "run.csv", index=False)
    (tmp_path / "rover.toml").write_text(ROVER)
    done = terrain_est_here("compare", tmp_path / "run.csv", "--model", "linear")
    assert (done.returncode, done.stdout) == (65, "")
    assert "sinkage" in done.stderr


@pytest.mark.parametrize("cell", [np.nan, "n/a"])
def test_a_column_without_numbers_was_not_measured_and_that_is_said(folder, tmp_path, compare, cell):
    table = pd.read_csv(folder / "clean.csv")
    table.assign(torque=cell).to_csv(tmp_path / "run.csv", index=False)
    (tmp_path / "rover.toml").write_text(ROVER)
    found = compare(tmp_path / "run.csv")
    assert found["channels"].keys() == {"drawbar_pull", "sinkage"}
    assert found["data"]["samples"] > 0
    (told,) = (note for note in found["warnings"] if "torque" in note)
    assert told.endswith("torque: torque in N m holds no number: taken as not measured")


@pytest.mark.parametrize(("channel", "unit"), [("torque", "N m"), ("sinkage", "m")])
def test_a_channel_that_no_column_gives_is_told_with_the_columns_that_are_left(
    folder, tmp_path, compare, channel, unit
):
    table = pd.read_csv(folder / "clean.csv")
    table.rename(columns={channel: "Misspelt"}).to_csv(tmp_path / "run.csv", index=False)
    (tmp_path / "rover.toml").write_text(ROVER)
    (told,) = (note for note in compare(tmp_path / "run.csv")["warnings"] if channel in note)
    assert f"{channel} is not compared" in told
    assert "columns that are left: Misspelt" in told
    assert told.endswith(f'[channels] {channel} = {{ column = "…", unit = "{unit}" }}')
    table.drop(columns=channel).to_csv(tmp_path / "run.csv", index=False)
    assert not any(channel in note for note in compare(tmp_path / "run.csv")["warnings"])


def test_keys_are_documented(folder, compare):
    text = (Path(__file__).parent.parent / "docs" / "compare.md").read_text("utf-8")
    models = ["--model", "wong-reece", "--model", folder / "model.toml"]
    found = compare(folder / "sinks.parquet", "--segments", "none", *models)
    keys = {*found, *found["data"], *found["channels"]["torque"], *found["failures"][0]}
    assert not {key for key in keys - {"channels", "failures"} if f"`{key}`" not in text}


def test_what_is_said_of_an_input_is_said_once(folder, terrain_est_here, tmp_path):
    points = pd.read_csv(folder / "clean.csv", nrows=30).drop(columns="time")
    points.to_csv(tmp_path / "points.csv", index=False)
    (tmp_path / "rover.toml").write_text(ROVER)
    done = terrain_est_here("compare", tmp_path / "points.csv")
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout.count("each row is taken for a steady test point") == 1


def test_what_is_said_of_an_input_is_said_where_another_one_fails(folder, terrain_est_here, tmp_path):
    points = pd.read_csv(folder / "clean.csv", nrows=30).drop(columns="time")
    points.to_csv(tmp_path / "points.csv", index=False)
    points.drop(columns="load").to_csv(tmp_path / "wrong.csv", index=False)
    (tmp_path / "rover.toml").write_text(ROVER)
    done = terrain_est_here("compare", tmp_path / "points.csv", tmp_path / "wrong.csv")
    assert (done.returncode, done.stdout) == (65, "")
    assert done.stderr.count("points.csv: no column is known as a time: each row is taken for a steady") == 1


def test_where_each_channel_comes_from(folder, terrain_est_here):
    loud = terrain_est_here("compare", folder / "clean.csv", "--verbose", "--json")
    plain = terrain_est_here("compare", folder / "clean.csv", "--json")
    assert (loud.returncode, loud.stdout) == (0, plain.stdout)
    first, *channels = loud.stderr.splitlines()
    assert first.startswith(f"{folder / 'clean.csv'}  wheel: ")
    assert first.endswith(" samples used")
    assert "  load: load in N" in channels
    assert plain.stderr == ""
    assert terrain_est_here("compare", folder / "clean.csv", "--verbose", "--quiet").stderr == ""


def test_a_pull_of_the_other_sign_is_named_and_its_line_mends_it(folder, tmp_path, terrain_est_here):
    """No effect explains a sign: `diagnose` would find one all the same."""
    table = pd.read_csv(folder / "clean.csv")
    table.assign(drawbar_pull=-table["drawbar_pull"]).to_csv(tmp_path / "run.csv", index=False)
    (tmp_path / "rover.toml").write_text(ROVER)
    before = terrain_est_here("compare", "run.csv", "-q", cwd=tmp_path).stdout
    assert "and the sign of drawbar pull may be wrong: if so, copy the line of the note" in before
    assert before.endswith("Next: terrain-est compare run.csv\n")
    line = before.partition("way round, ")[2].partition(" under [channels]")[0]
    (tmp_path / "rover.toml").write_text(f"{ROVER}[channels]\n{line}\n")
    after = terrain_est_here("compare", "run.csv", "-q", cwd=tmp_path).stdout
    assert "The model fits to within the noise" in after


def test_a_log_without_load_is_refused_as_what_was_asked_for(terrain_est_here, tmp_path):
    (tmp_path / "rover.toml").write_text(ROVER)
    (tmp_path / "run.csv").write_text("torque,sinkage,slip\n" + "2.0,0.02,0.2\n" * 20)
    for verb, what in (("compare", "a model cannot be compared with it"), ("estimate", "c and φ cannot be")):
        done = terrain_est_here(verb, tmp_path / "run.csv")
        assert (done.returncode, done.stdout) == (65, "")
        assert f"run.csv: {what}" in done.stderr
        assert ": load is neither measured nor derived\n" in done.stderr
