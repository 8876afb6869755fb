"""Kills batches at every write and at random moments, and compares with an undisturbed one.

    python benchmarks/batch_kills.py [KILLS [SEED]] > benchmarks/results/batch_kills.txt

Points: a batch of five inputs (three drives, a copy, an empty file) is killed before each single
write, killed in the middle of it, or meets a full disk from there on; then it is run again.

Moments: the real command, over some drives, a copy and an empty file, is killed at a moment drawn
uniformly from the time that an undisturbed run takes, again and again until it comes to its end;
then the whole mission once more from the start.
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
from collections import Counter
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
sys.path[:0] = [str(ROOT), str(ROOT / "tests")]

import missions  # noqa: E402

KILLS = 200
DRIVES = 30
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
    command = [sys.executable, "-m", "terrain_cli", "batch", "in", "-o", output, "--jobs", "1", "--quiet"]
    return subprocess.Popen(command, cwd=folder, env=ENVIRONMENT, stderr=subprocess.DEVNULL)


def phase(output):
    """Say how far a batch had come when it was killed."""
    manifest = output / "manifest.jsonl"
    lines = manifest.read_bytes().count(b"\n") if manifest.exists() else 0
    if not lines:
        return "before the first line of the manifest"
    return "between its lines" if lines < DRIVES + 2 else "behind its last line"


def moments(folder, kills, seed):
    """Kill the command at random moments."""
    draw = random.Random(seed)  # noqa: S311 - moments, no secrets
    missions.mission(folder / "in", [f"{number}.csv" for number in range(DRIVES)])
    began = time.monotonic()
    start(folder, "undisturbed").wait()
    whole = time.monotonic() - began
    wanted = missions.files(folder / "undisturbed")
    phases, ended, wrong, doubled = Counter(), 0, 0, 0
    while phases.total() < kills:
        with start(folder, "out") as process:
            try:
                process.wait(draw.uniform(0.0, whole))
                ended += 1
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()
                phases[phase(folder / "out")] += 1
                continue
        wrong += missions.files(folder / "out") != wanted
        lines = [line["location"] for line in missions.manifest(folder / "out")]
        doubled += len(lines) - len(set(lines))
        shutil.rmtree(folder / "out")
    print(f"{phases.total()} kills of the command (seed {seed}), {ended} batches that came to their end:")
    for name, count in phases.most_common():
        print(f"  {count} {name}")
    print(f"  {wrong} with other bytes than the undisturbed, {doubled} inputs done twice")


def main():
    kills = int(sys.argv[1]) if len(sys.argv) > 1 else KILLS
    seed = int(sys.argv[2]) if len(sys.argv) > 2 else int(time.time())
    with tempfile.TemporaryDirectory() as folder:
        points(Path(folder, "points"))
        moments(Path(folder, "moments"), kills, seed)


if __name__ == "__main__":
    main()
