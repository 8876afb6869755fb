"""No file that is there already is replaced, unless `--force` says so."""

from __future__ import annotations

from pathlib import Path

import pytest
from wheel_table import ROVER

import formats
from terrain_cli.app import main


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "rover.toml").write_text(ROVER)
    return tmp_path


@pytest.fixture
def run(folder, capfd):
    def run(*args):
        with pytest.raises(SystemExit) as end:
            main(list(args))
        return end.value.code, capfd.readouterr().err

    return run


@pytest.mark.parametrize(
    "args",
    [
        ("simulate", "-q", "--duration", "2", "-o", "old.csv"),
        ("simulate", "-q", "--duration", "2", "-o", "x.csv", "--truth", "old.csv"),
        ("simulate", "-q", "--duration", "2", "-o", "x.csv", "--rover", "old.csv"),
        ("simulate", "-q", "--duration", "9", "-o", "x.csv", "--hide", "--truth", "old.csv"),
        ("model", "new", "old.csv"),
    ],
)
def test_a_file_that_is_there(run, args):
    Path("old.csv").write_text("old")
    code, err = run(*args)
    assert (code, err) == (73, "terrain-est: old.csv: is there already\n  --force replaces it\n")
    assert Path("old.csv").read_text() == "old"
    assert not Path("x.csv").exists()
    assert run(*args, "--force") == (0, "")
    assert Path("old.csv").read_text() != "old"


def test_what_is_open_already_is_not_replaced(folder):
    with Path("old.csv").open("w") as file:
        formats.check_free(f"/dev/fd/{file.fileno()}")


def test_a_sealed_file_that_nobody_named(run):
    Path("x.csv.sealed.json").write_text("old")
    code, err = run("simulate", "-o", "x.csv", "--hide")
    assert code == 73
    assert "x.csv.sealed.json: is there already" in err
    assert not Path("x.csv").exists()


def test_no_folder_is_replaced(run):
    Path("x.mcap").mkdir()
    Path("x.mcap/other.txt").write_text("x")
    code, err = run("simulate", "-q", "-o", "x.mcap/", "--force")
    assert (code, err) == (
        73,
        "terrain-est: x.mcap/: is there already\n  remove it, or name another: no folder is replaced\n",
    )
    assert Path("x.mcap/other.txt").read_text() == "x"
