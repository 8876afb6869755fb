"""A batch over whole and damaged inputs, with and without --salvage, and from one to the other."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import missions
import pyarrow.parquet as pq
import pytest

from formats.recovery import HINT
from terrain_cli.app import main
from terrain_cli.batch import batch_run as batches

SAMPLE = Path(__file__).resolve().parent.parent.parent / "sample_data"
ENDINGS = ("bag", "mcap", "db3", "csv")
CUT = [f"in/cut.{ending}" for ending in ENDINGS]


def as_db3(mcap, target):
    """Write the messages of an MCAP file into a rosbag2 database."""
    from rosbags.highlevel import AnyReader
    from rosbags.rosbag2 import StoragePlugin, Writer

    folder = target.parent / "recording"
    writer = Writer(folder, version=9, storage_plugin=StoragePlugin.SQLITE3)
    with AnyReader([mcap]) as reader, writer:
        copies = {
            one.id: writer.add_connection(one.topic, one.msgtype, typestore=reader.typestore)
            for one in reader.connections
        }
        for one, time, data in reader.messages():
            writer.write(copies[one.id], time, data)
    next(folder.glob("*.db3")).rename(target)
    shutil.rmtree(folder)


@pytest.fixture(scope="module")
def logs(tmp_path_factory):
    """Make the sample drive of each kind, whole and cut off after two thirds."""
    folder = tmp_path_factory.mktemp("logs")
    for name in ("rover.toml", "run.bag", "run.mcap", "run.csv", "run.parquet"):
        shutil.copy(SAMPLE / name, folder)
    as_db3(folder / "run.mcap", folder / "run.db3")
    for ending in (*ENDINGS, "parquet"):
        data = (folder / f"run.{ending}").read_bytes()
        (folder / f"cut.{ending}").write_bytes(data[: len(data) * 2 // 3])
    return folder


@pytest.fixture
def run(logs, tmp_path, monkeypatch, capfd):
    """Return a function that runs the command beside the logs, and returns exit code, stdout and stderr."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("TERRAIN_EST_METHOD", missions.METHOD)
    monkeypatch.setattr(batches, "LocalPool", missions.Inline)
    shutil.copytree(logs, "in")

    def run(*args, verb="batch"):
        with pytest.raises(SystemExit) as end:
            main([verb, *(("in", "-o", "out") if verb == "batch" else ()), *args])
        captured = capfd.readouterr()
        assert "Traceback" not in captured.err
        return end.value.code, captured.out, captured.err

    return run


def reasons(out):
    return {path: why for why, path in (line.split("\t") for line in out.splitlines())}


def test_without_it_they_fail_alone_with_the_hint(run):
    code, _, err = run()
    assert code == 75
    assert err.splitlines()[-7].startswith("5 done, 5 failed")
    lines = missions.by_path()
    for path in CUT:
        assert (lines[path]["status"], lines[path]["exit_code"]) == ("failed", 65)
        assert HINT in lines[path]["hint"]
    assert "--salvage cannot help" in lines["in/cut.parquet"]["hint"]
    assert all(line["recovered_of"] is None for line in lines.values())


def test_what_was_saved_is_in_the_manifest_and_the_summary(run):
    code, _, err = run("--salvage")
    assert code == 75
    assert [line for line in err.splitlines() if line.startswith("failed")] == [
        f"failed (65): {missions.by_path()['in/cut.parquet']['error']}"
    ]
    accounts = {
        entry["source"]: entry for entry in json.loads(Path("out/summary.json").read_text())["inputs"]
    }
    for path in CUT:
        line, salvage = missions.by_path()[path], accounts[path]["salvage"]
        assert line["status"] == "ok"
        assert 0.5 < line["recovered"] < 1.0
        assert (line["recovered"], line["recovered_of"]) == (salvage["fraction"], salvage["fraction_of"])
        assert line["warnings"][0] == f"damaged: {salvage['damage'][0]}"
        assert line["warnings"] == accounts[path]["wheels"][0]["remarks"]
        share = f"{100 * min(line['recovered'], 0.999):.1f} % of {line['recovered_of']}"
        assert f"salvaged ({share}): {path}" in err
        run(path, "--salvage", "-q", "-o", "alone.parquet", verb="estimate")
        assert Path("out", line["result"]).read_bytes() == Path("alone.parquet").read_bytes()
    for ending in (*ENDINGS, "parquet"):
        line = missions.by_path()[f"in/run.{ending}"]
        assert (line["status"], line["recovered"], line["recovered_of"]) == ("ok", None, None)


def test_added_later_only_the_damaged_are_done_again(run):
    run()
    before = missions.by_path()
    damaged = [*CUT, "in/cut.parquet"]
    assert reasons(run("--salvage", "--dry-run")[1]) == dict.fromkeys(damaged, "other options")
    run("--salvage")
    after = missions.by_path()
    assert {path for path in after if after[path] != before[path]} == set(damaged)
    assert run("--salvage", "--dry-run")[1] == ""
    table = Path("out/segments.parquet").read_bytes()
    shutil.rmtree("out")
    run("--salvage")
    assert Path("out/segments.parquet").read_bytes() == table


def test_left_out_again_they_fail_again(run):
    run("--salvage")
    whole = {f"in/run.{ending}" for ending in (*ENDINGS, "parquet")}
    assert set(reasons(run("--dry-run")[1])) == {*CUT, "in/cut.parquet"}
    run()
    assert {path for path, line in missions.by_path().items() if line["status"] == "ok"} == whole
    assert set(pq.read_table("out/segments.parquet")["source"].to_pylist()) == whole
    # What was saved then is not computed again.
    assert "\n4 known already, 5 as before, 1 failed" in f"\n{run('--salvage')[2]}"


@pytest.mark.parametrize("first", [(), ("--salvage",)])
def test_copies(run, first):
    for kind in ("run", "cut"):
        shutil.copy(f"in/{kind}.mcap", f"in/{kind}.copy.mcap")
    run(*first)
    then = () if first else ("--salvage",)
    # Beside those, one of a name that sorts before and one behind.
    for kind in ("run", "cut"):
        shutil.copy(f"in/{kind}.mcap", f"in/a.{kind}.mcap")
        shutil.copy(f"in/{kind}.mcap", f"in/z.{kind}.mcap")
    run(*then)
    assert run(*then, "--dry-run")[1] == ""
    # Of each content one was done.
    done = [line["sha256"] for line in missions.by_path().values() if line["status"] == "ok"]
    assert len(done) == len(set(done))
    table = Path("out/segments.parquet").read_bytes()
    shutil.rmtree("out")
    run(*then)
    assert Path("out/segments.parquet").read_bytes() == table


def test_a_whole_file_that_is_only_touched_is_not_computed_again(run):
    run("--format", "csv")
    Path("in/run.csv").touch()
    assert "\n4 done, 1 known already" in f"\n{run('--salvage', '--format', 'csv')[2]}"
