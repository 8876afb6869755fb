"""Packed CSV. The same table gives the same bytes: no packing notes the time."""

from __future__ import annotations

import bz2
import gzip
import io
import sys
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, BinaryIO, cast

if sys.version_info >= (3, 14):
    from compression import zstd
else:
    from backports import zstd

from formats.output.column_forms import normalise
from formats.output.text_writer import write_text
from formats.output.whole_files import replacing

if TYPE_CHECKING:
    from collections.abc import Mapping

    from formats.output.column_forms import Values

#: Endings of packed files.
PACKINGS = (".gz", ".bz2", ".zst")


def write_packed(columns: Mapping[str, Values], path: str) -> None:
    """Write a table as packed CSV, whole or not at all; how, its ending says, one of `PACKINGS`."""
    table = normalise(columns)
    with replacing(path) as temporary, ExitStack() as stack:
        file = stack.enter_context(Path(temporary).open("wb"))
        packed = stack.enter_context(_packed(file, Path(path).suffix.lower()))
        stream = stack.enter_context(io.TextIOWrapper(packed, encoding="utf-8", newline=""))
        write_text(table, stream, "csv", None, "")


def _packed(file: BinaryIO, ending: str) -> BinaryIO:
    if ending == ".gz":
        return cast("BinaryIO", gzip.GzipFile(filename="", mode="wb", fileobj=file, mtime=0))
    if ending == ".bz2":
        return cast("BinaryIO", bz2.BZ2File(file, "wb"))
    return cast("BinaryIO", zstd.ZstdFile(file, "w"))
