"""How far the rows of `estimate --follow` are from those of `estimate`, by the full model.

    python benchmarks/follow_agreement.py [DRIVES]

writes benchmarks/results/follow_agreement.txt: DRIVES, 40 by default, over several soils; the same DRIVES give
the same table but for the times.
"""

from __future__ import annotations

import os

os.environ.update(dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1"))

import sys
import time
from pathlib import Path

import numpy as np

HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE.parent), str(HERE.parent / "tests")]

from simulator import SOILS, base_contact, one_wheel, simulate, undulation, wave  # noqa: E402

import terrain_cli  # noqa: E402
from benchmarks.published import publish  # noqa: E402 - found through the path above
from terrain_cli.estimation import estimators  # noqa: E402
from terrain_cli.presentation import segment_table  # noqa: E402
from terrain_cli.rover import rover_file  # noqa: E402
from terrain_cli.run.settings import Settings  # noqa: E402
from terrain_cli.stream import followed_wheel  # noqa: E402
from terrain_cli.windows import cut_windows  # noqa: E402

RESULT = HERE / "results" / "follow_agreement.txt"
ROVER = rover_file.of_text("[wheel]\nradius = 0.125\nwidth = 0.1\n[soil]\nshear_modulus = 0.018\n")
NAMES = tuple(name for name in SOILS if name not in {"snow", "lunar soil"})
FIRST, RATE, SOILS_OF_EACH = 9_610_000, 20.0, 6
#: Earlier segments that are fitted with the next, and samples of each; (8, 4000) are in use.
CHOICES = ((0, 4000), (2, 4000), (8, 400), (8, 4000), (4, 4000))
FILE = estimators.full_model()
#: Samples of a segment so far at which its open row is looked at.
OPEN = (20, 60, 100, 200, 400, 800, 1200)


def drive(seed):
    """Return the samples of a wheel over 6 soils of 20 to 100 s each, with labels."""
    import pandas as pd

    rng = np.random.default_rng(seed)
    names = rng.choice(NAMES, SOILS_OF_EACH)
    run = simulate(
        one_wheel(
            [
                (base_contact(SOILS[name]), float(length))
                for name, length in zip(names, rng.uniform(20, 100, SOILS_OF_EACH), strict=True)
            ],
            load=undulation(80.0, rng.uniform(0.1, 0.3), rng.uniform(4.0, 12.0), seed=seed),
            slip=wave(rng.uniform(0.2, 0.4), rng.uniform(0.2, 0.5), rng.uniform(6.0, 20.0)),
            noise=0.03,
            rate=RATE,
            seed=seed,
        )
    )
    table = pd.DataFrame(run.columns())
    log = run.wheels["wheel"]
    table["terrain"] = [f"{k}" for k in np.searchsorted(log.boundaries, table["time"], side="right")]
    return terrain_cli.from_frame(table, ROVER)[0]


def wheel(segments):
    stress = followed_wheel.CommonStress(None)
    return followed_wheel.FollowedWheel(Settings(segments=segments), FILE, stress, again=True)


def offline(samples, segments):
    cut = cut_windows.cut(samples, segments)
    return segment_table.table(cut, estimators.estimate(cut, "auto", FILE).estimates)


def apart(row, other, place=0):
    """Compare a row with one of a table.

    By how many standard errors c, φ and strength differ; the ratio of the errors of c and φ; whether the status
    is the same.
    """
    names = (("c_kPa", "c_se_kPa"), ("phi_deg", "phi_se_deg"), ("strength_kPa", "strength_se_kPa"))
    away = [abs(row[name][0] - other[name][place]) / other[error][place] for name, error in names]
    wider = [row[error][0] / other[error][place] for _, error in names[:2]]
    return [*away, *wider, row["status"][0] == other["status"][place]]


def named(samples, label):
    """Return the samples with a label."""
    labels = samples.labels["terrain"]
    return np.flatnonzero(np.array(labels.names)[labels.codes] == label)


def references(samples):
    """Return the table of the whole log, and those of the log up to the end of each segment, by labels."""
    ends = [int(named(samples, str(k))[-1]) + 1 for k in range(SOILS_OF_EACH)]
    return [offline(samples.taken(slice(0, end)), "terrain") for end in ends]


def closed(samples, tables, segments="terrain"):
    """Compare each closed row with that of the log, and with that of the log so far; and time them all.

    Third, compare what is told again at the end with the log. Rows whose ends are not those of a row of the log are left out.
    """
    follower = wheel(segments)
    began = time.process_time()
    rows = [*follower.take(samples), *follower.end()]
    took = (time.process_time() - began) / len(rows)
    again = follower.again(followed_wheel.CommonStress(None))
    later, now, last, whole = [], [], [], tables[-1]
    for row, said_again in zip(rows, again, strict=True):
        ends = np.array([whole["t_start_s"] - row["t_start_s"], whole["t_end_s"] - row["t_end_s"]])
        away = np.abs(ends).max(axis=0)
        place = int(away.argmin())
        if away[place] < 0.5 / RATE:
            later.append([place, *apart(row, whole, place)])
            now.append([place, *apart(row, tables[place], place)])
            last.append([place, *apart(said_again, whole, place)])
    return *(np.array(found, dtype=float) for found in (later, now, last)), took


def opened(samples):
    """Compare open rows of the second segment, which are told every 20 samples, with `estimate` of these alone.

    In each: its samples, the seconds it took, and NaN where it is by the recursive estimator.
    """
    one = samples.taken(named(samples, "1"))
    follower, found = wheel("none"), []
    for count in range(20, len(one) + 1, 20):
        list(follower.take(one.taken(slice(count - 20, count))))
        began = time.process_time()
        row = follower.open_row()
        took = time.process_time() - began
        if count in OPEN:
            full = row["method"] == ["wong-reece"]
            there = offline(one.taken(slice(0, count)), "none") if full else None
            found.append([count, took, *(apart(row, there) if full else [np.nan] * 6)])
    return found


def said(rows):
    """Say what columns of c, φ and strength, of both errors, and of the status say."""
    cells = []
    for row in rows[:, :3].T:
        column = row[np.isfinite(row)]
        cells.append(
            f"{100 * np.mean(column <= 0.1):9.0f}{np.median(column):8.3f}{np.percentile(column, 95):8.3f}"
        )
    return "".join(cells) + f"{np.nanmedian(rows[:, 3]):8.3f}{100 * rows[:, 5].mean():8.0f}{len(rows):6d}"


HEAD = (
    "".join(f"{f'{name}: %':>9}{'median':>8}{'95 %':>8}" for name in ("c", "φ", "strength"))
    + f"{'errors':>8}{'status':>8}{'rows':>6}{'s':>7}"
)


def report(drives):
    logs = [drive(seed) for seed in range(FIRST, FIRST + drives)]
    tables = [references(log) for log in logs]
    yield from (
        "Rows of estimate --follow beside those of estimate: by how many standard errors c, φ and strength differ",
        "",
        f"{drives} drives over {SOILS_OF_EACH} soils of 20 to 100 s at {RATE:g} Hz, 3 % of noise, the full model. Share of the rows",
        "within 0.1 standard errors in %, median and 95 % of the difference; then the median ratio of the errors of c, the",
        "share of rows of the same status in %, rows, and the seconds of a processor for a row.",
        "",
        "1. Closed rows, segments by labels. Fitted again with the next are the last EARLIER segments, so many samples of",
        "   EACH. First beside the log so far, the segments up to this one; then beside the whole log. At last what",
        "   --again tells at the end, beside the whole log.",
        "",
        f"{'EARLIER':>8}{'EACH':>6}{HEAD}",
    )
    for earlier, each in CHOICES:
        for name, value in (("_EARLIER", earlier), ("_OF_EACH", each)):
            setattr(followed_wheel, name, value)
        found = [closed(log, those) for log, those in zip(logs, tables, strict=True)]
        took = f"{np.mean([one[3] for one in found]):7.3f}"
        whole, now, again = (np.concatenate([one[kind] for one in found]) for kind in (0, 1, 2))
        yield f"{earlier:8d}{each:6d}{said(now[:, 1:])}{took}"
        yield f"{'whole log':>14}{said(whole[:, 1:])}"
    yield f"{'4th and later':>14}{said(whole[whole[:, 0] >= 3, 1:])}"
    yield f"{'told again':>14}{said(again[:, 1:])}"
    yield from (
        "",
        "2. Open rows of a segment, told every 20 samples, beside estimate of the same samples alone.",
        "",
        f"{'samples':>14}{HEAD}",
    )
    found = np.array([row for log in logs for row in opened(log)], dtype=float)
    for count in OPEN:
        some = found[found[:, 0] == count]
        full = some[np.isfinite(some[:, 7])]
        if len(full):
            yield f"{count:14d}{said(full[:, 2:])}{some[:, 1].mean():7.3f}"
    recursive = np.isnan(found[:, 7])
    yield f"by the recursive estimator, as the full model told neither: {recursive.sum()} of {len(found)} rows"


def main():
    publish(report(int(sys.argv[1]) if len(sys.argv) > 1 else 40), RESULT)


if __name__ == "__main__":
    main()
