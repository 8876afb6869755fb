"""GeoPackage, written by GDAL, with styles for QGIS. The same tables give the same bytes."""

from __future__ import annotations

import sqlite3
from contextlib import closing, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, cast

import numpy as np
from pyogrio import get_gdal_config_option, raw, set_gdal_config_options
from pyogrio.errors import CRSError, DataLayerError, DataSourceError, FeatureError, GeometryError

from formats.errors import CannotWriteError
from formats.output.qgis_styles import qml
from formats.output.reference_systems import SITE_FRAME, is_wgs84, unknown_crs
from formats.output.wkt import parse

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence
    from typing import Literal

    from formats.output.column_forms import Table

#: Stands where a GeoPackage notes when it was changed: the time of writing would be other bytes each time.
_NO_DATE = "1970-01-01T00:00:00.000Z"
#: As QGIS makes it, and finds it (its provider `ogr`, `saveStyle` and `loadStyle`).
_LAYER_STYLES = """
CREATE TABLE layer_styles (
    id INTEGER PRIMARY KEY AUTOINCREMENT NOT NULL, f_table_catalog TEXT(256), f_table_schema TEXT(256),
    f_table_name TEXT(256), f_geometry_column TEXT(256), styleName TEXT(30), styleQML TEXT, styleSLD TEXT,
    useAsDefault BOOLEAN, description TEXT, owner TEXT(30), ui TEXT(30),
    update_time DATETIME DEFAULT (strftime('%Y-%m-%dT%H:%M:%fZ','now')))
"""


@dataclass(frozen=True)
class Layer:
    """One layer of a GeoPackage."""

    name: str
    table: Table
    #: Columns of numbers that have a style each; QGIS shows the first unless asked for another.
    graduated: Sequence[str] = ()


def write_geopackage(
    layers: Sequence[Layer], destination: str, path: str, crs: str | None, geometry: str
) -> None:
    """Write tables as the layers of a GeoPackage.

    Without a `crs` they are in a site frame (srs_id −1, undefined Cartesian). A layer that lacks the column
    `geometry`, of WKT, has none. `destination` is for messages.
    """
    system = SITE_FRAME if crs is None else "EPSG:4326" if is_wgs84(crs) else crs
    # GDAL does not write into a file that is there but empty.
    Path(path).unlink()
    styles = []
    try:
        with _no_date():
            for layer in layers:
                kind = _write_layer(layer, path, system, geometry)
                styles += [(layer.name, *style) for style in _styles(layer, kind)]
        if styles:
            with closing(sqlite3.connect(path)) as database, database:
                _write_styles(database, styles)
    except CRSError as error:
        raise unknown_crs(system) from error
    except sqlite3.Error as error:
        raise CannotWriteError(destination, str(error), hint="is there space left on the device?") from error
    except (DataSourceError, DataLayerError, FeatureError, GeometryError) as error:
        reason = " ".join(str(error).split())
        raise CannotWriteError(
            destination, f"GDAL could not write it: {reason}", hint="is there space left on the device?"
        ) from error


@contextmanager
def _no_date() -> Iterator[None]:
    """Let GDAL note no date of its own."""
    before = get_gdal_config_option("OGR_CURRENT_DATE")
    set_gdal_config_options({"OGR_CURRENT_DATE": _NO_DATE})
    try:
        yield
    finally:
        set_gdal_config_options({"OGR_CURRENT_DATE": before})


def _write_layer(layer: Layer, path: str, system: str, geometry: str) -> str | None:
    """Write one layer, and return the type of its geometries."""
    fields = {name: cells.values for name, cells in layer.table.items() if name != geometry}
    shapes, wkb, shape_type = [], None, None
    if geometry in layer.table:
        shapes = [parse(text) for text in layer.table[geometry].values]
        wkb = np.array([shape.wkb() if shape else None for shape in shapes], dtype=object)
        kinds = {(shape.kind, len(shape.points[0])) for shape in shapes if shape}
        shape_type = kinds.pop()[0] if len(kinds) == 1 else "Unknown"
    raw.write(
        path,
        wkb,
        list(fields.values()),
        list(fields),
        layer=layer.name,
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


def _styles(layer: Layer, kind: str | None) -> list[tuple[str, str, bool]]:
    """Return name, QML and whether it is the default of every style that a layer can have."""
    if kind not in ("Point", "LineString"):
        return []
    kind = cast("Literal['Point', 'LineString']", kind)
    made = [(name, qml(name, layer.table[name].values.astype(np.float64), kind)) for name in layer.graduated]
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
