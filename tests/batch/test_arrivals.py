"""Inputs that are still coming in, and a batch that waits for them."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from contextlib import ExitStack
from pathlib import Path

import missions
from wheel_table import ROVER

from formats.errors import NotFoundError
from terrain_cli.batch.batch_inputs import Arrivals, Input

ROOT = Path(__file__).resolve().parent.parent.parent


def item(size, stamp="1", problem=None):
    return Input("a", "/a", size, stamp, problem)


def test_taken_once_when_it_has_come_to_rest():
    arrivals = Arrivals(5.0)
    assert arrivals.rested([item(1)], now=0.0) == []
    assert arrivals.rested([item(2)], now=3.0) == []
    assert arrivals.rested([item(2)], now=7.0) == []
    assert arrivals.rested([item(2)], now=8.0) == [item(2)]
    assert arrivals.rested([item(2)], now=9.0) == []
    # Written again: taken again, after it has come to rest again.
    assert arrivals.rested([item(2, "2")], now=10.0) == []
    assert arrivals.rested([item(2, "2")], now=15.0) == [item(2, "2")]


def test_what_is_not_there_yet_is_waited_for():
    arrivals = Arrivals(0.0)
    missing = item(None, None, NotFoundError("a", "no such file"))
    assert arrivals.rested([missing], now=0.0) == []
    assert arrivals.rested([item(1)], now=1.0) == [item(1)]


def until(condition, seconds=60.0):
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end
        time.sleep(0.05)


def test_watch(tmp_path):
    (tmp_path / "in").mkdir()
    (tmp_path / "in/rover.toml").write_text(ROVER)
    command = [
        sys.executable,
        "-m",
        "terrain_cli",
        "batch",
        "in",
        "-o",
        "out",
        "--watch",
        "--settle",
        "1.5",
        "--jobs",
        "1",
    ]
    env = {**os.environ, "PYTHONPATH": str(ROOT), "TERRAIN_EST_METHOD": "least-squares"}
    manifest, table = tmp_path / "out/manifest.jsonl", tmp_path / "out/segments.parquet"
    with (
        subprocess.Popen(command, cwd=tmp_path, env=env, stderr=subprocess.PIPE, text=True) as process,
        ExitStack() as failing,
    ):
        # It would watch for ever.
        failing.callback(process.kill)
        until(manifest.exists)
        # Arrives piece by piece: whole only after more than the time that it must rest.
        content = missions.drive(0.1)
        with (tmp_path / "in/slow.csv").open("w") as file:
            for start in range(0, len(content), len(content) // 5):
                file.write(content[start : start + len(content) // 5])
                file.flush()
                time.sleep(0.5)
                assert manifest.read_text() == ""
        until(table.exists)
        first = table.read_bytes()
        (tmp_path / "in/next.csv").write_text(missions.drive(0.2))
        until(lambda: table.read_bytes() != first)
        process.send_signal(signal.SIGINT)
        err = process.communicate(timeout=10)[1]
    assert process.returncode == 130
    assert "out: interrupted; 2 of 2 inputs done, and kept" in err
    lines = missions.manifest(tmp_path / "out")
    assert [(line["path"], line["status"]) for line in lines] == [
        ("in/slow.csv", "ok"),
        ("in/next.csv", "ok"),
    ]
    watched = table.read_bytes()
    # As if all had been there at once.
    subprocess.run([*command[:6], "again"], cwd=tmp_path, env=env, check=True, capture_output=True)
    assert (tmp_path / "again/segments.parquet").read_bytes() == watched
