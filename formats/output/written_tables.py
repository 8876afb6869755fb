"""Which tables a file holds that `write_table` may have written, told from its content."""

from __future__ import annotations

import re
import sqlite3
from contextlib import closing
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Sequence

#: Enough for the header of any table, and all that is read of a text.
HEAD = 1 << 16
#: What GDAL puts before the columns of a layer, and QGIS beside the layers.
_OF_GEOPACKAGE, _STYLES = ("fid", "geom"), "layer_styles"


def columns(path: str) -> list[Sequence[str]] | None:
    """Return the first columns of each table of a file, none where it is a file of another kind.

    The list is empty where a table without rows shows no columns. OSError where it cannot be read.
    """
    with Path(path).open("rb") as file:
        head = file.read(HEAD)
    if head.startswith(b"PAR1"):
        return _parquet(path)
    if head.startswith(b"SQLite format 3\0"):
        return _geopackage(path)
    text = head.decode("utf-8", "replace")
    if not text.startswith(("[", "{", "\x1e")):
        return [text.partition("\n")[0].split(",")]
    rows = text.partition('"features": [')[2] or text
    if re.fullmatch(r"[\[\]}\s]*", rows):
        return []
    names = re.findall(r'"(\w+)": ', rows.partition('"properties": {')[2] or rows)
    return [names] if names else None


def _parquet(path: str) -> list[Sequence[str]] | None:
    import pyarrow as pa
    from pyarrow import parquet

    try:
        return [parquet.read_schema(path).names]
    except pa.ArrowException:
        return None


def _geopackage(path: str) -> list[Sequence[str]] | None:
    """Return the columns of each layer; None where one is a raster."""
    try:
        # Nothing is made beside it.
        with closing(sqlite3.connect(f"{Path(path).resolve().as_uri()}?immutable=1", uri=True)) as database:
            layers = dict(database.execute("SELECT table_name, data_type FROM gpkg_contents"))
            layers.pop(_STYLES, None)
            if not {"features", "attributes"}.issuperset(layers.values()):
                return None
            named = [database.execute("SELECT name FROM pragma_table_info(?)", [name]) for name in layers]
            return [[name for (name,) in names if name not in _OF_GEOPACKAGE] for names in named]
    except (sqlite3.Error, ValueError):
        return None
