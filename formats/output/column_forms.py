"""Columns in one common form, which every writer takes."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal, TypeAlias

import numpy as np

from formats.table import Labels

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray

Values: TypeAlias = "NDArray[Any] | Labels | Sequence[str | None] | Sequence[float | None]"


@dataclass(frozen=True, slots=True)
class Cells:
    """One column."""

    kind: Literal["real", "integer", "text"]
    #: float64 (NaN where empty), int64, or objects (str, None where empty); shape (n,).
    values: NDArray[Any]

    def objects(self, rows: slice = slice(None)) -> list[Any]:
        """Return cells as Python objects, None where empty."""
        cells = self.values[rows].tolist()
        # NaN is what differs from itself.
        return [None if cell != cell else cell for cell in cells] if self.kind == "real" else cells  # noqa: PLR0124


Table: TypeAlias = dict[str, Cells]


def normalise(columns: Mapping[str, Values]) -> Table:
    """Bring columns into one form."""
    table = {name: _cells(name, values) for name, values in columns.items()}
    if len({len(cells.values) for cells in table.values()}) > 1:
        lengths = ", ".join(f"{name} {len(cells.values)}" for name, cells in table.items())
        raise ValueError(f"columns of different length: {lengths}")
    return table


def _cells(name: str, values: Values) -> Cells:
    if isinstance(values, Labels):
        return Cells("text", np.array([*values.names, None], dtype=object)[values.codes])
    if not isinstance(values, np.ndarray):
        objects = np.empty(len(values), dtype=object)
        objects[:] = values
        if all(cell is None or isinstance(cell, str) for cell in objects):
            return Cells("text", objects)
        values = np.asarray([math.nan if cell is None else cell for cell in objects])
    if values.dtype.kind == "f":
        return Cells("real", values.astype(np.float64, copy=False))
    if values.dtype.kind in "iub":
        return Cells("integer", values.astype(np.int64, copy=False))
    raise TypeError(f"{name}: {values.dtype} is neither numbers nor text")
