"""The rows of a table that is still being written: CSV with a header, or JSON Lines."""

import csv
import json
from collections import Counter
from collections.abc import Iterator, Sequence
from typing import Any

import pyarrow as pa

from formats.content import BAGS, COMPRESSED, FILE_KINDS, HEAD_BYTES, content
from formats.errors import FormatError
from formats.table import Batch, Column, Field, Kind, Source, Stream
from formats.text import unguarded
from formats.text.cell_values import Names, kind_of, numbers, of_texts, times
from formats.text.dialect import examine, split_line

HEAD_LINES = 64  # Lines from which the columns are told, if so many come in time
_LONGEST = 1 << 20  # A line longer than this is none
#: Lines among which one that comes again is known: a network may deliver what it is not sure of twice.
_KNOWN = 4096
_MARK = "\ufeff"
#: What may be wrong with a row.
_WIDTH, _OBJECT = "of another width than the header", "that are no JSON object"
_HEADER = "of the header again"


class ArrivingRows(Source):
    """A table whose rows, a line each, arrive: first `prepare` until the columns are known, then `take`."""

    #: What is counted; no row tells that no more will come, none adds a column, and all are taken.
    counted = "rows"
    ended = young = full = False

    def __init__(self, path: str) -> None:
        super().__init__(path, "csv")
        self._rest = self._head = b""
        self._lines: list[str] = []
        self._known: dict[str, None] = {}
        self._json = False
        self._delimiter, self._decimal = ",", "."
        self._header: list[str] = []
        self._kinds: dict[str, Kind] = {}
        self._names: dict[str, Names] = {}
        self.wanted: Sequence[str] = ()  # Columns that are made of the rows; all if empty
        #: Rows so far, and those of which something is wrong, by what that is.
        self.count = self.repeated = 0
        self.odd: Counter[str] = Counter()
        self.cells: Counter[str] = Counter()  # Cells that are not what their column is, by column

    @property
    def begun(self) -> bool:
        return bool(self._head)

    def prepare(self, data: bytes, *, hurry: bool) -> bool:
        """Take bytes until the columns can be told, in a `hurry` from a header and one row."""
        self._head = (self._head + data)[:HEAD_BYTES]
        if self._head:
            self._refuse()
        self._add(data)
        self._lines[:1] = [line.lstrip(_MARK) for line in self._lines[:1]]
        self._json = bool(self._lines) and self._lines[0].lstrip().startswith("{")
        least = HEAD_LINES if not hurry else 1 if self._json else 2
        if len(self._lines) < least:
            return False
        kinds: Sequence[Kind | None]
        if self._json:
            rows = [row for row in map(_object, self._lines) if row is not None]
            self._header = list(dict.fromkeys(name for row in rows for name in row))
            kinds = [kind_of([row.get(name, "") for row in rows], ".") for name in self._header]
        else:
            text = "".join(self._lines)
            dialect = examine(self.label, text, whole=True)
            self._header = list(dialect.names)
            self._delimiter, self._decimal, kinds = dialect.delimiter, dialect.decimal, dialect.kinds
            self.remarks += dialect.remarks
            # The rows begin where the header ends.
            self._lines = self._lines[dialect.first_row - 1 :]
        self._kinds = {name: kind or "number" for name, kind in zip(self._header, kinds, strict=True) if name}
        return True

    def _refuse(self) -> None:
        kind = content(self.label, self._head)
        if kind in COMPRESSED:
            hint = "unpack it on the way: zcat run.csv.gz |"
            raise FormatError(self.label, f"is packed ({kind})", hint=hint)
        if kind in BAGS:
            what = f"is {FILE_KINDS[kind].found}, which can be followed in its file, not in a pipe"
            raise FormatError(self.label, what, hint="name the file that the recorder writes")
        if kind != "csv":
            what = f"holds {FILE_KINDS[kind].found}, and only CSV, JSON Lines and bags can be followed"
            hint = "batch --watch takes a recording as soon as it is closed"
            raise FormatError(self.label, what, hint=hint)

    def _add(self, data: bytes, *, last: bool = False) -> None:
        whole, end, rest = (self._rest + data).rpartition(b"\n")
        if last and rest.strip():
            whole, end, rest = self._rest + data, b"\n", b""
        self._rest = rest
        if len(rest) > _LONGEST:
            raise FormatError(self.label, "has a line longer than 1 MiB", hint="end every row with a newline")
        if end:
            self._lines += [f"{line}\n" for line in whole.decode("utf-8", "replace").split("\n")]

    def take(self, data: bytes = b"", *, last: bool = False) -> Batch | None:
        """Return the rows that are whole, None where there are none; at the `last` all that is left."""
        self._add(data, last=last)
        lines, self._lines = self._once(self._lines), []
        if not lines:
            return None
        names = list(self.wanted or self._kinds)
        cells = self._objects(lines, names) if self._json else self._rows(lines, names)
        if not cells or not cells[0]:
            return None
        self.count += len(cells[0])
        return {name: self._column(name, column) for name, column in zip(names, cells, strict=True)}

    def _once(self, lines: Sequence[str]) -> list[str]:
        """Leave out and count lines that came before."""
        new = []
        for line in lines:
            if line in self._known:
                self.repeated += bool(line.strip())
            else:
                self._known[line] = None
                new.append(line)
        while len(self._known) > _KNOWN:
            del self._known[next(iter(self._known))]
        return new

    def _rows(self, lines: Sequence[str], names: Sequence[str]) -> list[Sequence[str]]:
        width, place = len(self._header), [self._header.index(name) for name in names]
        rows = []
        for line in lines:
            row = self._cells_of(line)
            while len(row) > width and not row[-1].strip():
                row.pop()
            if len(row) != width:
                self.odd[_WIDTH] += bool(line.strip())
            elif row[place[0]] == names[0]:
                # A writer that was started anew says its header once more.
                self.odd[_HEADER] += 1
            else:
                rows.append(row)
        columns = list(zip(*rows, strict=True))
        return [columns[j] for j in place] if columns else []

    def _cells_of(self, line: str) -> list[str]:
        line = line.rstrip("\r\n")
        try:
            return split_line(line, self._delimiter) if '"' in line else line.split(self._delimiter)
        except csv.Error:
            return []

    def _objects(self, lines: Sequence[str], names: Sequence[str]) -> list[Sequence[str]]:
        rows = [_object(line) for line in lines if line.strip()]
        known = [row for row in rows if row is not None]
        self.odd[_OBJECT] += len(rows) - len(known)
        return [[row.get(name, "") for row in known] for name in names]

    def _column(self, name: str, cells: Sequence[str]) -> Column:
        kind = self._kinds[name]
        if kind == "text":
            return self._names.setdefault(name, Names(unguarded)).labels(pa.array(cells, pa.string()))
        found, bad = times(of_texts(cells)) if kind == "time" else numbers(of_texts(cells), self._decimal)
        self.cells[name] += int(bad.sum())
        return found

    def streams(self) -> tuple[Stream, ...]:
        fields = tuple(Field(name, kind) for name, kind in self._kinds.items())
        return (Stream(topic="", type="table", fields=fields),)

    def read(self, topic: str, fields: Sequence[str], batch_rows: int = HEAD_LINES) -> Iterator[Batch]:  # noqa: ARG002
        """Read the named columns of the first rows, which are not taken by it."""
        before = self.odd.copy(), self.cells.copy()
        cells = (self._objects if self._json else self._rows)(self._lines, fields)
        batch = {name: self._column(name, column) for name, column in zip(fields, cells, strict=False)}
        self.odd, self.cells = before
        if batch:
            yield batch

    def faults(self) -> list[str]:
        kinds = {"number": "no number", "time": "no time"}
        rows = [f"rows {what}, passed over: {count}" for what, count in self.odd.items() if count]
        cells = {name: count for name, count in self.cells.items() if count}
        odd = [f"cells of {name} with {kinds[self._kinds[name]]} in them: {n}" for name, n in cells.items()]
        return [*rows, *odd]


def _object(line: str) -> dict[str, str] | None:
    """Read one JSON object as cells, objects within it by dotted names."""
    try:
        value = json.loads(line)
    except ValueError:
        return None
    return dict(_cells("", value)) if isinstance(value, dict) else None


def _cells(above: str, value: dict[str, Any]) -> Iterator[tuple[str, str]]:
    for name, inner in value.items():
        if isinstance(inner, dict):
            yield from _cells(f"{above}{name}.", inner)
        elif isinstance(inner, bool):
            yield above + name, str(int(inner))
        elif not isinstance(inner, list):
            # JSON can spell half a character, which no text has.
            yield above + name, "" if inner is None else str(inner).encode("utf-8", "replace").decode()
