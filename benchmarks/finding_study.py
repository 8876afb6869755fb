"""How often `compare` finds what is there, and what is not: findings on simulated drives.

    python benchmarks/finding_study.py [CLEAN [MISFITS]]

writes benchmarks/results/finding_study.txt. CLEAN drives without a misfit, 60 by default, and MISFITS
with one, 20 by default, make each row; the same numbers give the same table but for the time.
"""

from __future__ import annotations

import os
import sys
import time
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from pathlib import Path

HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE.parent), str(HERE.parent / "tests"), str(HERE.parent / "tests" / "comparison")]

import numpy as np  # noqa: E402 - found through the path above
from known_misfits import MISFITS, Kind, compare, windows_of  # noqa: E402 - as above

from benchmarks.published import publish  # noqa: E402 - found through the path above
from terrain_cli.comparison.comparison_criteria import FINDING_LEVEL, SMALLEST_FINDING  # noqa: E402 - as above
from terrain_cli.mechanics.wheel_model import Model  # noqa: E402 - as above

RESULT = HERE / "results" / "finding_study.txt"
CLEAN = {
    "white noise, 3 %": Kind(),
    "white noise, 10 %": Kind(share=0.1),
    "AR(1) 0.8 noise, 3 %": Kind(memory=0.8),
    "soil varies every 8 s, runs labelled": Kind(varies=True, runs=True),
    "soil varies every 8 s, unlabelled": Kind(varies=True),
}
#: Seeds of the drives, none of which was looked at before the thresholds were set.
FIRST = 5000


def percent(part, whole):
    """Return a share in percent with its 95 % Wilson interval."""
    z, p = 1.96, part / whole
    middle = (p + z * z / (2 * whole)) / (1 + z * z / whole)
    half = z / (1 + z * z / whole) * np.sqrt(p * (1 - p) / whole + z * z / (4 * whole * whole))
    return f"{100 * p:5.1f} ({100 * max(middle - half, 0):4.1f}–{100 * min(middle + half, 1):5.1f})"


def findings(job):
    """Return channel, drivers and sentence of each finding on one drive, the strongest first."""
    seed, kind = job
    found = compare([windows_of(seed, kind)], Model(), seed=seed).failures
    return [(f.channel, (f.driver, *f.alternatives), f.sentence) for f in found]


def is_hit(finding, right):
    channel, drivers, _ = finding
    return bool(set(drivers) & set(right.get(channel, ())))


def clean_rows(pool, drives):
    for label, kind in CLEAN.items():
        found = list(pool.map(findings, [(FIRST + seed, kind) for seed in range(drives)]))
        number = sum(len(one) for one in found)
        yield f"{label:<40}{percent(sum(map(bool, found)), drives):>22}{number:>10}"


def misfit_rows(pool, drives):
    for label, (effects, right) in MISFITS.items():
        for form, kind in (("white", Kind(effects)), ("AR(1) 0.8", replace(Kind(effects), memory=0.8))):
            found = list(pool.map(findings, [(FIRST + seed, kind) for seed in range(drives)]))
            hits = sum(any(is_hit(f, right) for f in one) for one in found)
            first = sum(bool(one) and is_hit(one[0], right) for one in found)
            number = sum(len(one) for one in found) / drives
            yield f"{label:<30}{form:<10}{percent(hits, drives):>22}{percent(first, drives):>22}{number:>8.1f}"
            example = next((f for one in found for f in one if is_hit(f, right)), None)
            if example and form == "white":
                yield f"    {example[2]}"


def report(clean, misfits):
    start = time.perf_counter()
    with ProcessPoolExecutor(max_workers=os.cpu_count()) as pool:
        yield from (
            "Findings of compare on simulated drives",
            "",
            "Drives of 128 s at 20 Hz on one of four soils, with the contact that the base assumes: load ±20 %,",
            "slip 0.16 to 0.48, speed, pitch, yaw rate, motor temperature and pass all vary. Noise of load,",
            "torque, sinkage and slip is 3 % of each where not said otherwise. Windows by --segments auto, model",
            f"wong-reece without effects. A finding has p < {FINDING_LEVEL:g} over all channels, drivers and shapes, and is",
            f"larger than {SMALLEST_FINDING:g} of the noise. Shares of drives in %, with 95 % intervals.",
            "",
            f"1. Clean drives, {clean} a row: the share with any finding, and their number",
        )
        yield from clean_rows(pool, clean)
        yield from (
            "",
            f"2. Known misfits, {misfits} a row: the share where a finding names the right channel with the right",
            "driver (or one that varied alike), where the first finding does, and findings in a drive",
        )
        yield from misfit_rows(pool, misfits)
    yield ""
    yield f"{time.perf_counter() - start:.0f} s"


def main(clean=60, misfits=20):
    publish(report(clean, misfits), RESULT)


if __name__ == "__main__":
    main(*(int(argument) for argument in sys.argv[1:]))
