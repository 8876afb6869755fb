"""The manifest: one line of JSON for each input that was dealt with, only ever added to."""

from __future__ import annotations

import json
import os
import sys
from dataclasses import asdict, dataclass, field, fields
from typing import TYPE_CHECKING, Any, Literal

from formats.errors import CannotWriteError
from formats.output.whole_files import explained
from terrain_cli.batch.durable_files import append, lines

if TYPE_CHECKING:
    from pathlib import Path

#: What became of an input: a result, an error, or the content of another input once more.
Status = Literal["ok", "failed", "duplicate"]


@dataclass(frozen=True, slots=True, kw_only=True)
class ManifestEntry:
    """What became of one input; the last entry of a location holds.

    Parameters
    ----------
    path : str
        As it was named.
    location : str
        Its absolute path, or its address.
    size : int or None
        Bytes; of a folder, of all its files.
    stamp : str or None
        Changes when the input is written; None where nothing tells.
    sha256 : str or None
        Hash of the content; None where it could not be read.
    configuration : str
        Hash of what decides on the numbers; `configurations/` says what it stands for.
    versions : dict of str to str
        Of this program and what it computes with.
    status : {"ok", "failed", "duplicate"}
    duplicate_of : str or None
        The path of the input with the same content.
    exit_code : int or None
        What `terrain-est estimate` would have ended with; None of a duplicate.
    passing : bool
        The error may be gone next time: a worker was killed or hung, memory or a disk was short.
    recovered : float or None
        Share that --salvage read of a damaged input; None where nothing tells, and of whole ones.
    recovered_of : str or None
        What it is a share of; None of whole inputs.
    warnings : list of str
        What `terrain-est estimate` would have remarked.
    seconds : float
        Spent on it by the worker.
    result : str or None
        Its result file, below the folder of the batch.
    record : tuple of (int, int, str) or None
        Where the rows of the mission table are kept: offset, bytes and hash.
    finished : str
        ISO 8601, UTC.
    """

    path: str
    location: str
    size: int | None
    stamp: str | None
    sha256: str | None
    configuration: str
    versions: dict[str, str]
    status: Status
    duplicate_of: str | None = None
    error_class: str | None = None
    error: str | None = None
    hint: str | None = None
    exit_code: int | None = None
    passing: bool = False
    samples: int | None = None
    set_aside: int | None = None
    segments: int | None = None
    recovered: float | None = None
    recovered_of: str | None = None
    warnings: list[str] = field(default_factory=list)
    seconds: float = 0.0
    result: str | None = None
    result_bytes: int | None = None
    record: tuple[int, int, str] | None = None
    finished: str = ""

    def line(self) -> bytes:
        """Return the line of the manifest, with its end."""
        try:
            return json.dumps(asdict(self), ensure_ascii=False, allow_nan=False).encode() + b"\n"
        except UnicodeEncodeError:
            # The name of a file need not be text.
            return json.dumps(asdict(self), allow_nan=False).encode() + b"\n"


_NAMES = frozenset(one.name for one in fields(ManifestEntry))
_versions: dict[str, dict[str, str]] = {}
_NEEDED = frozenset({"path", "location", "size", "stamp", "sha256", "configuration", "status"})


def parse(line: bytes) -> ManifestEntry | None:
    """Read a line of the manifest.

    Returns
    -------
    ManifestEntry or None
        None for a line that no batch wrote whole.
    """
    try:
        values: Any = json.loads(line)
    except ValueError:
        return None
    if not isinstance(values, dict) or not values.keys() >= _NEEDED:
        return None
    # Keys of a later version are passed over.
    known = {"versions": {}, **{name: value for name, value in values.items() if name in _NAMES}}
    if known.get("record"):
        known["record"] = tuple(known["record"])
    # What is the same in nearly all lines is held once.
    told = known["versions"]
    known["versions"] = _versions.setdefault(json.dumps(told), told)
    known["configuration"] = sys.intern(known["configuration"])
    return ManifestEntry(**known)


class Manifest:
    """The manifest of a batch.

    Parameters
    ----------
    writable : bool
        Whether to mend a last line that a kill cut off, and to add entries.

    Attributes
    ----------
    entries : list of ManifestEntry
        In the order in which they were written.
    unreadable : list of int
        Lines, from 1, that say nothing: their inputs count as never seen.
    """

    def __init__(self, path: Path, *, writable: bool = True) -> None:
        self._path = path
        self.entries: list[ManifestEntry] = []
        self.unreadable: list[int] = []
        self._descriptor = -1
        self._size = size = 0
        for number, line in enumerate(lines(path), 1):
            size += len(line)
            if not line.endswith(b"\n"):
                # It was being written when the process died.
                break
            self._size = size
            entry = parse(line)
            if entry is None:
                self.unreadable.append(number)
            else:
                self.entries.append(entry)
        if writable:
            with explained(str(path)):
                self._descriptor = os.open(
                    path, os.O_WRONLY | os.O_CREAT | os.O_APPEND | os.O_NOFOLLOW | os.O_CLOEXEC, 0o666
                )
                if self._size < size:
                    os.ftruncate(self._descriptor, self._size)

    def add(self, entry: ManifestEntry) -> None:
        """Write an entry, so that it outlasts a loss of power.

        Raises
        ------
        CannotWriteError
            Nothing of it is left in the file.
        """
        if self._descriptor < 0:
            raise CannotWriteError(str(self._path), "was opened to be read")
        self._size += append(self._descriptor, self._size, entry.line(), str(self._path))
        self.entries.append(entry)

    def close(self) -> None:
        """Close the file."""
        if self._descriptor >= 0:
            os.close(self._descriptor)
            self._descriptor = -1
