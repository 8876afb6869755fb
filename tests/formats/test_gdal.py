"""What GDAL makes of the tables written here."""

from __future__ import annotations

import csv
import io
import re
import shutil
import sqlite3
import subprocess

import pytest

from formats import open_source, write_table

pytestmark = [
    pytest.mark.real,
    pytest.mark.skipif(shutil.which("ogr2ogr") is None, reason="needs GDAL: ogrinfo and ogr2ogr (gdal-bin)"),
]


def layer(path):
    """Names and types of the fields, the features and the reference system, as ogrinfo prints them."""
    done = subprocess.run(["ogrinfo", "-al", path], capture_output=True, text=True, check=True)
    assert done.stderr == ""
    head, _, features = done.stdout.partition("OGRFeature")
    types = dict(re.findall(r"^(\w+): (\w+) \(\d+\.\d+\)$", head, re.MULTILINE))
    system = re.search(r"Layer SRS WKT:\n(.*?)Data axis", head, re.DOTALL)[1]
    geometries = re.findall(r"^  ((?:LINESTRING|POINT) .*)$", features, re.MULTILINE)
    return types, system, geometries


def rows_by_gdal(path):
    command = ["ogr2ogr", "-f", "CSV", "/vsistdout/", path, "-lco", "SEPARATOR=TAB"]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    return list(csv.reader(io.StringIO(done.stdout), delimiter="\t"))


TYPES = {"source": "String", "terrain": "String", "segment": "Integer64", "c_kPa": "Real", "k_mm": "Real"}
GEOMETRIES = [
    "LINESTRING (137.4 -4.5,137.4000001 -4.6)",
    "POINT (137.5 -4.7)",
    "LINESTRING (137.4 -4.5,137.4000001 -4.6)",
]


@pytest.mark.parametrize("ending", ["gpkg", "geojson"])
@pytest.mark.parametrize(
    ("crs", "begins"),
    [
        ("EPSG:4326", 'GEOGCRS["WGS 84"'),
        ("IAU_2015:49900", 'GEOGCRS["Mars (2015) - Sphere / Ocentric"'),
        ("IAU_2015:30100", 'GEOGCRS["Moon (2015) - Sphere / Ocentric"'),
        (None, 'ENGCRS["Undefined Cartesian SRS"'),
    ],
)
def test_gdal_opens_it(columns, tmp_path, ending, crs, begins):
    path = str(tmp_path / f"out.{ending}")
    write_table(columns, path, crs=crs)
    types, system, geometries = layer(path)
    # GeoJSON has no types of its own: an empty column is text to GDAL, and integers are short.
    expected = TYPES if ending == "gpkg" else {**TYPES, "k_mm": "String", "segment": "Integer"}
    assert types == expected
    assert system.startswith(begins)
    assert [text.replace("2.0)", "2)") for text in geometries] == GEOMETRIES
    assert rows_by_gdal(path)[1:] == [
        ["run, 1.bag", "sand", "0", "0.1", ""],
        ['a "b".csv', "Böschung", "1", "-0.333333333333333", ""],
        ["c", "", "2", "", ""],
        ["d", "sand", "3", "3", ""],
    ]


def test_csv_pipe_into_a_geopackage(columns, tmp_path):
    del columns["k_mm"]
    stream = io.StringIO()
    write_table(columns, stream)
    path = str(tmp_path / "out.gpkg")
    command = ["ogr2ogr", "-f", "GPKG", path, "CSV:/vsistdin/", "-a_srs", "IAU_2015:49900"]
    options = ["-oo", "AUTODETECT_TYPE=YES", "-oo", "EMPTY_STRING_AS_NULL=YES"]
    done = subprocess.run(
        [*command, *options], input=stream.getvalue(), capture_output=True, text=True, check=True
    )
    assert done.stderr == ""
    types, system, geometries = layer(path)
    assert {name: types[name] for name in ("source", "terrain", "segment", "c_kPa")} == {
        "source": "String",
        "terrain": "String",
        "segment": "Integer",
        "c_kPa": "Real",
    }
    assert system.startswith('GEOGCRS["Mars (2015) - Sphere / Ocentric"')
    assert geometries == GEOMETRIES
    with sqlite3.connect(path) as database:
        ((name,),) = database.execute("select table_name from gpkg_contents")
        values = [value for (value,) in database.execute(f"select c_kPa from {name}")]  # noqa: S608 (GDAL's)
    database.close()
    assert values == [0.1, -0.3333333333333333, None, 3.0]


def test_gdal_leaves_the_apostrophe_of_a_guarded_name(tmp_path):
    path = str(tmp_path / "out.csv")
    names = ["=1+1", "-left", "left"]
    write_table({"wheel": names, "=note": names, "c_kPa": [-1.5, 2.0, 3.0]}, path)
    header, *rows = rows_by_gdal(path)
    assert header == ["wheel", "'=note", "c_kPa"]
    assert rows == [["'=1+1", "'=1+1", "-1.5"], ["'-left", "'-left", "2.0"], ["left", "left", "3.0"]]
    # Here it is taken off, and the formats of a GIS have none.
    (read,) = open_source(path).read("", ["wheel", "=note"])
    assert [[column.names[code] for code in column.codes] for column in read.values()] == [names, names]
    path = str(tmp_path / "out.gpkg")
    write_table({"wheel": names, "WKT": ["POINT (1 2)"] * 3}, path)
    assert [row[0] for row in rows_by_gdal(path)[1:]] == names
