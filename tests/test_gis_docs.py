"""The commands of docs/gis.md, one after the other, as somebody follows the page."""

from __future__ import annotations

import re

import pages
import pytest

from formats import output_kind
from terrain_cli.presentation import segment_files, segment_table

PAGE = pages.text_of("gis.md")


@pytest.mark.real("ogr2ogr", "awk")
def test_commands_run(tmp_path, bin_folder, terrain_est_here):
    # The python3 of the page is the one in which this package is installed.
    outputs, _ = pages.run(PAGE, tmp_path, bin_folder, terrain_est_here)
    (shown,) = (text for line, text in outputs.items() if "geopandas" in line)
    assert shown.startswith("Mars (2015) - Sphere / Ocentric\n")
    assert "LINESTRING (137.4" in shown
    written = {name for line in outputs for name in re.findall(r"soil\.(?!crs)\w+|\w+\.gpkg", line)}
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
