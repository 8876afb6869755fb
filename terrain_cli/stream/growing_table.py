"""A table that grows: CSV, sequences of GeoJSON, MCAP; each row is there as soon as it is known."""

from __future__ import annotations

import io
import sys
from contextlib import ExitStack
from typing import TYPE_CHECKING, Self, TextIO

import numpy as np

from formats.output.common_forms import normalise
from formats.output.text_writer import write_text
from formats.output.whole_files import explained
from terrain_cli.errors import UsageError
from terrain_cli.presentation import segment_files, segment_table

if TYPE_CHECKING:
    from collections.abc import Sequence

    from formats.output.bag_writer import GrowingBag

KINDS = ("csv", "geojsonl", "geojsons", "mcap")  # What can be read while it grows
#: Columns that tell whether a row is of a segment that is open, or of one that was told before.
OPEN, AGAIN = "open", "again"


class GrowingTable:
    """The table of segments, in a file or on the standard output ("-")."""

    def __init__(self, destination: str, crs: str | None, marks: Sequence[str] = ()) -> None:
        """Check the name; the last columns are `marks`, of which each row has some or none."""
        kind = segment_files.result_kind(destination)
        if kind not in KINDS:
            hint = f"with --follow write {', '.join(f'.{one}' for one in KINDS)}"
            raise UsageError(f"-o {destination}: a table that grows cannot be .{kind}", hint=hint)
        self._destination, self._kind, self._crs, self._marks = destination, kind, crs, marks
        self._stack = ExitStack()
        self._stream: TextIO | None = None
        self._bag: GrowingBag | None = None
        self._wheels: dict[str, None] = {}
        self._begun = False

    def __enter__(self) -> Self:
        with explained(self._destination):
            if self._destination == "-":
                self._stream = sys.stdout
            elif self._kind == "mcap":
                from formats.output.bag_writer import GrowingBag

                self._bag = self._stack.enter_context(GrowingBag(self._destination))
            else:
                opened = open(self._destination, "w", encoding="utf-8", newline="")  # noqa: PTH123
                self._stream = self._stack.enter_context(opened)
        return self

    def __exit__(self, *_: object) -> None:
        self._stack.close()

    def add(self, row: segment_table.Table, mark: str = "") -> None:
        """Write a row, so that whoever reads has it."""
        crs = segment_table.reference_system(row, self._crs)
        row = {**row, **{one: ["true" if one == mark else "false"] for one in self._marks}}
        if self._bag:
            self._bag.add(segment_files.topics(row, crs, self._wheels))
            self._wheels |= dict.fromkeys(row["wheel"])
            return
        text = io.StringIO()
        write_text(normalise(row), text, self._kind, crs)
        # The names of the columns stand there once.
        again = self._kind == "csv" and self._begun
        assert self._stream is not None  # noqa: S101 - entered
        with explained(self._destination):
            self._stream.write(text.getvalue().partition("\n")[2] if again else text.getvalue())
            self._stream.flush()
        self._begun = True


def readable(row: segment_table.Table) -> str:
    """Say one row in a line, for a person."""

    def number(name: str, digits: int) -> str:
        value = float(np.asarray(row[name], dtype=float)[0])
        return "–" if np.isnan(value) else f"{value:.{digits}f}"

    return (
        f"{row['wheel'][0]}  segment {int(row['segment'][0])}  {number('t_start_s', 1)} to "
        f"{number('t_end_s', 1)} s  {int(row['n_samples'][0])} samples  c {number('c_kPa', 2)} ± "
        f"{number('c_se_kPa', 2)} kPa  φ {number('phi_deg', 1)} ± {number('phi_se_deg', 1)}°  "
        f"strength {number('strength_kPa', 2)} ± {number('strength_se_kPa', 2)} kPa  "
        f"{row['status'][0]} ({row['method'][0]})"
    )
