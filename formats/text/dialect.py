"""How a text table is written: told from its first lines."""

import csv
import io
import re
from collections import Counter
from dataclasses import dataclass
from itertools import islice

from formats.errors import FormatError
from formats.limits import COLUMNS
from formats.table import Kind
from formats.text import unguarded
from formats.text.cell_values import kind_of, number_pattern

#: Tab before semicolon before comma, where two would do: a decimal comma looks like a comma.
DELIMITERS = {"\t": "tabs", ";": "semicolons", ",": "commas"}
SAMPLE_ROWS = 1000


@dataclass(frozen=True, slots=True, kw_only=True)
class Dialect:
    delimiter: str
    decimal: str
    names: tuple[str, ...]  # One for each field of a row; empty where the header names none
    kinds: tuple[Kind | None, ...]  # One for each field; None where its cells in the sample are all empty
    first_row: int  # Number of the line on which the first row of data begins, from 1
    #: Bytes of UTF-8 before the first row of data.
    offset: int
    remarks: tuple[str, ...]


def examine(path: str, head: str, *, whole: bool) -> Dialect:
    """Tell how a table is written, by the beginning of its text; `whole` says that this is all of it."""
    lines = list(io.StringIO(head, newline=""))
    if not whole and lines:
        lines.pop()
    first = next((j for j, line in enumerate(lines) if line.strip() and not line.startswith("#")), None)
    if first is None:
        raise FormatError(
            path, "has no table in it" if whole else "has no end of line where a header should be"
        )
    try:
        delimiter = _delimiter(path, lines[first : first + 100])
        header, begin, rows = _split(path, lines, first, delimiter)
    except csv.Error as error:
        raise FormatError(path, "a cell is longer than 128 KiB: a quote that is not closed?") from error
    if len(header) > COLUMNS:
        raise FormatError(path, f"has {len(header):,} columns; {COLUMNS:,} at most are read")
    names = _names(path, header, rows)
    decimal = _decimal(delimiter, rows)
    columns = [[row[j] for row in rows if j < len(row)] for j in range(len(names))]
    _refuse_units_row(path, names, columns, decimal, begin + 1)
    remarks = [f"columns separated by {DELIMITERS[delimiter]}"] if delimiter != "," else []
    if decimal == ",":
        remarks.append("decimal comma")
    if begin == first:
        remarks.append(f"the names of the columns are in the comment on line {first}")
    return Dialect(
        delimiter=delimiter,
        decimal=decimal,
        names=names,
        kinds=tuple(kind_of(cells, decimal) for cells in columns),
        first_row=begin + 1,
        offset=len("".join(lines[:begin]).encode()),
        remarks=tuple(remarks),
    )


def split_line(text: str, delimiter: str) -> list[str]:
    # The csv module refuses fields beyond 128 KiB.
    return next(csv.reader(io.StringIO(text[:100_000], newline=""), delimiter=delimiter), [])


def _delimiter(path: str, lines: list[str]) -> str:
    scores = {}
    for delimiter in DELIMITERS:
        widths = [len(row) for row in csv.reader(lines, delimiter=delimiter) if row]
        scores[delimiter] = (widths[0] > 1, sum(width == widths[0] for width in widths))
    best = max(DELIMITERS, key=lambda delimiter: scores[delimiter])
    if not scores[best][0]:
        spaced = {len(line.split()) for line in lines if line.strip()}
        if len(spaced) == 1 and spaced.pop() > 1 and len(lines) > 1:
            hint = "separate them by commas, semicolons or tabs"
            raise FormatError(path, "has spaces between its columns", hint=hint)
        return ","
    return best


def _split(path: str, lines: list[str], first: int, delimiter: str) -> tuple[list[str], int, list[list[str]]]:
    """Return the header, the index of the first line of data, and the first rows."""
    reader = csv.reader(lines[first:], delimiter=delimiter)
    header = [cell.strip().strip('"').strip() for cell in next(reader)]
    begin = first + reader.line_num
    first_rows = islice(reader, SAMPLE_ROWS)
    rows = [row for row in first_rows if len(row) > 1 or "".join(row).strip()]
    if all(any(kind_of([cell], decimal) != "text" for decimal in ".,") for cell in header):
        # numpy.savetxt writes the names as a comment.
        comment = lines[first - 1] if first else ""
        names = [cell.strip() for cell in split_line(comment.lstrip("#").strip(), delimiter)]
        if comment.startswith("#") and len(names) == len(header):
            return names, first, [header, *rows]
        what = f"line {first + 1} holds values where the names of the columns should be"
        hint = "put a line with the names of the columns first, such as time,load,torque,sinkage,slip"
        raise FormatError(path, what, hint=hint)
    if not rows:
        raise FormatError(path, "has a header but no rows")
    return header, begin, rows


def _names(path: str, header: list[str], rows: list[list[str]]) -> tuple[str, ...]:
    """Name every field of a row, allowing for delimiters that end each line."""
    width = max(Counter(map(len, rows)).items(), key=lambda item: (item[1], item[0] == len(header)))[0]
    surplus = [cell for row in rows if len(row) == width for cell in row[len(header) :]]
    if width > len(header) and not any(cell.strip() for cell in surplus):
        header = header + [""] * (width - len(header))
    elif all(len(row) > len(header) for row in rows):
        raise FormatError(path, f"the header names {len(header)} columns, but the rows have {width} fields")
    elif width < len(header) and not any(header[width:]):
        header = header[:width]
    header = [unguarded(name) for name in header]
    twice = [name for name, count in Counter(header).items() if name and count > 1]
    if twice:
        raise FormatError(path, f"two columns are named {twice[0]!r}", hint="give every column its own name")
    return tuple(header)


def _decimal(delimiter: str, rows: list[list[str]]) -> str:
    if delimiter == ",":
        return "."
    cells = [cell.strip() for row in rows for cell in row]
    comma = re.compile(number_pattern(","), re.IGNORECASE | re.ASCII)
    point = re.compile(number_pattern("."), re.IGNORECASE | re.ASCII)
    with_comma = sum("," in cell and bool(comma.match(cell)) for cell in cells)
    with_point = sum("." in cell and bool(point.match(cell)) for cell in cells)
    return "," if with_comma > with_point else "."


def _refuse_units_row(
    path: str, names: tuple[str, ...], columns: list[list[str]], decimal: str, line: int
) -> None:
    if not any(
        name and cells and kind_of(cells[:1], decimal) == "text"
        for name, cells in zip(names, columns, strict=True)
    ):
        return
    numeric = [j for j, cells in enumerate(columns) if names[j] and kind_of(cells[1:], decimal) == "number"]
    units = [(names[j], columns[j][0].strip()) for j in numeric]
    words = [(name, unit) for name, unit in units if kind_of([unit], decimal) == "text"]
    # A column without dimension has nothing or a 1 there.
    if words and all(kind_of([unit], decimal) != "number" or unit == "1" for _, unit in units):
        name, unit = words[0]
        what = f"line {line} holds no numbers ({unit!r} under {name!r}): units in a row of their own?"
        hint = f"put the units into the header ({name} [{unit}]) and take the row out"
        raise FormatError(path, what, hint=hint)
