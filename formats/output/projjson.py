"""Reference systems as PROJJSON, in which GeoParquet states them.

Three are built in, as PROJ writes them; every other takes pyproj, the extra `gis`.
"""

from __future__ import annotations

from typing import Any

from formats.errors import FormatError
from formats.output.reference_systems import is_wgs84, unknown_crs

_SCHEMA = "https://proj.org/schemas/v0.7/projjson.schema.json"
#: The realisations of WGS 84, by their EPSG codes: without them the ensemble is another datum.
_WGS84_MEMBERS = {
    "Transit": 1166,
    "G730": 1152,
    "G873": 1153,
    "G1150": 1154,
    "G1674": 1155,
    "G1762": 1156,
    "G2139": 1309,
    "G2296": 1383,
}
#: Spheres of the IAU's working group of 2015 (doi 10.1007/s10569-017-9805-5): name, radius in m, anchor.
_SPHERES = {
    "IAU_2015:49900": ("Mars (2015) - Sphere", 3_396_190, "Viking 1 lander: 47.95137 W"),
    "IAU_2015:30100": ("Moon (2015) - Sphere", 1_737_400, None),
}


def projjson(crs: str) -> dict[str, Any]:
    """Describe a reference system as PROJJSON.

    Parameters
    ----------
    crs : str
        As GDAL takes it. WGS 84, by any of its names, is OGC:CRS84: longitude before latitude,
        as the coordinates are.

    Raises
    ------
    FormatError
        PROJ does not know the system, or pyproj is needed and not installed.
    """
    if is_wgs84(crs):
        return _wgs84()
    if crs.upper() in _SPHERES:
        return _sphere(crs.upper())
    try:
        from pyproj import CRS
        from pyproj.exceptions import CRSError
    except ImportError:
        raise FormatError(
            crs,
            "GeoParquet describes a reference system in full, for which this one takes pyproj",
            hint=f"pip install 'terrain-est[gis]', or write .gpkg; {', '.join(_SPHERES)} need nothing",
        ) from None
    try:
        return CRS.from_user_input(crs).to_json_dict()
    except CRSError:
        raise unknown_crs(crs) from None


def _wgs84() -> dict[str, Any]:
    members = [
        {"name": f"World Geodetic System 1984 ({name})", "id": {"authority": "EPSG", "code": code}}
        for name, code in _WGS84_MEMBERS.items()
    ]
    return {
        "$schema": _SCHEMA,
        "type": "GeographicCRS",
        "name": "WGS 84 (CRS84)",
        "datum_ensemble": {
            "name": "World Geodetic System 1984 ensemble",
            "members": members,
            "ellipsoid": {
                "name": "WGS 84",
                "semi_major_axis": 6378137,
                "inverse_flattening": 298.257223563,
            },
            "accuracy": "2.0",
            "id": {"authority": "EPSG", "code": 6326},
        },
        "coordinate_system": {"subtype": "ellipsoidal", "axis": [_LONGITUDE, _LATITUDE]},
        "id": {"authority": "OGC", "code": "CRS84"},
    }


def _sphere(crs: str) -> dict[str, Any]:
    name, radius, anchor = _SPHERES[crs]
    return {
        "$schema": _SCHEMA,
        "type": "GeographicCRS",
        "name": f"{name} / Ocentric",
        "datum": {
            "type": "GeodeticReferenceFrame",
            "name": name,
            **({"anchor": anchor} if anchor else {}),
            "ellipsoid": {"name": name, "radius": radius},
            "prime_meridian": {"name": "Reference Meridian", "longitude": 0},
        },
        "coordinate_system": {"subtype": "ellipsoidal", "axis": [_LATITUDE, _LONGITUDE]},
        "id": {"authority": "IAU", "code": int(crs.rpartition(":")[2]), "version": 2015},
    }


_LATITUDE = {
    "name": "Geodetic latitude",
    "abbreviation": "Lat",
    "direction": "north",
    "unit": "degree",
}
_LONGITUDE = {
    "name": "Geodetic longitude",
    "abbreviation": "Lon",
    "direction": "east",
    "unit": "degree",
}
