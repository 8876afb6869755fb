"""A batch that is killed at any write, or whose disk is full from there on, and is run again.

`benchmarks/batch_kills.py` does the same at every single point, and with the real command many times.
"""

from __future__ import annotations

import contextlib
import json
import os
import random
import signal
import subprocess
import sys
import time
from pathlib import Path

import missions
import pytest
from child_processes import TERRAIN_EST, children

from terrain_cli.batch.manifest import uninterrupted

HERE = Path(__file__).resolve().parent
ROOT = HERE.parent.parent


@pytest.mark.parametrize(("mode", "step"), [("kill", 9), ("torn", 3), ("full", 13)])
def test_at_many_writes(tmp_path, mode, step):
    first = random.randint(1, step)  # noqa: S311 - other points each time; the benchmark tries all
    command = [sys.executable, HERE / "kill_points.py", mode, tmp_path, str(first), str(step)]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    told = json.loads(done.stdout)
    assert told["points"] >= 4
    assert told["ends"] == ([73] if mode == "full" else [-signal.SIGKILL])
    assert told["wrong"] == [], f"from {first}"


def start(folder, *args, **options):
    command = [
        *TERRAIN_EST,
        "batch",
        "in",
        "in/day1",
        "in/day2",
        "-o",
        "out",
        "--jobs",
        "2",
        *args,
    ]
    options = {"env": {**os.environ, "PYTHONPATH": str(ROOT)}, **options}
    return subprocess.Popen(command, cwd=folder, stderr=subprocess.PIPE, text=True, **options)


def finish(process):
    try:
        err = process.communicate(timeout=120)[1]
    finally:
        process.kill()
    assert "Traceback" not in err
    return process.returncode, err


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory):
    folder = tmp_path_factory.mktemp("undisturbed")
    missions.mission(folder / "in")
    assert finish(start(folder))[0] == 75
    return missions.files(folder / "out")


def same_as(undisturbed, folder, *, results=True):
    """Run once more, and compare; but for the names of results, which say where the inputs lay."""
    assert finish(start(folder))[0] == 75
    files = missions.files(folder / "out")
    for name in ("segments.parquet", "summary.json"):
        assert files[name] == undisturbed[name]
    assert not results or sorted(files.values()) == sorted(undisturbed.values())


def test_the_command_killed_at_any_moment(tmp_path, undisturbed):
    missions.mission(tmp_path / "in")
    for wait in random.sample(range(200, 3000), 3):
        with start(tmp_path) as process:
            time.sleep(wait / 1000)
            process.kill()
    same_as(undisturbed, tmp_path)


def test_a_worker_killed_at_any_moment(tmp_path, undisturbed):
    missions.mission(tmp_path / "in")
    with start(tmp_path) as process:
        killed, end = set(), time.monotonic() + 20
        while process.poll() is None and time.monotonic() < end and len(killed) < 2:
            for pid in set(children(process.pid)) - killed:
                time.sleep(random.random() * 0.5)  # noqa: S311
                # On an idle machine a worker may have done its work by now.
                with contextlib.suppress(ProcessLookupError):
                    os.kill(pid, signal.SIGKILL)
                    killed.add(pid)
        code, err = finish(process)
    assert code == 75
    assert ("its worker was killed (SIGKILL; out of memory?)" in err) == bool(killed)
    # Where the first of two copies was lost, its result is that of the second.
    same_as(undisturbed, tmp_path, results=False)


def test_what_belongs_together_is_not_interrupted():
    done = []

    def together():
        with uninterrupted():
            os.kill(os.getpid(), signal.SIGINT)
            done.append("all of it")

    with pytest.raises(KeyboardInterrupt):
        together()
    assert done == ["all of it"]


@pytest.mark.parametrize(
    ("name", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 130), (signal.SIGHUP, 129)]
)
def test_interrupted_within_a_second(tmp_path, undisturbed, name, code):
    # A machine at work on other things may take its time once, but not each time.
    for attempt in range(3):
        folder = tmp_path / str(attempt)
        took = interrupted(folder, name, code)
        same_as(undisturbed, folder)
        if took < 1.0:
            return
    pytest.fail(f"took {took:.2f} s, the last of three times")


def interrupted(tmp_path, name, code):
    """Interrupt a batch of which four inputs are done; return how many seconds its end took."""
    missions.mission(tmp_path / "in")
    # Something that takes its time.
    (tmp_path / "site").mkdir()
    (tmp_path / "site/sitecustomize.py").write_text(
        "import time\nfrom terrain_cli.run import one_log\nown = one_log.run\n"
        "def run(path, *args, **options):\n"
        "    if path.endswith('b.csv'):\n        time.sleep(600)\n"
        "    return own(path, *args, **options)\n"
        "one_log.run = run\n"
    )
    env = {**os.environ, "PYTHONPATH": f"{tmp_path / 'site'}:{ROOT}"}
    with start(tmp_path, env=env) as process:
        manifest, end = tmp_path / "out/manifest.jsonl", time.monotonic() + 120
        while not (manifest.exists() and manifest.read_bytes().count(b"\n") >= 4):
            assert time.monotonic() < end
            time.sleep(0.05)
        asked = time.monotonic()
        process.send_signal(name)
        ended, err = finish(process)
        took = time.monotonic() - asked
    assert ended == code
    assert "terrain-est: out: interrupted; 4 of 5 inputs done, and kept" in err
    assert "run the same command again to go on" in err
    return took
