"""Do two commits write the same bytes: ``python -m benchmarks.same_outputs OLD [NEW] [--drives N]``.

For changes that move code and must not change a number. Every verb runs on the sample data, and
`compare` and `diagnose` on N simulated drives with a hidden effect, each in a process of its own. What they
print, how they end and what they write is compared byte by byte; the moment of writing is left out.
OLD and NEW are anything git knows; NEW is the working tree if it is ".". Exits with 1 if anything differs.
"""

from __future__ import annotations

import argparse
import difflib
import os
import re
import shutil
import subprocess
import sys
import tempfile
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from benchmarks import harness
from benchmarks.compare import discard, tree_of

#: Each line runs after the one before it, in the same folder.
SAMPLES = """
inspect run.csv
inspect run.bag --json
inspect run.mcap -v
estimate run.csv
estimate run.csv --method recursive --trace trace.csv --summary soils.json --rejects rejects.csv
estimate run.bag --method wong-reece
estimate run.mcap --segments fixed --window-samples 200 --method ridge --samples samples.csv
estimate run.parquet --segments none --method least-squares -o soil.parquet
estimate run.csv -o soil.gpkg --samples soil.gpkg
estimate run.csv -o soil.geojson
estimate run.csv -o soil.mcap
batch run.csv run.bag run.parquet -o batch --jobs 1 --quiet
model new base.toml
model show base.toml
effects list
effects show bulldozing
compare run.csv --json
compare run.csv --model base.toml
diagnose run.csv --json
model add base.toml grouser-ripple --data run.csv --force
model history base.toml
simulate --seed 3 -o simulated.mcap --force
report run.csv -o report.html
estimate none.csv
estimate run.csv --method none
"""
#: Of one drive with an effect that nobody names.
DRIVE = """
simulate --hide --drive mixed --noise 3% --seed {seed} -o run.csv
estimate run.csv --method wong-reece
compare run.csv --json
diagnose run.csv --json
"""
#: The moment of writing, and how long the work took; and where and when an input lay, with what the names of results have of that.
_PASSING = re.compile(
    rb"20\d\d-\d\d-\d\d[T ]\d\d:\d\d(:\d\d(\.\d+)?)?(Z|\+00:00)?|\d{19}-\d{19}|(?<=-)[0-9a-f]{16}(?=\.)"
    rb'|(?<="seconds": )[\d.]+'
)


def outputs(tree: Path, lines: str, folder: Path) -> dict[str, bytes]:
    """Run commands in a folder, and return what they printed and what they wrote, by name."""
    environment = os.environ | {"PYTHONPATH": str(tree), "OPENBLAS_NUM_THREADS": "1", "COLUMNS": "100"}
    found = {}
    for line in lines.split("\n"):
        if not line:
            continue
        done = subprocess.run(
            [sys.executable, "-m", "terrain_cli", *line.split()],
            cwd=folder,
            env=environment,
            capture_output=True,
            check=False,
        )
        found[line] = b"exit %d\n" % done.returncode + done.stdout + b"\n--\n" + done.stderr
    for path in sorted(folder.rglob("*")):
        # The lock of a batch holds the number of a process.
        if path.is_file() and path.name != "lock":
            found[str(path.relative_to(folder))] = path.read_bytes()
    place = str(folder).encode()
    return {
        _PASSING.sub(b"-", name.encode()).decode(): _PASSING.sub(b"-", content.replace(place, b"HERE"))
        for name, content in found.items()
    }


def difference(old: bytes, new: bytes) -> str:
    """Return the first lines in which two outputs differ."""
    texts = [content.decode("utf-8", "replace").splitlines() for content in (old, new)]
    lines = difflib.unified_diff(*texts, "old", "new", lineterm="", n=0)
    return "\n".join(line[:160] for line, _ in zip(lines, range(8), strict=False))


def main() -> int:
    """Run everything with both commits and print what differs."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.same_outputs", description=__doc__)
    parser.add_argument("old")
    parser.add_argument("new", nargs="?", default=".")
    parser.add_argument("--drives", type=int, default=4)
    parser.add_argument("--jobs", type=int, default=os.cpu_count())
    asked = parser.parse_args()
    cases = {"sample data": SAMPLES} | {
        f"drive {seed}": DRIVE.format(seed=seed) for seed in range(asked.drives)
    }
    differing = total = 0
    with tempfile.TemporaryDirectory() as temporary, ThreadPoolExecutor(asked.jobs) as pool:
        trees = [tree_of(commit, Path(temporary)) for commit in (asked.old, asked.new)]
        try:
            under_way = {}
            for name, lines in cases.items():
                for tree, side in zip(trees, ("old", "new"), strict=True):
                    # The same path on both sides: messages name it.
                    folder = Path(temporary, "outputs", side, name.replace(" ", "-"), "work")
                    if name == "sample data":
                        shutil.copytree(harness.ROOT / "sample_data", folder)
                    else:
                        folder.mkdir(parents=True)
                    under_way[name, side] = pool.submit(outputs, tree, lines, folder)
            for name in cases:
                old, new = (under_way[name, side].result() for side in ("old", "new"))
                total += len(old.keys() | new.keys())
                for what in sorted(old.keys() | new.keys()):
                    if old.get(what) != new.get(what):
                        differing += 1
                        print(
                            f"{name}: {what}\n{difference(old.get(what, b''), new.get(what, b''))}",
                            flush=True,
                        )
        finally:
            for tree in trees:
                discard(tree)
    print(f"{total - differing} of {total} outputs are the same")
    return 1 if differing else 0


if __name__ == "__main__":
    sys.exit(main())
