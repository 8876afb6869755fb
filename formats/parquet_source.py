"""Parquet: a file, a folder of parts, or partitions; only the columns asked for are read."""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from formats import limits
from formats.errors import DamagedError, FormatError, NotFoundError
from formats.limits import TooMuchError
from formats.page_claims import check_pages
from formats.recovery import Recovery
from formats.table import BATCH_ROWS, Batch, Column, Field, Kind, Labels, Source, Stream
from formats.text.cell_values import MISSING, Names, exact, floats, kind_of, nanoseconds, numbers

#: What to do about a damaged file.
_LOST = "Parquet keeps its index at the end: copy the file again, or write it anew"
_NO_VALUE = "__HIVE_DEFAULT_PARTITION__"  # What Hive writes for a partition without a value


class ParquetSource(Source):
    """A Parquet file, or the parts of a folder in natural order, with partitions ``key=value`` as columns."""

    def __init__(self, path: str, files: Sequence[str], *, salvage: bool = False) -> None:
        super().__init__(path, "parquet")
        self._parts = {file: _partition(Path(file), Path(path)) for file in files}
        if salvage:
            files = self._readable(files)
        self._kinds: dict[str, Kind] = {}
        self._rows = 0
        passed_over: dict[str, None] = {}
        for file in files:
            with self._open(file) as part:
                self._rows += self._rows_of(file, part)
                for field in part.schema_arrow:
                    kind = _kind(field.type)
                    if kind is None:
                        passed_over[field.name] = None
                    elif self._kinds.setdefault(field.name, kind) != kind:
                        what = f"{field.name} is {kind}, but not in the parts before it"
                        raise FormatError(self._name(file), what)
                if len(set(part.schema_arrow.names)) < len(part.schema_arrow.names):
                    raise FormatError(self._name(file), "two columns have the same name")
        if not self._rows:
            raise FormatError(self.label, "has columns but no rows")
        self._partitions = {key for values in self._parts.values() for key in values}
        for key in sorted(self._partitions):
            texts = [values.get(key, "") for values in self._parts.values()]
            self._kinds[key] = kind_of(texts, ".") or "text"
        if passed_over:
            names = ", ".join(passed_over)
            self.remarks.append(f"columns passed over, being neither numbers, texts nor times: {names}")

    def streams(self) -> tuple[Stream, ...]:
        fields = tuple(Field(name, kind) for name, kind in self._kinds.items())
        return (Stream(topic="", type="table", fields=fields, count=self._rows),)

    def read(self, topic: str, fields: Sequence[str], batch_rows: int = BATCH_ROWS) -> Iterator[Batch]:
        for name in fields:
            if topic or name not in self._kinds:
                raise FormatError(self.label, f"has no column {name!r}")
        names = {field: Names() for field in fields}
        for file, partition in self._parts.items():
            with self._open(file) as part:
                stored = [f for f in fields if f not in self._partitions and f in part.schema_arrow.names]
                self._check(file, part, stored)
                batches = part.iter_batches(batch_rows, columns=stored)
                rows = 0
                while (batch := self._next(file, batches)) is not None:
                    rows += len(batch)
                    yield {
                        field: self._values(file, field, batch.column(field), names[field])
                        if field in stored
                        else _constant(partition.get(field), len(batch), self._kinds[field], names[field])
                        for field in fields
                    }
                if stored and rows != part.metadata.num_rows:
                    stated = f"{part.metadata.num_rows:,} rows are stated, {rows:,} can be read"
                    raise DamagedError(self._name(file), f"is corrupt: {stated}", hint=_LOST)

    def _readable(self, files: Sequence[str]) -> list[str]:
        """Set aside the parts that cannot be read, and tell of them; fail where there is no other."""
        self.recovery = Recovery(what="parts", checked=True)
        readable = []
        for file in files:
            size = Path(file).stat().st_size
            try:
                with self._open(file) as part:
                    checked = self._checked(file, part)
            except DamagedError as error:
                if len(files) == 1:
                    raise
                self.recovery.damage.append(str(error))
                self.recovery.lost = [(None, None)]
                del self._parts[file]
            else:
                readable.append(file)
                self.recovery.bytes_read += size
                self.recovery.checked = self.recovery.checked and checked
            self.recovery.bytes_expected = (self.recovery.bytes_expected or 0) + size
        if not readable:
            raise DamagedError(self.label, f"none of its {len(files)} parts is whole", hint=_LOST)
        self.recovery.read, self.recovery.expected = len(readable), len(files)
        self.remarks += self.recovery.sentences()
        return readable

    def _rows_of(self, file: str, part: Any) -> int:
        """Return how many rows a part has, if that can be."""
        columns = len(part.schema)
        if columns > limits.COLUMNS:
            raise FormatError(
                self._name(file), f"has {columns:,} columns; {limits.COLUMNS:,} at most are read"
            )
        rows, most = int(part.metadata.num_rows), limits.PARQUET_ROWS_PER_BYTE * Path(file).stat().st_size
        if not 0 <= rows <= max(limits.PARQUET_ROWS, most):
            what = f"claims {rows:,} rows, more than a file of its size can hold"
            raise DamagedError(self._name(file), what, hint=_LOST)
        return rows

    def _check(self, file: str, part: Any, stored: Sequence[str]) -> None:
        """Refuse columns that become far more than the file has, and pages that claim what cannot be."""
        size, becomes = Path(file).stat().st_size, 8 * len(stored) * int(part.metadata.num_rows)
        if becomes > limits.file_limit(size):
            more = f"more than {limits.UNPACKED_RATIO} times its size"
            what = f"is not read, for {len(stored)} columns of it become {becomes:,} bytes, {more}"
            raise DamagedError(self._name(file), what, hint="if that is right, save it as CSV")
        try:
            check_pages(file, _leaves(part, stored))
        except TooMuchError as error:
            raise DamagedError(self._name(file), f"is not read, for {error}", hint=_LOST) from error

    @staticmethod
    def _checked(file: str, part: Any) -> bool:
        """Tell whether every page that can be read has a checksum, which is verified as it is read."""
        readable = [field.name for field in part.schema_arrow if _kind(field.type)]
        try:
            return check_pages(file, _leaves(part, readable))
        except TooMuchError:
            return False

    def _name(self, file: str) -> str:
        return file if len(self._parts) > 1 else self.label

    def _open(self, file: str) -> Any:
        try:
            return pq.ParquetFile(
                file,
                # The default reads ahead without bound: gigabytes on a long log.
                pre_buffer=False,
                # Longer pages are read at once; what goes through the buffer is copied once more.
                buffer_size=1 << 16,
                page_checksum_verification=True,
            )
        except PermissionError as error:
            raise NotFoundError(self._name(file), "no permission to read it") from error
        except (OSError, pa.ArrowException, UnicodeDecodeError) as error:
            what = "is not a whole Parquet file: its footer is missing or corrupt"
            hint = f"{_LOST}; without it nothing tells where its columns are, so --salvage cannot help"
            raise DamagedError(self._name(file), what, hint=hint) from error

    def _next(self, file: str, batches: Iterator[pa.RecordBatch]) -> pa.RecordBatch | None:
        try:
            return next(batches, None)
        except (OSError, pa.ArrowException) as error:
            raise DamagedError(self._name(file), f"is corrupt: {_reason(error)}", hint=_LOST) from error

    def _values(self, file: str, field: str, array: pa.Array, names: Names) -> Column:
        try:
            return _column(array, self._kinds[field], names)
        except (pa.ArrowException, UnicodeDecodeError) as error:
            raise FormatError(self._name(file), f"{field} cannot be read: {_reason(error)}") from error


def _leaves(part: Any, names: Sequence[str]) -> set[int]:
    """Return the columns of a row group that these fields are stored in."""
    paths = [part.schema.column(leaf).path for leaf in range(len(part.schema))]
    return {leaf for leaf, path in enumerate(paths) if {path, path.split(".")[0]}.intersection(names)}


def _reason(error: Exception) -> str:
    return (str(error).splitlines() or [type(error).__name__])[0][:160]


def _partition(file: Path, folder: Path) -> dict[str, str]:
    """Return the values that the folders between `folder` and `file` stand for."""
    between = file.parent.relative_to(folder).parts if file.is_relative_to(folder) and file != folder else ()
    pairs = [part.split("=", 1) for part in between if "=" in part]
    return {unquote(key): "" if value == _NO_VALUE else unquote(value) for key, value in pairs}


def _kind(kind: pa.DataType) -> Kind | None:
    types = pa.types
    if types.is_dictionary(kind):
        kind = kind.value_type
    if types.is_timestamp(kind) or types.is_date(kind):
        return "time"
    if types.is_string(kind) or types.is_large_string(kind):
        return "text"
    numeric = (types.is_integer, types.is_floating, types.is_boolean, types.is_decimal, types.is_duration)
    return "number" if any(is_kind(kind) for is_kind in (*numeric, types.is_null)) else None


def _column(array: pa.Array, kind: Kind, names: Names) -> Column:
    if kind == "text":
        return names.labels(array)
    if pa.types.is_dictionary(array.type):
        array = array.dictionary_decode()
    if kind == "time":
        zone = getattr(array.type, "tz", None)
        return nanoseconds(array.cast(pa.timestamp("ns", zone))).view("datetime64[ns]")
    if pa.types.is_duration(array.type):
        ns = nanoseconds(array.cast(pa.duration("ns"))).view("timedelta64[ns]")
        return np.asarray(ns / np.timedelta64(1, "s"))
    rounded = array if pa.types.is_float64(array.type) else array.cast(pa.float64(), safe=False)
    return exact(rounded, array) if pa.types.is_integer(array.type) else floats(rounded)


def _constant(value: str | None, rows: int, kind: Kind, names: Names) -> Column:
    """Repeat the value of a partition, or nothing for a column this part does not have."""
    cell = None if value is None or value.lower() in MISSING else value
    if kind == "time":
        return np.full(rows, np.datetime64(cell or "NaT", "ns"))
    cells = pa.array([cell], pa.string())
    if kind == "text":
        labels = names.labels(cells)
        return Labels(np.repeat(labels.codes, rows), labels.names)
    return np.repeat(numbers(cells, ".")[0], rows)
