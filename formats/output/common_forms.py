"""The forms that all writers share: of columns, of points and lines, and of reference systems."""

import io
import math
import re
import struct
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import chain
from typing import Any, Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

from formats.errors import FormatError
from formats.table import Labels

Values: TypeAlias = "NDArray[Any] | Labels | Sequence[str | None] | Sequence[float | None]"
LAYER = "segments"  # What a GIS shows as the name of the layer
WKT = "WKT"  # The column that holds the geometry
_WKT = re.compile(r"\s*(POINT|LINESTRING)\s*(?:Z\s*)?\(([^()]+)\)\s*", re.IGNORECASE)
_EMPTY = re.compile(r"\s*(POINT|LINESTRING)\s*(?:Z\s*)?EMPTY\s*", re.IGNORECASE)
#: Metres in a frame of their own: GDAL reads it from GeoJSON, and writes srs_id −1 for it in a GeoPackage.
SITE_FRAME = 'LOCAL_CS["Undefined Cartesian SRS",UNIT["metre",1]]'


#: Columns of one length: float64 (NaN where empty), int64, or objects (str, None where empty).
Table: TypeAlias = "dict[str, NDArray[Any]]"


def normalise(columns: Mapping[str, Values]) -> Table:
    """Bring columns into one form."""
    table = {name: _column(name, values) for name, values in columns.items()}
    if len(set(map(len, table.values()))) > 1:
        lengths = ", ".join(f"{name} {len(column)}" for name, column in table.items())
        raise ValueError(f"columns of different length: {lengths}")
    return table


def _column(name: str, values: Values) -> NDArray[Any]:
    if isinstance(values, Labels):
        return np.array([*values.names, None], dtype=object)[values.codes]
    if not isinstance(values, np.ndarray):
        objects = np.empty(len(values), dtype=object)
        objects[:] = values
        if all(cell is None or isinstance(cell, str) for cell in objects):
            return objects
        values = np.asarray([math.nan if cell is None else cell for cell in objects])
    if values.dtype.kind == "f":
        return values.astype(np.float64, copy=False)
    if values.dtype.kind in "iub":
        return values.astype(np.int64, copy=False)
    raise TypeError(f"{name}: {values.dtype} is neither numbers nor text")


@dataclass(frozen=True, slots=True)
class WktShape:
    """A point or a line."""

    kind: Literal["Point", "LineString"]
    points: tuple[tuple[float, ...], ...]  # (x, y) or (x, y, z) each

    def wkb(self) -> bytes:
        size = len(self.points[0])
        code = (1 if self.kind == "Point" else 2) + 1000 * (size - 2)
        count = b"" if self.kind == "Point" else struct.pack("<I", len(self.points))
        numbers = chain.from_iterable(self.points)
        return struct.pack("<BI", 1, code) + count + struct.pack(f"<{size * len(self.points)}d", *numbers)


def parse(text: str | None) -> WktShape | None:
    """Read well-known text; None for nothing and for an empty geometry."""
    if not text or _EMPTY.fullmatch(text):
        return None
    match = _WKT.fullmatch(text)
    if match is None:
        raise ValueError(f"neither POINT nor LINESTRING: {text[:60]!r}")
    points = tuple(tuple(map(float, point.split())) for point in match[2].split(","))
    if len({len(point) for point in points}) != 1 or len(points[0]) not in (2, 3):
        raise ValueError(f"points without two or three coordinates: {text[:60]!r}")
    return WktShape("Point" if match[1].upper() == "POINT" else "LineString", points)


def is_wgs84(crs: str) -> bool:
    """Tell whether GeoJSON means this system when it names none."""
    return crs.upper() in {"EPSG:4326", "OGC:CRS84", "CRS84", "WGS84"}


def urn(crs: str) -> str:
    """Return the name by which GeoJSON refers to a system. Definitions (WKT, PROJ) stand for themselves."""
    code = re.fullmatch(r"([A-Za-z]+)(?:_(\d+))?:(\w+)", crs)
    return f"urn:ogc:def:crs:{code[1].upper()}:{code[2] or ''}:{code[3]}" if code else crs


def projjson(crs: str) -> dict[str, Any]:
    """Describe a reference system as PROJJSON, in which GeoParquet states it."""
    # WGS 84, by any of its names, is OGC:CRS84: longitude before latitude, as the coordinates are.
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
        empty, nothing = np.empty(0, dtype=object), [np.empty(0)]
        raw.write(io.BytesIO(), empty, nothing, ["x"], driver="GeoJSON", geometry_type="Point", crs=crs)
    except CRSError as error:
        raise unknown_crs(crs) from error


def unknown_crs(crs: str) -> FormatError:
    """Say that GDAL does not know a reference system."""
    hint = "for instance EPSG:4326 (Earth), IAU_2015:49900 (Mars), IAU_2015:30100 (Moon)"
    return FormatError(crs, "GDAL knows no such reference system", hint=hint)
