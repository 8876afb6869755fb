"""Tables of text: CSV and its kin, plain or compressed."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
import pyarrow as pa
import pyarrow.csv as pc
from numpy.typing import NDArray

from formats.content import SalvagedText, TextStream
from formats.errors import DamagedError, FormatError
from formats.recovery import HINT, Notice, Recovery
from formats.table import BATCH_ROWS, Batch, Column, Field, Kind, Source, Stream
from formats.text import unguarded
from formats.text.cell_values import MISSING_SPELLINGS, Names, kind_of, numbers, of_texts, times
from formats.text.dialect import SAMPLE_ROWS, Dialect, examine, split_line

_Rows = tuple[NDArray[np.int64], list[pa.Array]]  # The numbers of some rows, and the cells of each column
_HEAD_BYTES = 1 << 18  # Read to tell delimiter, decimal sign and kinds
_LOOK_AHEAD_BYTES = 1 << 28  # How far to look for the first value of a column that is empty there
_BLOCK_BYTES = 1 << 20  # Parsed at once: a larger block falls out of the processor's cache and is slower


@dataclass
class _Finding:
    """Something wrong with some cells or rows: the first of them in words, and how many."""

    first: str
    what: str
    count: int = 0

    def __str__(self) -> str:
        return self.first if self.count == 1 else f"{self.first} ({self.count} such {self.what})"


_Findings: TypeAlias = dict[tuple[str, str], _Finding]  # By what is wrong, or by the column whose cells are


class DelimitedSource(Source):
    """A CSV, TSV or semicolon table; with `salvage` one that is cut off is read up to its last whole row."""

    # Rows are counted as a spreadsheet does, from the first line of the file, but for blank ones.

    def __init__(self, path: str, file: str, *, salvage: bool = False) -> None:
        super().__init__(path, "csv")
        self._file = file
        self.recovery = Recovery(what="rows", bytes_expected=Path(file).stat().st_size) if salvage else None
        with self._open() as stream:
            head = stream.read(_HEAD_BYTES)
            whole = not stream.read(1)
        # The cut may fall inside a character; the last line of a part is not used.
        text = head.decode("utf-8", "strict" if whole else "ignore")
        self._dialect: Dialect = examine(self.label, text, whole=whole)
        self.remarks = [
            *([f"packed with {stream.packing}"] if stream.packing else []),
            *([stream.encoding.upper()] if stream.encoding != "utf-8" else []),
            *self._dialect.remarks,
        ]
        self._said: dict[tuple[str, str], Notice] = {}
        self._kinds = dict(zip(self._dialect.names, self._look_ahead(), strict=True))
        #: Rows set aside in the last reading, for they have more fields than the header or were cut off.
        self.skipped = 0
        self._count: int | None = None

    def _open(self) -> TextStream:
        kind = TextStream if self.recovery is None else SalvagedText
        return kind(self.label, self._file)

    def streams(self) -> tuple[Stream, ...]:
        """Return the one table; its rows are counted once it has been read."""
        fields = tuple(Field(name, kind) for name, kind in self._kinds.items() if name)
        return (Stream(topic="", type="table", fields=fields, count=self._count),)

    def read(self, topic: str, fields: Sequence[str], batch_rows: int = BATCH_ROWS) -> Iterator[Batch]:
        for name in fields:
            if topic or not name or name not in self._kinds:
                raise FormatError(self.label, f"has no column {name!r}")
        findings: _Findings = {}
        names = {field: Names(unguarded) for field in fields}
        count = 0
        for rows, block in self._rows([self._dialect.names.index(field) for field in fields], findings):
            for begin in range(0, len(rows), batch_rows):
                part = slice(begin, begin + batch_rows)
                yield {
                    field: self._column(field, block[j].slice(begin, batch_rows), rows[part], names, findings)
                    for j, field in enumerate(fields)
                }
            count += len(rows)
        self.remarks = [remark for remark in self.remarks if remark not in self._said.values()]
        self._said |= {key: Notice(finding) for key, finding in findings.items()}
        self.remarks += self._said.values()
        if fields and not count:
            first = next(iter(findings.values()), "")
            raise FormatError(self.label, f"has no row that fits its header: {first}")
        self._count = count if fields else self._count

    def _column(
        self,
        field: str,
        cells: pa.Array,
        rows: NDArray[np.int64],
        names: dict[str, Names],
        findings: _Findings,
    ) -> Column:
        kind = self._kinds[field]
        if kind == "text":
            return names[field].labels(cells)
        values: Column
        values, bad = times(cells) if kind == "time" else numbers(cells, self._dialect.decimal)
        if bad.any():
            j = int(np.argmax(bad))
            what = "a time" if kind == "time" else "a number"
            text = cells[j].as_py()
            shown = repr(text if len(text) <= 40 else text[:39] + "…")
            first = f"row {rows[j]}: {field} is {shown}, not {what}"
            findings.setdefault(("cells", field), _Finding(first, "cells")).count += int(bad.sum())
        return values

    def _rows(self, places: list[int], findings: _Findings) -> Iterator[_Rows]:
        """Read the cells of some fields, whatever the rows are like, with the number of each row."""
        if not places:
            return
        keys = [str(j) for j in range(len(self._dialect.names))]
        uneven: list[tuple[int, str]] = []

        def keep(row: Any) -> str:
            # The parser counts the rows of data from 1.
            uneven.append((self._dialect.first_row - 1 + row.number, row.text))
            return "skip"

        self.skipped = 0
        stream = self._open()
        mend = _Mending(self.label, self._dialect, places, uneven, findings)
        try:
            stream.read(self._dialect.offset)
            reader = pc.open_csv(
                stream,
                read_options=pc.ReadOptions(use_threads=False, block_size=_BLOCK_BYTES, column_names=keys),
                parse_options=pc.ParseOptions(
                    delimiter=self._dialect.delimiter, newlines_in_values=True, invalid_row_handler=keep
                ),
                convert_options=pc.ConvertOptions(
                    include_columns=[str(j) for j in places],
                    column_types={str(j): pa.string() for j in places},
                    strings_can_be_null=True,
                    null_values=list(MISSING_SPELLINGS),
                ),
            )
            for batch in reader:
                yield mend(batch.columns)
            nothing = [pa.nulls(0, pa.string())] * len(places)  # Unlike `array`, it does not import pandas
            yield mend(nothing, last=True, cut=not stream.ended_in_newline)
        except pa.ArrowInvalid as error:
            after = f"after row {mend.row - 1}"
            what = "a quote that is not closed" if "straddl" in str(error) else str(error).splitlines()[0]
            raise DamagedError(self.label, f"{after}: {what}", hint="open it in an editor there") from error
        finally:
            self.skipped = mend.skipped
            stream.close()
        if self.recovery is not None and isinstance(stream, SalvagedText):
            stream.account(self.recovery, mend.row - self._dialect.first_row - self.skipped, mend.row)
            self.remarks += [text for text in self.recovery.sentences() if text not in self.remarks]
        if stream.nul_bytes:
            passed_over = f"{stream.nul_bytes} NUL bytes passed over, as a power cut leaves them"
            findings["bytes", "NUL"] = _Finding(passed_over, "bytes", 1)
        if stream.quote_marks % 2:
            odd = "an odd number of quote marks: where one is not closed, rows are read as one text"
            findings["bytes", "quote"] = _Finding(odd, "bytes", 1)

    def _look_ahead(self) -> list[Kind]:
        """Decide the kinds, reading on for columns that are empty in the first rows."""
        kinds = list(self._dialect.kinds)
        open_places = [j for j, kind in enumerate(kinds) if kind is None and self._dialect.names[j]]
        size = 0
        for _, block in self._rows(open_places, {}):
            for j, cells in zip(open_places, block, strict=True):
                if kinds[j] is None:
                    kinds[j] = kind_of(cells.drop_null()[:SAMPLE_ROWS].to_pylist(), self._dialect.decimal)
            size += _BLOCK_BYTES
            if size >= _LOOK_AHEAD_BYTES or all(kinds[j] is not None for j in open_places):
                break
        return [kind or "number" for kind in kinds]


@dataclass
class _Mending:
    """Puts rows with too few fields back in their places, filled up; counts those with too many."""

    path: str
    dialect: Dialect
    places: list[int]
    uneven: list[tuple[int, str]]
    findings: _Findings

    def __post_init__(self) -> None:
        self.row, self.skipped = self.dialect.first_row, 0

    def __call__(self, block: list[pa.Array], *, last: bool = False, cut: bool = False) -> _Rows:
        """Return the numbers of the rows and their cells; `cut`: the file does not end in a newline."""
        # Uneven rows behind the last even one of a block wait for the next, for the parser reads ahead.
        count = len(block[0])
        here = 0
        while here < len(self.uneven) and (last or self.uneven[here][0] - self.row - here < count):
            here += 1
        rows = np.arange(self.row, self.row + count + here)
        self.row += len(rows)
        if not here:
            return rows, block
        own, self.uneven[:here] = self.uneven[:here], []
        even = np.delete(rows, [number - rows[0] for number, _ in own])
        mended = {n: self._fields(n, text, cut=cut and n == own[-1][0]) for n, text in own}
        added = {number: fields for number, fields in mended.items() if fields}
        rows = np.concatenate([even, np.array(list(added), dtype=np.int64)])
        order = np.argsort(rows, kind="stable")
        filled = []
        for cells, place in zip(block, self.places, strict=True):
            texts = (fields[place] if place < len(fields) else "" for fields in added.values())
            filled.append(pa.concat_arrays([cells, of_texts(texts)]).take(pa.array(order)))
        return rows[order], filled

    def _fields(self, row: int, text: str, *, cut: bool) -> list[str]:
        """Split an uneven row; nothing where it is set aside."""
        if not text.strip():
            return []
        fields = split_line(text, self.dialect.delimiter)
        width = len(self.dialect.names)
        while len(fields) > width and not fields[-1].strip():
            fields.pop()
        if cut and len(fields) < width:
            what = f"cut off in row {row}: its last row has {len(fields)} of {width} fields"
            raise DamagedError(self.path, what, hint=HINT)
        if len(fields) > width:
            what = f"row {row} has {len(fields)} fields where the header names {width}: set aside"
            self._note("long", what)
            self.skipped += 1
            return []
        if len(fields) < width:
            self._note("short", f"row {row} has {len(fields)} of {width} fields: the others are empty")
        return fields

    def _note(self, key: str, first: str) -> None:
        self.findings.setdefault(("rows", key), _Finding(first, "rows")).count += 1
