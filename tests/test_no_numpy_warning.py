"""Data that no wheel leaves: what comes of them is said in words, and never as a warning of numpy's.

Warnings are errors in the tests, and an error that is none of the program's own ends with 1.
"""

from __future__ import annotations

import numpy as np
import pytest
from wheel_table import HEADER, ROVER, good, text

#: Samples: all that is odd is in a few of them.
ROWS = 60
#: Of a velocity all the same: a wheel that turns in place, slow for the full model, which meets 5e-324.
STILL = (1e-12, 1e-29, 0.0)
EDGE = (1.7e308, 1e305, -1e305, 1e29, 1e12, 1e-12, 1e-29, 5e-324, 0.0, np.inf, np.nan)
LINE = (
    ("estimate", "t.csv", "--summary", "s.json", "-o", "o.csv"),
    ("estimate", "t.csv", "--method", "least-squares", "--segments", "none"),
    ("estimate", "t.csv", "--method", "recursive", "--trace", "trace.csv"),
    ("estimate", "t.csv", "--method", "ridge", "--segments", "fixed", "--window-samples", "3"),
    ("inspect", "t.csv"),
)
WHOLE = (
    ("estimate", "t.csv", "--method", "wong-reece", "--segments", "none", "--robust"),
    ("compare", "t.csv", "--segments", "none"),
    ("compare", "t.csv", "--model", "linear", "--segments", "none"),
)


def drive():
    """Return the columns of a table that is as it should be."""
    table = np.array(good()[:ROWS], dtype=float)
    return dict(zip(HEADER, table.T.copy(), strict=True))


def changed(**columns):
    return drive() | {name: np.full(ROWS, value) for name, value in columns.items()}


def first(rows):
    return {name: column[:rows] for name, column in drive().items()}


def still(**columns):
    """Return a table whose rows are all the same."""
    return {name: np.full(ROWS, column[1]) for name, column in drive().items()} | columns


ODD = {
    "constant": still(time=drive()["time"]),
    "time that stands still": still(),
    "no time": {name: column for name, column in still().items() if name != "time"},
    "zero": {name: np.zeros(ROWS) for name in HEADER},
    "no row": first(0),
    "one row": first(1),
    "two rows": first(2),
    "slip 0": changed() | {"velocity": 0.125 * drive()["angular_velocity"]},
    "slip 1": changed(velocity=0.0),
    "slip said to be 1": changed(slip=1.0),
    "load below zero": changed() | {"load": -drive()["load"]},
    "torque zero": changed(torque=0.0),
    "a wheel that stands": changed(angular_velocity=0.0),
    "everything at 1e305": {name: np.full(ROWS, 1e305) for name in HEADER},
    "everything at 5e-324": {name: np.full(ROWS, 5e-324) for name in HEADER},
}


@pytest.fixture
def check(tmp_path, terrain_est_here):
    """Return a function that writes a table and runs commands on it."""
    (tmp_path / "rover.toml").write_text(ROVER)

    def check(columns, *commands, codes=(0, 65)):
        rows = zip(*columns.values(), strict=True)
        (tmp_path / "t.csv").write_text(text([[repr(float(x)) for x in row] for row in rows], columns))
        for command in commands:
            done = terrain_est_here(*command, cwd=tmp_path)
            assert done.returncode in codes, (command, done.stderr)
            assert "Warning" not in done.stderr, (command, done.stderr)

    return check


def test_a_warning_within_a_command_would_be_seen(check, monkeypatch):
    def numbers(*_):
        return np.divide(1.0, np.zeros(1))

    monkeypatch.setattr("terrain_cli.telemetry.plausibility.found", numbers)
    with pytest.raises(AssertionError, match="unexpected RuntimeWarning"):
        check(drive(), LINE[0])


@pytest.mark.parametrize("name", HEADER)
def test_sizes_that_nothing_has(check, name):
    for value in EDGE:
        by_line = (name == "velocity" and value in STILL) or (name, value) == ("torque", 0.0)
        check(changed(**{name: value}), LINE[1 if by_line else 0], LINE[4])
        some = drive()
        some[name][3::7] = value
        check(some, LINE[1], LINE[4])


@pytest.mark.parametrize("odd", ODD)
def test_odd_tables_by_the_line(check, odd):
    # To the full model, a wheel at 5e-324 m/s slips by 1 too.
    check(ODD[odd], *LINE[odd == "slip 1" :])


@pytest.mark.parametrize("odd", ["constant", "torque zero", "two rows"])
def test_odd_tables_by_the_whole_model(check, odd):
    check(ODD[odd], *WHOLE)


def test_odd_tables_in_pages_pictures_and_folders(check):
    page = ("report", "t.csv", "--segments", "none", "--model", "linear", "-o", "r.html")
    check(ODD["time that stands still"], page)
    check(ODD["torque zero"], ("estimate", "t.csv", "--plot", "pictures", "-o", "soil.gpkg"))
    check(ODD["torque zero"], ("batch", "t.csv", "-o", "all"), codes=(0, 75))


def test_odd_tables_are_diagnosed_and_tried(check):
    check(
        ODD["slip said to be 1"],
        ("model", "new", "m.toml", "--base", "linear"),
        ("diagnose", "t.csv", "--segments", "none"),
        ("model", "add", "m.toml", "load-bias", "--segments", "none", "--data", "t.csv"),
    )
