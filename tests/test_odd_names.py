"""Files whose names are no text: read as any other, and told in a form that is text."""

from __future__ import annotations

import csv
import json
import os
import shutil
import sqlite3
from pathlib import Path

import missions
import pyarrow.parquet as pq
import pytest

from terrain_cli.app import main
from terrain_cli.batch import batch_run as batches

SAMPLE = Path(__file__).resolve().parent.parent / "sample_data"


@pytest.fixture
def run(tmp_path, monkeypatch, capfd):
    """Return a function that runs the command in a folder with the sample drive under such names."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("TERRAIN_EST_METHOD", missions.METHOD)
    monkeypatch.setattr(batches, "LocalPool", missions.Inline)
    folder = odd(b"d\xe9j\xe0")
    folder.mkdir()
    for name in ("run.csv", "run.bag", "run.mcap", "run.parquet"):
        shutil.copy(SAMPLE / name, folder / odd(b"\xff" + name.encode()))
    shutil.copy(SAMPLE / "rover.toml", folder)

    def run(*args):
        with pytest.raises(SystemExit) as end:
            main([str(arg) for arg in args])
        captured = capfd.readouterr()
        for text in captured:
            text.encode()
            assert "unexpected" not in text
        return end.value.code, captured.out, captured.err

    return run


def odd(name):
    return Path(os.fsdecode(name))


def log(ending):
    return odd(b"d\xe9j\xe0/\xffrun." + ending.encode())


ENDINGS = ("csv", "bag", "mcap", "parquet")
SHOWN = r"d\xe9j\xe0/\xffrun."


@pytest.mark.parametrize("ending", ENDINGS)
def test_estimate(run, ending):
    code, out, err = run("estimate", log(ending), "--summary", "soil.json")
    assert code == 0
    rows = list(csv.DictReader(out.splitlines()))
    assert {row["source"] for row in rows} == {SHOWN + ending}
    assert SHOWN + ending in err
    assert json.loads(Path("soil.json").read_text())["inputs"][0]["source"] == SHOWN + ending


def test_every_kind_of_output(run):
    for kind in ("parquet", "gpkg", "geojson", "json", "mcap"):
        assert run("estimate", log("csv"), "-q", "-o", f"soil.{kind}")[0] == 0
    assert set(pq.read_table("soil.parquet")["source"].to_pylist()) == {SHOWN + "csv"}
    with sqlite3.connect("soil.gpkg") as base:
        assert base.execute("select distinct source from segments").fetchall() == [(SHOWN + "csv",)]
    base.close()


@pytest.mark.parametrize("ending", ENDINGS)
def test_inspect(run, ending):
    code, out, _ = run("inspect", log(ending))
    assert code == 0
    assert out.startswith(SHOWN + ending)
    (entry,) = json.loads(run("inspect", log(ending), "--json")[1])["inputs"]
    assert (entry["source"], entry["rover"]) == (SHOWN + ending, r"d\xe9j\xe0/rover.toml")


def test_compare(run):
    code, out, _ = run("compare", log("csv"), "--json", "--segments", "none", "--model", "linear")
    assert code == 0
    assert json.loads(out)["data"]["sources"] == [SHOWN + "csv"]


@pytest.mark.parametrize("verb", ["inspect", "estimate"])
def test_what_is_wrong_is_told_by_the_name(run, verb):
    log("bag").write_bytes(log("bag").read_bytes()[:100_000])
    log("csv").write_text("")
    assert run(verb, log("bag"))[2].startswith(f"terrain-est: {SHOWN}bag: cut off")
    assert run(verb, log("csv"))[2] == f"terrain-est: {SHOWN}csv: is empty\n"
    code, _, err = run(verb, odd(b"no\xff.csv"))
    assert (code, err) == (66, "terrain-est: no\\xff.csv: no such file or folder\n")


def test_batch(run):
    log("mcap").write_bytes(log("mcap").read_bytes()[:100_000])
    code, _, err = run("batch", odd(b"d\xe9j\xe0"), "-o", "out")
    assert code == 75
    assert f"failed (65): {SHOWN}mcap: cut off" in err
    lines = {line["path"]: line for line in missions.manifest("out")}
    assert set(lines) == {SHOWN + ending for ending in ENDINGS}
    assert Path(lines[SHOWN + "csv"]["location"]).exists()
    table = Path("out", lines[SHOWN + "bag"]["result"])
    assert set(pq.read_table(table)["source"].to_pylist()) == {SHOWN + "bag"}
    assert run("batch", odd(b"d\xe9j\xe0"), "-o", "out", "--dry-run")[1] == ""


def test_names_of_outputs(run):
    for ending in ("csv", "parquet", "gpkg"):
        assert run("estimate", log("csv"), "-q", "-o", odd(b"\xff." + ending.encode()))[0] == 0
        assert odd(b"\xff." + ending.encode()).stat().st_size > 0
    code, _, err = run("estimate", log("csv"), "-q", "-o", odd(b"d\xe9j\xe0/soil.parquet"))
    assert (code, err.partition(": ")[2]) == (
        73,
        "d\\xe9j\\xe0/soil.parquet: a file of this kind needs a path that is text (UTF-8)\n",
    )
    code, _, err = run("batch", log("csv"), "-o", odd(b"out\xff"))
    assert code == 73
    assert "out\\xff: the folder of a batch needs a path that is text" in err
