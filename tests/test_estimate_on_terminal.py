"""`terrain-est estimate` on a terminal, which shows a table to read, and into a pipe, which gets CSV."""

from __future__ import annotations

import csv
import io

import pytest
from terminals import on_terminal
from wheel_table import ROVER, good, text

from terrain_cli.presentation.segment_table import COLUMNS

FIRST = f"{COLUMNS[0]},{COLUMNS[1]},"
LINE = "c [kPa]"


@pytest.fixture
def log(tmp_path, monkeypatch):
    (tmp_path / "rover.toml").write_text(ROVER)
    (tmp_path / "run.csv").write_text(text(good()))
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("TERRAIN_EST_METHOD", "least-squares")
    return "run.csv"


@pytest.fixture
def shown(log, tmp_path, bin_folder):
    """Return a function that gives what a terminal shows, and what goes to the standard error beside it."""

    def run(*args, code=0):
        with (tmp_path / "stderr").open("w+") as stderr:
            text = on_terminal([bin_folder / "terrain-est", "estimate", log, *args], stderr=stderr, code=code)
            stderr.seek(0)
            return text.replace("\r\n", "\n"), stderr.read()

    return run


@pytest.mark.parametrize("quiet", [(), ("--quiet",)])
def test_a_terminal_shows_the_table_to_read_once_and_no_csv(shown, quiet):
    out, err = shown(*quiet)
    assert out.count(LINE) == 1
    assert FIRST not in out
    assert "LINESTRING" not in out
    assert err == ""


def test_csv_can_be_asked_for(shown, terrain_est_here, log):
    out, err = shown("--csv")
    piped = terrain_est_here("estimate", log)
    assert out == piped.stdout
    assert err == piped.stderr
    (row,) = csv.DictReader(io.StringIO(out))
    assert tuple(row) == COLUMNS
    assert LINE in err
    assert shown("-o", "-")[0] == piped.stdout


def test_a_file_takes_the_csv_and_the_table_is_shown_once(shown, tmp_path, terrain_est_here, log):
    out, err = shown("-o", "soil.csv")
    assert (out, err.count(LINE)) == ("", 1)
    assert (tmp_path / "soil.csv").read_text() == terrain_est_here("estimate", log).stdout
    assert shown("-o", "soil.csv", "--quiet") == ("", "")


def test_a_pipe_gets_csv_alone(terrain_est, log):
    done = terrain_est("estimate", log, "--quiet")
    assert done.stdout.startswith(FIRST)
    assert LINE not in done.stdout
    assert done.stderr == ""


def test_csv_beside_a_file_is_wrong_use(terrain_est_here, log):
    done = terrain_est_here("estimate", log, "--csv", "-o", "soil.csv")
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr.startswith("terrain-est: --csv and -o both say where the table goes")


def test_samples_are_written_beside_the_table_to_read(shown, tmp_path):
    out, _ = shown("--samples", "samples.csv")
    assert LINE in out
    assert (tmp_path / "samples.csv").read_text().count("\n") > 2
