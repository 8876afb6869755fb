"""Sequences of GeoJSON: one feature a line, and with the separators of RFC 8142."""

from __future__ import annotations

import json
import subprocess

import geopandas
import pytest

from formats import write_table

ENDINGS = ["geojsonl", "geojsons"]


def read(path):
    """Parse a sequence as its ending promises: RFC 8142, section 2, or JSON lines."""
    data = path.read_bytes()
    if path.suffix == ".geojsons":
        before, *texts = data.split(b"\x1e")
        assert before == b""
    else:
        assert b"\x1e" not in data
        texts = data.splitlines(keepends=True)
    assert all(text.endswith(b"\n") and text.count(b"\n") == 1 for text in texts)
    return [json.loads(text) for text in texts]


@pytest.mark.parametrize("ending", ENDINGS)
@pytest.mark.parametrize("crs", ["EPSG:4326", "IAU_2015:49900", None])
def test_the_features_of_a_collection_one_by_one(columns, tmp_path, ending, crs):
    write_table(columns, str(tmp_path / f"out.{ending}"), crs=crs)
    write_table(columns, str(tmp_path / "out.geojson"), crs=crs)
    collection = json.loads((tmp_path / "out.geojson").read_bytes())
    system = {"crs": collection["crs"]} if crs != "EPSG:4326" else {}
    assert read(tmp_path / f"out.{ending}") == [{**feature, **system} for feature in collection["features"]]


@pytest.mark.parametrize("ending", ENDINGS)
def test_an_empty_table_is_an_empty_sequence(tmp_path, ending):
    write_table({"a": [], "WKT": []}, str(tmp_path / f"out.{ending}"))
    assert (tmp_path / f"out.{ending}").read_bytes() == b""


@pytest.mark.parametrize("ending", ENDINGS)
def test_geopandas_reads_it(columns, tmp_path, ending):
    write_table(columns, str(tmp_path / f"out.{ending}"), crs="EPSG:4326")
    frame = geopandas.read_file(tmp_path / f"out.{ending}")
    assert frame["source"].tolist() == columns["source"]
    assert frame.geometry[0].wkt == "LINESTRING (137.4 -4.5, 137.4000001 -4.6)"
    assert frame.geometry.isna().tolist() == [False, False, True, False]


@pytest.mark.real("ogr2ogr", "ogrinfo")
@pytest.mark.parametrize("ending", ENDINGS)
def test_gdal_reads_it_and_takes_the_reference_system_from_its_user(columns, tmp_path, ending):
    path = str(tmp_path / f"out.{ending}")
    write_table(columns, path, crs="IAU_2015:49900")

    def gdal(*command):
        done = subprocess.run([*command], capture_output=True, text=True, check=True)
        assert done.stderr == ""
        return done.stdout

    shown = gdal("ogrinfo", "-al", path)
    assert "using driver `GeoJSONSeq'" in shown
    assert "Feature Count: 4" in shown
    # What docs/gis.md warns of: GDAL passes over the member that names the system.
    assert 'GEOGCRS["WGS 84"' in shown
    gdal("ogr2ogr", "-a_srs", "IAU_2015:49900", str(tmp_path / "mars.gpkg"), path)
    assert "Mars (2015) - Sphere" in gdal("ogrinfo", "-al", "-so", str(tmp_path / "mars.gpkg"))
