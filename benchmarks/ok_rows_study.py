"""Of the rows that `estimate` marks `ok`, how many are off where an effect is hidden that the model lacks.

    python benchmarks/ok_rows_study.py [--drives N] [--seed N]

writes benchmarks/results/ok_rows_study.txt, in some ten minutes on two cores. N drives of the usual rover and N of
one of six vehicles, on a soil and with noise drawn for each, with loads that vary and that do not, for each
effect; four times as many with nothing hidden. Some are driven without a drawbar pull as well, which alone tells
friction and gains from another soil. The truth is that of the tests' simulator. A row is off
where c, φ or the strength at the common stress is more than three standard errors from it. Of a strength that
curves or that softens, c and φ are those of the straight line that touches it at the common stress, where the
soil carries most: no wheel measures what the letters of such a law stand for.
"""

from __future__ import annotations

import argparse
import sys
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from itertools import product
from pathlib import Path

import numpy as np

HERE = Path(__file__).resolve().parent
sys.path[:0] = [
    str(HERE.parent),
    str(HERE.parent / "tests"),
    str(HERE.parent / "tests" / "diagnosis"),
    str(HERE),
]

from diagnosis_drives import vehicle  # noqa: E402 - found through the path above
from hidden_drives import FULL, Kind, drive_of, samples_from, simulate, sized  # noqa: E402 - as above

from terrain_cli.estimation import estimators  # noqa: E402 - as above
from terrain_cli.estimation.wheel_fit import missing_effects  # noqa: E402 - as above
from terrain_cli.windows.cut_windows import cut  # noqa: E402 - as above

RESULT = HERE / "results" / "ok_rows_study.txt"
FIRST, DRIVES, CLEAN = 116_000_000, 3, 4
COURSES, NOISES = ("rich", "poor-load"), ("white", "ar1")
FARTHEST = 20.0  # Shear displacement in k beyond which no soil of these has its peak
#: Another soil in every pass.
LEFT_OUT = "multi-pass"
#: What another soil hides where no drawbar pull is measured.
WITHOUT_PULL = (None, "drivetrain-friction", "gear-efficiency", "load-bias")


def _untested(*given):
    t = given[2]
    return np.zeros(len(t), dtype=bool), np.zeros((*t.shape, t.shape[1]))


#: What the rows say, without the test for missing effects and with it.
TESTS = (_untested, missing_effects.moved)


def counted(job):
    """Return rows `ok`, and those of them that are off, without the test and with it."""
    effect, pull, seed, course, other = job
    kind = vehicle(seed) if other else Kind(noise=NOISES[seed % 2])
    kind = replace(kind, course=course, effects=sized(effect, rover=kind.rover) if effect else {})
    try:
        drive = drive_of(seed, kind)
        columns = simulate(drive).wheels["wheel"].aligned()
        measured = {name: column for name, column in columns.items() if pull or name != "drawbar_pull"}
        windows = cut(samples_from("drive", measured, kind))
    except (ValueError, ArithmeticError):
        # The soil does not carry this vehicle with the effect.
        return np.zeros(4, dtype=int)
    soil = drive.tracks[0].soils[0][0]
    hidden = kind.effects.get(effect, {})
    counts = []
    for missing_effects.moved in TESTS:
        found = estimators.estimate(windows, "auto", estimators.full_model()).estimates
        cohesion, tan_phi = touching(soil, effect, hidden, found.stress)
        strength = cohesion + found.stress * tan_phi
        off = [
            np.abs(found.c - cohesion) > 3.0 * found.c_se,
            np.abs(found.phi - np.arctan(tan_phi)) > 3.0 * found.phi_se,
            np.abs(found.strength_at_stress - strength) > 3.0 * found.strength_at_stress_se,
        ]
        ok = found.status == "ok"
        counts += [int(ok.sum()), int((ok & np.any(off, axis=0)).sum())]
    return np.array(counts)


def touching(soil, effect, hidden, stress):
    """Return c and tan φ of the straight line that touches the soil's strength at a stress, where it carries most."""
    if effect == "strength-curvature":
        tan_phi = soil.tan_phi * (stress / 10e3) ** -hidden["B"]
        return soil.cohesion + hidden["B"] * stress * tan_phi, (1.0 - hidden["B"]) * tan_phi
    most = 1.0
    if effect == "post-peak-softening":
        way = np.linspace(0.0, FARTHEST * soil.shear_modulus, 2001)
        lost = hidden["loss"] * -np.expm1(-way / hidden["length"])
        most = float(np.max(-np.expm1(-way / soil.shear_modulus) * (1.0 - lost)))
    return most * soil.cohesion, most * soil.tan_phi


def lines(drives, seed, run):
    yield "Rows marked ok, and those of them that are more than three standard errors off: before and after the"
    yield "test for effects that the model lacks and that would move c, φ or strength by more than its error"
    yield ""
    for pull, effects in ((True, (None, *(n for n in FULL if n != LEFT_OUT))), (False, WITHOUT_PULL)):
        yield f"{'hidden' if pull else 'without pull':22}{'ok before':>12}{'off':>6}{'ok after':>12}{'off':>6}"
        total = np.zeros(4, dtype=int)
        for effect in effects:
            seeds = range(seed, seed + drives * (1 if effect else CLEAN))
            jobs = [
                (effect, pull, one + 10_000 * other, course, other)
                for one, course, other in product(seeds, COURSES, (0, 1))
            ]
            found = sum(run(counted, jobs))
            total += found if effect else 0
            yield f"{effect or 'nothing':22}{found[0]:>12}{found[1]:>6}{found[2]:>12}{found[3]:>6}"
        yield f"{'any of these effects':22}{total[0]:>12}{total[1]:>6}{total[2]:>12}{total[3]:>6}"
        yield ""


def main():
    parser = argparse.ArgumentParser(description="How many rows marked ok are off under a hidden effect.")
    parser.add_argument("--drives", type=int, default=DRIVES)
    parser.add_argument("--seed", type=int, default=FIRST)
    asked = parser.parse_args()
    told = []
    with ProcessPoolExecutor() as pool:
        for line in lines(asked.drives, asked.seed, pool.map):
            print(line, flush=True)
            told.append(line)
    RESULT.write_text("\n".join(told).rstrip() + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
