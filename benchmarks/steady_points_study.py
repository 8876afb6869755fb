"""How often `diagnose` is right about a few steady test points, as papers and soil bins give them.

    python benchmarks/steady_points_study.py [CLEAN [HIDDEN]]

writes benchmarks/results/steady_points_study.txt. CLEAN tables of each size, 60 by default, hide nothing,
and HIDDEN, 6 by default, hide each of the effects in each of its forms.
"""

from __future__ import annotations

import os
import sys
import time
from concurrent.futures import ProcessPoolExecutor
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

import numpy as np  # noqa: E402 - found through the path above
from diagnosis_table import share  # noqa: E402 - as above
from hidden_drives import LOAD, PULL_NOISE, SOILS, WHEEL, ramps, sized  # noqa: E402 - as above
from simulator import Drive, Sensor, Track, base_contact, constant, simulate  # noqa: E402 - as above

from formats import Labels  # noqa: E402 - as above
from terrain_cli.diagnosis import diagnose  # noqa: E402 - as above
from terrain_cli.mechanics.wheel_model import Model  # noqa: E402 - as above
from terrain_cli.models import ModelFile  # noqa: E402 - as above
from terrain_cli.telemetry.wheel_samples import Geometry, Samples  # noqa: E402 - as above
from terrain_cli.windows.cut_windows import cut  # noqa: E402 - as above

RESULT = HERE / "results" / "steady_points_study.txt"
#: Slips, and loads at which each is run.
SIZES = {
    "5 slips, one load": (5, 1),
    "6 slips, one load": (6, 1),
    "8 slips, one load": (8, 1),
    "12 slips, one load": (12, 1),
    "6 slips, two loads": (6, 2),
    "12 slips, two loads": (12, 2),
}
EFFECTS = ("slip-sinkage", "max-stress-angle", "drivetrain-friction", "gear-efficiency", "bulldozing")
CHANNELS = ("load", "torque", "sinkage", "slip", "drawbar_pull")
#: Share of noise in each reading, of which one is drawn; steady runs are averaged, and repeat that well.
NOISES = (0.01, 0.02, 0.03)
#: s that a test point lasts; it is read in its middle.
STEADY = 4.0
#: Seeds of the tables, none of which was looked at before the rules were set.
FIRST = 8_510_000


def points(seed, slips, loads, effects):
    """Measure a wheel at rising slips under one load after another."""
    rng = np.random.default_rng([9, seed])
    soil = base_contact(SOILS[int(rng.integers(len(SOILS)))])
    noise = float(rng.choice(NOISES))
    slip = np.tile(np.linspace(rng.choice([0.0, 0.05, 0.1]), rng.uniform(0.4, 0.7), slips), loads)
    load = np.repeat(LOAD * rng.uniform(0.8, 1.2) * np.array([1.0, 1.6])[:loads], slips)
    noisy = Sensor(relative=noise)
    drive = Drive(
        [Track("wheel", [(soil, STEADY * len(slip))], ramps(load, STEADY), ramps(slip, STEADY))],
        WHEEL,
        constant(0.05),
        effects=effects,
        rate=1.0,
        sensors={
            **dict.fromkeys(CHANNELS, noisy),
            "slip": Sensor(),
            "drawbar_pull": Sensor(absolute=PULL_NOISE * noise),
        },
        channels=(*CHANNELS, "angular_velocity", "velocity"),
        seed=seed,
    )
    columns = simulate(drive).wheels["wheel"].aligned()
    middle = np.searchsorted(columns["time"], STEADY * (np.arange(len(slip)) + 0.5))
    return Samples(
        source=f"points {seed}",
        wheel="wheel",
        geometry=Geometry(WHEEL.radius, WHEEL.width, 0.018),
        origin=0.0,
        time=None,
        channels={name: columns[name][middle] for name in CHANNELS},
        labels={},
        stretch=np.zeros(len(slip), dtype=np.intp),
        distance=None,
        set_aside=Labels(np.full(len(slip), -1, dtype=np.int32), ()),
    )


def asked(job):
    """Diagnose a table: alarm, name and family."""
    seed, slips, loads, effect, form = job
    samples = points(seed, slips, loads, sized(effect, form=form) if effect else {})
    found = diagnose([cut(samples, "none")], ModelFile(model=Model()), seed=seed)
    return found.alarm.raised, found.effect, found.family


def report(clean, hidden):
    began = time.perf_counter()
    with ProcessPoolExecutor(max_workers=os.cpu_count()) as pool:
        yield from (
            "Steady test points: what diagnose says of tables of a few",
            "",
            "A wheel at slips from 0 … 0.1 to 0.4 … 0.7 under one load, or two, on one of four soils, by the",
            "simulator of the tests; noise of load, torque and sinkage 1, 2 or 3 % of each, of the pull 0.15 to",
            "0.45 N, none repeated. Effects at full size, in the form of the catalogue and in another.",
            f"Seeds from {FIRST}; shares in % with 95 % intervals.",
            "",
            f"1. Nothing hidden, {clean} tables a row: the share with an alarm, and with a name",
        )
        for size, (slips, loads) in SIZES.items():
            jobs = [(FIRST + seed, slips, loads, "", "") for seed in range(clean)]
            found = list(pool.map(asked, jobs))
            yield f"{size:<22}{share(one[0] for one in found)}  {share(one[1] is not None for one in found)}"
        yield from (
            "",
            f"2. {', '.join(EFFECTS)}, {hidden} tables of each in each form a row:",
            "the share with an alarm, with the effect in the family, first in it, named alone, and with a wrong name",
        )
        for size, (slips, loads) in SIZES.items():
            jobs = [
                (FIRST + seed, slips, loads, effect, form)
                for effect in EFFECTS
                for form in ("catalogue", "other")
                for seed in range(hidden)
            ]
            rows = [(job[3], *one) for job, one in zip(jobs, pool.map(asked, jobs), strict=True)]
            yield (
                f"{size:<22}{share(alarm for _, alarm, _, _ in rows)}  "
                f"{share(effect in family for effect, _, _, family in rows)}"
            )
            yield (
                f"{'':<22}{share(family[:1] == (effect,) for effect, _, _, family in rows)}  "
                f"{share(name == effect for effect, _, name, _ in rows)}"
                f"{share(name not in (None, effect) for effect, _, name, _ in rows)}"
            )
    yield ""
    yield f"{time.perf_counter() - began:.0f} s"


def main(clean=60, hidden=6):
    lines = []
    for line in report(clean, hidden):
        print(line, flush=True)
        lines.append(line.rstrip())
    RESULT.write_text("\n".join(lines) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main(*(int(argument) for argument in sys.argv[1:]))
