"""GeoPackage, written by GDAL, with styles for QGIS. The same tables give the same bytes."""

import sqlite3
from collections.abc import Iterator, Mapping, Sequence
from contextlib import closing, contextmanager
from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np
from numpy.typing import NDArray
from pyogrio import get_gdal_config_option, raw, set_gdal_config_options
from pyogrio.errors import CRSError, DataLayerError, DataSourceError, FeatureError, GeometryError

from formats.errors import CannotWriteError
from formats.output.common_forms import SITE_FRAME, WKT, Table, is_wgs84, parse, unknown_crs

#: Stands where a GeoPackage notes when it was changed: the time of writing would be other bytes each time.
_NO_DATE = "1970-01-01T00:00:00.000Z"
#: GDAL leaves the year out of the authority of a planet's system, by which QGIS then does not know it.
_WITH_YEAR = """
UPDATE gpkg_spatial_ref_sys
SET definition = replace(definition, 'AUTHORITY["IAU",', 'AUTHORITY["' || organization || '",')
WHERE organization LIKE 'IAU~_%' ESCAPE '~'
"""
#: As QGIS makes it, and finds it (its provider `ogr`, `saveStyle` and `loadStyle`).
_LAYER_STYLES = """
CREATE TABLE layer_styles (
    id INTEGER PRIMARY KEY AUTOINCREMENT NOT NULL, f_table_catalog TEXT(256), f_table_schema TEXT(256),
    f_table_name TEXT(256), f_geometry_column TEXT(256), styleName TEXT(30), styleQML TEXT, styleSLD TEXT,
    useAsDefault BOOLEAN, description TEXT, owner TEXT(30), ui TEXT(30),
    update_time DATETIME DEFAULT (strftime('%Y-%m-%dT%H:%M:%fZ','now')))
"""
#: From low to high: five of the colours of viridis, which keep their order in grey and to the colour-blind.
COLOURS = ("68,1,84,255", "59,82,139,255", "33,145,140,255", "94,201,98,255", "253,231,37,255")
_SYMBOLS = {
    "LineString": (
        "line",
        "SimpleLine",
        "line_color",
        {"line_width": "1.2", "line_width_unit": "MM", "capstyle": "round", "joinstyle": "round"},
    ),
    "Point": (
        "marker",
        "SimpleMarker",
        "color",
        {"name": "circle", "size": "2.4", "size_unit": "MM", "outline_style": "no"},
    ),
}
_GEOMETRY_TYPES = {"Point": "0", "LineString": "1"}  # As QGIS numbers them


def write_geopackage(
    layers: Mapping[str, Table],
    graduated: Mapping[str, Sequence[str]],
    destination: str,
    path: str,
    crs: str | None,
) -> None:
    """Write tables as the layers of a GeoPackage, by their names; `destination` is for messages."""
    # Columns that are `graduated` have a style each, of which QGIS shows the first. Without a `crs` they are
    # in a site frame (srs_id −1, undefined Cartesian).
    system = SITE_FRAME if crs is None else "EPSG:4326" if is_wgs84(crs) else crs
    # GDAL does not write into a file that is there but empty.
    Path(path).unlink()
    styles = []
    try:
        with _no_date():
            for name, table in layers.items():
                kind = _write_layer(name, table, path, system)
                styles += [(name, *style) for style in _styles(table, graduated.get(name, ()), kind)]
        with closing(sqlite3.connect(path)) as database, database:
            database.execute(_WITH_YEAR)
            if styles:
                _write_styles(database, styles)
    except CRSError as error:
        raise unknown_crs(system) from error
    except (sqlite3.Error, DataSourceError, DataLayerError, FeatureError, GeometryError) as error:
        what = f"cannot be written: {' '.join(str(error).split())}"
        raise CannotWriteError(destination, what, hint="is there space left on the device?") from error


@contextmanager
def _no_date() -> Iterator[None]:
    """Let GDAL note no date of its own."""
    before = get_gdal_config_option("OGR_CURRENT_DATE")
    set_gdal_config_options({"OGR_CURRENT_DATE": _NO_DATE})
    try:
        yield
    finally:
        set_gdal_config_options({"OGR_CURRENT_DATE": before})


def _write_layer(layer: str, table: Table, path: str, system: str) -> str | None:
    """Write one layer, and return the type of its geometries."""
    fields = {name: column for name, column in table.items() if name != WKT}
    shapes, wkb, shape_type = [], None, None
    if WKT in table:
        shapes = [parse(text) for text in table[WKT]]
        wkb = np.array([shape.wkb() if shape else None for shape in shapes], dtype=object)
        kinds = {(shape.kind, len(shape.points[0])) for shape in shapes if shape}
        shape_type = kinds.pop()[0] if len(kinds) == 1 else "Unknown"
    raw.write(
        path,
        wkb,
        list(fields.values()),
        list(fields),
        layer=layer,
        driver="GPKG",
        geometry_type=shape_type,
        crs=system,
        append=Path(path).exists(),
        # Read by GDAL 3.6 without a warning, unlike 1.4.
        dataset_options={"VERSION": "1.3"},
    )
    if shape_type == "Unknown" and any(shape and shape.kind == "LineString" for shape in shapes):
        # QGIS shows points and lines as two layers, and gives the style to those it is made for.
        return "LineString"
    return shape_type


def _styles(table: Table, graduated: Sequence[str], kind: str | None) -> list[tuple[str, str, bool]]:
    """Return name, QML and whether it is the default of every style that a layer can have."""
    if kind not in _SYMBOLS:
        return []
    made = [(name, qml(name, table[name].astype(np.float64), kind)) for name in graduated]
    some = [(name, text) for name, text in made if text]
    return [(name, text, name == some[0][0]) for name, text in some]


def _write_styles(database: sqlite3.Connection, styles: Sequence[tuple[str, str, str, bool]]) -> None:
    database.execute(_LAYER_STYLES)
    database.execute(
        "INSERT INTO gpkg_contents (table_name, data_type, identifier, description, last_change, srs_id) "
        "VALUES ('layer_styles', 'attributes', 'layer_styles', '', ?, 0)",
        [_NO_DATE],
    )
    columns = dict(database.execute("SELECT table_name, column_name FROM gpkg_geometry_columns"))
    database.executemany(
        "INSERT INTO layer_styles (f_table_catalog, f_table_schema, f_table_name, f_geometry_column, "
        "styleName, styleQML, styleSLD, useAsDefault, description, owner, ui, update_time) "
        "VALUES ('', '', ?, ?, ?, ?, '', ?, ?, '', NULL, ?)",
        [
            (layer, columns[layer], name, text, default, f"graduated by {name}", _NO_DATE)
            for layer, name, text, default in styles
        ],
    )


def classes(values: NDArray[np.float64]) -> list[tuple[float, float]]:
    """Cut numbers into classes of about as many each: lower and upper bounds, none without numbers."""
    known = values[np.isfinite(values)]
    if len(known) == 0:
        return []
    bounds = np.unique(np.quantile(known, np.linspace(0.0, 1.0, len(COLOURS) + 1), method="nearest"))
    if len(bounds) == 1:
        bounds = np.repeat(bounds, 2)
    return list(zip(bounds[:-1].tolist(), bounds[1:].tolist(), strict=True))


def qml(column: str, values: NDArray[np.float64], kind: str) -> str | None:
    """Write a style (QML of QGIS 3) that colours points or lines by a column, if that has numbers."""
    ranges = classes(values)
    if not ranges:
        return None
    root = ET.Element("qgis", version="3.22.0", styleCategories="Symbology")
    how = {"type": "graduatedSymbol", "attr": column, "graduatedMethod": "GraduatedColor"}
    how |= {"symbollevels": "0", "enableorderby": "0", "forceraster": "0"}
    renderer = ET.SubElement(root, "renderer-v2", how)
    above, symbols = ET.SubElement(renderer, "ranges"), ET.SubElement(renderer, "symbols")
    shades = np.linspace(0, len(COLOURS) - 1, len(ranges)).round().astype(int)
    for place, ((lower, upper), shade) in enumerate(zip(ranges, shades, strict=True)):
        shown = {"symbol": str(place), "label": f"{lower:.4g} – {upper:.4g}", "render": "true"}
        ET.SubElement(above, "range", {"lower": repr(lower), "upper": repr(upper), **shown})
        _symbol(symbols, str(place), COLOURS[shade], kind)
    ET.SubElement(root, "layerGeometryType").text = _GEOMETRY_TYPES[kind]
    # QGIS looks for its document type, and takes nothing else.
    document_type = "<!DOCTYPE qgis PUBLIC 'http://mrcc.com/qgis.dtd' 'SYSTEM'>\n"
    return document_type + ET.tostring(root, encoding="unicode")


def _symbol(parent: ET.Element, name: str, colour: str, kind: str) -> None:
    symbol_type, layer, colour_key, options = _SYMBOLS[kind]
    symbol = ET.SubElement(
        parent, "symbol", name=name, type=symbol_type, alpha="1", clip_to_extent="1", force_rhr="0"
    )
    inner = ET.SubElement(symbol, "layer", {"class": layer, "enabled": "1", "locked": "0", "pass": "0"})
    properties = ET.SubElement(inner, "Option", type="Map")
    for key, value in {**options, colour_key: colour}.items():
        ET.SubElement(properties, "Option", name=key, type="QString", value=value)
