"""Points and lines: from text to coordinates and to bytes."""

from __future__ import annotations

import re
import struct
from dataclasses import dataclass
from itertools import chain
from typing import Literal

#: What a GIS shows as the name of the layer.
LAYER = "segments"

_WKT = re.compile(r"\s*(POINT|LINESTRING)\s*(?:Z\s*)?\(([^()]+)\)\s*", re.IGNORECASE)
_EMPTY = re.compile(r"\s*(POINT|LINESTRING)\s*(?:Z\s*)?EMPTY\s*", re.IGNORECASE)


@dataclass(frozen=True, slots=True)
class WktShape:
    """A point or a line."""

    kind: Literal["Point", "LineString"]
    #: (x, y) or (x, y, z) each.
    points: tuple[tuple[float, ...], ...]

    def wkb(self) -> bytes:
        """Return the shape as well-known binary (ISO 19125)."""
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
