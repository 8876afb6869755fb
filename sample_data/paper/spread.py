"""Print the truth of each soil beside mean ± spread of its estimates.

python spread.py DRIVE.toml TABLE.csv…: the soils of a drive file, and what tables of `terrain-est estimate`
say of the logs that are named after them.
"""

from __future__ import annotations

import sys
import tomllib
from pathlib import Path

import pandas as pd


def main(drive: Path, tables: list[Path]) -> None:
    """Print c, φ and k of every soil, and how many of the estimates are to be used as they are."""
    soils = tomllib.loads(drive.read_text("utf-8"))["soils"]
    estimates = {path.stem: pd.read_csv(path) for path in tables}
    for label, column, key, scale in (
        ("c [kPa]", "c_kPa", "cohesion", 1e-3),
        ("φ [°]", "phi_deg", "phi_deg", 1.0),
        ("k [mm]", "k_mm", "shear_modulus", 1e3),
    ):
        row(label, "truth", list(estimates))
        for soil, truth in soils.items():
            cells = [spread(table, soil, column) for table in estimates.values()]
            row(soil, f"{truth[key] * scale:.2f}", cells)
        print()
    row("status ok", "", list(estimates))
    for soil in soils:
        of_soil = [of(table, soil)["status"] for table in estimates.values()]
        row(soil, "", [f"{(status == 'ok').sum()} of {len(status)}" for status in of_soil])


def row(first: str, truth: str, cells: list[str]) -> None:
    """Print one line of the table."""
    print(f"{first:17}  {truth:>5}  {'  '.join(f'{cell:22}' for cell in cells)}".rstrip())


def of(table: pd.DataFrame, soil: str) -> pd.DataFrame:
    """Return the estimates from the log of a soil."""
    return table[[Path(source).stem == soil for source in table["source"]]]


def spread(table: pd.DataFrame, soil: str, column: str) -> str:
    """Return mean ± standard deviation, and of how many where the data do not always tell."""
    values = of(table, soil)[column]
    told = values.dropna()
    few = f" ({len(told)} of {len(values)})" if len(told) < len(values) else ""
    return f"{told.mean():.2f} ± {told.std():.2f}{few}"


if __name__ == "__main__":
    main(Path(sys.argv[1]), [Path(name) for name in sys.argv[2:]])
