"""Whether the p-value of `diagnose` is one: how it is distributed where nothing is hidden, and what it detects.

    python benchmarks/alarm_study.py [--clean N] [--hidden N] [--jobs N]

prints the table and writes it to benchmarks/results/alarm_study.txt. Drives are of 800 samples, of six vehicles on four
soils, at three rates, on smooth and rough loads, with white noise, noise of AR(1) 0.8, and two soils in turn.
"""

from __future__ import annotations

import argparse
import multiprocessing
import os
import sys
from pathlib import Path

HERE = Path(__file__).resolve().parent
sys.path[:0] = [
    str(HERE.parent),
    str(HERE.parent / "tests"),
    str(HERE.parent / "tests" / "diagnosis"),
    str(HERE),
]
os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import hidden_drives  # noqa: E402 - as above
import numpy as np  # noqa: E402 - found through the path above
from finding_study import percent  # noqa: E402 - as above
from hidden_drives import FULL, Kind, Rover, sized  # noqa: E402 - as above
from scipy import stats  # noqa: E402 - as above
from simulator import Wheel, undulation  # noqa: E402 - as above
from window_coverage_study import VEHICLES  # noqa: E402 - as above

from terrain_cli import models  # noqa: E402 - as above
from terrain_cli.diagnosis import diagnose, diagnosed_log, refits, steps  # noqa: E402 - as above
from terrain_cli.effects import catalogue  # noqa: E402 - as above

RESULT = HERE / "results" / "alarm_study.txt"
#: Seeds of the drives, without and with an effect.
FIRST, FIRST_HIDDEN = 84_000_000, 84_002_000
SAMPLES, RATES = 800, (10.0, 20.0, 40.0)
NOISES, COURSES = ("white", "ar1", "two soils"), ("rich", "poor-load", "rich", "poor-speed")
LEVELS = (0.01, 0.05, 0.1, 0.5)


def windows_of(seed, effects):
    """Drive one of the vehicles, and return its windows."""
    rng = np.random.default_rng([9, seed])
    radius, width, load = VEHICLES[rng.integers(len(VEHICLES))]
    rate = RATES[rng.integers(len(RATES))]
    noise = NOISES[seed % len(NOISES)]
    course, share = COURSES[rng.integers(len(COURSES))], rng.choice([0.01, 0.03])
    rough = undulation(1.0, rng.choice([0.0, 0.25]), rng.uniform(0.5, 2.0), seed + 21)
    wheel = Wheel(radius=radius, width=width, grouser_height=0.08 * radius, grouser_count=12)
    kind = Kind(
        effects,
        noise="ar1" if noise == "ar1" else "white",
        soils=2 if noise == "two soils" else 1,
        course=course,
        share=share,
        seconds=SAMPLES / rate,
        rate=rate,
        rover=Rover(wheel=wheel, load=load, rough=rough),
    )
    return hidden_drives.windows_of(seed, kind)


def p_values(seed):
    """Return how often chance gives what is seen: by the scores before any effect is fitted, and by the alarm."""
    effects = {} if seed < FIRST_HIDDEN else sized(list(FULL)[seed % len(FULL)], 0.5)
    windows, every = windows_of(seed, effects), list(catalogue().values())
    case = diagnosed_log.Case(file=models.ModelFile(), effects=every, seed=seed, progress=lambda _: None)
    log = diagnosed_log.scores(case, diagnosed_log.soils(case, windows))
    scores = steps.alarm_of_scores(case, log, refits.refit(log.data, None))
    alarm = diagnose(windows, models.ModelFile(), effects=every, seed=seed, smallest_share=0.0).alarm
    return scores.p_value, alarm.p_value


def row(name, found):
    """Return the shares of p-values below each level, with the test of whether small ones are too many."""
    found = np.asarray(found)
    shares = "".join(f"{percent(int(np.sum(found <= level)), len(found)):>22}" for level in LEVELS)
    ks = stats.kstest(found, "uniform", alternative="greater").pvalue
    return f"{name:<20}{len(found):>5}{shares}{ks:>7.2f}"


def told(clean, hidden):
    """Yield the table, from the pairs of p-values by seed of clean drives, and of drives with an effect."""
    head = "".join(f"{f'p <= {level:g}':>22}" for level in LEVELS)
    yield "Is the p-value of `diagnose` one?"
    yield ""
    yield f"Drives of {SAMPLES} samples at {', '.join(f'{rate:g}' for rate in RATES)} Hz, six vehicles, four soils, smooth loads and loads that"
    yield "change by a quarter in half a second to two seconds, noise of 1 or 3 %. Scores: the effects' scores, the laws and the"
    yield "order of points, before any effect is fitted. Alarm: also the gain on held-out blocks; this is the p_value that is"
    yield "printed, without the least size that an alarm asks for besides. % of drives (95 % interval), and the p-value of the"
    yield "test of Kolmogorov and Smirnov that small p-values are not more frequent than chance makes them."
    for number, (title, found) in enumerate(
        [("Nothing hidden", clean), ("An effect of half its full size", hidden)], 1
    ):
        yield ""
        yield f"{number}. {title}, seeds from {min(found)}"
        yield f"{'':<20}{'n':>5}{head}{'KS':>7}"
        for place, what in enumerate(("scores", "alarm")):
            yield row(what, [pair[place] for pair in found.values()])
            if found is clean:
                for k, name in enumerate(NOISES):
                    some = [pair[place] for seed, pair in found.items() if seed % len(NOISES) == k]
                    yield row(f"  {name}", some)


def main(arguments=None):
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--clean", type=int, default=150, metavar="N", help="drives with nothing hidden")
    parser.add_argument(
        "--hidden", type=int, default=2 * len(FULL), metavar="N", help="drives with an effect"
    )
    parser.add_argument("--jobs", type=int, default=1, metavar="N", help="processes")
    given = parser.parse_args(arguments)
    seeds = [*range(FIRST, FIRST + given.clean), *range(FIRST_HIDDEN, FIRST_HIDDEN + given.hidden)]
    with multiprocessing.Pool(given.jobs) as pool:
        pairs = dict(zip(seeds, pool.imap(p_values, seeds), strict=True))
    clean, hidden = (
        {seed: pair for seed, pair in pairs.items() if (seed >= FIRST_HIDDEN) == there}
        for there in (False, True)
    )
    lines = list(told(clean, hidden))
    print("\n".join(lines))
    RESULT.write_text("\n".join(lines) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
