"""Which logs the files, folders and patterns of a command line stand for."""

from __future__ import annotations

import glob
import os
import re
from fnmatch import fnmatch
from pathlib import Path
from typing import TYPE_CHECKING

from formats.content import FILE_KINDS, SIDE_FILES, failure
from formats.errors import NotFoundError

if TYPE_CHECKING:
    from collections.abc import Sequence

#: What the ending of a file's name promises.
_ENDINGS = {ending: kind for kind, known in FILE_KINDS.items() for ending in known.endings}
_PACKINGS = (".gz", ".zst", ".bz2")
#: Hidden files and _SUCCESS, _metadata and the like.
_NO_DATA = (".", "_")
#: Folders of partitions within each other.
_DEEPEST = 20


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
    """List the files of a log.

    Of a rosbag2 folder all that is in it, but for settings (.toml), which may lie there too; of a database
    also what SQLite keeps beside it.
    """
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
    """List in natural order the files below a folder that holds nothing but Parquet; else none.

    `above` are the folders it is in: a link back to one of them would never end.
    """
    parts: list[str] = []
    own = folder.resolve()
    if own in above or len(above) > _DEEPEST:
        return []
    for entry in _entries(folder):
        below = (
            parquet_parts(entry, (*above, own))
            if entry.is_dir()
            else [str(entry)] * (entry.suffix.lower() == ".parquet")
        )
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
        raise NotFoundError(
            name, "no log in this folder", hint=f"looked for {', '.join(_ENDINGS)} and rosbag2 folders"
        )
    return [str(log) for log in logs]


def _is_log_folder(folder: Path | str) -> bool:
    return (Path(folder) / "metadata.yaml").is_file() or bool(parquet_parts(Path(folder)))


def _entries(folder: Path) -> list[Path]:
    entries = [entry for entry in folder.iterdir() if not entry.name.startswith(_NO_DATA)]
    return sorted(entries, key=lambda entry: natural(entry.name))
