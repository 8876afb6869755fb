"""Which logs the files, folders and patterns of a command line stand for."""

from __future__ import annotations

import glob
import re
from pathlib import Path
from typing import TYPE_CHECKING

from formats.errors import NotFoundError
from formats.streams import failure

if TYPE_CHECKING:
    from collections.abc import Sequence

#: What the ending of a file's name promises.
_ENDINGS = {
    ".csv": "csv",
    ".tsv": "csv",
    ".txt": "csv",
    ".parquet": "parquet",
    ".bag": "ros1",
    ".mcap": "mcap",
    ".db3": "db3",
}
_PACKINGS = (".gz", ".zst", ".bz2")
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
            matches = [name]
            if glob.has_magic(name) and not Path(name).exists():
                # Path.glob takes no pattern that is absolute or climbs.
                matches = sorted(glob.glob(name, recursive=True), key=natural)  # noqa: PTH207
                if not matches:
                    raise NotFoundError(name, "matches no file")
            for match in matches:
                found.update(dict.fromkeys(_logs_of(match)))
        except OSError as error:
            raise failure(name, error) from error
    return list(found)


def promised_kind(path: str) -> str | None:
    """Tell what the name of a file promises.

    Parameters
    ----------
    path : str

    Returns
    -------
    str or None
        "csv", "parquet", "ros1", "mcap" or "db3"; None for other names.
    """
    name = Path(path)
    packed = name.suffix.lower() in _PACKINGS
    kind = _ENDINGS.get(Path(name.stem).suffix.lower() if packed else name.suffix.lower())
    return None if packed and kind != "csv" else kind


def parquet_parts(folder: Path, above: tuple[Path, ...] = ()) -> list[str]:
    """List the files below a folder that holds nothing but Parquet.

    Parameters
    ----------
    folder : Path
    above : tuple of Path
        The folders it is in: a link back to one of them would never end.

    Returns
    -------
    list of str
        In natural order; empty if there is anything else.
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
    """Key that sorts part-2 before part-10.

    Parameters
    ----------
    name : str

    Returns
    -------
    list of tuple
    """
    return [(0, int(piece)) if piece.isdecimal() else (1, piece) for piece in re.split(r"(\d+)", name)]


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
    # Hidden files and _SUCCESS, _metadata and the like are no data.
    entries = [entry for entry in folder.iterdir() if not entry.name.startswith((".", "_"))]
    return sorted(entries, key=lambda entry: natural(entry.name))
