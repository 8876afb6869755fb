"""A drive in which the wheel skids now and then: what the line leaves out the whole model uses."""

from __future__ import annotations

import csv
import io
import json
import math

import numpy as np
import pytest
from simulator import CHANNELS, DRY_SAND, UPLAND_SANDY_LOAM, Drive, Sensor, Track, simulate, undulation, wave
from simulator.effects import base_contact
from simulator.logs import write_csv

from terrain_cli import api

ROVER = "[wheel]\nradius = 0.125\nwidth = 0.1\n[soil]\nshear_modulus = 0.018\n"


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Write a log of two soils, with slip from −0.2 to 0.5."""
    path = tmp_path_factory.mktemp("skidding")
    (path / "rover.toml").write_text(ROVER)
    soils = [(base_contact(DRY_SAND), 40.0), (base_contact(UPLAND_SANDY_LOAM), 40.0)]
    track = Track("wheel", soils, load=undulation(80.0, 0.2, 5.0, seed=5), slip=wave(0.15, 2.2, 9.0))
    log = simulate(
        Drive(
            [track],
            rate=10.0,
            sensors={name: Sensor(relative=0.01) for name in ("load", "torque", "sinkage", "slip")},
            channels=(*CHANNELS, "slip", "drawbar_pull"),
            effects={"slip-sinkage": {"n1": 0.0}},
            seed=3,
        )
    )
    write_csv(log, path / "run.csv")
    return path


def rows(done):
    assert done.returncode == 0, done.stderr
    return list(csv.DictReader(io.StringIO(done.stdout)))


def count(folder, keep):
    with (folder / "run.csv").open() as stream:
        return sum(keep(float(row["slip"])) for row in csv.DictReader(stream))


def test_the_line_leaves_them_out_with_the_reason(folder, terrain_est_here):
    done = terrain_est_here("estimate", folder / "run.csv", "--method", "least-squares")
    skids = count(folder, lambda slip: slip < 0.0)
    assert skids > 100
    assert f"{skids} · wheel skids (slip < 0)" in done.stderr
    assert sum(int(row["n_samples"]) for row in rows(done)) == count(folder, lambda slip: slip >= 0.0)


def test_the_whole_model_uses_them_and_cuts_by_the_line_of_the_others(folder, terrain_est_here):
    done = terrain_est_here("estimate", folder / "run.csv", "--model", "wong-reece")
    assert "skids" not in done.stderr
    first, second = rows(done)
    assert int(first["n_samples"]) + int(second["n_samples"]) == count(folder, math.isfinite)
    assert float(second["t_start_s"]) == pytest.approx(40.0, abs=1.0)
    for row, phi in ((first, 28.0), (second, 33.7)):
        assert float(row["phi_deg"]) == pytest.approx(phi, abs=4.0 * float(row["phi_se_deg"]))
        assert float(row["phi_se_deg"]) < 1.0
        assert row["phi_ls_deg"]


def test_compare_predicts_them(folder, terrain_est_here):
    for base in ("wong-reece", "linear"):
        done = terrain_est_here("compare", folder / "run.csv", "--model", base, "--json", "-q")
        assert (done.returncode, done.stderr) == (0, "")
        found = json.loads(done.stdout)
        assert found["data"]["samples"] == count(folder, math.isfinite)
    found = json.loads(terrain_est_here("compare", folder / "run.csv", "--json", "-q").stdout)
    for errors in found["channels"].values():
        assert errors["samples"] == found["data"]["samples"]
        assert errors["rmse"] == pytest.approx(errors["noise"], rel=0.2)
    assert found["failures"] == []


def test_a_log_that_only_skids_is_one_window(folder):
    (samples,) = api.read(folder / "run.csv", where="slip < 0", model="wong-reece")
    window = api.segment(samples)
    assert len(window.rows) == len(samples)
    assert not window.driving.any()
    assert len(window) == len(np.unique(samples.stretch[samples.usable]))
    assert set(api.estimate(window, "least-squares")["status"]) == {"too-few-samples"}
    assert set(api.estimate(window, model="wong-reece")["n_samples"]) == set(np.diff(window.bounds))
    assert len(api.trace(window)) == 0
