"""The same drive gives the same table, whatever file it comes in."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from terrain_cli import rover
from terrain_cli.presentation.segment_table import COLUMNS
from terrain_cli.run import one_log
from terrain_cli.run.settings import Settings

SAMPLE = Path(__file__).parent.parent / "sample_data"


@pytest.fixture(scope="module")
def reference():
    return table("run.csv")


def table(name):
    path = SAMPLE / name
    return one_log.run(str(path), rover.load(SAMPLE / "rover.toml"), Settings()).table


def test_the_columns_are_those_of_the_contract(reference):
    assert list(reference) == list(COLUMNS)
    assert len(reference["wheel"]) > 2


@pytest.mark.parametrize("name", ["run.parquet", "run.bag", "run.mcap"])
def test_same_drive_same_table(reference, name):
    other = table(name)
    for column, expected in reference.items():
        if column == "source":
            continue
        if isinstance(expected, list):
            assert other[column] == expected, column
        else:
            np.testing.assert_allclose(other[column], expected, rtol=1e-9, atol=1e-9, err_msg=column)
