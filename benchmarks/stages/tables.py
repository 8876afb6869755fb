"""CSV and Parquet to columns: four of ten."""

from __future__ import annotations

import os
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

import formats
from benchmarks.harness import Case, Stage

if TYPE_CHECKING:
    from pathlib import Path

ROWS = {
    "csv": {"small": 30_000, "medium": 300_000, "full": 3_000_000},
    "parquet": {"small": 100_000, "medium": 1_000_000, "full": 10_000_000},
}
COLUMNS = ("time", "load", "torque", "sinkage", "slip", "current", "temperature", "x", "y", "yaw")
USED = ["load", "torque", "sinkage", "slip"]
#: Rows of a chunk of pandas: more and fewer are slower.
CHUNK = 100_000
ROOM = bytearray(1 << 20)


def write(kind: str, rows: int, folder: Path) -> Path:
    """Write a table of noisy sensors, if it is not there."""
    import pyarrow as pa
    from pyarrow import csv, parquet

    path = folder / f"table-{rows}.{kind}"
    if path.exists():
        return path
    part, step = path.with_suffix(".part"), 1_000_000
    writer = None
    for begin in range(0, rows, step):
        rng = np.random.default_rng(begin)
        n = min(step, rows - begin)
        batch = {"time": (begin + np.arange(n)) / 100.0}
        batch |= {name: np.round(rng.normal(10.0 * j, 1.0, n), 6) for j, name in enumerate(COLUMNS[1:], 1)}
        piece = pa.table(batch)
        if writer is None:
            writer = (
                csv.CSVWriter(part, piece.schema)
                if kind == "csv"
                else parquet.ParquetWriter(part, piece.schema)
            )
        writer.write_table(piece)
    writer.close()
    part.rename(path)
    return path


def columns(path: Path) -> dict[str, list[np.ndarray]]:
    """Read with terrain-est: the pieces of each column."""
    batches = list(formats.open_source(str(path)).read("", USED))
    return {name: [batch[name] for batch in batches] for name in USED}


def drained(path: Path) -> int:
    """Read with terrain-est, and keep nothing."""
    return sum(len(batch[USED[0]]) for batch in formats.open_source(str(path)).read("", USED))


def with_pandas_csv(path: Path) -> dict[str, np.ndarray]:
    import pandas as pd

    chunks = list(pd.read_csv(path, usecols=USED, chunksize=CHUNK))
    return {name: np.concatenate([chunk[name].to_numpy() for chunk in chunks]) for name in USED}


def with_pandas_parquet(path: Path) -> dict[str, np.ndarray]:
    import pandas as pd
    import pyarrow as pa

    # OMP_NUM_THREADS, which keeps BLAS to one thread, would keep Arrow's pool to one too.
    pa.set_cpu_count(os.cpu_count() or 1)
    frame = pd.read_parquet(path, columns=USED)
    return {name: frame[name].to_numpy() for name in USED}


def same(ours: dict, peer: dict) -> str:
    """Compare: pandas' parser of CSV rounds the last digit as it likes, ours does not."""
    worst = max(float(np.max(np.abs(np.concatenate(ours[n]) / peer[n] - 1.0))) for n in USED)
    if worst > 4.0 * np.finfo(float).eps:
        raise AssertionError(f"columns differ by {worst:.1e}")
    return f"largest relative difference {worst:.0e}"


def arrow(path: Path) -> int:
    """Read the columns with pyarrow, and do nothing with them."""
    from pyarrow import parquet

    with parquet.ParquetFile(path, pre_buffer=False, buffer_size=1 << 20) as file:
        return sum(len(batch) for batch in file.iter_batches(65_536, columns=USED))


def read(path: Path) -> int:
    """Read a file piece by piece: no program needs more memory for that, nor the time that memory takes."""
    with path.open("rb", buffering=0) as file:
        return sum(iter(lambda: file.readinto(ROOM), 0))


def make(kind: str, size: str, folder: Path) -> Case:
    """Make the case of CSV or Parquet."""
    rows = ROWS[kind][size]
    path = write(kind, rows, folder)
    peer = with_pandas_csv if kind == "csv" else with_pandas_parquet
    floor = partial(read, path) if kind == "csv" else partial(arrow, path)
    return Case(partial(columns, path), partial(peer, path), same, floor, rows, rows, "rows")


STAGES = (
    Stage("csv", "pandas read_csv, usecols, chunks", partial(make, "csv"), 1.0, 2.0),
    Stage("parquet", "pandas read_parquet, columns=", partial(make, "parquet"), 1.2, 1.5),
)
