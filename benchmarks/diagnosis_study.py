"""The blind study of `diagnose`: how often it is right about what it has never seen.

    python benchmarks/diagnosis_study.py [--quick] [--section NAME …] [--cache FOLDER] [--jobs N]

prints the table and writes it to benchmarks/results/diagnosis_study.txt; `--section vehicles` drives six vehicles on
ten soils instead, and writes benchmarks/results/diagnosis_vehicles.txt. What is found of each drive is
kept in FOLDER (build/diagnosis_study by default), one line each: a study that was stopped goes on where
it was, and `--table` makes the table of what is there. `--tuning` takes drives from below the seeds that
are scored, for whoever works on thresholds; nothing is then written to results.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import time
from concurrent.futures import ProcessPoolExecutor, as_completed
from pathlib import Path

HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE)]
# One thread each: the drives are what runs in parallel.
os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import diagnosis_drives  # noqa: E402 - found through the path above
from diagnosis_table import table, vehicle_table  # noqa: E402 - as above

RESULT = HERE / "results" / "diagnosis_study.txt"
VEHICLES_RESULT = HERE / "results" / "diagnosis_vehicles.txt"
CACHE = HERE.parent / "build" / "diagnosis_study"


def key(job):
    """Return what tells a drive from all others."""
    return json.dumps({n: job[n] for n in sorted(job) if n not in {"found", "seconds", "code"}})


def known(folder, section):
    """Return what was found so far of a section's drives."""
    path = folder / f"{section}.jsonl"
    lines = path.read_text(encoding="utf-8").splitlines() if path.exists() else []
    return {key(one): one for one in map(json.loads, lines)}


def study(section, wanted, folder, workers, run=diagnosis_drives.run):
    """Run the drives that are still missing, and return all that are wanted."""
    done = known(folder, section)
    missing = [job for job in wanted if key(job) not in done]
    began = time.perf_counter()
    if missing:
        folder.mkdir(parents=True, exist_ok=True)
        with (
            (folder / f"{section}.jsonl").open("a", encoding="utf-8") as file,
            ProcessPoolExecutor(max_workers=workers) as pool,
        ):
            for number, future in enumerate(as_completed([pool.submit(run, job) for job in missing])):
                one = future.result()
                done[key(one)] = one
                file.write(json.dumps(one) + "\n")
                file.flush()
                spent = time.perf_counter() - began
                print(
                    f"\r{section}: {number + 1} of {len(missing)}, {spent:.0f} s",
                    end="",
                    file=sys.stderr,
                    flush=True,
                )
        print(file=sys.stderr)
    return [done[key(job)] for job in wanted if key(job) in done]


def main(arguments=None):
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--quick", action="store_true", help="a few drives of each row")
    parser.add_argument(
        "--section",
        action="append",
        choices=(*diagnosis_drives.SECTIONS, diagnosis_drives.VEHICLE_DRIVES),
        help="only this one (repeatable)",
    )
    parser.add_argument("--number", type=int, help="drives of each row")
    parser.add_argument("--tuning", action="store_true", help="seeds below those that are scored")
    parser.add_argument(
        "--only", action="append", default=[], metavar="WHAT=VALUE", help="drives with this (repeatable)"
    )
    parser.add_argument("--cache", type=Path, default=CACHE, metavar="FOLDER")
    parser.add_argument("--jobs", type=int, default=os.cpu_count())
    parser.add_argument("--table", action="store_true", help="run nothing")
    given = parser.parse_args(arguments)

    numbers = diagnosis_drives.QUICK_NUMBERS if given.quick else diagnosis_drives.FULL_NUMBERS
    folder = given.cache / ("tuning" if given.tuning else "scored")
    found, planned = {}, {}
    for section in given.section or diagnosis_drives.SECTIONS:
        first = 1000 if given.tuning else diagnosis_drives.FIRST
        wanted = [
            job
            for job in diagnosis_drives.jobs(section, given.number or numbers[section], first)
            if all(
                str(job.get(what)) == value for what, _, value in (one.partition("=") for one in given.only)
            )
        ]
        planned[section] = len(wanted)
        if given.table:
            done = known(folder, section)
            found[section] = [done[key(job)] for job in wanted if key(job) in done]
        else:
            found[section] = study(section, wanted, folder, given.jobs)
    vehicles = given.section == [diagnosis_drives.VEHICLE_DRIVES]
    lines = list(vehicle_table(found[given.section[0]]) if vehicles else table(found, planned))
    print("\n".join(lines))
    some = given.tuning or given.quick or given.only or given.number
    some = some or any(len(ones) < planned[section] for section, ones in found.items())
    if not some and (vehicles or not given.section):
        result = VEHICLES_RESULT if vehicles else RESULT
        result.write_text("\n".join(lines) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
