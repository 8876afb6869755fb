"""The program as a whole process: from a bag to a table, from Parquet to a table, and its help."""

from __future__ import annotations

import os
import subprocess
import sys
from functools import partial
from pathlib import Path

import numpy as np

from benchmarks import rover_bag
from benchmarks.harness import ROOT, Case, Stage, inputs_folder
from benchmarks.stages import bags

#: Changes of soil this many seconds beside the true ones are found.
TOLERANCE = 1.0
PARQUET_ROWS = {"small": 100_000, "medium": 1_000_000, "full": 100_000_000}


#: Where the program is that is measured: `benchmarks.compare` measures that of another folder.
TREE = Path(os.environ.get("TERRAIN_EST_TREE", ROOT))


def run(*command: str) -> str:
    """Run a command, its modules compiled before as those of installed programs are; return what it says."""
    compiled = {"PYTHONDONTWRITEBYTECODE": "", "PYTHONPYCACHEPREFIX": str(inputs_folder() / "compiled")}
    return subprocess.run(
        command, cwd=TREE, env=os.environ | compiled, check=True, capture_output=True, text=True
    ).stdout


def program(*arguments: str) -> str:
    """Run terrain-est as a process."""
    return run(sys.executable, "-m", "terrain_cli", *arguments)


def rows(csv: str) -> dict[str, np.ndarray]:
    """Return the columns of a table in CSV."""
    import csv as reader
    import io

    found = list(reader.DictReader(io.StringIO(csv)))
    return {name: np.array([row[name] for row in found]) for name in found[0]}


def same_soils(ours: str, peer: str) -> str:
    """Compare the windows' starts with the truth, and c and φ of each wheel and soil."""
    a, b = rows(ours), rows(peer)
    seconds = float(a["t_end_s"].astype(float).max()) - rover_bag.START / 1e9
    truth = np.arange(1, len(rover_bag.SOILS)) * seconds / len(rover_bag.SOILS)
    worst = 0.0
    for wheel in rover_bag.WHEELS:
        lines = []
        for table in (a, b):
            mine = table["wheel"] == wheel
            starts = table["t_start_s"][mine].astype(float) - rover_bag.START / 1e9
            if len(starts) != len(rover_bag.SOILS) or np.abs(starts[1:] - truth).max() > TOLERANCE:
                raise AssertionError(f"{wheel}: windows from {starts}, soils change at {truth}")
            lines.append(np.array([table["c_ls_kPa"][mine], table["phi_ls_deg"][mine]], dtype=float))
        worst = max(worst, float(np.abs(lines[0][1] - lines[1][1]).max()))
    if worst > 0.2:
        raise AssertionError(f"φ differs by {worst:.2f}°")
    return f"both find the {len(truth)} changes under each wheel; φ differs by {worst:.2f}° at most"


def estimate(size: str, folder: Path) -> Case:
    """Make the case of a bag; at full size ten minutes, and never so short that soils are not found."""
    path = bags.path_of(("ros1", "none"), "full" if size == "full" else "medium", folder)
    # The peer fits a line too.
    arguments = (str(path), "--rover", str(path.parent / "rover.toml"), "--method", "least-squares")
    return Case(
        partial(program, "estimate", *arguments),
        partial(run, sys.executable, "-m", "benchmarks.peer_estimate", str(path)),
        same_soils,
        unit="process",
        processes=True,
    )


def drive_table(count: int, folder: Path) -> Path:
    """Write a drive of many samples as Parquet, if it is not there."""
    import pyarrow as pa
    from pyarrow import parquet

    path = folder / f"drive-{count}.parquet"
    if path.exists():
        return path
    part, step, writer = path.with_suffix(".part"), 200_000, None
    truth = rover_bag.drive(step / 100.0, 100.0)
    for begin in range(0, count, step):
        n = min(step, count - begin)
        batch = {"time_s": (begin + np.arange(n)) / 100.0, "velocity_mps": truth["speed"][:n]}
        batch |= {
            f"{name}_{unit}": truth[name][:n, 0]
            for name, unit in (
                ("load", "N"),
                ("torque", "Nm"),
                ("sinkage", "m"),
                ("angular_velocity", "radps"),
            )
        }
        piece = pa.table(batch)
        writer = writer or parquet.ParquetWriter(part, piece.schema)
        writer.write_table(piece)
    writer.close()
    part.rename(path)
    (folder / "rover.toml").write_text(rover_bag.ROVER.partition("[wheels")[0], encoding="utf-8")
    return path


def parquet_estimate(size: str, folder: Path) -> Case:
    """Make the case of a long Parquet file."""
    count = PARQUET_ROWS[size]
    path = drive_table(count, folder)

    def check(ours, _):
        samples = rows(ours)["n_samples"].astype(float).sum()
        if samples < 0.99 * count:
            raise AssertionError(f"{samples:.0f} of {count} samples in the table")
        return f"{samples:,.0f} samples in the table"

    return Case(
        partial(
            program,
            *("estimate", str(path), "--segments", "auto", "--rover", str(folder / "rover.toml")),
            *("--method", "least-squares"),
        ),
        partial(run, sys.executable, "-c", READ, str(path)),
        check,
        None,
        count,
        count,
        "rows",
        processes=True,
    )


#: The read alone: all columns, whatever is done with them.
READ = """
import sys
from pyarrow import parquet
with parquet.ParquetFile(sys.argv[1], pre_buffer=False, buffer_size=1 << 20) as file:
    for batch in file.iter_batches(65536):
        [column.to_numpy(zero_copy_only=False) for column in batch.columns]
"""


def help_text(size: str, folder: Path) -> Case:  # noqa: ARG001 - every stage is made so
    """Make the case of the help."""

    def check(ours, _):
        if "estimate" not in ours:
            raise AssertionError("no help")
        return "the help is printed"

    return Case(
        partial(program, "--help"),
        partial(run, sys.executable, "-c", "import click"),
        check,
        partial(run, sys.executable, "-c", ""),
        unit="process",
        processes=True,
    )


STAGES = (
    Stage(
        "estimate bag",
        "AnyReader, pandas, ruptures, sklearn: benchmarks/peer_estimate.py",
        estimate,
        8.0,
        18.0,
        rounds=3,
        at="full",
    ),
    Stage(
        "estimate parquet",
        "reading the file alone",
        parquet_estimate,
        4.0,
        2.5,
        within=True,
        rounds=3,
        at="full",
    ),
    Stage("help", "python -c 'import click'", help_text, 1.5, 1.15, within=True),
)
