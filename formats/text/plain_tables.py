"""Tables of text in which nothing is odd: parsed to numbers at once, pieces of them side by side.

The parser of `delimited` tells of every odd row, for which it must work through the file in one
thread and make texts, that become numbers afterwards. Here each piece goes to a thread, which makes
numbers of its cells while it parses. On two cores that is 2 to 3 times as fast.
"""

from __future__ import annotations

import io
import os
from collections import deque
from concurrent.futures import Future, ThreadPoolExecutor
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
import pyarrow as pa
import pyarrow.csv as pc

from formats.text.cell_values import EXACT, MISSING_SPELLINGS, floats

if TYPE_CHECKING:
    from collections.abc import Callable, Generator, Iterator, Mapping, Sequence

    from formats.content import TextStream

#: More bytes fall out of the processor's cache, fewer are not worth a thread's while.
_PIECE_BYTES = 1 << 21
#: A line that is longer than this is no row of numbers; nearly all are shorter than that.
_LONGEST_LINE, _USUAL_LINE = 1 << 18, 1 << 12
_THREADS = 2


class OddError(Exception):
    """There is something that needs the texts of cells, or their rows looked at."""


def columns(
    stream: TextStream | io.FileIO, delimiter: str, decimal: str, width: int, kinds: Mapping[int, pa.DataType]
) -> Generator[list[pa.Array], None, None]:
    """Read some columns of the rows that a stream still has.

    A file itself, not a stream of its text, should be plain UTF-8: threads then read it too. Of the `width`
    columns of the table those are read whose place is in `kinds` (float64 or string), in that order, and with
    nothing left out so far.

    OddError where a row has more or fewer cells, a cell of a number is none, float64 would lose digits of it,
    or there are quote marks, NUL bytes or bytes that are no UTF-8. What was yielded before is right.
    """
    names = [str(place) for place in range(width)]
    # Every spelling of a missing value is compared with every cell. Most numbers are there, or the cell is
    # empty, or a NaN, which is a number; the other spellings are looked for where that does not do.
    numbers = all(pa.types.is_floating(kind) for kind in kinds.values())
    convert = [
        pc.ConvertOptions(
            include_columns=[names[place] for place in kinds],
            column_types={names[place]: kind for place, kind in kinds.items()},
            strings_can_be_null=True,
            null_values=spellings,
            decimal_point=decimal,
        )
        for spellings in ([""], list(MISSING_SPELLINGS))[0 if numbers else 1 :]
    ]
    parse = partial(_parse, names=names, delimiter=delimiter, convert=convert)
    with ThreadPoolExecutor(_THREADS) as pool:
        waiting: deque[Future[list[pa.Array]]] = deque()
        for piece in _file_pieces(stream) if isinstance(stream, io.FileIO) else _pieces(stream):
            waiting.append(pool.submit(parse, piece))
            if len(waiting) > _THREADS:
                yield waiting.popleft().result()
        while waiting:
            yield waiting.popleft().result()


def _file_pieces(file: io.FileIO) -> Iterator[Callable[[], bytes]]:
    """Cut what is left of a file after ends of lines; its bytes are read where they are parsed."""
    begin, size, number = file.tell(), os.fstat(file.fileno()).st_size, file.fileno()
    while begin < size:
        end = begin + _PIECE_BYTES
        for reach in (_USUAL_LINE, _LONGEST_LINE):
            found = os.pread(number, reach, end).find(b"\n")
            if found >= 0:
                break
        end = size if found < 0 else end + found + 1
        if end - begin > _PIECE_BYTES + _LONGEST_LINE:
            raise OddError
        yield partial(_read, number, begin, end)
        begin = end


def _read(number: int, begin: int, end: int) -> bytes:
    piece = os.pread(number, end - begin, begin)
    if len(piece) < end - begin or b"\0" in piece:
        raise OddError
    if not piece.isascii():
        try:
            piece.decode()
        except UnicodeDecodeError as error:
            raise OddError from error
    return piece


def _pieces(stream: TextStream) -> Iterator[Callable[[], bytes]]:
    """Cut a stream, which can be read only in order, after ends of lines."""
    rest = b""
    while data := stream.read(_PIECE_BYTES):
        end = data.rfind(b"\n") + 1
        if stream.nul_bytes or len(data) - end > _LONGEST_LINE:
            raise OddError
        if end:
            yield partial(bytes, b"".join((rest, memoryview(data)[:end])))
            rest = data[end:]
        else:
            rest += data
    if rest:
        yield partial(bytes, rest)


def _parse(
    read: Callable[[], bytes], *, names: Sequence[str], delimiter: str, convert: Sequence[pc.ConvertOptions]
) -> list[pa.Array]:
    piece = read()
    if b'"' in piece:
        raise OddError
    for options in convert:
        try:
            table = pc.read_csv(
                pa.BufferReader(piece),
                read_options=pc.ReadOptions(
                    use_threads=False, block_size=len(piece) + 1, column_names=list(names)
                ),
                parse_options=pc.ParseOptions(delimiter=delimiter, quote_char=False),
                convert_options=options,
            ).combine_chunks()
        except pa.ArrowInvalid as error:
            if options is convert[-1]:
                raise OddError from error
        else:
            break
    found = [column.chunk(0) if column.num_chunks else pa.array([], column.type) for column in table.columns]
    for cells in found:
        if pa.types.is_floating(cells.type) and (np.abs(floats(cells)) >= EXACT).any():
            raise OddError
    return found
