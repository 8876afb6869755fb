"""Files written whole or not at all; and how a table that was written before is known again."""

import errno
import os
import re
import shutil
import sqlite3
import stat
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import closing, contextmanager
from pathlib import Path

from formats.errors import CannotWriteError, shown

#: As many as Linux follows.
_MOST_LINKS = 40
_REASONS = {
    errno.ENOSPC: "no space left on the device",
    errno.EDQUOT: "the disk quota is used up",
    errno.EFBIG: "larger than a file may be here",
    errno.EACCES: "no permission to write it",
    errno.EPERM: "no permission to write it",
    errno.EROFS: "the file system is read-only",
    errno.ENOENT: "no such folder",
    errno.ENOTDIR: "no such folder",
    errno.EBADF: "is closed",
}
HEAD = 1 << 16  # Enough for the header of any table, and all that is read of a text
#: What GDAL puts before the columns of a layer, and QGIS beside the layers.
_OF_GEOPACKAGE, _STYLES = ("fid", "geom"), "layer_styles"


@contextmanager
def replacing(path: str) -> Iterator[str]:
    """Write a file beside its place, and put it there when it is complete.

    If anything fails, the old file is as it was and nothing new remains.

    Parameters
    ----------
    path : str
        The place. A link is followed. A pipe or a device, and what is open already, such as /dev/stdout or
        the shell's >(…), gets the file once it is complete, and stays what it is.

    Yields
    ------
    str
        The path to write to; it ends as `path` does.

    Raises
    ------
    CannotWriteError
        No space, no permission, no such folder.
    """
    with explained(path):
        target = Path(path).resolve() if Path(path).is_symlink() else Path(path)
        descriptor = opened(path)
        mode = target.stat().st_mode if descriptor is None and target.exists() else None
        if mode is not None and (stat.S_ISDIR(mode) or stat.S_ISBLK(mode)):
            raise CannotWriteError(path, "is a folder" if stat.S_ISDIR(mode) else "is a disk")
        if descriptor is not None or (mode is not None and not stat.S_ISREG(mode)):
            # Some kinds of files are not written from front to back, or are removed and made anew.
            with tempfile.NamedTemporaryFile(prefix="terrain-est-", suffix=Path(path).suffix) as file:
                yield file.name
                _pass_on(file.name, path if descriptor is None else descriptor)
            return
        effective = os.access in os.supports_effective_ids
        if mode is not None and not os.access(target, os.W_OK, effective_ids=effective):
            raise CannotWriteError(path, "is write-protected")
        temporary = target.with_name(f".{shown(target.stem)[:100]}-{os.urandom(4).hex()}{target.suffix}")
        try:
            temporary.touch(exist_ok=False)
            yield str(temporary)
            if mode is not None:
                temporary.chmod(stat.S_IMODE(mode))
            with temporary.open("rb") as written:
                # Some file systems find only now that they are full.
                os.fsync(written.fileno())
            temporary.replace(target)
        finally:
            # SQLite may leave a journal beside its file.
            for rest in (temporary, temporary.with_name(f"{temporary.name}-journal")):
                rest.unlink(missing_ok=True)


def opened(path: str) -> int | None:
    """Return the descriptor of this process that a path leads to, as /dev/stdout and /dev/fd/63 do."""
    try:
        place = os.path.abspath(path)  # noqa: PTH100 - resolve would follow the last link too
    except FileNotFoundError:  # the working folder is gone
        return None
    for _ in range(_MOST_LINKS):
        folder, name = os.path.split(place)
        folder = os.path.realpath(folder)
        if folder in {"/dev/fd", f"/proc/{os.getpid()}/fd"} and name.isdecimal():
            return int(name)
        place = os.path.join(folder, name)  # noqa: PTH118
        if not os.path.islink(place):  # noqa: PTH114
            return None
        place = os.path.join(folder, os.readlink(place))  # noqa: PTH115, PTH118
    return None


def _pass_on(path: str, stream: int | str) -> None:
    """Write a file to a pipe or device, or where an open one stands: opened anew that would begin anew."""
    with open(path, "rb") as file, open(stream, "wb", closefd=isinstance(stream, str)) as target:  # noqa: PTH123
        shutil.copyfileobj(file, target)


def check_free(path: str, *, replace: bool = False, folder: bool = False) -> None:
    """Check before the work that a file can be written, and that none is lost by it.

    Parameters
    ----------
    replace : bool
        A file may be there.
    folder : bool
        Files will be written into it; it is made where it is not there.

    Raises
    ------
    CannotWriteError
        It is there already, it is a folder, or nothing can be written into its folder.
    """
    place = Path(path)
    if is_stream(path):
        return
    with explained(path):
        if folder:
            there = next(above for above in (place, *place.absolute().parents) if above.exists())
            with tempfile.TemporaryFile(dir=there):
                return
        if path.endswith("/") and place.exists():
            hint = "remove it, or name another: no folder is replaced"
            raise CannotWriteError(path, "is there already", hint=hint)
        if place.is_dir():
            raise CannotWriteError(path, "is a folder")
        if place.is_file() and not replace:
            raise CannotWriteError(path, "is there already", hint="--force replaces it")
        if place.is_file() or not place.exists():
            # Only the system knows whether a file may be made there.
            with tempfile.TemporaryFile(dir=place.parent):
                pass


def is_stream(path: str) -> bool:
    """Tell whether a path names what this process has open, such as /dev/stdout: it is written as it is."""
    return path == "-" or opened(path) is not None


@contextmanager
def explained(path: str) -> Iterator[None]:
    """Make what the system says of a failed write a `CannotWriteError`; a reader that went is no failure."""
    try:
        yield
    except BrokenPipeError:
        raise
    except OSError as error:
        what = _REASONS.get(error.errno or 0, error.strerror or str(error))
        hint = "make it first, or name another" if error.errno == errno.ENOENT else ""
        raise CannotWriteError(path, what, hint=hint) from error
    except UnicodeEncodeError as error:
        if shown(path) == path:
            raise
        raise CannotWriteError(path, "a file of this kind needs a path that is text (UTF-8)") from error


def first_columns(path: str) -> list[Sequence[str]] | None:
    """Return the first columns of each table of a file; empty without rows, None for another kind of file."""
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
