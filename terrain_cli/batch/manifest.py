"""The manifest and the records it points to: two files that are only ever added to.

A record is an Arrow stream for each content and configuration: the rows of the mission table, the estimates
behind them in SI units, and the account of the samples. It says nothing of where the input lay, so that a
file that is moved or copied is not computed again. One file of many records is read in one go. Writes survive
a kill, a full disk and a loss of power.
"""

from __future__ import annotations

import json
import os
import signal
import sys
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field, fields
from hashlib import sha256
from typing import TYPE_CHECKING, Any, Literal

from formats.output.whole_files import explained
from terrain_cli.processes import ENDINGS, answered

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from terrain_cli.estimation import WindowEstimates
    from terrain_cli.presentation.segment_table import Table

#: What became of an input: a result, an error, or the content of another input once more.
Status = Literal["ok", "failed", "duplicate"]


@contextmanager
def uninterrupted() -> Iterator[None]:
    """Have Ctrl-C, SIGTERM and SIGHUP wait until what belongs together is done."""
    # Handlers run in the main thread, whichever gets the signal: a mask would keep it from one only.
    waiting: list[int] = []
    try:
        with answered((signal.SIGINT, *ENDINGS), lambda number, _: waiting.append(number)):
            yield
    finally:
        for number in waiting:
            signal.raise_signal(number)


def lines(path: Path) -> Iterator[bytes]:
    """Read a file line by line, ends of lines included; nothing if it is not there."""
    with explained(str(path)):
        try:
            stream = path.open("rb")
        except FileNotFoundError:
            return
        with stream:
            yield from stream


def write_all(descriptor: int, data: bytes) -> None:
    """Write every byte: one call may write fewer."""
    view = memoryview(data)
    while view:
        view = view[os.write(descriptor, view) :]


class GrowingFile:
    """A file that is only ever added to, all or nothing, so that it outlasts a loss of power."""

    def __init__(self, path: Path, end: int | None = None) -> None:
        """Open it, and forget what follows its `end`; without one it is only to be read."""
        self._path = str(path)
        with explained(self._path):
            mode = os.O_RDONLY if end is None else os.O_RDWR | os.O_CREAT | os.O_APPEND
            self.descriptor = os.open(path, mode | os.O_NOFOLLOW | os.O_CLOEXEC, 0o666)
            self.size = os.fstat(self.descriptor).st_size
            if end is not None and self.size > end:
                os.ftruncate(self.descriptor, end)
                self.size = end

    def append(self, data: bytes) -> None:
        with explained(self._path):
            try:
                write_all(self.descriptor, data)
                os.fsync(self.descriptor)
            except OSError:
                os.ftruncate(self.descriptor, self.size)
                raise
        self.size += len(data)

    def close(self) -> None:
        os.close(self.descriptor)


def put(data: bytes, temporary: Path, target: Path) -> None:
    """Write a file whole, by way of a temporary one on the same disk. A link at its place is replaced."""
    with explained(str(target)):
        descriptor = os.open(temporary, os.O_WRONLY | os.O_CREAT | os.O_TRUNC | os.O_NOFOLLOW, 0o666)
        try:
            write_all(descriptor, data)
            os.fsync(descriptor)
        except OSError:
            # The room it took may be what the manifest needs.
            os.ftruncate(descriptor, 0)
            raise
        finally:
            os.close(descriptor)
    place(temporary, target)


def place(temporary: Path, target: Path) -> None:
    """Put a file that is complete where it belongs."""
    with explained(str(target)):
        # Its name is on the disk when the manifest, which is written next, is: in that order.
        os.replace(temporary, target)  # noqa: PTH105 - as all writes here, by the system's own name


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


def entries_of(path: Path) -> tuple[list[ManifestEntry], int]:
    """Return the entries of a manifest, less lines that cannot be read, and the bytes of its whole lines."""
    entries, size = [], 0
    for line in lines(path):
        if not line.endswith(b"\n"):
            # It was being written when the process died.
            break
        size += len(line)
        if entry := parse(line):
            entries.append(entry)
    return entries, size


#: Offset and bytes in the file, and the beginning of their hash.
Pointer = tuple[int, int, str]
_ACCOUNT = b"account"
_SI = "si:"  # Sets the columns of the estimates apart from those of the table


class Records(GrowingFile):
    """The file of records; without the `end` of the last one that the manifest knows, only to be read."""

    def add(self, record: bytes) -> Pointer:
        """Add a record, so that it outlasts a loss of power; or leave the file as it was."""
        offset = self.size
        self.append(record)
        return offset, len(record), _digest(record)

    def read(self, pointer: Pointer) -> bytes | None:
        """Return a record; None if it is not there any more as it was written."""
        offset, length, digest = pointer
        parts = []
        while length > 0:
            part = os.pread(self.descriptor, length, offset)
            if not part:
                return None
            parts.append(part)
            offset, length = offset + len(part), length - len(part)
        record = b"".join(parts)
        return record if _digest(record) == digest else None


def _digest(record: bytes) -> str:
    return sha256(record).hexdigest()[:16]


def encode(table: Table, estimates: WindowEstimates, account: dict[str, Any]) -> bytes:
    import pyarrow as pa

    own = {name: values for name, values in table.items() if name != "source"}
    columns = {n: pa.array(v, pa.string() if isinstance(v, list) else None) for n, v in own.items()}
    columns |= {f"{_SI}{f.name}": pa.array(getattr(estimates, f.name)) for f in fields(estimates)}
    told = {name: value for name, value in account.items() if name != "source"}
    batch = pa.RecordBatch.from_pydict(columns, metadata={_ACCOUNT: json.dumps(told, allow_nan=False)})
    sink = pa.BufferOutputStream()
    with pa.ipc.new_stream(sink, batch.schema, options=pa.ipc.IpcWriteOptions(compression="zstd")) as writer:
        writer.write_batch(batch)
    data: bytes = sink.getvalue().to_pybytes()
    return data


def decode(record: bytes, path: str) -> tuple[Table, WindowEstimates, dict[str, Any]]:
    """Read a record; its rows get the source `path`."""
    import pyarrow as pa

    from terrain_cli.estimation import WindowEstimates

    batch = pa.ipc.open_stream(record).read_next_batch()
    own: dict[str, Any] = {name: batch[name].to_numpy(zero_copy_only=False) for name in batch.schema.names}
    table: Table = {"source": [path] * batch.num_rows}
    # Text is a list in the table, and an array in the estimates.
    table |= {
        name: list(values) if values.dtype == object else values
        for name, values in own.items()
        if not name.startswith(_SI)
    }
    si = {name.removeprefix(_SI): values for name, values in own.items() if name.startswith(_SI)}
    texts = {name: values.astype(str) for name, values in si.items() if values.dtype == object}
    estimates = WindowEstimates(**{**si, **texts})
    return table, estimates, {"source": path, **json.loads(batch.schema.metadata[_ACCOUNT])}
