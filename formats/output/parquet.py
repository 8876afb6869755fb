"""Parquet."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

if TYPE_CHECKING:
    from formats.output.table import Table

_TYPES = {"real": pa.float64(), "integer": pa.int64(), "text": pa.string()}


def write_parquet(table: Table, path: str) -> None:
    """Write a table as Parquet; empty cells are null.

    Parameters
    ----------
    table : dict of str to Cells
    path : str
    """
    arrays = {
        name: pa.array(
            cells.values, _TYPES[cells.kind], mask=np.isnan(cells.values) if cells.kind == "real" else None
        )
        for name, cells in table.items()
    }
    pq.write_table(pa.table(arrays), path)
