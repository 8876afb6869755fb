"""What `diagnose` says of the base linear, the paper's, on drives of the full wheel.

    python benchmarks/linear_base_study.py [CLEAN [HIDDEN]]

writes benchmarks/results/linear_base_study.txt. CLEAN drives of each course, 12 by default, lack nothing but what
the base takes for granted, and HIDDEN, 3 by default, hide each of the effects in each of its forms besides.
"""

from __future__ import annotations

import os
import sys
import time
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from pathlib import Path

HERE = Path(__file__).resolve().parent
sys.path[:0] = [
    str(HERE),
    str(HERE.parent),
    str(HERE.parent / "tests"),
    str(HERE.parent / "tests" / "diagnosis"),
]
os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

from diagnosis_table import share  # noqa: E402 - found through the path above
from hidden_drives import Kind, samples_of, sized  # noqa: E402 - as above

from terrain_cli.diagnosis import diagnose  # noqa: E402 - as above
from terrain_cli.models import ASSUMPTIONS, build  # noqa: E402 - as above
from terrain_cli.windows.cut_windows import cut  # noqa: E402 - as above

RESULT = HERE / "results" / "linear_base_study.txt"
COURSES = ("rich", "poor-load", "poor-speed", "poor")
EFFECTS = (
    "slip-sinkage",
    "max-stress-angle",
    "grousers",
    "side-slip",
    "drivetrain-friction",
    "gear-efficiency",
    "motor-temperature",
    "slope",
    "drawbar-bias",
    "sensor-lag",
)
#: k that the base assumes, in m, in turn; that of the soils is 0.018.
ASSUMED = (0.018, 0.01, 0.03)
#: Seeds of the drives, none of which was looked at before the rules were set.
FIRST = 8_750_000


def asked(job):
    """Diagnose a drive: alarm, name, family."""
    seed, course, effect, form = job
    kind = Kind(sized(effect, form=form) if effect else {}, course=course)
    samples = samples_of(seed, kind)
    geometry = samples.geometry._replace(shear_modulus=ASSUMED[seed % len(ASSUMED)])
    found = diagnose([cut(replace(samples, geometry=geometry))], build("linear"), seed=seed)
    return effect, found.alarm.raised, found.effect, set(found.family)


def line(title, rows):
    """Return shares of the rows with an alarm, assumption, effect and names."""
    shares = (
        (raised for _, raised, _, _ in rows),
        (bool(family & ASSUMPTIONS.keys()) for *_, family in rows),
        (effect in family for effect, _, _, family in rows),
        (name in ASSUMPTIONS for _, _, name, _ in rows),
        (name is not None and name == effect for effect, _, name, _ in rows),
        (name not in (None, effect, *ASSUMPTIONS) for effect, _, name, _ in rows),
    )
    return f"{title:<20}" + "".join(f"{share(some):>26}" for some in shares)


def report(clean, hidden):
    began = time.perf_counter()
    with ProcessPoolExecutor(max_workers=os.cpu_count()) as pool:
        yield from (
            "The base linear on drives of the full wheel: what diagnose says is missing",
            "",
            "Drives of 128 s by the simulator of the tests, which integrates the stresses of Bekker, Janosi–Hanamoto",
            "and Wong–Reece, on one of four soils of k = 18 mm, of which the base assumes 18, 10 or 30 in turn. 3 % noise of",
            "load, torque, sinkage and slip. What the base takes for granted is missing in each of them.",
            f"Seeds from {FIRST}; shares in % with 95 % intervals.",
            "",
        )
        heads = (
            "alarm",
            "an assumption in family",
            "the effect in it",
            "assumption named",
            "effect named",
            "wrong name",
        )
        yield f"{'':<20}" + "".join(f"{head:>26}" for head in heads)
        yield f"1. No effect, {clean} drives a row"
        for course in COURSES:
            jobs = [(FIRST + seed, course, "", "") for seed in range(clean)]
            yield line(course, list(pool.map(asked, jobs)))
        yield f"2. With an effect of full size, rich drives, {hidden} in the form of the catalogue and {hidden} in another"
        every = []
        for effect in EFFECTS:
            jobs = [
                (FIRST + seed, "rich", effect, form)
                for form in ("catalogue", "other")
                for seed in range(hidden)
            ]
            rows = list(pool.map(asked, jobs))
            every += rows
            yield line(effect, rows)
        yield line("all", every)
    yield ""
    yield f"{time.perf_counter() - began:.0f} s"


def main(clean=12, hidden=3):
    lines = []
    for text in report(clean, hidden):
        print(text, flush=True)
        lines.append(text.rstrip())
    RESULT.write_text("\n".join(lines) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
