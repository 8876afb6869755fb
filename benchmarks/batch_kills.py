"""Kills batches at every write and at random moments, and compares with an undisturbed one.

    python benchmarks/batch_kills.py [KILLS] > benchmarks/results/batch_kills.txt

Points: a batch of five inputs (three drives, a copy, an empty file) is killed before each single
write, killed in the middle of it, or meets a full disk from there on; then it is run again.

Moments: the real command, over 40 drives with 2 workers, is killed at a random moment, again and
again until it comes to its end; then the whole mission once more from the start.
"""

from __future__ import annotations

import json
import os
import random
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
sys.path[:0] = [str(ROOT), str(ROOT / "tests")]

import missions  # noqa: E402

KILLS = 200
DRIVES = 40
ENVIRONMENT = {**os.environ, "PYTHONPATH": str(ROOT)}


def points(folder):
    """Try every write there is."""
    for mode in ("kill", "torn", "full"):
        command = [sys.executable, ROOT / "tests/batch/kill_points.py", mode, folder / mode]
        told = json.loads(subprocess.run(command, capture_output=True, text=True, check=True).stdout)
        print(
            f"{mode:>5}: {told['points']} points, {len(told['wrong'])} wrong {told['wrong'] or ''}",
            flush=True,
        )


def start(folder, output):
    command = [sys.executable, "-m", "terrain_cli", "batch", "in", "-o", output, "--jobs", "2", "--quiet"]
    return subprocess.Popen(command, cwd=folder, env=ENVIRONMENT, stderr=subprocess.DEVNULL)


def moments(folder, kills):
    """Kill the command at random moments."""
    missions.mission(folder / "in", [f"{number}.csv" for number in range(DRIVES)])
    began = time.monotonic()
    start(folder, "undisturbed").wait()
    whole = time.monotonic() - began
    wanted = missions.files(folder / "undisturbed")
    killed = ended = wrong = doubled = 0
    while killed < kills:
        with start(folder, "out") as process:
            try:
                # As often before the workers are there as at their work or at the table.
                process.wait(random.uniform(0.2, whole))  # noqa: S311
                ended += 1
            except subprocess.TimeoutExpired:
                process.kill()
                killed += 1
                continue
        wrong += missions.files(folder / "out") != wanted
        lines = [line["location"] for line in missions.manifest(folder / "out")]
        doubled += len(lines) - len(set(lines))
        shutil.rmtree(folder / "out")
    print(f"{killed} kills of the command, {ended} batches that came to their end:")
    print(f"  {wrong} with other bytes than the undisturbed, {doubled} inputs done twice")


def main():
    kills = int(sys.argv[1]) if len(sys.argv) > 1 else KILLS
    with tempfile.TemporaryDirectory() as folder:
        points(Path(folder, "points"))
        moments(Path(folder, "moments"), kills)


if __name__ == "__main__":
    main()
