"""What the paper's estimators take for true, in their errors."""

from __future__ import annotations

import math

import numpy as np
import pandas as pd
import pytest
from simulator import CHANNELS, Drive, Sensor, Soil, Track, Wheel, forces, simulate, undulation, wave
from simulator.logs import write_csv
from wheel_samples import WHEEL, free

import terrain_cli as terrain
from terrain_cli.estimation import assumed, estimators

MODULUS = 0.02


@pytest.fixture(scope="module")
def truth():
    return free(12, 40, 5)


@pytest.fixture(scope="module")
def table(truth):
    columns = truth.measured(2, 0.005)
    columns.pop("drawbar_pull")
    labels = np.repeat([f"soil {j:02d}" for j in range(12)], 40)
    return pd.DataFrame(columns | {"time": np.arange(480) / 10.0, "terrain": labels})


def cut(table, folder, modulus=f"{MODULUS}"):
    (folder / "rover.toml").write_text(
        f"[wheel]\nradius = {WHEEL.radius}\nwidth = {WHEEL.width}\n[soil]\nshear_modulus = {modulus}\n"
    )
    (samples,) = terrain.from_frame(table, folder / "rover.toml")
    return terrain.segment(samples, "terrain")


@pytest.mark.parametrize("method", ["least-squares", "ridge", "recursive"])
def test_the_errors_hold_on_soils_whose_k_and_stresses_are_others(truth, table, tmp_path, method):
    # Soils of Table II: k is 10 to 30 mm, the stresses are not triangles.
    found = terrain.estimate(cut(table, tmp_path), method)
    c = (found["c_kPa"] - truth.cohesion / 1e3) / found["c_se_kPa"]
    phi = (found["phi_deg"] - np.degrees(truth.phi)) / found["phi_se_deg"]
    assert np.mean(np.abs(c) < 2.0) >= 0.75
    assert np.mean(np.abs(phi) < 2.0) >= 0.75
    ok = found["status"] == "ok"
    assert not (ok & ((np.abs(c) > 4.0) | (np.abs(phi) > 4.0))).any()


def test_a_better_known_k_makes_errors_smaller(table, tmp_path):
    wide = terrain.estimate(cut(table, tmp_path), "least-squares")
    said = terrain.estimate(cut(table, tmp_path, "{ value = 0.02, factor = 2 }"), "least-squares")
    pd.testing.assert_frame_equal(wide, said)
    narrow = terrain.estimate(cut(table, tmp_path, "{ value = 0.02, factor = 1.05 }"), "least-squares")
    np.testing.assert_allclose(narrow["phi_deg"], wide["phi_deg"])
    assert (narrow["phi_se_deg"] < wide["phi_se_deg"]).all()
    assert narrow["phi_se_deg"].median() < 0.8 * wide["phi_se_deg"].median()


def test_a_trace_ends_with_the_errors_of_the_table(table, tmp_path):
    windows = cut(table, tmp_path)
    ends = terrain.trace(windows).groupby("segment", sort=False).last()
    rows = terrain.estimate(windows, "recursive")
    for name in ("c_kPa", "c_se_kPa", "phi_deg", "phi_se_deg"):
        np.testing.assert_allclose(ends[name], rows[name], rtol=1e-6)


def test_what_is_assumed_does_not_average_out(table, tmp_path):
    # One soil in twelve windows.
    one = table.assign(terrain=np.repeat([f"part {j:02d}" for j in range(4)], 120))
    windows = cut(one.iloc[:480], tmp_path)
    rows = terrain.estimate(windows, "least-squares")
    (entry,) = (e for e in terrain.summarise(windows, "least-squares") if e["terrain"] == "part 00")
    assert entry["pooled"]["phi_se_deg"] == pytest.approx(rows["phi_se_deg"][0], rel=0.3)
    assert math.isfinite(entry["pooled"]["strength_at_stress_kPa"])


def test_the_errors_reach_the_soil_that_leads_to_the_estimate(tmp_path):
    # The triangles leave a quarter of the c of clay, and the estimates agree with each other.
    sinkage = np.linspace(0.004, 0.012, 60)
    slip = 0.35 + 0.25 * np.sin(np.arange(60) / 9.0)
    clay = Soil("clay", 4140.0, math.radians(13.0), MODULUS, 13.2e3, 692.2e3, 0.5, c1=0.5, c2=0.0)
    at = [forces(clay, Wheel(0.05, 0.05), float(z), float(i)) for z, i in zip(sinkage, slip, strict=True)]
    table = pd.DataFrame(
        {
            "time": np.arange(60) / 10.0,
            "load": [one.load for one in at],
            "torque": [one.torque for one in at],
            "sinkage": sinkage,
            "slip": slip,
        }
    )
    text = f"[wheel]\nradius = 0.05\nwidth = 0.05\n[soil]\nshear_modulus = {MODULUS}\n"
    (tmp_path / "rover.toml").write_text(text)
    (samples,) = terrain.from_frame(table, tmp_path / "rover.toml")
    (row,) = terrain.estimate(terrain.segment(samples, "none"), "least-squares").to_dict("records")
    assert row["c_kPa"] < 0.3 * 4.14
    assert abs(row["c_kPa"] - 4.14) < 2.0 * row["c_se_kPa"]


@pytest.mark.parametrize(
    ("seed", "c1", "c2"), [(0, 0.5, 0.0), (3, 0.35, 0.15), (6, 0.43, 0.32), (9, 0.3, 0.05)]
)
def test_the_errors_hold_on_soil_whose_exponent_is_small(seed, c1, c2, tmp_path):
    # Of n = 0.55 the triangles leave more than of 0.85, the middle of what is published.
    clay = Soil("clay", 4600.0, math.radians(14.0), 0.011, 12e3, 1.1e6, 0.55, c1=c1, c2=c2, exit_ratio=0.1)
    track = Track("wheel", [(clay, 40.0)], undulation(98.0, 0.25, 2.5, seed=seed), wave(0.2, 0.5, 7.0))
    sensors = {name: Sensor(relative=0.02) for name in ("load", "torque", "sinkage", "slip")}
    drive = Drive([track], rate=5.0, sensors=sensors, channels=(*CHANNELS, "slip"), seed=seed)
    write_csv(simulate(drive), tmp_path / "clay.csv")
    (tmp_path / "rover.toml").write_text(
        "[wheel]\nradius = 0.125\nwidth = 0.1\n[soil]\nshear_modulus = { value = 0.011, factor = 1.05 }\n"
    )
    (samples,) = terrain.read(tmp_path / "clay.csv", tmp_path / "rover.toml")
    (row,) = terrain.estimate(terrain.segment(samples, "none"), "least-squares").to_dict("records")
    assert abs(row["c_kPa"] - 4.6) < 1.6 * row["c_se_kPa"]
    assert abs(row["phi_deg"] - 14.0) < 1.6 * row["phi_se_deg"]


def test_windows_worked_on_in_groups_have_the_same_errors(table, tmp_path, monkeypatch):
    windows = cut(table, tmp_path)
    whole = terrain.estimate(windows, "least-squares")
    # Two and a half windows of 40 samples: groups are of whole windows.
    monkeypatch.setattr(assumed, "_GROUP", 100)
    assert [len(group) for group in windows.groups(100)] == [2] * 6
    assert [len(group) for group in windows.groups(10)] == [1] * 12
    pd.testing.assert_frame_equal(terrain.estimate(windows, "least-squares"), whole)


def test_more_windows_than_the_full_model_is_fitted_to_unasked(table, tmp_path, monkeypatch):
    windows = cut(table, tmp_path)
    monkeypatch.setattr(estimators, "_MOST_WINDOWS", 11)
    by_line = terrain.estimate(windows)
    assert set(by_line["method"]) <= {"least-squares", "ridge"}
    assert any("too many for the full model" in remark for remark in windows.samples.remarks)
    assert set(terrain.estimate(windows, "wong-reece")["method"]) == {"wong-reece"}
