"""What a batch costs for each input: the figures behind docs/batch.md.

python benchmarks/batch_costs.py [INPUTS] > benchmarks/results/batch_costs.txt
"""

from __future__ import annotations

import os
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from statistics import median

ROOT = Path(__file__).resolve().parent.parent
sys.path[:0] = [str(ROOT), str(ROOT / "tests")]

import missions  # noqa: E402

from benchmarks import rover_bag  # noqa: E402

INPUTS = 1000
ENVIRONMENT = {**os.environ, "PYTHONPATH": str(ROOT)}


def batch(folder, *args):
    """Run the command; return wall and processor seconds."""
    command = [sys.executable, "-m", "terrain_cli", "batch", *args, "-o", "out", "--quiet"]
    began, used = time.monotonic(), resource.getrusage(resource.RUSAGE_CHILDREN)
    done = subprocess.run(command, cwd=folder, env=ENVIRONMENT, capture_output=True, text=True, check=False)
    now = resource.getrusage(resource.RUSAGE_CHILDREN)
    if done.returncode:
        raise SystemExit(done.stderr)
    seconds = now.ru_utime + now.ru_stime - used.ru_utime - used.ru_stime
    return time.monotonic() - began, seconds


def report(what, count, wall, used):
    print(
        f"{what:<44} {wall:8.2f} s {used:8.2f} s of processor  {1e3 * wall / count:8.3f} ms each", flush=True
    )


def many(folder, count):
    """Many small inputs: what is spent besides estimating."""
    missions.mission(folder / "in", [f"{number}.csv" for number in range(count)])
    (folder / "in/copy.csv").unlink()
    (folder / "in/empty.csv").unlink()
    print(f"{count} tables of 60 rows, 2 workers")
    report("first run", count, *batch(folder, "in", "--jobs", "2"))
    report("again, nothing new", count, *batch(folder, "in", "--jobs", "2"))
    (folder / "out/segments.parquet").unlink()
    report("again, only the mission table", count, *batch(folder, "in", "--jobs", "2"))
    spent = [line["seconds"] for line in missions.manifest(folder / "out")]
    print(f"{'a worker, of its own time (median)':<44} {1e3 * median(spent):8.1f} ms each")
    sizes = {
        "manifest.jsonl": "manifest",
        ".state/records": "records",
        "segments.parquet": "mission table",
        "summary.json": "summary",
    }
    for name, what in sizes.items():
        print(f"{what:<44} {(folder / 'out' / name).stat().st_size / count:8.0f} B each")
    results = sum(path.stat().st_size for path in (folder / "out/results").iterdir())
    print(f"{'results':<44} {results / count:8.0f} B each")


def keeper(folder, count):
    """Tell what the one process that writes spends, apart from its workers."""
    missions.mission(folder / "in", [f"{number}.csv" for number in range(count)])
    spent, own = [], os.fsync

    def fsync(descriptor):
        began = time.monotonic()
        own(descriptor)
        spent.append(time.monotonic() - began)

    os.fsync = fsync
    began = time.process_time()
    missions.batch([folder / "in"], folder / "out", jobs=2)
    used = time.process_time() - began
    os.fsync = own
    print(f"{'the keeper, processor':<44} {1e3 * used / count:8.2f} ms each")
    print(f"{'the keeper, fsync':<44} {len(spent) / count:8.2f} each, median {1e3 * median(spent):.2f} ms")


def large(folder):
    """Bags of ten minutes: what a mission consists of."""
    kinds = (("ros1", "none"), ("ros1", "lz4"), ("mcap", "zstd"), ("db3", "none"))
    rover_bag.write(folder / "in", 600.0, kinds)
    print("bags of ten minutes, six wheels, fifteen topics: terrain-est estimate, with its start")
    print("their truth is the line, which the full model does not fit: it searches for long")
    for path in sorted((folder / "in").glob("run-*")):
        for model in ("linear", "wong-reece"):
            arguments = ["estimate", "-q", str(path), "-o", str(folder / "soil.csv"), "--model", model]
            began, used = time.monotonic(), resource.getrusage(resource.RUSAGE_CHILDREN)
            subprocess.run([sys.executable, "-m", "terrain_cli", *arguments], env=ENVIRONMENT, check=True)
            now = resource.getrusage(resource.RUSAGE_CHILDREN)
            seconds = now.ru_utime + now.ru_stime - used.ru_utime - used.ru_stime
            what = f"{path.name}, {path.stat().st_size / 1e6:.0f} MB, {model}"
            print(f"{what:<44} {time.monotonic() - began:8.2f} s {seconds:8.2f} s of processor", flush=True)


def main():
    count = int(sys.argv[1]) if len(sys.argv) > 1 else INPUTS
    with tempfile.TemporaryDirectory() as folder:
        many(Path(folder, "many"), count)
        keeper(Path(folder, "keeper"), count // 2)
        large(Path(folder, "large"))


if __name__ == "__main__":
    main()
