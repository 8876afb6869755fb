"""`terrain-est estimate` into a GIS and into players of messages, and with localisation tables."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import geopandas
import numpy as np
import pandas as pd
import pyogrio
import pytest
import shapely
from mcap.reader import make_reader

from formats import CannotWriteError
from terrain_cli.errors import UsageError
from terrain_cli.presentation import segment_files, segment_table

SAMPLE = Path(__file__).resolve().parent.parent / "sample_data"
MARS = "IAU_2015:49900"
T0 = 1_754_000_000.0
LONGITUDE, LATITUDE = 137.44, -4.59


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """Enter a folder with the sample drive, a localisation table of its first 40 s, and a rover file."""
    for name in ("run.bag", "run.csv", "rover.toml"):
        shutil.copy(SAMPLE / name, tmp_path)
    time = np.arange(0.0, 40.5, 0.5)
    columns = {
        "time": T0 + time,
        "longitude": LONGITUDE + time * 1e-5,
        "planetocentric_latitude": LATITUDE - time * 1e-6,
    }
    pd.DataFrame(columns).to_csv(tmp_path / "places.csv", index=False)
    # Where segments lie does not hang on how they are estimated.
    monkeypatch.setenv("TERRAIN_EST_METHOD", "least-squares")
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture
def run(terrain_est_here):
    def call(*args):
        done = terrain_est_here("estimate", *args)
        assert done.returncode == 0, done.stderr
        return done

    return call


BY_CLOCK = ("run.bag", "--places", "places.csv", "--crs", MARS)


def test_segments_lie_where_the_table_says_by_clock(folder, run):
    done = run(*BY_CLOCK, "-o", "soil.parquet", "--summary", "soil.json")
    frame = geopandas.read_parquet("soil.parquet")
    assert [*frame.columns] == [*segment_table.COLUMNS, "geometry"]
    assert frame.crs.name == "Mars (2015) - Sphere / Ocentric"
    early = frame[frame["t_end_s"] <= T0 + 40.0]
    assert 0 < len(early) < len(frame)
    for row in early.itertuples():
        ends = shapely.get_coordinates(row.geometry)[[0, -1]]
        time = np.array([row.t_start_s, row.t_end_s]) - T0
        # The clock of the bag rises in steps of 50 ms.
        np.testing.assert_allclose(ends[:, 0], LONGITUDE + time * 1e-5, rtol=0, atol=1e-11)
        np.testing.assert_allclose(ends[:, 1], LATITUDE - time * 1e-6, rtol=0, atol=1e-11)
        assert ends[0, 0] < row.longitude_deg < ends[1, 0]
    late = frame[frame["t_start_s"] > T0 + 40.0]
    assert late["longitude_deg"].isna().all()
    assert late.geometry.isna().all()
    # x and y of the log are as they were.
    assert frame["x_m"].notna().all()
    log = pd.read_csv("run.csv")
    placed = int(((log["time"] <= T0 + 40.0) & (log["wheel"] == "front-left")).sum())
    (entry,) = json.loads(Path("soil.json").read_text())["inputs"]
    for wheel in entry["wheels"]:
        counts = wheel["places"]
        missed = wheel["samples"] - placed
        assert counts == {"by": "clock", "placed": placed, "missed": missed, "ambiguous": 0}
        text = f"wheel {wheel['wheel']}: {placed} of {wheel['samples']} samples placed by clock; "
        assert f"{text}{missed} are outside the table or in its gaps" in done.stderr


def test_without_a_table_nothing_is_said_of_places(folder, run):
    run("run.bag", "-o", "soil.csv", "--summary", "soil.json")
    document = json.loads(Path("soil.json").read_text())
    assert document["settings"]["places"] is None
    assert {wheel["places"] for wheel in document["inputs"][0]["wheels"]} == {None}


def test_segments_lie_where_the_table_says_by_site_and_drive(folder, run):
    log = pd.read_csv("run.csv")
    elapsed = log["time"] - T0
    log["SITE"], log["DRIVE"], log["POSE"] = (
        7,
        np.where(elapsed < 30.0, 100, 102),
        (elapsed // 10).astype(int),
    )
    log.to_csv("run.csv", index=False)
    # As the table of Mars 2020: one entry for each drive.
    table = {"frame": ["SITE", "ROVER"], "site": 7, "drive": [-1, 100], "pose": -1, "longitude": [1, 77.45]}
    pd.DataFrame({**table, "planetodetic_latitude": [1, 18.5]}).to_csv("best_interp.csv", index=False)
    done = run(
        "run.csv", "--places", "best_interp.csv", "--crs", MARS, "-o", "soil.geojson",
        "--segments", "fixed", "--window-distance", "0.5",
    )  # fmt: skip
    frame = geopandas.read_file("soil.geojson")
    before = frame["t_end_s"] < T0 + 30.0
    assert frame[before]["longitude_deg"].tolist() == [77.45] * before.sum()
    latitude = np.degrees(np.arctan(np.tan(np.radians(18.5)) * (3376200 / 3396190) ** 2))
    np.testing.assert_allclose(frame[before].geometry.y, latitude, rtol=0, atol=1e-12)
    assert set(frame[before].geometry.geom_type) == {"Point"}
    assert frame[frame["t_start_s"] > T0 + 30.0].geometry.isna().all()
    assert "samples placed by site, drive and pose" in done.stderr


def test_the_rover_file_may_name_the_table(folder, run):
    with Path("rover.toml").open("a") as file:
        file.write(f'[estimate]\nplaces = "places.csv"\ncrs = "{MARS}"\n')
    assert run("run.bag").stdout == run(*BY_CLOCK).stdout


def test_tracks_of_a_site_frame_do_not_stand_among_longitudes(folder, run):
    """One file has one reference system: what is not located has no geometry in it."""
    log = pd.read_csv("run.csv")
    log["time"] += 86_400.0
    log.to_csv("next.csv", index=False)
    run("run.bag", "next.csv", "--places", "places.csv", "--crs", MARS, "-o", "soil.csv")
    table = pd.read_csv("soil.csv")
    assert table[table["source"] == "next.csv"]["WKT"].isna().all()
    assert table[table["source"] == "run.bag"]["WKT"].notna().any()
    assert table["x_m"].notna().all()


def test_jobs_give_the_same(folder, run):
    shutil.copy("run.csv", "again.csv")
    command = ("run.bag", "again.csv", "--places", "places.csv", "--crs", MARS)
    assert run(*command, "--jobs", "2").stdout == run(*command).stdout


def test_segments_and_samples_in_one_geopackage(folder, run):
    run(*BY_CLOCK, "-o", "soil.gpkg", "--samples", "./soil.gpkg", "-q")
    assert [name for name, _ in pyogrio.list_layers("soil.gpkg")] == ["segments", "samples", "layer_styles"]
    segments = geopandas.read_file("soil.gpkg", layer="segments")
    samples = geopandas.read_file("soil.gpkg", layer="samples")
    assert samples.crs == segments.crs
    assert "Mars" in samples.crs.name
    counts = samples.groupby(["wheel", "segment"]).size()
    expected = segments.set_index(["wheel", "segment"])["n_samples"]
    assert counts.to_dict() == expected.to_dict()
    first = samples.iloc[0]
    assert first.geometry == shapely.Point(first["longitude_deg"], first["latitude_deg"])
    log = pd.read_csv("run.csv").query("wheel == 'front-left'").iloc[first["sample"] - 1]
    assert (first["load_N"], first["sinkage_m"]) == pytest.approx((log["load"], log["sinkage"]), rel=1e-6)
    styles = pyogrio.read_dataframe("soil.gpkg", layer="layer_styles")
    assert styles[styles["useAsDefault"]][["f_table_name", "styleName"]].to_numpy().tolist() == [
        ["segments", "strength_at_stress_kPa"],
        ["samples", "slip"],
    ]


def test_samples_in_a_file_of_their_own(folder, run):
    table = run("run.csv", "-q", "--samples", "samples.gpkg").stdout
    assert table.startswith("source,wheel,segment,")
    assert pyogrio.list_layers("samples.gpkg")[0].tolist() == ["samples", "Point"]
    run("run.csv", "-q", "--samples", "samples.parquet")
    frame = geopandas.read_parquet("samples.parquet")
    assert frame.crs is None
    assert len(frame) == pyogrio.read_info("samples.gpkg", layer="samples")["features"]


def test_messages_for_foxglove_and_plotjuggler(folder, run):
    run(*BY_CLOCK, "-o", "soil.mcap", "-q")
    with Path("soil.mcap").open("rb") as file:
        statistics = make_reader(file).get_summary()
    counts = {
        channel.topic: statistics.statistics.channel_message_counts[number]
        for number, channel in statistics.channels.items()
    }
    assert counts.keys() == {
        f"/terrain/{wheel}/{what}" for wheel in ("front_left", "front_right") for what in ("estimate", "fix")
    }
    assert statistics.statistics.message_start_time == int(T0 * 1e9)


def test_a_sequence_says_how_gdal_is_to_read_it(folder, run):
    done = run(*BY_CLOCK, "-o", "soil.geojsons")
    assert f"soil.geojsons: GDAL takes every sequence of GeoJSON for WGS 84; add -a_srs {MARS}" in done.stderr
    assert Path("soil.geojsons").read_bytes().count(b"\x1e") == len(geopandas.read_file("soil.geojsons"))
    assert "-a_srs NONE" in run("run.csv", "-o", "soil.geojsonl").stderr
    assert (
        segment_files.remark("soil.geojsonl", "EPSG:4326") == segment_files.remark("soil.geojson", MARS) == ""
    )


@pytest.mark.parametrize(
    ("args", "code", "message"),
    [
        (("--places", "places.csv"), 2, "places.csv has planetocentric_latitude, and without --crs"),
        (("--places", "missing.csv"), 66, "missing.csv"),
        (("--places", "run.csv", "-o", "soil.shp"), 73, "the ending '.shp' is not known"),
        (
            ("-o", "soil.csv", "--samples", "soil.csv"),
            2,
            "-o and --samples both go to soil.csv\n  only a .gpkg holds both",
        ),
        (("--samples", "samples.mcap"), 73, "the ending '.mcap' is not known"),
        (("--crs", "Mars", "-o", "soil.parquet"), 2, "GDAL knows no such reference system"),
    ],
)
def test_refused_before_the_work(folder, terrain_est_here, args, code, message):
    before = sorted(folder.iterdir())
    done = terrain_est_here("estimate", "run.bag", *args)
    assert done.returncode == code, done.stderr
    assert message in done.stderr
    assert "Traceback" not in done.stderr
    assert (done.stdout, sorted(folder.iterdir())) == ("", before)


def test_steady_test_points_are_no_messages(folder, terrain_est_here):
    pd.read_csv("run.csv").drop(columns="time").to_csv("bench.csv", index=False)
    quickest = ("estimate", "bench.csv", "--method", "least-squares")
    done = terrain_est_here(*quickest, "-o", "soil.mcap")
    assert done.returncode == 65
    assert "segments have no time, which every message needs" in done.stderr
    assert not Path("soil.mcap").exists()
    done = terrain_est_here(
        "estimate", "bench.csv", "--method", "least-squares", "--places", "places.csv", "--crs", MARS
    )
    assert done.returncode == 65
    assert "bench.csv: places.csv gives no place for it" in done.stderr


def test_system_and_ending_are_checked_before_the_work():
    segment_files.check("soil.parquet", None, "EPSG:32633")
    with pytest.raises(UsageError, match=r"--crs EPSG:1: GDAL knows no such") as caught:
        segment_files.check("soil.parquet", None, "EPSG:1")
    assert "IAU_2015:49900 (Mars)" in caught.value.hint
    with pytest.raises(CannotWriteError, match="is not known"):
        segment_files.check(None, "samples.shp")
