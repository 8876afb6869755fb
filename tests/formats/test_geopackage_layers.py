"""Layers of a GeoPackage, and the styles in which QGIS shows them."""

from __future__ import annotations

import json
import math
import shutil
import sqlite3
import subprocess
import time
from contextlib import closing
from xml.etree import ElementTree as ET

import numpy as np
import pyogrio
import pytest
from hypothesis import given
from hypothesis import strategies as st

from formats import write_table
from formats.output.geopackage import COLOURS, classes, qml

#: What QGIS 3 itself puts into a GeoPackage when a style is saved there.
QGIS_COLUMNS = [
    ("id", "INTEGER"),
    ("f_table_catalog", "TEXT(256)"),
    ("f_table_schema", "TEXT(256)"),
    ("f_table_name", "TEXT(256)"),
    ("f_geometry_column", "TEXT(256)"),
    ("styleName", "TEXT(30)"),
    ("styleQML", "TEXT"),
    ("styleSLD", "TEXT"),
    ("useAsDefault", "BOOLEAN"),
    ("description", "TEXT"),
    ("owner", "TEXT(30)"),
    ("ui", "TEXT(30)"),
    ("update_time", "DATETIME"),
]
STRENGTHS = np.array([3.0, 1.0, math.nan, 2.0, 9.0, 4.5, 7.0, 8.0, 1.5, 6.0, 0.5, 5.0])
GRADUATED = {"segments": ("strength_kPa", "c_kPa", "phi_deg"), "samples": ("slip",)}
PYTHON_OF_QGIS = "/usr/bin/python3"
#: Opens each layer as QGIS does when it is dragged into a project, and draws it.
LOAD = """
import json, os, sys
os.environ["QT_QPA_PLATFORM"] = "offscreen"
from qgis.core import QgsApplication, QgsMapRendererParallelJob, QgsMapSettings, QgsVectorLayer
from qgis.PyQt.QtCore import QSize
application = QgsApplication([], False)
application.initQgis()
shown = {}
for name in ("segments", "samples"):
    layer = QgsVectorLayer(f"{sys.argv[1]}|layername={name}", name, "ogr")
    loaded = layer.loadDefaultStyle()[1]
    renderer = layer.renderer()
    settings = QgsMapSettings()
    settings.setLayers([layer])
    settings.setDestinationCrs(layer.crs())
    settings.setOutputSize(QSize(300, 300))
    extent = layer.extent()
    extent.grow(0.002)
    settings.setExtent(extent)
    job = QgsMapRendererParallelJob(settings)
    job.start()
    job.waitForFinished()
    picture = job.renderedImage()
    drawn = {picture.pixelColor(x, y).getRgb() for x in range(300) for y in range(300)}
    shown[name] = [
        loaded,
        renderer.type(),
        renderer.classAttribute(),
        layer.crs().authid(),
        [[r.lowerValue(), r.upperValue(), r.symbol().color().getRgb()] for r in renderer.ranges()],
        sorted(drawn),
    ]
print(json.dumps(shown))
"""


@pytest.fixture
def path(tmp_path):
    n = len(STRENGTHS)
    segments = {
        "segment": np.arange(n),
        "strength_kPa": STRENGTHS,
        "c_kPa": np.full(n, math.nan),
        "phi_deg": np.linspace(20, 40, n),
        "WKT": [f"LINESTRING (137.4 {-4.5 - k / 1000}, 137.401 {-4.5 - k / 1000})" for k in range(n)],
    }
    samples = {"slip": np.linspace(0, 1, 30), "WKT": [f"POINT (137.4 {-4.5 - k / 1000})" for k in range(30)]}
    path = tmp_path / "out.gpkg"
    layers = {"samples": samples}
    write_table(segments, str(path), crs="IAU_2015:49900", layers=layers, graduated=GRADUATED)
    return path


def rows(path, query):
    with closing(sqlite3.connect(path)) as database:
        return database.execute(query).fetchall()


def test_layers(path):
    assert [name for name, _ in pyogrio.list_layers(path)] == ["segments", "samples", "layer_styles"]
    for layer, count in (("segments", 12), ("samples", 30)):
        info = pyogrio.read_info(path, layer=layer)
        assert info["features"] == count
        assert "Mars (2015) - Sphere" in info["crs"] or info["crs"] == "IAU_2015:49900"
    assert rows(path, "select count(*) from rtree_samples_geom") == [(30,)]


def test_a_system_of_a_planet_has_the_year_of_its_authority(path):
    """Without it QGIS does not know the system, though GDAL does."""
    query = "select definition from gpkg_spatial_ref_sys where organization = 'IAU_2015'"
    ((definition,),) = rows(path, query)
    assert 'AUTHORITY["IAU_2015","49900"]' in definition
    assert 'AUTHORITY["IAU",' not in definition


def test_table_of_styles_is_laid_out_as_by_qgis(path):
    columns = rows(path, "select name, type from pragma_table_info('layer_styles')")
    assert columns == QGIS_COLUMNS
    assert rows(path, "select data_type from gpkg_contents where table_name = 'layer_styles'") == [
        ("attributes",)
    ]
    # The first that is known, by default; a column without numbers has no style.
    assert rows(
        path, "select f_table_name, f_geometry_column, styleName, useAsDefault from layer_styles order by id"
    ) == [
        ("segments", "geom", "strength_kPa", 1),
        ("segments", "geom", "phi_deg", 0),
        ("samples", "geom", "slip", 1),
    ]
    # QGIS asks for the empty string, not for null.
    assert rows(path, "select distinct f_table_catalog, f_table_schema from layer_styles") == [("", "")]


def test_styles_are_graduated(path):
    for layer, name, text in rows(path, "select f_table_name, styleName, styleQML from layer_styles"):
        assert text.startswith("<!DOCTYPE qgis ")
        root = ET.fromstring(text)  # noqa: S314 (written here)
        assert root.tag == "qgis"
        renderer = root.find("renderer-v2")
        assert renderer.attrib["type"] == "graduatedSymbol"
        assert renderer.attrib["attr"] == name
        kind, geometry = ("line", "1") if layer == "segments" else ("marker", "0")
        assert root.findtext("layerGeometryType") == geometry
        symbols = {symbol.attrib["name"]: symbol for symbol in renderer.find("symbols")}
        assert {symbol.attrib["type"] for symbol in symbols.values()} == {kind}
        bounds = [(float(r.attrib["lower"]), float(r.attrib["upper"])) for r in renderer.find("ranges")]
        assert [upper for _, upper in bounds[:-1]] == [lower for lower, _ in bounds[1:]]
        (column,) = zip(*rows(path, f"select {name} from {layer} where {name} is not null"), strict=True)  # noqa: S608
        assert (bounds[0][0], bounds[-1][1]) == (min(column), max(column))
        assert [r.attrib["symbol"] for r in renderer.find("ranges")] == list(symbols)


@given(st.lists(st.floats(-1e9, 1e9) | st.just(math.nan), max_size=60))
def test_every_number_is_in_a_class(values):
    ranges = classes(np.array(values))
    assert len(ranges) <= len(COLOURS)
    assert all(lower <= upper for lower, upper in ranges)
    for value in filter(math.isfinite, values):
        assert any(lower <= value <= upper for lower, upper in ranges)


def test_classes_hold_about_as_many_each():
    values = np.random.default_rng(1).lognormal(size=1000)
    counts = [np.sum((values > lower) & (values <= upper)) for lower, upper in classes(values)]
    assert len(counts) == 5
    assert np.ptp(counts) <= 2
    assert classes(np.array([2.0, 2.0])) == [(2.0, 2.0)]
    assert qml("c_kPa", np.array([math.nan]), "Point") is None


def test_points_and_lines_in_one_layer_take_the_style_of_lines(tmp_path):
    table = {"a": [1.0, 2.0], "WKT": ["POINT (0 0)", "LINESTRING (0 0, 1 1)"]}
    write_table(table, str(tmp_path / "out.gpkg"), graduated={"segments": ("a",)})
    ((text,),) = rows(tmp_path / "out.gpkg", "select styleQML from layer_styles")
    assert ET.fromstring(text).findtext("layerGeometryType") == "1"  # noqa: S314


def test_the_same_tables_give_the_same_bytes(tmp_path):
    """Also where GDAL builds the index of a large layer apart, and a second later."""
    n = 20_000
    rng = np.random.default_rng(1)
    columns = {
        "a": rng.normal(size=n),
        "WKT": [f"POINT ({x!r} {y!r})" for x, y in rng.normal(size=(n, 2)).tolist()],
    }
    for name in ("a.gpkg", "b.gpkg"):
        write_table(
            columns, str(tmp_path / name), layers={"samples": columns}, graduated={"segments": ("a",)}
        )
        time.sleep(1.1)
    assert (tmp_path / "a.gpkg").read_bytes() == (tmp_path / "b.gpkg").read_bytes()
    assert pyogrio.get_gdal_config_option("OGR_CURRENT_DATE") is None


def test_nothing_to_show_has_no_styles(tmp_path):
    graduated = {"segments": ("a",)}
    write_table({"a": [1.0]}, str(tmp_path / "a.gpkg"), graduated=graduated)
    write_table({"a": [], "WKT": []}, str(tmp_path / "b.gpkg"), graduated=graduated)
    for name in ("a.gpkg", "b.gpkg"):
        assert [layer for layer, _ in pyogrio.list_layers(tmp_path / name)] == ["segments"]


@pytest.mark.real("ogrinfo")
def test_gdal_opens_layers_and_styles(path):
    def gdal(*command):
        done = subprocess.run([*command], capture_output=True, text=True, check=True)
        assert done.stderr == ""
        return done.stdout

    shown = gdal("ogrinfo", str(path))
    assert "1: segments (Line String)\n2: samples (Point)\n3: layer_styles (None)\n" in shown
    assert "useAsDefault: Integer(Boolean)" in gdal("ogrinfo", "-so", str(path), "layer_styles")


def qgis_is_there():
    if shutil.which(PYTHON_OF_QGIS) is None:
        return False
    return (
        subprocess.run(
            [PYTHON_OF_QGIS, "-c", "import qgis.core"], check=False, capture_output=True
        ).returncode
        == 0
    )


@pytest.mark.skipif(not qgis_is_there(), reason="QGIS (python3-qgis) is not installed")
def test_qgis_shows_the_styles(path):
    command = [PYTHON_OF_QGIS, "-c", LOAD, str(path)]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    shown = json.loads(done.stdout.splitlines()[-1])
    for layer, column in (("segments", "strength_kPa"), ("samples", "slip")):
        loaded, kind, attribute, system, ranges, drawn = shown[layer]
        assert (loaded, kind, attribute, system) == (True, "graduatedSymbol", column, "IAU_2015:49900")
        assert len(ranges) == 5
        assert ",".join(map(str, ranges[0][2])) == COLOURS[0]
        assert ",".join(map(str, ranges[-1][2])) == COLOURS[-1]
        # On the map every class is there, in its colour.
        assert [colour for _, _, colour in ranges if colour not in drawn] == []
