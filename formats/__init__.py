"""Files to named columns in batches, and tables to files; libraries are imported when a kind needs them."""

from formats.errors import CannotWriteError, DamagedError, FormatError, NotFoundError, shown
from formats.output import check_crs, check_free, output_kind, replacing, write_parts, write_table
from formats.source import expand, open_source
from formats.table import BATCH_ROWS, LOG_TIME, STAMP, Batch, Column, Field, Kind, Labels, Source, Stream

__all__ = [
    "BATCH_ROWS",
    "LOG_TIME",
    "STAMP",
    "Batch",
    "CannotWriteError",
    "Column",
    "DamagedError",
    "Field",
    "FormatError",
    "Kind",
    "Labels",
    "NotFoundError",
    "Source",
    "Stream",
    "check_crs",
    "check_free",
    "expand",
    "open_source",
    "output_kind",
    "replacing",
    "shown",
    "write_parts",
    "write_table",
]
