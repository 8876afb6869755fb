"""GeoPackage, written by GDAL."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from pyogrio import raw
from pyogrio.errors import CRSError, DataLayerError, DataSourceError, FeatureError, GeometryError

from formats.errors import CannotWriteError
from formats.output.crs import SITE_FRAME, is_wgs84, unknown_crs
from formats.output.wkt import LAYER, parse

if TYPE_CHECKING:
    from formats.output.table import Table


def write_geopackage(table: Table, destination: str, path: str, crs: str | None, geometry: str) -> None:
    """Write a table as the one layer of a GeoPackage.

    Parameters
    ----------
    table : dict of str to Cells
    destination, path : str
        For messages, and where to write.
    crs : str or None
        None is a site frame: srs_id −1, undefined Cartesian.
    geometry : str
        The column of WKT; without one the layer has no geometry.

    Raises
    ------
    FormatError
        GDAL does not know the reference system.
    CannotWriteError
    """
    fields = {name: cells.values for name, cells in table.items() if name != geometry}
    shapes, wkb, shape_type = [], None, None
    if geometry in table:
        shapes = [parse(text) for text in table[geometry].values]
        wkb = np.array([shape.wkb() if shape else None for shape in shapes], dtype=object)
        kinds = {(shape.kind, len(shape.points[0])) for shape in shapes if shape}
        shape_type = kinds.pop()[0] if len(kinds) == 1 else "Unknown"
    system = SITE_FRAME if crs is None else "EPSG:4326" if is_wgs84(crs) else crs
    # GDAL does not write into a file that is there but empty.
    Path(path).unlink()
    try:
        raw.write(
            path,
            wkb,
            list(fields.values()),
            list(fields),
            layer=LAYER,
            driver="GPKG",
            geometry_type=shape_type,
            crs=system,
            # Read by GDAL 3.6 without a warning, unlike 1.4.
            dataset_options={"VERSION": "1.3"},
        )
    except CRSError as error:
        raise unknown_crs(system) from error
    except (DataSourceError, DataLayerError, FeatureError, GeometryError) as error:
        reason = " ".join(str(error).split())
        raise CannotWriteError(
            destination, f"GDAL could not write it: {reason}", hint="is there space left on the device?"
        ) from error
