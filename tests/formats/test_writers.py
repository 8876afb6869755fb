"""Tables to files: every digit, whole or not at all, and what GDAL makes of them."""

from __future__ import annotations

import csv
import io
import json
import math
import os
import resource
import sqlite3
import stat
import subprocess
import sys
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest
from hypothesis import given
from hypothesis import strategies as st

from formats import CannotWriteError, FormatError, check_crs, output_kind, replacing, write_table
from formats.output.common_forms import parse

ENDINGS = ["csv", "parquet", "json", "geojson", "gpkg", "geojsonl", "geojsons"]

LINE = "LINESTRING (137.4 -4.5, 137.4000001 -4.6)"
POINT = "POINT (137.5 -4.7)"
ROWS = [
    ["run, 1.bag", "sand", 0, 0.1, None, LINE],
    ['a "b".csv', "Böschung", 1, -0.3333333333333333, None, POINT],
    ["c", None, 2, None, None, None],
    ["d", "sand", 3, 3.0, None, LINE],
]


def names_in(folder):
    return sorted(path.name for path in folder.iterdir())


def test_csv_to_the_letter(columns, tmp_path):
    write_table(columns, str(tmp_path / "out.csv"))
    assert (tmp_path / "out.csv").read_bytes().decode() == (
        "source,terrain,segment,c_kPa,k_mm,WKT\n"
        f'"run, 1.bag",sand,0,0.1,,"{LINE}"\n'
        f'"a ""b"".csv",Böschung,1,-0.3333333333333333,,{POINT}\n'
        "c,,2,,,\n"
        f'd,sand,3,3.0,,"{LINE}"\n'
    )


def test_csv_to_a_stream(columns, tmp_path, capsys):
    write_table(columns, str(tmp_path / "out.csv"))
    write_table(columns, "-")
    stream = io.StringIO()
    write_table(columns, stream)
    assert capsys.readouterr().out == stream.getvalue() == (tmp_path / "out.csv").read_text()


def test_json(columns, tmp_path):
    write_table({**columns, "x": np.array([math.inf, -math.inf, 1, 2])}, str(tmp_path / "out.json"))

    def refuse(word):
        raise AssertionError(word)

    rows = json.loads((tmp_path / "out.json").read_text("utf-8"), parse_constant=refuse)
    names = [*columns, "x"]
    assert [list(row) for row in rows] == [names] * 4
    assert [list(row.values()) for row in rows] == [
        [*row, x] for row, x in zip(ROWS, [None, None, 1, 2], strict=True)
    ]


def test_parquet(columns, tmp_path):
    write_table(columns, str(tmp_path / "out.parquet"))
    table = pq.read_table(tmp_path / "out.parquet")
    assert [str(kind) for kind in table.schema.types] == [
        "string",
        "string",
        "int64",
        "double",
        "double",
        "string",
        "binary",
    ]
    assert [list(row.values())[:-1] for row in table.to_pylist()] == ROWS
    # The text stays, for readers that do not know GeoParquet.
    assert [shape and parse(shape).wkb() for shape in table["WKT"].to_pylist()] == table[
        "geometry"
    ].to_pylist()
    assert table["k_mm"].null_count == 4


@pytest.mark.parametrize(
    ("crs", "name"),
    [
        ("EPSG:4326", None),
        ("IAU_2015:49900", "urn:ogc:def:crs:IAU:2015:49900"),
        ("epsg:32633", "urn:ogc:def:crs:EPSG::32633"),
        ("+proj=longlat +R=3396190 +no_defs", "+proj=longlat +R=3396190 +no_defs"),
        (None, 'LOCAL_CS["Undefined Cartesian SRS",UNIT["metre",1]]'),
    ],
)
def test_geojson(columns, tmp_path, crs, name):
    write_table(columns, str(tmp_path / "out.geojson"), crs=crs)
    collection = json.loads((tmp_path / "out.geojson").read_text("utf-8"))
    assert collection["type"] == "FeatureCollection"
    assert collection.get("crs") == (name and {"type": "name", "properties": {"name": name}})
    features = collection["features"]
    assert [feature["type"] for feature in features] == ["Feature"] * 4
    assert [list(feature["properties"].values()) for feature in features] == [row[:-1] for row in ROWS]
    line = {"type": "LineString", "coordinates": [[137.4, -4.5], [137.4000001, -4.6]]}
    point = {"type": "Point", "coordinates": [137.5, -4.7]}
    assert [feature["geometry"] for feature in features] == [line, point, None, line]


@pytest.mark.parametrize(
    ("crs", "srs_id", "organization"),
    [
        ("EPSG:4326", 4326, "EPSG"),
        ("OGC:CRS84", 4326, "EPSG"),
        ("IAU_2015:49900", 49900, "IAU_2015"),
        (None, -1, "NONE"),
    ],
)
def test_geopackage(columns, tmp_path, crs, srs_id, organization):
    path = tmp_path / "out.gpkg"
    write_table(columns, str(path), crs=crs)
    with sqlite3.connect(path) as database:
        assert database.execute("select table_name, srs_id from gpkg_geometry_columns").fetchall() == [
            ("segments", srs_id)
        ]
        assert database.execute(
            "select organization, organization_coordsys_id from gpkg_spatial_ref_sys where srs_id = ?",
            [srs_id],
        ).fetchall() == [(organization, srs_id)]
        names = [name for name in columns if name != "WKT"]
        query = f"select {', '.join(names)} from segments"  # noqa: S608 (the names above)
        assert [list(row) for row in database.execute(query)] == [row[:-1] for row in ROWS]
        types = {row[1]: row[2] for row in database.execute("pragma table_info(segments)")}
    database.close()
    assert {name: types[name] for name in names} == {
        "source": "TEXT",
        "terrain": "TEXT",
        "segment": "INTEGER",
        "c_kPa": "REAL",
        "k_mm": "REAL",
    }


@pytest.mark.parametrize("ending", ENDINGS)
def test_table_without_rows_or_geometry(columns, tmp_path, ending):
    path = str(tmp_path / f"out.{ending}")
    write_table({"a": np.empty(0), "n": np.empty(0, int), "t": [], "WKT": []}, path)
    write_table({name: values for name, values in columns.items() if name != "WKT"}, path)
    assert names_in(tmp_path) == [f"out.{ending}"]


def test_columns_of_other_kinds(tmp_path):
    path = tmp_path / "out.csv"
    write_table(
        {"flag": np.array([True, False]), "half": [0.5, None], "count": [1, 2], "f4": np.float32([1, 2])},
        str(path),
    )
    assert path.read_text() == "flag,half,count,f4\n1,0.5,1,1.0\n0,,2,2.0\n"
    with pytest.raises(ValueError, match="different length: a 2, b 3"):
        write_table({"a": [1, 2], "b": [1, 2, 3]}, str(path))
    with pytest.raises(TypeError, match="when: datetime64"):
        write_table({"when": np.array(["2024-01-01"], "datetime64[ns]")}, str(path))


@given(st.lists(st.floats(allow_nan=False, allow_infinity=False), min_size=2, max_size=6), st.booleans())
def test_well_known_text_keeps_every_digit(values, elevated):
    size = 2 + elevated
    points = [tuple(values[j % len(values)] + 0.0 for j in range(k, k + size)) for k in range(3)]
    text = ", ".join(" ".join(map(repr, point)) for point in points)
    shape = parse(f"LINESTRING {'Z ' * elevated}({text})")
    assert shape.points == tuple(points)
    assert shape.wkb()[9:] == np.array(points, "<f8").tobytes()
    assert parse(f"point({' '.join(map(repr, points[0]))})").points == (points[0],)


def test_well_known_text_that_is_empty_or_wrong():
    assert parse(None) is parse("") is parse("LINESTRING EMPTY") is parse("POINT Z EMPTY") is None
    for text in ["POLYGON ((0 0, 1 1, 1 0, 0 0))", "POINT (1)", "LINESTRING (0 0, 1 1 1)", "POINT 1 2"]:
        with pytest.raises(ValueError, match=r"POINT|coordinates"):
            parse(text)


@pytest.mark.parametrize("ending", ["geojson", "gpkg", "parquet", "geojsonl", "geojsons"])
@pytest.mark.parametrize("crs", ["EPSG:999999", "Mars"])
def test_unknown_reference_system(columns, tmp_path, ending, crs):
    with pytest.raises(FormatError, match=f"{crs}: GDAL knows no such reference system") as caught:
        write_table(columns, str(tmp_path / f"out.{ending}"), crs=crs)
    assert "IAU_2015:49900" in caught.value.hint
    assert names_in(tmp_path) == []
    with pytest.raises(FormatError):
        check_crs(crs)
    check_crs("IAU_2015:30100")
    check_crs(None)


def test_kind_by_ending(tmp_path):
    assert [output_kind(f"a.b/out.{ending.upper()}") for ending in ENDINGS] == ENDINGS
    assert output_kind("-") == output_kind("/dev/null") == "csv"
    for name in ["out.xlsx", "out", str(tmp_path)]:
        with pytest.raises(CannotWriteError, match="is not known") as caught:
            output_kind(name)
        assert caught.value.exit_code == 73
        assert ".csv, .parquet, .json, .geojson, .gpkg, .geojsonl, .geojsons" in caught.value.hint
    with pytest.raises(CannotWriteError, match="gpkg needs a file"):
        write_table({"a": [1]}, "-", kind="gpkg")


@pytest.mark.parametrize("ending", ENDINGS)
def test_no_such_folder_or_a_folder(columns, tmp_path, ending):
    with pytest.raises(CannotWriteError, match="no such folder") as caught:
        write_table(columns, str(tmp_path / "missing" / f"out.{ending}"))
    assert caught.value.exit_code == 73
    (tmp_path / f"out.{ending}").mkdir()
    with pytest.raises(CannotWriteError, match="is a folder"):
        write_table(columns, str(tmp_path / f"out.{ending}"))


@pytest.mark.parametrize("ending", ENDINGS)
def test_file_that_may_not_grow_leaves_the_old_one(columns, tmp_path, ending):
    """The kernel refuses to write beyond a limit: as real as a full disk, without needing one."""
    path = tmp_path / f"out.{ending}"
    path.write_text("old")
    table = {name: [*values] * 5000 for name, values in columns.items() if name != "terrain"}
    table["noise"] = np.random.default_rng(1).normal(size=20_000)
    table["c_kPa"] = np.array(table["c_kPa"])
    write_table(table, str(tmp_path / f"whole.{ending}"), crs="EPSG:4326")
    assert (tmp_path / f"whole.{ending}").stat().st_size > 120_000
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (120_000, limits[1]))
    try:
        with pytest.raises(CannotWriteError) as caught:
            write_table(table, str(path), crs="EPSG:4326")
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert str(path) in str(caught.value)
    assert "\n" not in str(caught.value)
    assert path.read_text() == "old"
    assert names_in(tmp_path) == [f"out.{ending}", f"whole.{ending}"]


def test_full_device(columns):
    with pytest.raises(CannotWriteError, match="/dev/full: no space left on the device"):
        write_table(columns, "/dev/full")
    with pytest.raises(CannotWriteError, match="standard output: no space left on the device"):
        write_table(columns, full := Path("/dev/full").open("w"))  # noqa: SIM115 (closing it fails again)
    with pytest.raises(OSError, match="No space left"):
        full.close()


@pytest.mark.parametrize("ending", ENDINGS)
def test_a_pipe_of_any_name_gets_the_whole_file_and_stays_a_pipe(columns, tmp_path, ending):
    """A GeoPackage is removed and made anew where it is written, which no pipe or device may be."""
    pipe, whole = tmp_path / f"pipe.{ending}", tmp_path / f"whole.{ending}"
    os.mkfifo(pipe)
    with subprocess.Popen(["cat", str(pipe)], stdout=subprocess.PIPE) as reader:
        try:
            write_table(columns, str(pipe))
            assert pipe.is_fifo()
            got, _ = reader.communicate(timeout=30)
        finally:
            # Nothing else ends it where the pipe was never opened.
            reader.kill()
    write_table(columns, str(whole))
    assert got == whole.read_bytes()
    assert names_in(tmp_path) == sorted([pipe.name, whole.name])


def test_no_disk_is_written(columns, tmp_path, monkeypatch):
    disk = tmp_path / "disk.csv"
    disk.write_text("as it was")
    monkeypatch.setattr(stat, "S_ISBLK", lambda _: True)
    with pytest.raises(CannotWriteError, match="is a disk"):
        write_table(columns, str(disk))
    assert disk.read_text() == "as it was"


def test_closed_pipe_is_the_callers_matter(columns):
    reader, writer = os.pipe()
    os.close(reader)
    with pytest.raises(BrokenPipeError), os.fdopen(writer, "w") as stream:
        write_table(columns, stream)


def test_replacing_keeps_mode_and_link(tmp_path):
    real, link = tmp_path / "real.json", tmp_path / "link.json"
    real.write_text("old")
    real.chmod(0o640)
    link.symlink_to(real)
    with replacing(str(link)) as temporary:
        assert Path(temporary).suffix == ".json"
        assert Path(temporary).parent == tmp_path
        Path(temporary).write_text("new")
        assert real.read_text() == "old"
    assert real.read_text() == "new"
    assert real.stat().st_mode & 0o777 == 0o640
    assert link.is_symlink()
    assert names_in(tmp_path) == ["link.json", "real.json"]


def test_replacing_follows_the_umask(tmp_path):
    before = os.umask(0o027)
    try:
        for ending in ENDINGS:
            write_table({"a": [1.0]}, str(tmp_path / f"out.{ending}"))
    finally:
        os.umask(before)
    assert {path.stat().st_mode & 0o777 for path in tmp_path.iterdir()} == {0o640}


@pytest.mark.parametrize("failure", [KeyboardInterrupt, ValueError, BrokenPipeError])
def test_replacing_leaves_nothing_behind(tmp_path, failure):
    path = tmp_path / "out.json"
    path.write_text("old")
    with pytest.raises(failure), replacing(str(path)) as temporary:  # noqa: PT012 (the body is the test)
        Path(temporary).write_text("half")
        raise failure
    assert path.read_text() == "old"
    assert names_in(tmp_path) == ["out.json"]


def test_write_protected(tmp_path, unprivileged, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("out.csv").write_text("old")
    Path("out.csv").chmod(0o400)
    Path("closed").mkdir(mode=0o500)
    with unprivileged():
        with pytest.raises(CannotWriteError, match=r"^out.csv: is write-protected"):
            write_table({"a": [1]}, "out.csv")
        with pytest.raises(CannotWriteError, match=r"^closed/out.csv: no permission to write it"):
            write_table({"a": [1]}, "closed/out.csv")
    assert Path("out.csv").read_text() == "old"


def test_nothing_heavy_is_imported_with_the_package():
    code = "import formats, sys; print({'pandas', 'pyarrow', 'pyogrio', 'rosbags'} & {*sys.modules})"
    root = Path(__file__).parents[2]
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=root)
    assert done.stdout == "set()\n"


@pytest.mark.parametrize("name", ["=1+1", "+1", "-wheel", "@cmd", "\t=1"])
def test_no_name_is_a_formula_of_a_spreadsheet(name, tmp_path):
    path = tmp_path / "out.csv"
    write_table({"wheel": [name, None, "a=b"], "c_kPa": [-1.5, 2.0, 3.0], name: ["x", "", "y"]}, str(path))
    with path.open(encoding="utf-8", newline="") as file:
        header, *rows = csv.reader(file)
    assert header == ["wheel", "c_kPa", f"'{name}"]
    assert [row[:2] for row in rows] == [[f"'{name}", "-1.5"], ["", "2.0"], ["a=b", "3.0"]]
