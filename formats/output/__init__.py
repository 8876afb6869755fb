"""Tables to files: CSV, Parquet, JSON, GeoJSON, sequences of it, and GeoPackage."""

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import TextIO

from formats.errors import CannotWriteError
from formats.output.common_forms import LAYER, Values, check_crs, normalise
from formats.output.text_writer import write_text
from formats.output.whole_files import check_free, explained, opened, replacing

__all__ = ["check_crs", "check_free", "output_kind", "replacing", "write_parts", "write_table"]

_TEXT_KINDS = ("csv", "json", "geojson", "geojsonl", "geojsons")
_KINDS = {f".{kind}": kind for kind in ("csv", "parquet", "json", "geojson", "gpkg", "geojsonl", "geojsons")}


def output_kind(destination: str, *others: str) -> str:
    """Tell from its name how a file is to be written.

    Parameters
    ----------
    destination : str
        "-" is the standard output; that, pipes and devices take CSV.
    others : str
        Further endings that the caller writes, for the message.

    Returns
    -------
    {"csv", "parquet", "json", "geojson", "gpkg", "geojsonl", "geojsons"}

    Raises
    ------
    CannotWriteError
        An ending that is not known.
    """
    path = Path(destination)
    kind = _KINDS.get(path.suffix.lower())
    with explained(destination):
        stream = destination == "-" or opened(destination) is not None
        if kind is None and (stream or path.is_fifo() or path.is_char_device()):
            return "csv"
    if kind is None:
        what = f"the ending {path.suffix!r} is not known"
        raise CannotWriteError(destination, what, hint=f"known are {', '.join([*_KINDS, *others])}")
    return kind


def write_table(
    columns: Mapping[str, Values],
    destination: str | TextIO,
    *,
    kind: str | None = None,
    crs: str | None = None,
    layer: str = LAYER,
    layers: Mapping[str, Mapping[str, Values]] | None = None,
    graduated: Mapping[str, Sequence[str]] | None = None,
) -> None:
    """Write a table, whole or not at all.

    Numbers keep every digit (the shortest text that gives the same float64 back); NaN is an
    empty cell, or null. The column WKT, if there is one, is the geometry (POINT or LINESTRING):
    a GeoPackage and GeoJSON hold that in place of the column, Parquet beside it.

    Parameters
    ----------
    columns : mapping of str to sequence
        Of one length: arrays of numbers, `Labels`, or sequences of str or of numbers, None where empty.
    destination : str or text stream
        A path, or "-" for the standard output.
    kind : {"csv", "parquet", "json", "geojson", "gpkg", "geojsonl", "geojsons"}, optional
        By the ending of the path, or CSV to a stream, if not given.
    crs : str, optional
        Reference system of the geometry as GDAL takes it, such as "EPSG:4326" or
        "IAU_2015:49900", x before y and longitude before latitude; a site frame in metres if
        not given.
    layer : str
        What a GIS shows as the name of the table.
    layers : mapping of str to mapping, optional
        Further tables by the names of their layers, which only a GeoPackage has.
    graduated : mapping of str to sequence of str, optional
        Layer → columns by which QGIS can colour it.

    Raises
    ------
    CannotWriteError
        No space, no permission, no such folder, an unknown ending, a kind that no stream takes.
    FormatError
        GDAL does not know the reference system.
    BrokenPipeError
        Whoever read the standard output has gone.
    """
    table = normalise(columns)
    if destination == "-":
        import sys

        destination = sys.stdout
    if not isinstance(destination, str):
        kind = kind or "csv"
        if kind not in _TEXT_KINDS:
            raise CannotWriteError("standard output", f"{kind} needs a file", hint="give -o FILE")
        with explained("standard output"):
            write_text(table, destination, kind, crs, layer)
            destination.flush()
        return
    kind = kind or output_kind(destination)
    with replacing(destination) as temporary:
        if kind in _TEXT_KINDS:
            with Path(temporary).open("w", encoding="utf-8", newline="") as stream:
                write_text(table, stream, kind, crs, layer)
        elif kind == "parquet":
            from formats.output.parquet_writer import write_parquet

            write_parquet([table], temporary, crs)
        else:
            from formats.output.geopackage import write_geopackage

            tables = {layer: table, **{name: normalise(more) for name, more in (layers or {}).items()}}
            write_geopackage(tables, graduated or {}, destination, temporary, crs)


def write_parts(parts: Iterable[Mapping[str, Values]], destination: str, *, crs: str | None = None) -> None:
    """Write a table as Parquet, whole or not at all, of which only a part is held at a time.

    Parameters
    ----------
    parts : iterable of mapping
        At least one; as `write_table` takes them, with the same columns.
    destination : str
        A path.
    crs : str, optional
        As for `write_table`.

    Raises
    ------
    CannotWriteError, FormatError
        As from `write_table`.
    """
    from formats.output.parquet_writer import write_parquet

    with replacing(destination) as temporary:
        write_parquet(map(normalise, parts), temporary, crs)
