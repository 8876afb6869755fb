"""From the names that a user gives to the inputs they stand for, each opened by what it holds."""

import glob
import io
import os
import re
import stat
import sys
import tempfile
import weakref
from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from fnmatch import fnmatch
from functools import partial
from pathlib import Path

from formats.byte_sources import kept, no_file, piped, readable
from formats.content import COMPRESSED, FILE_KINDS, HEAD_BYTES, SIDE_FILES, content, failure, first_bytes
from formats.errors import FormatError, NotFoundError, shown
from formats.limits import METADATA_BYTES
from formats.table import STANDARD_INPUT, Source

#: What the ending of a file's name promises.
_ENDINGS = {ending: kind for kind, known in FILE_KINDS.items() for ending in known.endings}
_PACKINGS = (".gz", ".zst", ".bz2")
_NO_DATA = (".", "_")  # Hidden files and _SUCCESS, _metadata and the like
#: Folders of partitions within each other.
_DEEPEST = 20
_BLOCK = 1 << 20


def expand(inputs: Sequence[str]) -> list[str]:
    """List the logs that files, folders and patterns stand for.

    A rosbag2 folder is one log, and so is a folder that holds nothing but Parquet (parts or
    partitions). Any other folder stands for the logs directly inside it.

    Parameters
    ----------
    inputs : sequence of str
        "-" is the standard input; ``*``, ``?``, ``[…]`` and ``**`` make a pattern unless a
        file has that very name.

    Returns
    -------
    list of str
        In the order given, folders and patterns in natural order, nothing twice.

    Raises
    ------
    NotFoundError
    """
    found: dict[str, None] = {}
    for name in inputs:
        try:
            matches = _matches(name)
            if not matches:
                raise NotFoundError(name, "matches no file")
            for match in matches:
                found.update(dict.fromkeys(_logs_of(match)))
        except OSError as error:
            raise failure(name, error) from error
    return list(found)


def parts(log: str) -> list[str]:
    """List the files of a log: of a folder all but settings (.toml), of a database also what SQLite adds."""
    folder = Path(log)
    if log == "-":
        return [log]
    if not folder.is_dir():
        return [log, *(f"{log}{ending}" for ending in SIDE_FILES if os.path.isfile(f"{log}{ending}"))]  # noqa: PTH113
    inside = (entry for entry in folder.iterdir() if entry.is_file() and entry.suffix != ".toml")
    return parquet_parts(folder) or [str(entry) for entry in inside]


def takes(name: str, path: str) -> bool:
    """Tell whether a folder of logs, or a pattern, stands for a file too once that is there."""
    file = Path(path)
    matches = _matches(name)
    for match in matches:
        if _is_folder(match, file.parent) and not _is_log_folder(match):
            return promised_kind(path) is not None and not file.name.startswith(_NO_DATA)
    pattern = matches != [name] and fnmatch(file.name, Path(name).name)
    return pattern and any(_is_folder(Path(match).parent, file.parent) for match in matches)


def promised_kind(path: str) -> str | None:
    """Tell what the name of a file promises: one of `content.FILE_KINDS`, or nothing."""
    name = Path(path)
    packed = name.suffix.lower() in _PACKINGS
    kind = _ENDINGS.get(Path(name.stem).suffix.lower() if packed else name.suffix.lower())
    return None if packed and kind != "csv" else kind


def parquet_parts(folder: Path, above: tuple[Path, ...] = ()) -> list[str]:
    """List in natural order the files below a folder that holds nothing but Parquet; else none."""
    # `above` are the folders it is in: a link back to one of them would never end.
    parts: list[str] = []
    own = folder.resolve()
    if own in above or len(above) > _DEEPEST:
        return []
    for entry in _entries(folder):
        if entry.is_dir():
            below = parquet_parts(entry, (*above, own))
        else:
            below = [str(entry)] * (entry.suffix.lower() == ".parquet")
        if not below:
            return []
        parts += below
    return parts


def natural(name: str) -> list[tuple[int, int | str]]:
    """Key that sorts part-2 before part-10."""
    return [(0, int(piece)) if piece.isdecimal() else (1, piece) for piece in re.split(r"(\d+)", name)]


def _matches(name: str) -> list[str]:
    if not glob.has_magic(name) or Path(name).exists():
        return [name]
    # Path.glob takes no pattern that is absolute or climbs.
    return sorted(glob.glob(name, recursive=True), key=natural)  # noqa: PTH207


def _is_folder(path: str | Path, folder: Path) -> bool:
    return os.path.isdir(path) and os.path.isdir(folder) and folder.samefile(path)  # noqa: PTH112 - Path may raise


def _logs_of(name: str) -> list[str]:
    path = Path(name)
    if name == "-":
        return [name]
    path.stat()
    if not path.is_dir() or _is_log_folder(path):
        return [name]
    logs = [
        entry for entry in _entries(path) if (_is_log_folder if entry.is_dir() else promised_kind)(str(entry))
    ]
    if not logs:
        hint = f"looked for {', '.join(_ENDINGS)} and rosbag2 folders"
        raise NotFoundError(name, "no log in this folder", hint=hint)
    return [str(log) for log in logs]


def _is_log_folder(folder: Path | str) -> bool:
    return (Path(folder) / "metadata.yaml").is_file() or bool(parquet_parts(Path(folder)))


def _entries(folder: Path) -> list[Path]:
    entries = [entry for entry in folder.iterdir() if not entry.name.startswith(_NO_DATA)]
    return sorted(entries, key=lambda entry: natural(entry.name))


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
        from formats.rosbag.bag_source import BagSource

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
        from formats.rosbag.bag_source import BagSource

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
