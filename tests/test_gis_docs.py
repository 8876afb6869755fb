"""The commands of docs/gis.md, one after the other, as somebody follows the page."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from formats import output_kind
from terrain_cli.presentation import segment_files, segment_table

ROOT = Path(__file__).resolve().parent.parent
PAGE = (ROOT / "docs" / "gis.md").read_text("utf-8")
LINES = [
    line
    for block in re.findall(r"^```sh\n(.*?)^```", PAGE, re.MULTILINE | re.DOTALL)
    for line in block.splitlines()
]


@pytest.mark.real("ogr2ogr", "awk")
def test_commands_run(tmp_path, bin_folder):
    shutil.copytree(ROOT / "sample_data", tmp_path / "sample_data")
    # The python3 of the page is the one in which this package is installed.
    path = f"{bin_folder}:{Path(sys.executable).parent}:{os.environ['PATH']}"
    for line in LINES:
        done = subprocess.run(
            ["bash", "-euo", "pipefail", "-c", line],
            cwd=tmp_path,
            env={**os.environ, "PATH": path, "PYTHONPATH": str(ROOT)},
            capture_output=True,
            text=True,
            check=False,
        )
        assert done.returncode == 0, f"{line}\n{done.stderr}"
        if "geopandas" in line:
            assert done.stdout.startswith("Mars (2015) - Sphere / Ocentric\n")
            assert "LINESTRING (137.4" in done.stdout
    written = {name for line in LINES for name in re.findall(r"soil\.(?!crs)\w+|\w+\.gpkg", line)}
    assert written <= {file.name for file in tmp_path.iterdir()}
    assert len(written) >= 7


def test_the_table_of_endings_is_complete():
    table = PAGE.partition("| ending |")[2].partition("\n\n")[0]
    endings = re.findall(r"`(\.\w+)`", "".join(row.split("|")[1] for row in table.splitlines()[2:]))
    for ending in endings:
        segment_files.check(f"soil{ending}")
    kinds = {output_kind(f"soil{ending}") for ending in endings if ending != ".mcap"}
    assert kinds == {"csv", "parquet", "json", "geojson", "geojsonl", "geojsons", "gpkg"}


def test_the_columns_of_samples_are_those_of_the_page():
    listed = re.findall(r"`(\w+)`", PAGE.partition("Columns: ")[2].partition("\n\n")[0])
    own = [*segment_table._SAMPLE_COLUMNS.values()]
    assert listed == ["source", "wheel", "segment", "sample", "time_s", *own, "WKT"]
    for layer, columns in segment_files.STYLES.items():
        assert set(columns) <= set(segment_table.COLUMNS if layer == "segments" else listed)
        for column in columns:
            assert f"`{column}`" in PAGE
