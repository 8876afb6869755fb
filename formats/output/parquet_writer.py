"""Parquet, and GeoParquet where there is a geometry."""

import json
import math
from collections.abc import Iterable
from contextlib import ExitStack
from dataclasses import dataclass, field
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq

from formats.output.common_forms import WKT, Table, WktShape, parse, projjson

_TYPES = {"f": pa.float64(), "i": pa.int64(), "O": pa.string()}  # By the kind of their array
GEOMETRY = "geometry"  # Of the binary geometry, which stands beside the text


def write_parquet(tables: Iterable[Table], path: str, crs: str | None) -> None:
    """Write the parts of a table, of which one is held at a time, as Parquet; empty cells are null."""
    # WKT gets a column of WKB beside it, as GeoParquet 1.1 has it: who does not know that still has the text.
    extent = Extent()
    with ExitStack() as stack:
        writer = None
        for table in tables:
            part = _arrow(table, extent)
            if writer is None:
                # With Arrow's own schema beside it, pyarrow would not look for keys that come last.
                writer = stack.enter_context(pq.ParquetWriter(path, part.schema, store_schema=False))
            writer.write_table(part)
        if writer is not None and GEOMETRY in part.schema.names:
            writer.add_key_value_metadata({"geo": json.dumps(geo_metadata(extent, crs))})


@dataclass
class Extent:
    """What kinds of shapes there are, and the box around them."""

    kinds: set[str] = field(default_factory=set)
    #: The least and the largest x and y.
    low: tuple[float, float] = math.inf, math.inf
    high: tuple[float, float] = -math.inf, -math.inf

    def take(self, shape: WktShape) -> bytes:
        """Take in a shape, and return its bytes."""
        self.kinds.add(f"{shape.kind}{' Z' if len(shape.points[0]) == 3 else ''}")
        x, y, *_ = zip(*shape.points, strict=True)
        self.low = min(self.low[0], *x), min(self.low[1], *y)
        self.high = max(self.high[0], *x), max(self.high[1], *y)
        return shape.wkb()


def _arrow(table: Table, extent: Extent) -> pa.Table:
    arrays = {
        # As of pandas: NaN is null.
        name: pa.array(column, _TYPES[column.dtype.kind], from_pandas=True)
        for name, column in table.items()
    }
    if WKT in table:
        shapes = map(parse, table[WKT])
        arrays[GEOMETRY] = pa.array([extent.take(shape) if shape else None for shape in shapes], pa.binary())
    return pa.table(arrays)


def geo_metadata(extent: Extent, crs: str | None) -> dict[str, Any]:
    """Describe a column of geometries in the key ``geo``: https://geoparquet.org/releases/v1.1.0/."""
    column: dict[str, Any] = {
        "encoding": "WKB",
        "geometry_types": sorted(extent.kinds),
        # Left out it would mean longitudes and latitudes on the Earth.
        "crs": None if crs is None else projjson(crs),
    }
    if extent.kinds:
        column["bbox"] = [*extent.low, *extent.high]
    return {"version": "1.1.0", "primary_column": GEOMETRY, "columns": {GEOMETRY: column}}
