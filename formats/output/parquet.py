"""Parquet, and GeoParquet where there is a geometry."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from formats.output.projjson import projjson
from formats.output.wkt import parse

if TYPE_CHECKING:
    from formats.output.table import Table
    from formats.output.wkt import Shape

_TYPES = {"real": pa.float64(), "integer": pa.int64(), "text": pa.string()}
#: Of the binary geometry, which stands beside the text.
GEOMETRY = "geometry"


def write_parquet(table: Table, path: str, crs: str | None, geometry: str) -> None:
    """Write a table as Parquet; empty cells are null.

    A table with a column of WKT becomes GeoParquet 1.1: it gains the column `GEOMETRY` of WKB,
    and the key ``geo`` says what that is. A reader that does not know GeoParquet still has the text.

    Parameters
    ----------
    table : dict of str to Cells
    path : str
    crs : str or None
        None is a site frame, for which GeoParquet has ``null``.
    geometry : str
        The column of WKT, if there is one.

    Raises
    ------
    FormatError
        The reference system is not known, or not without pyproj.
    """
    arrays = {
        name: pa.array(
            cells.values, _TYPES[cells.kind], mask=np.isnan(cells.values) if cells.kind == "real" else None
        )
        for name, cells in table.items()
    }
    metadata = {}
    if geometry in table:
        shapes = [parse(text) for text in table[geometry].values]
        arrays[GEOMETRY] = pa.array([shape.wkb() if shape else None for shape in shapes], pa.binary())
        metadata["geo"] = json.dumps(geo_metadata([shape for shape in shapes if shape], crs))
    pq.write_table(pa.table(arrays, metadata=metadata), path)


def geo_metadata(shapes: list[Shape], crs: str | None) -> dict[str, Any]:
    """Describe a column of geometries, as GeoParquet 1.1 has it in the key ``geo``.

    See https://geoparquet.org/releases/v1.1.0/.

    Parameters
    ----------
    shapes : list of Shape
    crs : str or None

    Returns
    -------
    dict
    """
    kinds = {f"{shape.kind}{' Z' if len(shape.points[0]) == 3 else ''}" for shape in shapes}
    column: dict[str, Any] = {
        "encoding": "WKB",
        "geometry_types": sorted(kinds),
        # Left out it would mean longitudes and latitudes on the Earth.
        "crs": None if crs is None else projjson(crs),
    }
    if shapes:
        corners = np.array([point[:2] for shape in shapes for point in shape.points])
        column["bbox"] = [*corners.min(axis=0).tolist(), *corners.max(axis=0).tolist()]
    return {"version": "1.1.0", "primary_column": GEOMETRY, "columns": {GEOMETRY: column}}
