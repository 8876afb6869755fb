"""One log, one model, one cut: every verb and the API give the same c, φ and status of each segment."""

from __future__ import annotations

import csv
import io
import json
import re

import numpy as np
import pyarrow.parquet as pq
import pytest
from simulator import CHANNELS, DRY_SAND, UPLAND_SANDY_LOAM, Drive, Sensor, Track, simulate, undulation, wave
from simulator.logs import write_csv

import terrain_cli as terrain

ROVER = "[wheel]\nradius = 0.125\nwidth = 0.1\n[soil]\nshear_modulus = 0.018\n[estimate]\nmin-samples = 12\n"
MODEL = 'format = "terrain-est/model/1"\nbase = "wong-reece"\neffects = ["slip-sinkage"]\n'
NAMES = ("c_kPa", "c_se_kPa", "phi_deg", "phi_se_deg")


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Write a log of two wheels, one of which skids now and then, over two soils; and a model."""
    path = tmp_path_factory.mktemp("one")
    (path / "rover.toml").write_text(ROVER)
    (path / "model.toml").write_text(MODEL)
    soils = [(DRY_SAND, 25.0), (UPLAND_SANDY_LOAM, 20.0)]
    tracks = [
        Track("left", soils, undulation(80.0, 0.25, 5.0, seed=5), wave(0.3, 0.6, 9.0)),
        Track("right", soils, undulation(70.0, 0.25, 7.0, seed=6), wave(0.15, 1.6, 11.0)),
    ]
    noisy = ("load", "torque", "sinkage", "slip", "drawbar_pull")
    log = simulate(
        Drive(
            tracks,
            rate=2.0,
            sensors={name: Sensor(relative=0.02) for name in noisy},
            channels=(*CHANNELS, "slip", "drawbar_pull"),
            seed=4,
        )
    )
    write_csv(log, path / "run.csv")
    return path


def estimated(done):
    """Return the numbers and the status of each segment of the table; NaN where a cell is empty."""
    assert done.returncode == 0, done.stderr
    rows = list(csv.DictReader(io.StringIO(done.stdout)))
    return (
        [(row["wheel"], int(row["segment"]), row["status"]) for row in rows],
        np.array([[float(row[name] or "nan") for name in NAMES] for row in rows]),
    )


def in_json(segments):
    return (
        [(row["wheel"], row["segment"], row["status"]) for row in segments],
        np.array([[np.nan if row[name] is None else row[name] for name in NAMES] for row in segments]),
    )


def in_page(text):
    """Return what the chart of c over φ holds."""
    (specs,) = re.findall(r"^const specs = (.*);$", text, re.MULTILINE)
    (chart,) = (
        one["datasets"]["data-0"]
        for one in json.loads(specs)
        if "friction angle φ (°)" in json.dumps(one["layer"], ensure_ascii=False)
    )
    return (
        [(*row["name"].split(" "), row["status"]) for row in chart],
        np.array(
            [[np.nan if row[key] is None else row[key] for key in ("x", "xe", "y", "ye")] for row in chart]
        ),
    )


@pytest.mark.parametrize(
    ("model", "options"),
    [
        (None, ()),
        ("model.toml", ("--segments", "none")),
        ("linear", ("--min-samples", "15")),
        # One soil predicts both as well: the segments stay those that were cut.
        (
            "wong-reece",
            ("--segments", "fixed", "--window-samples", "22", "--wheel", "left", "--where", "time < 23"),
        ),
    ],
)
def test_everywhere(folder, terrain_est_here, tmp_path, model, options):
    name = folder / model if model == "model.toml" else model
    chosen = [] if name is None else ["--model", name]
    places, numbers = estimated(terrain_est_here("estimate", "run.csv", *chosen, *options, "-q", cwd=folder))
    assert len(places) > 1
    assert np.isfinite(numbers).any()
    # compare
    done = terrain_est_here("compare", "run.csv", *chosen, *options, "--json", "-q", cwd=folder)
    found = json.loads(done.stdout)
    assert found["data"]["segments"] == len(places)
    there, values = in_json(found["segments"])
    assert there == places
    np.testing.assert_allclose(values, numbers, rtol=1e-9)
    # report
    page = tmp_path / "run.html"
    done = terrain_est_here("report", "run.csv", *chosen, *options, "-o", page, "-q", cwd=folder)
    assert done.returncode == 0, done.stderr
    there, values = in_page(page.read_text("utf-8"))
    several = len({wheel for wheel, *_ in places}) > 1
    assert there == [(*([wheel] * several), str(segment), status) for wheel, segment, status in places]
    # Five digits, and no error of what has none.
    np.testing.assert_allclose(values, numbers, rtol=1e-4)
    # API
    given = dict(zip(options[::2], options[1::2], strict=True))
    wheels = terrain.read(folder / "run.csv", folder / "rover.toml", model=name, where=given.get("--where"))
    least = int(given.get("--min-samples", 12))
    length = given.get("--window-samples")
    cut = [
        terrain.segment(
            one, given.get("--segments", "auto"), min_samples=least, window_samples=length and int(length)
        )
        for one in wheels
        if one.wheel == given.get("--wheel", one.wheel)
    ]
    frame = terrain.estimate(cut, min_samples=least, model=name)
    assert list(zip(frame["wheel"], frame["segment"], frame["status"], strict=True)) == places
    np.testing.assert_allclose(frame[list(NAMES)].to_numpy(), numbers, rtol=1e-9)


def test_two_models_differ_by_what_estimate_says_with_each(folder, terrain_est_here):
    both = ("--model", "linear", "--model", "wong-reece")
    found = json.loads(terrain_est_here("compare", "run.csv", *both, "--json", "-q", cwd=folder).stdout)
    for key, model in (("first", "linear"), ("second", "wong-reece")):
        _, numbers = estimated(terrain_est_here("estimate", "run.csv", "--model", model, "-q", cwd=folder))
        c, phi = ([one[key] for one in found["differences"] if one["name"] == name] for name in ("c", "phi"))
        known = [np.array([np.nan if value is None else value for value in values]) for values in (c, phi)]
        np.testing.assert_allclose(known[0] / 1e3, numbers[:, 0], rtol=1e-9)
        np.testing.assert_allclose(np.degrees(known[1]), numbers[:, 2], rtol=1e-9)


def test_options_that_only_estimate_has_come_from_the_rover_file_too(folder, terrain_est_here, tmp_path):
    rover = tmp_path / "rover.toml"
    rover.write_text(ROVER + "robust = true\n")
    log = folder / "run.csv"
    given = ("--rover", rover, "--segments", "none", "--wheel", "left", "-q")
    _, numbers = estimated(terrain_est_here("estimate", log, *given))
    _, plain = estimated(terrain_est_here("estimate", log, *given[2:], cwd=folder))
    _, values = in_json(json.loads(terrain_est_here("compare", log, *given, "--json").stdout)["segments"])
    np.testing.assert_allclose(values, numbers, rtol=1e-9)
    assert not np.allclose(numbers, plain, rtol=1e-6)


@pytest.mark.parametrize("options", [(), ("--jobs", "2")])
def test_strengths_of_all_inputs_are_at_one_stress(folder, terrain_est_here, tmp_path, options):
    """That of the first input: a wheel with a tenth of the load would have its own."""
    text = (folder / "run.csv").read_text().splitlines()
    load = text[0].split(",").index("load")
    rows = [line.split(",") for line in text[1:]]
    for row in rows:
        row[load] = f"{0.1 * float(row[load]):.6g}"
    (tmp_path / "light.csv").write_text("\n".join([text[0], *map(",".join, rows)]) + "\n")
    (tmp_path / "rover.toml").write_text(ROVER)
    (tmp_path / "run.csv").write_text("\n".join(text) + "\n")
    method = ("--method", "least-squares", "--segments", "none", "-q")

    def stresses(*inputs):
        done = terrain_est_here("estimate", *inputs, *method, *options, "--summary", "s.json", cwd=tmp_path)
        rows = list(csv.DictReader(io.StringIO(done.stdout)))
        (pooled,) = {
            one["pooled"]["stress_kPa"] for one in json.loads((tmp_path / "s.json").read_text())["terrains"]
        }
        return [float(row["stress_kPa"]) for row in rows], pooled

    heavy, light = stresses("run.csv")[1], stresses("light.csv")[1]
    assert light < heavy
    assert stresses("run.csv", "light.csv") == ([heavy] * 4, heavy)
    assert stresses("light.csv", "run.csv") == ([light] * 4, light)
    if options:
        return
    # A batch estimates each input by itself; its table and what is pooled are at the stress of the first.
    batch = ("batch", "light.csv", "run.csv", "-o", "out", *method)
    assert terrain_est_here(*batch, cwd=tmp_path).returncode == 0
    pooled = [one["pooled"] for one in json.loads((tmp_path / "out/summary.json").read_text())["terrains"]]
    assert {one["stress_kPa"] for one in pooled} == {light}
    assert all(one["strength_at_stress_kPa"] is not None for one in pooled)
    both = terrain_est_here("estimate", "light.csv", "run.csv", *method, cwd=tmp_path).stdout
    rows = list(csv.DictReader(io.StringIO(both)))
    told = pq.read_table(tmp_path / "out/segments.parquet").to_pylist()
    for name in ("stress_kPa", "strength_at_stress_kPa", "strength_at_stress_se_kPa"):
        np.testing.assert_allclose([row[name] for row in told], [float(row[name]) for row in rows], rtol=1e-9)
