"""Reference systems, by the names GDAL knows them by."""

from __future__ import annotations

import io
import re
from typing import Any

import numpy as np

from formats.errors import FormatError

#: Metres in a frame of their own: GDAL reads it from GeoJSON, and writes srs_id −1 for it in a GeoPackage.
SITE_FRAME = 'LOCAL_CS["Undefined Cartesian SRS",UNIT["metre",1]]'


def is_wgs84(crs: str) -> bool:
    """Tell whether GeoJSON means this system when it names none."""
    return crs.upper() in {"EPSG:4326", "OGC:CRS84", "CRS84", "WGS84"}


def urn(crs: str) -> str:
    """Return the name by which GeoJSON refers to a system. Definitions (WKT, PROJ) stand for themselves."""
    code = re.fullmatch(r"([A-Za-z]+)(?:_(\d+))?:(\w+)", crs)
    return f"urn:ogc:def:crs:{code[1].upper()}:{code[2] or ''}:{code[3]}" if code else crs


def projjson(crs: str) -> dict[str, Any]:
    """Describe a reference system as PROJJSON, in which GeoParquet states it.

    WGS 84, by any of its names, is OGC:CRS84: longitude before latitude, as the coordinates are.
    """
    from pyproj import CRS
    from pyproj.exceptions import CRSError

    try:
        return CRS.from_user_input("OGC:CRS84" if is_wgs84(crs) else crs).to_json_dict()
    except CRSError:
        raise unknown_crs(crs) from None


def check_crs(crs: str | None) -> None:
    """Ask GDAL whether it knows a reference system.

    Parameters
    ----------
    crs : str or None
        None is a site frame.

    Raises
    ------
    FormatError
    """
    if crs is None or is_wgs84(crs):
        return
    from pyogrio import raw
    from pyogrio.errors import CRSError

    try:
        raw.write(
            io.BytesIO(),
            np.empty(0, dtype=object),
            [np.empty(0)],
            ["x"],
            driver="GeoJSON",
            geometry_type="Point",
            crs=crs,
        )
    except CRSError as error:
        raise unknown_crs(crs) from error


def unknown_crs(crs: str) -> FormatError:
    """Say that GDAL does not know a reference system."""
    hint = "for instance EPSG:4326 (Earth), IAU_2015:49900 (Mars), IAU_2015:30100 (Moon)"
    return FormatError(crs, "GDAL knows no such reference system", hint=hint)
