"""Opens an input by what it holds."""

from __future__ import annotations

import io
import os
import re
import stat
import sys
import tempfile
import weakref
from contextlib import ExitStack
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from formats.content import COMPRESSED, FILE_KINDS, HEAD_BYTES, content, failure, first_bytes
from formats.copies import kept, no_file, piped, readable
from formats.errors import FormatError, NotFoundError, shown
from formats.input_paths import parquet_parts, promised_kind
from formats.limits import METADATA_BYTES
from formats.table import STANDARD_INPUT

if TYPE_CHECKING:
    from collections.abc import Iterator

    from formats.table import Source

_BLOCK = 1 << 20


def open_source(path: str, *, salvage: bool = False) -> Source:
    """Open one input by what it holds, whatever its name ends with.

    Parameters
    ----------
    path : str
        A file, a rosbag2 folder, a folder of Parquet, or "-" for CSV or Parquet on the
        standard input.
    salvage : bool
        Read what is left of a damaged one, and tell in `Source.recovery` what that is.

    Returns
    -------
    Source

    Raises
    ------
    NotFoundError
        No such file, or no permission to read it.
    DamagedError
        It is damaged; with salvage, so much that nothing can be read.
    FormatError
        Empty, of a kind that is not read, or not what it promises.
    """
    if shown(path) != path:
        return _open_linked(path, salvage=salvage)
    if path == "-":
        return _open_copy(path, _standard_input(), salvage=salvage)
    try:
        mode = readable(path).st_mode
        if stat.S_ISDIR(mode):
            return _open_folder(path, salvage=salvage)
        if stat.S_ISFIFO(mode):
            # Such as the shell's <(…).
            return _open_copy(path, piped(path), salvage=salvage)
    except OSError as error:
        raise failure(path, error) from error
    return _open_file(path, path, salvage=salvage)


def _open_file(path: str, file: str, *, salvage: bool) -> Source:
    label = STANDARD_INPUT if path == "-" else path
    kind = content(label, first_bytes(label, file))
    source: Source
    if kind == "parquet":
        from formats.parquet_source import ParquetSource

        source = ParquetSource(path, [file], salvage=salvage)
    elif kind == "csv" or kind in COMPRESSED:
        from formats.text.delimited import DelimitedSource

        source = DelimitedSource(path, file, salvage=salvage)
    else:
        from formats.rosbag import BagSource

        source = BagSource(path, kind, salvage=salvage)
    if promised_kind(path) not in (None, source.kind):
        source.remarks.append(f"holds {FILE_KINDS[source.kind].found}, whatever its name says")
    return source


def _standard_input() -> Iterator[bytes]:
    """Read the standard input, which may be a device only where a person types or nothing is there."""
    if sys.stdin is None:
        raise NotFoundError(STANDARD_INPUT, "is closed")
    stream = sys.stdin.buffer
    try:
        status = os.fstat(stream.fileno())
        device = stat.S_ISCHR(status.st_mode) or stat.S_ISBLK(status.st_mode)
        if device and not stream.isatty() and status.st_rdev != os.stat(os.devnull).st_rdev:  # noqa: PTH116
            raise no_file(STANDARD_INPUT, status.st_mode)
    except io.UnsupportedOperation:
        # Not one of the system's.
        pass
    yield from iter(partial(stream.read, _BLOCK), b"")


def _open_copy(path: str, blocks: Iterator[bytes], *, salvage: bool) -> Source:
    """Open what can be read only once, from a copy that is gone with the source."""
    label = STANDARD_INPUT if path == "-" else path
    try:
        file, copy = kept(label, _of_tables(label, blocks))
    except OSError as error:
        raise failure(label, error) from error
    try:
        source = _open_file(path, copy, salvage=salvage)
    except BaseException:
        file.close()
        raise
    weakref.finalize(source, file.close)
    return source


def _of_tables(label: str, blocks: Iterator[bytes]) -> Iterator[bytes]:
    """Pass on what a pipe can hold, and refuse all else before it is copied."""
    head = b""
    for block in blocks:
        head += block
        if len(head) >= HEAD_BYTES:
            break
    kind = content(label, head[:HEAD_BYTES])
    if kind not in COMPRESSED and not FILE_KINDS[kind].piped:
        raise FormatError(label, "a bag cannot be read from a pipe", hint="give the path of its file")
    yield head
    yield from blocks


def _open_linked(path: str, *, salvage: bool) -> Source:
    """Open what has no text for a name, which libraries take names for, through a link."""
    with ExitStack() as stack:
        folder = stack.enter_context(tempfile.TemporaryDirectory(prefix="terrain-est-"))
        # The ending says what the file is, which a name such as /proc/self/fd/3 has not. SIGKILL, which
        # nobody can answer, leaves the link behind, and never the file.
        link = Path(folder, f"input{shown(Path(path).suffix)}")
        link.symlink_to(Path(path).absolute())
        try:
            source = open_source(str(link), salvage=salvage)
        except FormatError as error:
            if error.path != str(link):
                raise
            raise type(error)(path, error.message, hint=error.hint) from error
        source.path = shown(path)
        weakref.finalize(source, stack.pop_all().close)
    return source


def _open_folder(path: str, *, salvage: bool) -> Source:
    metadata = Path(path) / "metadata.yaml"
    if metadata.is_file():
        from formats.rosbag import BagSource

        with metadata.open(encoding="utf-8", errors="replace") as file:
            text = file.read(METADATA_BYTES)
        storage = re.search(r"storage_identifier:\s*[\"']?(\w+)", text)
        kind = "mcap" if storage and storage[1] == "mcap" else "db3"
        if storage is None and any(Path(path).glob("*.mcap")):
            kind = "mcap"
        return BagSource(path, kind, salvage=salvage)
    parts = parquet_parts(Path(path))
    if not parts:
        raise FormatError(path, "is a folder, but neither a rosbag2 log nor one of Parquet files alone")
    for part in parts:
        if not Path(part).is_file():
            raise FormatError(part, "is no file, and a folder of Parquet holds nothing else")
    from formats.parquet_source import ParquetSource

    return ParquetSource(path, parts, salvage=salvage)
