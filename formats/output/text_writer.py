"""CSV, plain and packed, JSON, GeoJSON and sequences of GeoJSON. The same table gives the same bytes."""

import bz2
import csv
import gzip
import io
import json
import math
import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack
from pathlib import Path
from typing import Any, BinaryIO, TextIO, cast

from numpy.typing import NDArray

from formats.output.common_forms import (
    LAYER,
    SITE_FRAME,
    WKT,
    Table,
    Values,
    check_crs,
    is_wgs84,
    normalise,
    parse,
    urn,
)
from formats.output.whole_files import replacing
from formats.table import BATCH_ROWS
from formats.text import guarded

#: What stands before each feature: the record separator of RFC 8142, or nothing.
_SEPARATORS = {"geojsonl": "", "geojsons": "\x1e"}
PACKINGS = (".gz", ".bz2", ".zst")  # Endings of packed files


def write_text(table: Table, stream: TextIO, kind: str, crs: str | None, layer: str = LAYER) -> None:
    """Write a table as CSV, JSON or GeoJSON; "geojsonl" and "geojsons" (RFC 8142) have a feature a line."""
    if kind == "csv":
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow(map(guarded, table))
        writer.writerows(_rows(table, _guarded))
    elif kind == "json":
        _write_list(stream, (_strict(dict(zip(table, row, strict=True))) for row in _rows(table)))
        stream.write("\n")
    else:
        # A reader that does not know the name of a reference system takes the Earth's.
        check_crs(crs)
        features = (_feature(dict(zip(table, row, strict=True))) for row in _rows(table))
        system = _system(crs)
        if kind == "geojson":
            stream.write(f'{{"type": "FeatureCollection", "name": {json.dumps(layer)}, ')
            stream.writelines(f'"{name}": {json.dumps(value)}, ' for name, value in system.items())
            stream.write('"features": ')
            _write_list(stream, features)
            stream.write("}\n")
        else:
            # There is nothing around the features that could name the reference system for all of them.
            for feature in features:
                text = json.dumps({**feature, **system}, ensure_ascii=False, allow_nan=False)
                stream.write(f"{_SEPARATORS[kind]}{text}\n")


def _objects(column: NDArray[Any]) -> list[Any]:
    """Return cells as Python objects, None where empty."""
    cells = column.tolist()
    # NaN is what differs from itself.
    return [None if cell != cell else cell for cell in cells] if column.dtype.kind == "f" else cells  # noqa: PLR0124


def _guarded(column: NDArray[Any]) -> list[Any]:
    """Let no text of a column be run by a spreadsheet; numbers are what they are."""
    return list(map(guarded, column)) if column.dtype == object else _objects(column)


def _system(crs: str | None) -> dict[str, Any]:
    """Return the member that names a reference system, which WGS 84 needs none of."""
    if crs is not None and is_wgs84(crs):
        return {}
    return {"crs": {"type": "name", "properties": {"name": SITE_FRAME if crs is None else urn(crs)}}}


def _rows(table: Table, cells: Callable[[NDArray[Any]], list[Any]] = _objects) -> Iterator[tuple[Any, ...]]:
    count = max(map(len, table.values()), default=0)
    for begin in range(0, count, BATCH_ROWS):
        yield from zip(*(cells(column[begin : begin + BATCH_ROWS]) for column in table.values()), strict=True)


def _write_list(stream: TextIO, items: Iterator[dict[str, Any]]) -> None:
    before = "["
    for item in items:
        stream.write(f"{before}\n{json.dumps(item, ensure_ascii=False, allow_nan=False)}")
        before = ","
    stream.write("[]" if before == "[" else "\n]")


def _strict(properties: dict[str, Any]) -> dict[str, Any]:
    """Replace infinities, which JSON cannot hold."""
    return {k: None if isinstance(v, float) and math.isinf(v) else v for k, v in properties.items()}


def _feature(properties: dict[str, Any]) -> dict[str, Any]:
    shape = parse(properties.pop(WKT, None))
    described = None
    if shape is not None:
        points = [list(point) for point in shape.points]
        described = {"type": shape.kind, "coordinates": points[0] if shape.kind == "Point" else points}
    return {"type": "Feature", "properties": _strict(properties), "geometry": described}


def write_packed(columns: Mapping[str, Values], path: str) -> None:
    """Write a table as packed CSV, whole or not at all; how, its ending says, one of `PACKINGS`."""
    table = normalise(columns)
    with replacing(path) as temporary, ExitStack() as stack:
        file = stack.enter_context(Path(temporary).open("wb"))
        packed = stack.enter_context(_packed(file, Path(path).suffix.lower()))
        stream = stack.enter_context(io.TextIOWrapper(packed, encoding="utf-8", newline=""))
        write_text(table, stream, "csv", None)


def _packed(file: BinaryIO, ending: str) -> BinaryIO:
    if ending == ".gz":
        return cast("BinaryIO", gzip.GzipFile(filename="", mode="wb", fileobj=file, mtime=0))
    if ending == ".bz2":
        return cast("BinaryIO", bz2.BZ2File(file, "wb"))
    if sys.version_info >= (3, 14):
        from compression import zstd
    else:
        from backports import zstd
    return cast("BinaryIO", zstd.ZstdFile(file, "w"))
