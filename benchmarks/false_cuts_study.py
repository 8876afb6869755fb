"""How often one soil is cut in two where the model lacks an effect: by the line alone, and by all that cuts.

    python benchmarks/false_cuts_study.py [DRIVES]

writes benchmarks/results/false_cuts_study.txt, in a few minutes on two cores. DRIVES courses, 8 by default, are
driven on one soil and on two that take turns, at 1 and 3 % noise; the truth is that of the tests' simulator.
"""

from __future__ import annotations

import sys
from concurrent.futures import ProcessPoolExecutor
from itertools import product
from pathlib import Path

import numpy as np

HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE.parent), str(HERE.parent / "tests"), str(HERE.parent / "tests" / "diagnosis")]

from hidden_drives import FULL, Kind, sized, windows_of  # noqa: E402 - found through the path above

from terrain_cli.windows import cut_windows  # noqa: E402 - as above

RESULT = HERE / "results" / "false_cuts_study.txt"
RULES = "of_any_modulus", "needed", "sinkage_changes", "placed"
CUTS = [getattr(cut_windows, name) for name in RULES]
FIRST, SECONDS, TURN = 9_980_000, 200.0, 200.0 / 7.0
#: A change counts as found within so many seconds.
NEAR = 2.0


def _as_assumed(_lines, bounds, _fixed, **_):
    return bounds


def _not_joined(_x, _y, _drivers, bounds, _fixed):
    return bounds


def _not_cut(_load, _sinkage, _slip, _drivers, bounds, **_):
    return bounds


def _not_moved(_line, _wheel, bounds, _fixed, **_):
    return bounds


def counted(job):
    """Return the changes found and the false ones, of the line alone and with all that joins and cuts."""
    effect, seed, course, share, soils = job
    hidden = sized(effect) if effect else {}
    true = TURN * np.arange(1, 7) if soils == 2 else np.zeros(0)
    counts = []
    for rules in ((_as_assumed, _not_joined, _not_cut, _not_moved), CUTS):
        for name, rule in zip(RULES, rules, strict=True):
            setattr(cut_windows, name, rule)
        kind = Kind(effects=hidden, course=course, share=share, seconds=SECONDS, soils=soils)
        (windows,) = windows_of(seed, kind)
        times = windows.samples.time[windows.rows][windows.bounds[1:-1]]
        away = np.abs(times[:, None] - true)
        counts += [int((away < NEAR).any(axis=0).sum()), int((~(away < NEAR).any(axis=1)).sum())]
    return np.array(counts)


def lines(drives, run):
    yield "One soil, and two that take turns, under an effect that the model lacks: changes found and false ones"
    yield ""
    yield f"{drives} courses of {SECONDS:.0f} s a row, each at 1 and 3 % of noise, with loads that vary and that do not."
    yield "before: change points of the line alone; after: without those that another k, slip, load, speed, motor"
    yield "temperature or attitude explain, with those that the sinkage shows, and at the place where line and sinkage have them. multi-pass is"
    yield "no false cut: the soil is another in every pass."
    yield ""
    yield f"{'':22}{'one soil: false':>24}{'two soils: found':>30}{'two soils: false':>22}"
    yield f"{'effect':22}{'before':>14}{'after':>10}{'before':>20}{'after':>10}{'before':>12}{'after':>10}"
    courses = list(product(range(FIRST, FIRST + drives), ("rich", "poor-load"), (0.01, 0.03)))
    for effect in (None, *FULL):
        one, two = (sum(run(counted, [(effect, *course, soils) for course in courses])) for soils in (1, 2))
        of = 6 * len(courses)
        yield (
            f"{effect or 'none':22}{one[1]:>14}{one[3]:>10}{f'{two[0]} of {of}':>20}{two[2]:>10}{two[1]:>12}{two[3]:>10}"
        )


def main():
    told = []
    with ProcessPoolExecutor() as pool:
        for line in lines(int(sys.argv[1]) if len(sys.argv) > 1 else 8, pool.map):
            print(line, flush=True)
            told.append(line)
    RESULT.write_text("\n".join(told) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
