"""Why `online_cuts` has the constants it has: agreement with the offline search, delay, false splits, cost.

    python benchmarks/follow_study.py [RUNS]

writes benchmarks/results/follow_study.txt. RUNS drives of each kind, 6 by default, over several soils, and
as many over one soil; the same RUNS give the same table but for the times.
"""

from __future__ import annotations

import sys
import time
from pathlib import Path

import numpy as np

HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE.parent), str(HERE.parent / "tests"), str(HERE.parent / "tests" / "windows")]

from soil_drives import (  # noqa: E402 - found through the path above
    NAMES,
    Kind,
    clean,
    differ,
    drive,
    mixed,
    stiffened,
)

from benchmarks.published import publish  # noqa: E402 - found through the path above
from terrain_cli.vocabulary.choices import CUT_SAMPLES, MIN_DISTANCE  # noqa: E402 - as above
from terrain_cli.windows import online_cuts  # noqa: E402 - as above
from terrain_cli.windows.change_points import change_points, needed  # noqa: E402 - as above
from terrain_cli.windows.sinkage_changes import sinkage_changes  # noqa: E402 - as above

RESULT = HERE / "results" / "follow_study.txt"
KINDS = [
    *(Kind(load, slip) for load in ("constant", "steps", "waves", "white") for slip in ("constant", "waves")),
    Kind("steps", "steps"),
    Kind("waves", "waves", noise="correlated"),
]
#: HORIZON, SETTLED, EVERY_SECONDS, AGAIN_SECONDS; the first are those in use.
CHOICES = (
    (2048, 120, 10.0, 5.0),
    (1024, 120, 10.0, 5.0),
    (2048, 60, 10.0, 5.0),
    (2048, 240, 10.0, 5.0),
    (2048, 120, 5.0, 5.0),
    (2048, 120, 10.0, 2.0),
)
NAMES_OF = ("HORIZON", "SETTLED", "EVERY_SECONDS", "AGAIN_SECONDS")
#: The constants were chosen on the seeds from 0 on.
FIRST = 9_620_000


def long_drive(seed, kind):
    """Return a drive over 3 soils of 60 to 200 s each at 50 Hz: longer than any horizon."""
    rng = np.random.default_rng([3, seed])
    soils = [rng.choice(NAMES)]
    while len(soils) < 3:
        name = rng.choice(NAMES)
        if differ(name, soils[-1]):
            soils.append(name)
    return drive(rng, kind, soils, (rng.uniform(60.0, 200.0, 3) * 50).astype(int), 50)


def whole(one):
    """Return the bounds of the whole drive, as `cut_windows.cut` finds them."""
    none = np.empty(0, dtype=np.intp)
    bounds = needed(one.x, one.y, [one.slip], change_points(one.x, one.y, distance=one.distance), none)
    return sinkage_changes(
        one.load,
        one.sinkage,
        one.slip,
        [one.slip],
        bounds,
        distance=one.distance,
        min_samples=CUT_SAMPLES,
        min_distance=MIN_DISTANCE,
    )


def follow(one, chunk=64):
    """Return the bounds told as the samples arrive, and how long after it each was told, in s."""
    n = len(one.x)
    line = (np.arange(n), np.arange(n) / one.rate, one.x, one.y, one.distance)
    columns = np.array([*line, one.load, one.sinkage, one.slip])
    cuts, found, delays = online_cuts.OnlineCuts(), [], []
    for first in range(0, n, chunk):
        told = cuts.add(columns[:, first : first + chunk])
        found += told
        delays += [(cuts.count - bound) / one.rate for bound in told]
    return np.array([0, *found, *cuts.end(), n]), delays


def alike(some, others, rate):
    """Count those of some bounds that have another within 1 s."""
    return sum(bool(len(others)) and np.abs(others - bound).min() <= rate for bound in some)


def row(drives, cleans):
    """Return the figures of one choice of constants."""
    counts, score, delays, spent, size = np.zeros(4, int), np.zeros(4, int), [], 0.0, 0
    for one, offline in drives:
        began = time.process_time()
        online, late = follow(one)
        spent, size = spent + time.process_time() - began, size + len(one.x)
        a, b = offline[1:-1], online[1:-1]
        counts += [alike(a, b, one.rate), len(a), alike(b, a, one.rate), len(b)]
        score += one.score(online)
        delays += late
    false = sum(len(follow(one)[0]) > 2 for one, _ in cleans)
    middle, most = np.percentile(delays, [50, 95])
    return (
        f"{100 * counts[0] / counts[1]:10.1f}{100 * counts[2] / counts[3]:10.1f}"
        f"{100 * score[0] / score[1]:10.1f}{100 * score[2] / max(score[3], 1):10.1f}"
        f"{100 * false / len(cleans):10.2f}{middle:10.1f}{most:10.1f}{1e6 * spent / size:10.1f}"
    )


def report(runs):
    seeds = range(FIRST, FIRST + runs)
    stronger = [mixed(seed, kind) for kind in KINDS for seed in seeds]
    stronger += [long_drive(seed, kind) for kind in KINDS for seed in seeds[: max(runs // 4, 1)]]
    stiffer = [stiffened(seed, kind) for kind in KINDS for seed in seeds]
    cleans = [clean(seed, kind, longest=20_000) for kind in KINDS for seed in seeds]
    yield from (
        "Change points as samples arrive, beside those of the whole drive",
        "",
        f"{len(stronger)} drives over soils of other strength, some with segments longer than the horizon; {len(stiffer)}",
        "over one soil that is by turns twice as stiff and no stronger, so that the sinkage has to tell it; and",
        f"{len(cleans)} over one soil of 200 to 20,000 samples. 10 to 50 Hz, 3 % of noise. In %: bounds of the whole",
        "drive that are told within 1 s of their place; bounds told that the whole drive has too; changes of soil",
        "found within 1 s; bounds told that are none; drives over one soil that split. Then the time in s from a",
        "bound until it is told, median and 95 %, and microseconds of processor time for each sample.",
    )
    cleans = [(one, whole(one)) for one in cleans]
    for title, drives in (("soils of other strength", stronger), ("soils of other stiffness", stiffer)):
        yield from ("", title, "")
        yield from table([(one, whole(one)) for one in drives], cleans)


def table(drives, cleans):
    """Return a row for each choice of constants."""
    score = sum(one.score(offline) for one, offline in drives)
    false = sum(len(offline) > 2 for _, offline in cleans)
    yield (
        f"{'HORIZON':>8}{'SETTLED':>8}{'EVERY':>7}{'AGAIN':>7}{'same':>10}{'had':>10}{'found':>10}{'false':>10}{'split':>10}"
        f"{'delay':>10}{'95 %':>10}{'µs':>10}"
    )
    yield (
        f"{'whole drive':>30}{'':>20}{100 * score[0] / score[1]:10.1f}{100 * score[2] / score[3]:10.1f}"
        f"{100 * false / len(cleans):10.2f}"
    )
    before = [getattr(online_cuts, name) for name in NAMES_OF]
    for choice in CHOICES:
        for name, value in zip(NAMES_OF, choice, strict=True):
            setattr(online_cuts, name, value)
        yield f"{choice[0]:8d}{choice[1]:8d}{choice[2]:7.0f}{choice[3]:7.0f}" + row(drives, cleans)
    for name, value in zip(NAMES_OF, before, strict=True):
        setattr(online_cuts, name, value)


def main():
    publish(report(int(sys.argv[1]) if len(sys.argv) > 1 else 6), RESULT)


if __name__ == "__main__":
    main()
