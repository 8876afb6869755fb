"""How a rerun of a batch grows with what is in its folder: the figures behind docs/batch.md.

    python -m benchmarks.batch_scale [INPUTS…] > benchmarks/results/batch_scale.txt

One ten-minute drive of six wheels is estimated; its line, record and result are then written as
often as there are inputs, each for a file of its own. What is measured is the command, in a process
of its own; its workers count for time, and the largest process for memory.
"""

from __future__ import annotations

import json
import sys
import tempfile
from pathlib import Path

from benchmarks import rover_bag
from benchmarks.alone import alone
from terrain_cli.batch.batch_folder import result_name
from terrain_cli.batch.batch_inputs import local
from terrain_cli.batch.manifest import entries_of, parse

SIZES = (1_000, 10_000, 30_000)


def batch(folder, *args):
    """Run the command, and return what it took."""
    return alone(["-m", "terrain_cli", "batch", "in", "-o", "out", "--quiet", "--jobs", "1", *args], folder)


def grow(folder, count):
    """Make a mission of one input one of many."""
    ((seed,), _) = entries_of(folder / "out/manifest.jsonl")
    record = (folder / "out/.state/records").read_bytes()
    (folder / seed.path).unlink()
    (folder / "out" / seed.result).unlink()
    known = json.loads(seed.line())
    with (
        (folder / "out/manifest.jsonl").open("wb") as manifest,
        (folder / "out/.state/records").open("wb") as records,
    ):
        for number in range(count):
            path = folder / f"in/{number:07d}.csv"
            path.touch()
            item = local(str(path))
            name = result_name(item.location, "parquet")
            (folder / "out" / name).touch()
            told = {
                **known,
                "path": f"in/{path.name}",
                "location": item.location,
                "size": item.size,
                "stamp": item.stamp,
                "sha256": f"{number:064x}",
                "result": name,
                "result_bytes": 0,
                "record": [number * len(record), len(record), known["record"][2]],
            }
            manifest.write(parse(json.dumps(told).encode()).line())
            records.write(record)


def measure(folder, count):
    """Measure a folder of so many inputs."""
    rover_bag.write(folder / "in", 600.0, (("ros1", "none"),))
    batch(folder)
    grow(folder, count)
    sizes = [(folder / "out" / name).stat().st_size / 1e6 for name in ("manifest.jsonl", ".state/records")]
    print(f"{count:,} inputs: manifest {sizes[0]:.0f} MB, records {sizes[1]:.0f} MB")
    for what, args in (("--dry-run", ("--dry-run",)), ("the mission table", ()), ("again, nothing new", ())):
        used = batch(folder, *args)
        print(
            f"  {what:<22}{used.seconds:>8.2f} s {used.busy:>8.2f} s of processor {used.peak:>7.0f} MB"
            f" {1e3 * used.busy / count:>8.3f} ms each",
            flush=True,
        )
    table = [(folder / "out" / name).stat().st_size / 1e6 for name in ("segments.parquet", "summary.json")]
    print(f"  segments.parquet {table[0]:.1f} MB, summary.json {table[1]:.1f} MB")


def main():
    for count in [int(text) for text in sys.argv[1:]] or SIZES:
        with tempfile.TemporaryDirectory() as folder:
            measure(Path(folder), count)


if __name__ == "__main__":
    main()
