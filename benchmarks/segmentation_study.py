"""Why `change_points` has the constants it has: false splits and changes found on simulated drives.

    python benchmarks/segmentation_study.py [RUNS]

writes benchmarks/results/segmentation_study.txt. RUNS clean drives, 300 by default, and half as
many over several soils make each row; the same RUNS give the same table but for the times.
"""

from __future__ import annotations

import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE.parent), str(HERE.parent / "tests"), str(HERE.parent / "tests" / "windows")]

from soil_drives import Kind, clean, drive, mixed  # noqa: E402 - found through the path above

from terrain_cli.windows.change_points import PENALTY, change_points  # noqa: E402 - as above

RESULT = HERE / "results" / "segmentation_study.txt"
PENALTIES = (10.0, 15.0, 20.0, 25.0, 30.0, 40.0)
LOADS_AND_SLIPS = (
    ("constant", "constant"),
    ("constant", "waves"),
    ("steps", "constant"),
    ("steps", "steps"),
    ("waves", "constant"),
    ("waves", "waves"),
    ("white", "constant"),
    ("white", "waves"),
)
SENSORS = (
    ("white, 10 %", {"share": 0.10}),
    ("correlated (AR 0.8), 3 %", {"noise": "correlated"}),
    ("correlated (AR 0.8), 10 %", {"noise": "correlated", "share": 0.10}),
    ("sinkage interpolated 8 times", {"noise": "interpolated"}),
    ("slip from ω and V, 3 % each", {"rolling": 0.03}),
)


def find(one, penalty=PENALTY):
    return change_points(one.x, one.y, distance=one.distance, penalty=penalty)


def percent(part, whole):
    """Return a share in percent with its 95 % Wilson interval."""
    if whole == 0:
        return "–"
    z, p = 1.96, part / whole
    middle = (p + z * z / (2 * whole)) / (1 + z * z / whole)
    half = z / (1 + z * z / whole) * np.sqrt(p * (1 - p) / whole + z * z / (4 * whole * whole))
    return f"{100 * p:5.1f} ({100 * max(middle - half, 0):4.1f}–{100 * min(middle + half, 1):5.1f})"


def false_runs(kind, runs, penalty=PENALTY, **lengths):
    return sum(len(find(clean(seed, kind, **lengths), penalty)) > 2 for seed in range(runs))


def found(kind, runs, penalty=PENALTY):
    return sum(one.score(find(one, penalty)) for one in (mixed(seed, kind) for seed in range(runs)))


def split_rates(kind, runs, **options):
    """Return the shares of clean drives that split, by both truths."""
    models = ("linear", "wong-reece")
    return [percent(false_runs(replace(kind, model=model), runs, **options), runs) for model in models]


def row(label, cells):
    return f"{label:<34}" + "".join(f"{cell:>21}" for cell in cells)


def rows(kinds, runs):
    """Return a row for each kind of drive; where slip is swept, without drives over several soils."""
    for label, kind in kinds:
        cells = split_rates(kind, runs)
        if kind.slip != "sweep":
            hits, changes, false, bounds = found(kind, runs // 2)
            cells += [percent(hits, changes), percent(false, bounds)]
        yield row(label, cells)


def loads_and_slips():
    for load, slip in (
        *LOADS_AND_SLIPS,
        *((load, "sweep") for load in ("constant", "steps", "waves", "white")),
    ):
        yield f"load {load}, slip {slip}", Kind(load, slip)


def sensors():
    for label, changed in SENSORS:
        yield f"{label}, steps", replace(Kind("steps", "constant"), **changed)
        yield f"{label}, waves", replace(Kind("waves", "waves"), **changed)


def wrong_moduli():
    for ratio in (0.67, 0.8, 1.25, 1.5):
        for load, slip in (("steps", "constant"), ("waves", "waves"), ("steps", "sweep")):
            yield f"k × {ratio}, {load}, slip {slip}", Kind(load, slip, shear_modulus=0.018 * ratio)


def long_drives(runs):
    for load, slip in (("steps", "constant"), ("waves", "waves"), ("steps", "sweep")):
        yield row(
            f"load {load}, slip {slip}", split_rates(Kind(load, slip), runs, shortest=19_999, longest=20_000)
        )


def penalties(runs):
    """Return a row for each penalty, over the loads and slips that are not swept."""
    kinds = [Kind(load, slip) for load, slip in LOADS_AND_SLIPS]
    for penalty in PENALTIES:
        cells = []
        for changed in ({"model": "linear"}, {}, {"noise": "correlated"}):
            false = sum(false_runs(replace(kind, **changed), runs // 3, penalty) for kind in kinds)
            cells.append(percent(false, len(kinds) * (runs // 3)))
        hits, changes, false, bounds = sum(found(kind, runs // 6, penalty) for kind in kinds)
        yield row(f"penalty {penalty:g}", [*cells, percent(hits, changes), percent(false, bounds)])


def times():
    for n in (1000, 3000, 10_000, 100_000, 1_000_000):
        count = max(1, n // 1000)
        names = np.resize(["dry sand", "wet clayey soil", "upland sandy loam"], count)
        one = drive(np.random.default_rng(n), Kind(), names, [n // count] * count, 50)
        took = []
        for _ in range(5 if n <= 100_000 else 1):
            start = time.perf_counter()
            find(one)
            took.append(time.perf_counter() - start)
        yield f"n = {n:>9,}: {1e3 * min(took):8.1f} ms"


def report(runs):
    head = ("false, linear", "false, full")
    found_head = ("found, full", "false bounds, full")
    yield from (
        "Change points of y = c + x tan φ: false splits and changes found",
        "",
        f"Clean drives, {runs} a cell: one of 9 soils, 200 to 5000 samples at 10, 20 or 50 Hz; the share",
        "in % of drives that split, with its 95 % interval. Truth is the linearised model or the full",
        f"Wong–Reece wheel. Drives over several soils, {runs // 2} a cell: 3 to 6 soils whose lines differ by",
        "10 % of the strength, 8 to 20 s each; the share of changes found within 1 s, and of bounds further",
        "than 1 s from any change. Load waves by ±12 to 25 %, steps by up to ±30 %, or is white within",
        "±15 %; slip waves by ±15 to 40 %, steps between 0.15 and 0.5, or is swept from 0.1 to 0.6. Where",
        "not said otherwise noise is white, 3 % of each of W, T, z and i, k is the true one, and the",
        f"penalty is {PENALTY:g}. Most changes missed under constant load join two clouds by a line that a",
        "soil may have: nothing in (x, y) tells them from a step of the load.",
        "",
        "1. Load and slip",
        row("", head + found_head),
        *rows(loads_and_slips(), runs),
        "",
        "2. Sensors; with steps slip is constant, with waves it waves too",
        row("", head + found_head),
        *rows(sensors(), runs),
        "",
        "3. A wrong k, assumed over true",
        row("", head + found_head),
        *rows(wrong_moduli(), runs),
        "",
        f"4. Long drives: 20,000 samples of one soil, {runs // 3} a cell",
        row("", head),
        *long_drives(runs // 3),
        "",
        "5. The penalty: the rows of 1. in which slip is not swept, together",
        row("", (*head, "false, AR 0.8 noise", *found_head)),
        *penalties(runs),
        "",
        "6. Time, with a new soil every 20 s at 50 Hz",
        *times(),
    )


def main(runs):
    text = "\n".join(report(runs)) + "\n"
    RESULT.write_text(text, encoding="utf-8")
    print(text, end="")


if __name__ == "__main__":
    main(*(int(argument) for argument in sys.argv[1:] or ["300"]))
