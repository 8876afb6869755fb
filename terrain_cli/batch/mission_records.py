"""What the mission table is made of: a record for each content and configuration, in one file.

A record is an Arrow stream: the rows of the table, the estimates behind them in SI units, and the
account of the samples. It says nothing of where the input lay: that is put on when it is read, so
that a file that is moved or copied is not computed again. One file of many records is read in one
go where as many small files would each cost a search of the disk.
"""

from __future__ import annotations

import json
import os
from dataclasses import fields
from hashlib import sha256
from typing import TYPE_CHECKING, Any

from formats.output.whole_files import explained
from terrain_cli.batch.durable_files import append

if TYPE_CHECKING:
    from pathlib import Path

    from terrain_cli.estimation import WindowEstimates
    from terrain_cli.presentation.segment_table import Table

#: Offset and bytes in the file, and the beginning of their hash.
Pointer = tuple[int, int, str]
_ACCOUNT = b"account"
#: Sets the columns of the estimates apart from those of the table.
_SI = "si:"


class Records:
    """The file of records.

    `end` is where the last record ends that the manifest knows; what follows is forgotten. Without it the
    file is only to be read.
    """

    def __init__(self, path: Path, end: int | None = None) -> None:
        self._path = path
        with explained(str(path)):
            mode = os.O_RDONLY if end is None else os.O_RDWR | os.O_CREAT | os.O_APPEND
            self._descriptor = os.open(path, mode | os.O_NOFOLLOW | os.O_CLOEXEC, 0o666)
            self._size = os.fstat(self._descriptor).st_size
            if end is not None and self._size > end:
                os.ftruncate(self._descriptor, end)
                self._size = end

    def add(self, record: bytes) -> Pointer:
        """Add a record, so that it outlasts a loss of power; or leave the file as it was."""
        offset = self._size
        self._size += append(self._descriptor, offset, record, str(self._path))
        return offset, len(record), _digest(record)

    def read(self, pointer: Pointer) -> bytes | None:
        """Return a record; None if it is not there any more as it was written."""
        offset, length, digest = pointer
        parts = []
        while length > 0:
            part = os.pread(self._descriptor, length, offset)
            if not part:
                return None
            parts.append(part)
            offset, length = offset + len(part), length - len(part)
        record = b"".join(parts)
        return record if _digest(record) == digest else None

    def close(self) -> None:
        """Close the file."""
        os.close(self._descriptor)


def _digest(record: bytes) -> str:
    return sha256(record).hexdigest()[:16]


def encode(table: Table, estimates: WindowEstimates, account: dict[str, Any]) -> bytes:
    """Write a record."""
    import pyarrow as pa

    columns = {
        name: pa.array(values, pa.string() if isinstance(values, list) else None)
        for name, values in table.items()
        if name != "source"
    }
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
    own = {name: _values(batch[name]) for name in batch.schema.names}
    table: Table = {"source": [path] * batch.num_rows}
    # Text is a list in the table, and an array in the estimates.
    table |= {
        name: list(values) if values.dtype == object else values
        for name, values in own.items()
        if not name.startswith(_SI)
    }
    estimates = WindowEstimates(
        **{
            name.removeprefix(_SI): values.astype(str) if values.dtype == object else values
            for name, values in own.items()
            if name.startswith(_SI)
        }
    )
    return table, estimates, {"source": path, **json.loads(batch.schema.metadata[_ACCOUNT])}


def _values(column: Any) -> Any:
    return column.to_numpy(zero_copy_only=False)
