"""GeoParquet 1.1: the metadata against the specification, and what geopandas and PROJ make of it."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import geopandas
import jsonschema
import numpy as np
import pyarrow.parquet as pq
import pyproj
import pytest
import shapely

from formats import FormatError, write_table
from formats.output.common_forms import projjson

ROOT = Path(__file__).parents[2]
#: Of the WKB encoding, in the specification and in its JSON schema.
GEOMETRY_TYPES = {
    f"{kind}{z}"
    for kind in (
        "Point",
        "LineString",
        "Polygon",
        "MultiPoint",
        "MultiLineString",
        "MultiPolygon",
        "GeometryCollection",
    )
    for z in ("", " Z")
}
ENCODINGS = {"WKB", "point", "linestring", "polygon", "multipoint", "multilinestring", "multipolygon"}


def write(columns, tmp_path, crs=None):
    path = tmp_path / "out.parquet"
    write_table(columns, str(path), crs=crs)
    return path


def geo(path):
    """Return the metadata, having held it against the rules of GeoParquet 1.1."""
    schema = pq.read_schema(path)
    document = json.loads(schema.metadata[b"geo"])
    assert document["version"] == "1.1.0"
    assert document["primary_column"] in document["columns"]
    assert document.keys() <= {"version", "primary_column", "columns"}
    for name, column in document["columns"].items():
        assert column.keys() >= {"encoding", "geometry_types"}
        assert column["encoding"] in ENCODINGS
        assert column["encoding"] == "WKB"
        assert str(schema.field(name).type) == "binary"
        assert len(set(column["geometry_types"])) == len(column["geometry_types"])
        assert set(column["geometry_types"]) <= GEOMETRY_TYPES
        assert column.get("edges", "planar") in {"planar", "spherical"}
        assert column["crs"] is None or column["crs"]["type"].endswith("CRS")
        if "bbox" in column:
            assert len(column["bbox"]) == 4
            assert all(isinstance(number, float) for number in column["bbox"])
    return document["columns"][document["primary_column"]]


@pytest.mark.parametrize("crs", [None, "EPSG:4326", "OGC:CRS84", "IAU_2015:49900", "EPSG:32633"])
def test_metadata(columns, tmp_path, crs):
    column = geo(write(columns, tmp_path, crs))
    assert column["geometry_types"] == ["LineString", "Point"]
    assert column["bbox"] == [137.4, -4.7, 137.5, -4.5]
    assert (column["crs"] is None) == (crs is None)


@pytest.mark.parametrize("crs", ["IAU_2015:49900", "EPSG:32633", "EPSG:4326", None])
def test_geopandas_reads_it(columns, tmp_path, crs):
    frame = geopandas.read_parquet(write(columns, tmp_path, crs))
    assert list(frame.columns) == [*columns, "geometry"]
    expected = [None if text is None else shapely.from_wkt(text) for text in columns["WKT"]]
    assert [shape == wanted for shape, wanted in zip(frame.geometry, expected, strict=True)] == [True] * 4
    np.testing.assert_array_equal(frame["c_kPa"], columns["c_kPa"])
    # Longitude stands first, and that is OGC:CRS84.
    wanted = "OGC:CRS84" if crs == "EPSG:4326" else crs
    assert frame.crs == (wanted and pyproj.CRS(wanted))


@pytest.mark.parametrize("crs", ["OGC:CRS84", "IAU_2015:49900", "EPSG:32633"])
def test_it_is_valid_projjson(crs):
    """By the JSON schema that comes with PROJ."""
    schema = json.loads(Path(pyproj.datadir.get_data_dir(), "projjson.schema.json").read_text("utf-8"))
    jsonschema.validate(projjson(crs), schema)


def test_names_of_the_earth_are_one():
    assert projjson("EPSG:4326") == projjson("WGS84") == projjson("crs84")
    assert projjson("EPSG:4326")["id"] == {"authority": "OGC", "code": "CRS84"}


def test_small_letters_name_the_same():
    assert projjson("iau_2015:49900") == projjson("IAU_2015:49900")


@pytest.mark.parametrize(
    "crs",
    [
        "EPSG:3031",
        "IAU_2015:49900",
        "IAU_2015:30100",
        "IAU_2015:49910",
        "+proj=longlat +R=3396190 +no_defs",
        pyproj.CRS("EPSG:32633").to_wkt(),
    ],
)
def test_every_other_system_comes_from_proj(columns, tmp_path, crs):
    assert pyproj.CRS.from_json_dict(geo(write(columns, tmp_path, crs))["crs"]) == pyproj.CRS(crs)


def test_an_unknown_system_leaves_no_file(columns, tmp_path):
    with pytest.raises(FormatError, match=r"EPSG:1: GDAL knows no such reference system"):
        write(columns, tmp_path, "EPSG:1")
    assert not list(tmp_path.iterdir())


def test_elevated_geometry_and_none(tmp_path):
    column = geo(write({"WKT": ["POINT Z (1 2 3)", None, "LINESTRING Z (0 1 2, 3 4 5)"]}, tmp_path))
    assert column["geometry_types"] == ["LineString Z", "Point Z"]
    assert column["bbox"] == [0.0, 1.0, 3.0, 4.0]
    frame = geopandas.read_parquet(tmp_path / "out.parquet")
    assert frame.geometry[0].equals(shapely.from_wkt("POINT Z (1 2 3)"))
    nothing = geo(write({"a": [1.0, 2.0], "WKT": [None, ""]}, tmp_path))
    assert nothing["geometry_types"] == []
    assert "bbox" not in nothing
    assert geopandas.read_parquet(tmp_path / "out.parquet").geometry.isna().all()


def test_a_table_without_geometry_is_plain_parquet(tmp_path):
    path = write({"a": [1.0]}, tmp_path)
    assert b"geo" not in (pq.read_schema(path).metadata or {})
    assert pq.read_table(path).column_names == ["a"]


def test_the_same_table_gives_the_same_bytes(columns, tmp_path):
    """In two processes, so that no order of a set is the same by chance."""
    code = (
        "import sys; from formats import write_table; "
        "write_table({'WKT': ['POINT (1 2)', 'LINESTRING (0 0, 1 1)']}, sys.argv[1], crs='EPSG:32633')"
    )
    for seed in "12":
        command = [sys.executable, "-c", code, str(tmp_path / f"{seed}.parquet")]
        subprocess.run(command, check=True, cwd=ROOT, env={"PYTHONHASHSEED": seed})
    assert (tmp_path / "1.parquet").read_bytes() == (tmp_path / "2.parquet").read_bytes()
