"""What passes between files and the rest: named columns in batches."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

from formats.recovery import Recovery

#: So that a column has more than 512 KiB: with 65,536 rows a Parquet file of 10⁷, all of which is kept, took
#: 1.3 to 2 times as long, and no longer where Arrow's allocator was told to give nothing back.
BATCH_ROWS = 98_304
STANDARD_INPUT = "standard input"


@dataclass(frozen=True, slots=True)
class Labels:
    """A column of text, each distinct text held once.

    Parameters
    ----------
    codes : ndarray of int32, shape (n,)
        Index into `names`; −1 where there is none.
    names : tuple of str
    """

    codes: NDArray[np.int32]
    names: tuple[str, ...]

    def __len__(self) -> int:
        return len(self.codes)

    def take(self, rows: NDArray[np.intp] | NDArray[np.bool_] | slice) -> Labels:
        """Return some of the cells, by indices, a mask or a slice."""
        return Labels(self.codes[rows], self.names)


Column: TypeAlias = "NDArray[Any] | Labels"
#: Columns of one length: float64 (NaN where missing), datetime64[ns] (NaT where missing) or `Labels`.
Batch: TypeAlias = dict[str, Column]

Kind = Literal["number", "text", "time", "numbers", "texts"]


@dataclass(frozen=True, slots=True)
class Field:
    """One column, or one field of a message.

    Parameters
    ----------
    name : str
        The header of the column as written (without a byte-order mark), or the dotted path
        of the field in its message, such as ``wrench.force.z``.
    kind : {"number", "text", "time", "numbers", "texts"}
        The plural kinds are lists in each message; one element of a list is read with
        ``effort[2]`` or ``effort[wheel_fl]``: by its place, or by the place of the text in
        the list ``name`` beside it.
    elements : tuple of str
        For lists: the texts of the list ``name`` beside it in the first message, or the
        places ("0", "1", …) if there is none.
    """

    name: str
    kind: Kind
    elements: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True)
class Stream:
    """A series of records with the same fields: a table, or one topic of a bag.

    Parameters
    ----------
    topic : str
        The topic; empty for a table.
    type : str
        The message type; "table" for a table.
    fields : tuple of Field
    count : int or None
        Number of records, where it is known without reading them.
    start, end : int or None
        First and last log time in ns, where known without reading.
    """

    topic: str
    type: str
    fields: tuple[Field, ...]
    count: int | None = None
    start: int | None = None
    end: int | None = None


LOG_TIME = "@log"  # Every batch of a bag's topic also has these two columns, both datetime64[ns]
STAMP = "@stamp"  # NaT where the message has no header or its stamp is zero


@dataclass
class Source(ABC):
    """One input, opened: what is inside, and its columns batch by batch.

    Parameters
    ----------
    path : str
        As the user named it; "-" is the standard input.
    kind : str
        One of `content.FILE_KINDS`.
    remarks : list of str
        What a person should know about how the file was read (delimiter, decimal comma,
        rows passed over and why); complete only once it has been read.
    recovery : Recovery or None
        What was saved and what was lost, where it was opened with salvage.
    """

    path: str
    kind: str
    remarks: list[str] = field(default_factory=list)
    recovery: Recovery | None = None

    @property
    def label(self) -> str:
        return STANDARD_INPUT if self.path == "-" else self.path

    @abstractmethod
    def streams(self) -> tuple[Stream, ...]:
        """Return what is inside."""

    @abstractmethod
    def read(self, topic: str, fields: Sequence[str], batch_rows: int = BATCH_ROWS) -> Iterator[Batch]:
        """Read the named fields of one topic ("" for a table), in the order of the file.

        Parameters
        ----------
        topic : str
        fields : sequence of str
            Names from `Stream.fields`; elements of lists as ``effort[wheel_fl]``.
        batch_rows : int
            Largest number of rows in one batch.

        Yields
        ------
        dict of str to ndarray or Labels
            One entry per name asked for, under that name.

        Raises
        ------
        formats.errors.FormatError
        """

    def read_together(
        self, fields: Mapping[str, Sequence[str]], batch_rows: int = BATCH_ROWS
    ) -> Iterator[tuple[str, Batch]]:
        """Read the named fields of several topics, in one pass where the kind of file allows it.

        Parameters
        ----------
        fields : mapping of str to sequence of str
            topic → names as for `read`.
        batch_rows : int

        Yields
        ------
        topic : str
        batch : dict of str to ndarray or Labels

        Raises
        ------
        formats.errors.FormatError
        """
        for topic, names in fields.items():
            yield from ((topic, batch) for batch in self.read(topic, names, batch_rows))
