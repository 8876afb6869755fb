"""`terrain-est batch` as people run it: what it says, and what it ends with."""

from __future__ import annotations

import fcntl
import json
import os
import subprocess
import sys
from pathlib import Path

import missions
import pyarrow.parquet as pq
import pytest
from wheel_table import HEADER, ROVER, good, text

from terrain_cli.app import main
from terrain_cli.batch import batch_run as batches
from terrain_cli.batch.coordinator import Tally
from terrain_cli.batch.worker_tasks import Order
from terrain_cli.commands import batch, estimate
from terrain_cli.commands import batch as command

ROOT = Path(__file__).resolve().parent.parent

FILES = ("csv", "summary", "rejects", "trace", "plot", "posterior", "samples")


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """Work beside a folder of three inputs, one of which is empty."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("TERRAIN_EST_METHOD", missions.METHOD)
    Path("in").mkdir()
    Path("in/rover.toml").write_text(ROVER)
    for name, rows in (("a", good()), ("b", good()[:100])):
        Path(f"in/{name}.csv").write_text(text(rows))
    Path("in/empty.csv").write_text("")
    return tmp_path


@pytest.fixture
def run(folder, capfd, monkeypatch):
    """Return a function that runs the command here and returns exit code, stdout and stderr.

    Its workers do not take processes of their own, which take a second to start.
    """
    monkeypatch.setattr(batches, "LocalPool", missions.Inline)

    def run(*args, verb="batch"):
        with pytest.raises(SystemExit) as end:
            main([verb, *map(str, args)])
        captured = capfd.readouterr()
        assert "Traceback" not in captured.err
        return end.value.code, captured.out, captured.err

    return run


def test_a_batch_and_once_more(run):
    code, out, err = run("in", "-o", "out", "--jobs", "2")
    assert (code, out) == (75, "")
    first, failed, hint = err.splitlines()[-3:]
    assert first.startswith("2 done, 1 failed · ")
    assert failed == "failed (65): in/empty.csv: is empty"
    assert hint == "  hints: out/manifest.jsonl; --retry-failed tries again what has not changed"
    assert {path.name for path in Path("out").iterdir()} == {
        *("manifest.jsonl", "segments.parquet", "summary.json", "results", "configurations", ".state")
    }
    code, out, err = run("in", "-o", "out", "--quiet")
    assert (code, out, err) == (75, "", "failed (65): in/empty.csv: is empty\n")
    code, out, err = run("in/a.csv", "-o", "out")
    assert (code, out) == (0, "")
    assert err.startswith("1 as before · ")


def test_dry_run(run):
    code, out, _ = run("in", "-o", "out", "--dry-run")
    assert (code, out) == (0, "new\tin/a.csv\nnew\tin/b.csv\nnew\tin/empty.csv\n")
    assert not Path("out").exists()
    run("in", "-o", "out")
    assert run("in", "-o", "out", "--dry-run")[1] == ""
    Path("in/b.csv").write_text(text(good()[:50]))
    lines = Path("out/manifest.jsonl").read_bytes()
    assert run("in", "-o", "out", "--dry-run")[1] == "changed\tin/b.csv\n"
    assert run("in", "-o", "out", "--dry-run", "--method", "ridge", "--retry-failed")[1] == (
        "other options\tin/a.csv\nchanged\tin/b.csv\nother options\tin/empty.csv\n"
    )
    assert Path("out/manifest.jsonl").read_bytes() == lines


def test_options_of_estimate(run, monkeypatch):
    own = {option.name for option in estimate.command.params}
    ours = {option.name for option in command.command.params}
    # What is told of one run on one terminal, in files of its own, or as a drive goes on has no place here.
    assert own - ours <= {*FILES, "follow", "every", "again", "idle_timeout"}
    args = ("--segments", "fixed", "--window-samples", "40", "--where", "load > 85", "--method", "ridge")
    monkeypatch.setenv("TERRAIN_EST_MIN_SAMPLES", "7")
    assert run("in/a.csv", "-o", "out", *args)[0] == 0
    assert run("in/a.csv", "-o", "a.parquet", *args, verb="estimate")[0] == 0
    assert pq.read_table("out/segments.parquet").equals(pq.read_table("a.parquet"))


def test_defaults_of_the_rover_file(run, monkeypatch):
    monkeypatch.delenv("TERRAIN_EST_METHOD")
    with Path("in/rover.toml").open("a") as file:
        file.write('[estimate]\nmethod = "ridge"\n')
    assert run("in/a.csv", "-o", "out")[0] == 0
    assert set(pq.read_table("out/segments.parquet")["method"].to_pylist()) == {"ridge"}


def test_remarks_are_told_once_for_all_inputs(run):
    columns = [place for place, name in enumerate(HEADER) if name != "time"]
    for name in ("a", "b"):
        # Shuffled: rows in their order would look like a log.
        rows = [[good()[(7 * k) % 97][place] for place in columns] for k in range(97 - (name == "b"))]
        Path(f"in/{name}.csv").write_text(text(rows, [HEADER[place] for place in columns]))
    err = run("in", "-o", "out", "--segments", "none")[2]
    remark = "no column is known as a time: each row is taken for a steady test point"
    assert f"  in/a.csv and 1 more: {remark}\n" in err
    assert remark not in run("in", "-o", "out", "--force", "--quiet", "--segments", "none")[2]


@pytest.mark.parametrize(
    ("args", "code", "says"),
    [
        (("in",), 2, "Missing option '-o'"),
        (("-", "-o", "out"), 2, "batch reads files, not the standard input"),
        (("in", "-o", "out", "--also", "xlsx"), 2, "--also xlsx: no such kind of table"),
        (("in", "-o", "out", "--method", "ridge", "--robust"), 2, "--robust is for the full model"),
        (("nothing", "-o", "out"), 66, "nothing: no such file"),
        (("none*.bag", "-o", "out"), 66, "none*.bag: matches no file"),
        (("in", "-o", "out", "--rover", "none.toml"), 78, "none.toml: no such file"),
        (("in", "-o", "out", "--model", "none.toml"), 78, "none.toml: no such model file"),
        (("in", "-o", "in/a.csv"), 2, "-o in/a.csv would be written onto the input in/a.csv"),
        (("in/a.csv", "-o", "in/b.csv"), 73, "in/b.csv: "),
        (("in", "-o", "/proc/out"), 73, "/proc/out: no such folder"),
    ],
)
def test_what_cannot_be(run, args, code, says):
    end, out, err = run(*args)
    assert (end, out) == (code, "")
    assert says in err
    assert not Path("out").exists()


def test_its_own_folder_of_inputs_by_whatever_name(run):
    Path("link").symlink_to("in")
    assert run("in", "-o", "in")[0] == 75
    written = Path("in/segments.parquet").read_bytes()
    for names in (("in", "link"), ("link", "in"), ("in", "link/../in"), ("link", "link")):
        code, out, err = run(names[0], "-o", names[1], "--dry-run", "--force")
        assert code == 0, err
        assert [line.rpartition("/")[2] for line in out.splitlines()] == ["a.csv", "b.csv", "empty.csv"]
    Path("results").symlink_to("in/results")
    assert run("in", "results", "-o", "in", "--dry-run")[:2] == (0, "")
    assert run("in", "-o", "link")[0] == 75
    assert Path("in/segments.parquet").read_bytes() == written


@pytest.mark.parametrize("name", ["segments.csv", "segments.parquet", "results/run.parquet"])
def test_logs_with_the_names_of_results_are_not_replaced(run, name):
    Path("in", name).parent.mkdir(exist_ok=True)
    Path("in/a.csv").rename(Path("in", name))
    before = sorted(Path("in").rglob("*"))
    code, out, err = run("in", "-o", "in")
    assert (code, out) == (2, "")
    assert err.startswith(f"terrain-est: -o in would be written onto the input in/{name}\n")
    assert sorted(Path("in").rglob("*")) == before


def test_two_batches_in_one_folder(run):
    assert run("in/a.csv", "-o", "out")[0] == 0
    with Path("out/.state/lock").open("r+") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        lock.write("4711\n")
        lock.flush()
        before = Path("out/manifest.jsonl").read_bytes()
        code, out, err = run("in", "-o", "out")
        assert (code, out) == (73, "")
        assert err == (
            "terrain-est: out: another batch is at work here (process 4711)\n"
            "  wait for its end, or give another folder with -o\n"
        )
        assert Path("out/manifest.jsonl").read_bytes() == before
        # To look disturbs nobody.
        assert run("in/b.csv", "-o", "out", "--dry-run")[1] == "new\tin/b.csv\n"
    assert run("in", "-o", "out")[0] == 75


LIMIT = """\
import resource, signal, sys
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
resource.setrlimit(resource.RLIMIT_FSIZE, (20_000, 20_000))
from terrain_cli.app import main
main(sys.argv[1:])
"""


def test_a_file_that_may_not_grow(folder, run):
    """A limit on the size of files fails a write in the middle, as a full disk does."""
    for number in range(8):
        rows = [[*row[:2], f"{float(row[2]) + 0.1 * number:.6g}", *row[3:]] for row in good()]
        Path(f"in/{number}.csv").write_text(text(rows, HEADER))
    args = [sys.executable, "-c", LIMIT, "batch", "in", "-o", "out", "--jobs", "1"]
    # Python would keep the part of a compiled module that it may write, and trip over it for ever.
    env = {**os.environ, "PYTHONPATH": str(ROOT), "PYTHONDONTWRITEBYTECODE": "1"}
    done = subprocess.run(args, env=env, capture_output=True, text=True, check=False)
    assert done.returncode == 73, done.stderr
    assert "larger than a file may be here" in done.stderr
    assert "Traceback" not in done.stderr
    assert run("in", "-o", "out")[0] == 75
    assert run("in", "-o", "fresh")[0] == 75
    for name in ("segments.parquet", "summary.json"):
        assert Path("out", name).read_bytes() == Path("fresh", name).read_bytes()


@pytest.fixture
def small_disk(tmp_path):
    """Mount a disk of 200 kB."""
    disk = tmp_path / "disk"
    disk.mkdir()
    mount = ["mount", "-t", "tmpfs", "-o", "size=200k", "tmpfs", str(disk)]
    if os.geteuid() != 0 or subprocess.run(mount, capture_output=True, check=False).returncode != 0:
        pytest.skip("only root may mount a small disk")
    yield disk
    subprocess.run(["umount", str(disk)], check=True)


def test_a_full_disk(small_disk, run):
    run("in", "-o", "fresh")
    out = small_disk / "out"
    filler = small_disk / "filler"
    for kept in (4, 12, 28, 60, 90):
        filler.write_bytes(b"x" * (200 - kept) * 1024)
        code, _, err = run("in", "-o", out)
        if code != 75:
            assert code == 73, err
            assert "no space left on the device" in err
        filler.unlink()
    assert run("in", "-o", out)[0] == 75
    for name in ("segments.parquet", "summary.json"):
        assert (out / name).read_bytes() == Path("fresh", name).read_bytes()


def site(folder, body):
    """Have workers do something to the inputs whose names ask for it."""
    (folder / "site").mkdir()
    (folder / "site/sitecustomize.py").write_text(
        "import os, time\nfrom terrain_cli.run import one_log\nown = one_log.run\n"
        f"def run(path, *args, **options):\n    if path.endswith('b.csv'):\n        {body}\n"
        "    return own(path, *args, **options)\none_log.run = run\n"
    )
    return {**os.environ, "PYTHONPATH": f"{folder / 'site'}:{ROOT}"}


@pytest.mark.parametrize(
    ("body", "options", "says"),
    [
        ("time.sleep(600)", ("--timeout", "8"), "in/b.csv: took longer than 8 s"),
        ("data = bytearray(20_000_000_000)", ("--memory", "4"), "in/b.csv: out of memory"),
        ("os.kill(os.getpid(), 9)", (), "in/b.csv: its worker was killed (SIGKILL; out of memory?)"),
    ],
    ids=["hangs", "eats", "dies"],
)
def test_a_worker_in_trouble_costs_one_input(folder, run, body, options, says):
    args = [sys.executable, "-m", "terrain_cli", "batch", "in", "-o", "out", "--jobs", "1", *options]
    done = subprocess.run(
        args, env=site(folder, body), capture_output=True, text=True, timeout=60, check=False
    )
    assert done.returncode == 75, done.stderr
    assert f"failed (1): {says}\n" in done.stderr
    assert "1 done, 2 failed" in done.stderr
    lines = {
        line["path"]: line for line in map(json.loads, Path("out/manifest.jsonl").read_text().splitlines())
    }
    assert (lines["in/b.csv"]["passing"], lines["in/empty.csv"]["passing"]) == (True, False)
    # Next time it is tried again, without being asked to; what failed for good is not.
    code, _, err = run("in", "-o", "out")
    assert (code, err.splitlines()[-3].partition(" · ")[0]) == (
        75,
        "1 done, 1 as before, 1 failed before and unchanged",
    )
    run("in", "-o", "fresh")
    for name in ("segments.parquet", "summary.json"):
        assert Path("out", name).read_bytes() == Path("fresh", name).read_bytes()


def test_progress():
    tally = Tally(total=10, bytes_total=100, bytes_done=25)
    assert batch.line(tally, 2.0) == "0/10 inputs · 2 s"
    tally.counts.update(ok=3, failed=1)
    assert batch.line(tally, 8.0) == "4/10 inputs · 8 s · 0.5 inputs/s · 24 s left · 1 failed"
    assert [batch.duration(seconds) for seconds in (89, 600, 7200)] == ["89 s", "10 min", "2.0 h"]


def test_progress_is_told_in_a_file_too(capfd, monkeypatch):
    monkeypatch.setattr(batch, "PATIENCE", 0.0)
    progress = batch.Rate()
    tally = Tally(total=5, bytes_total=5, bytes_done=1)
    tally.counts["ok"] = 1
    # The second comes too soon after the first.
    progress.show(tally)
    progress.show(tally)
    progress.close()
    (line,) = capfd.readouterr().err.splitlines()
    assert line.startswith("1/5 inputs · 0 s · ")
    assert line.endswith(" left")


def test_a_batch_without_news_touches_nothing(run):
    run("in", "-o", "out")
    before = {path: path.stat().st_mtime_ns for path in Path("out").rglob("*") if path.name != "lock"}
    run("in", "-o", "out")
    assert {path: path.stat().st_mtime_ns for path in before} == before
    assert Order(configuration=None).largest == 16_000_000_000
