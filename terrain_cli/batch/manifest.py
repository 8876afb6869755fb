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
    """What became of one input; the last entry of a location holds."""

    path: str
    location: str  # Its absolute path, or its address
    size: int | None  # Bytes; of a folder, of all its files
    stamp: str | None  # Changes when the input is written; None where nothing tells
    sha256: str | None  # Hash of the content; None where it could not be read
    configuration: str  # Hash of what decides on the numbers; `configurations/` says what it stands for
    versions: dict[str, str]  # Of this program and what it computes with
    status: Status
    duplicate_of: str | None = None  # The path of the input with the same content
    error_class: str | None = None
    error: str | None = None
    hint: str | None = None
    exit_code: int | None = None  # What `terrain-est estimate` would have ended with; None of a duplicate
    # The error may be gone next time: a worker was killed or hung, memory or a disk was short
    passing: bool = False
    samples: int | None = None
    set_aside: int | None = None
    segments: int | None = None
    # Share that --salvage read of a damaged input; None where nothing tells, and of whole ones
    recovered: float | None = None
    recovered_of: str | None = None  # What it is a share of; None of whole inputs
    warnings: list[str] = field(default_factory=list)  # What `terrain-est estimate` would have remarked
    seconds: float = 0.0
    result: str | None = None  # Its result file, below the folder of the batch
    result_bytes: int | None = None
    # Where the rows of the mission table are kept: offset, bytes and hash
    record: tuple[int, int, str] | None = None
    finished: str = ""  # ISO 8601, UTC

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
    """Read a line of the manifest; None for one that no batch wrote whole."""
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
    """The entries of a batch, in the order in which they were written.

    `unreadable` lines, from 1, say nothing: their inputs count as never seen. Only where it is writable is a
    last line that a kill cut off mended.
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
        """Write an entry, so that it outlasts a loss of power, or nothing of it."""
        if self._descriptor < 0:
            raise CannotWriteError(str(self._path), "was opened to be read")
        self._size += append(self._descriptor, self._size, entry.line(), str(self._path))
        self.entries.append(entry)

    def close(self) -> None:
        """Close the file."""
        if self._descriptor >= 0:
            os.close(self._descriptor)
            self._descriptor = -1
