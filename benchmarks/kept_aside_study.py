"""What it costs to keep half of a log aside from `diagnose`, and what it gives `model add`.

    python benchmarks/kept_aside_study.py [HIDDEN [CLEAN]]

prints the table and writes it to benchmarks/results/kept_aside_study.txt. The drives are those of
diagnosis_study, with seeds of their own: 32 with an effect of half or full size, 15 with none. Each is
diagnosed twice: as a whole, and without the stretches that --keep-aside 0.5 keeps aside. Then an effect is added, and
judged as `model add` does it: on all stretches, and on those kept aside.
"""

from __future__ import annotations

import json
import os
import sys
from dataclasses import replace
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

from finding_study import percent  # noqa: E402 - found through the path above
from hidden_drives import FULL, Kind, sized, windows_of  # noqa: E402 - as above

from terrain_cli import models  # noqa: E402 - as above
from terrain_cli.comparison import kept_aside  # noqa: E402 - as above
from terrain_cli.diagnosis import diagnose  # noqa: E402 - as above
from terrain_cli.improvement.change_trial import tried  # noqa: E402 - as above
from terrain_cli.improvement.held_out_gain import weigh  # noqa: E402 - as above

RESULT = HERE / "results" / "kept_aside_study.txt"
FIRST, FIRST_CLEAN = 41_000_000, 41_001_000
SHARE = 0.5
SIZES, NOISES = (0.5, 1.0), ("white", "ar1")
COURSES = ("rich", "rich", "poor-load")


def run(number, *, clean):
    """Diagnose and judge one drive, and return what is counted."""
    seed = (FIRST_CLEAN if clean else FIRST) + number
    effect = "" if clean else list(FULL)[number % len(FULL)]
    kind = Kind(
        {} if clean else sized(effect, SIZES[number % 2]),
        noise=NOISES[number // 2 % 2],
        course=COURSES[number % 3],
    )
    wheels = windows_of(seed, kind)
    marked = kept_aside.marked(wheels, SHARE)
    file = models.ModelFile()
    found = {"effect": effect, "size": SIZES[number % 2], "course": kind.course, "noise": kind.noise}
    for name, windows in (("whole", wheels), ("half", kept_aside.seen(marked))):
        one = diagnose(windows, file, seed=seed)
        found[name] = {
            "alarm": one.alarm.raised,
            "verdict": one.verdict,
            "effect": one.effect,
            "family": list(one.family),
            "first": one.candidates[0].effect if one.candidates else None,
            "errors": {
                key: value.heldout_rmse / value.noise for key, value in one.comparison.channels.items()
            },
        }
    added = effect or found["whole"]["first"]
    step = tried(marked, "add", [added], file, models.added(file, [added], 0.018).file, seed=seed)
    channels, evidence = weigh(*(_unmarked(one) for one in (step.first, step.second)))
    every = replace(step, channels=channels, evidence=evidence)
    for name, one in (("on_all", every), ("on_aside", step)):
        ratio = one.evidence.overall
        found[name] = {"pays": one.pays, "ratio": list(ratio), "blocks": one.evidence.blocks}
    return found


def _unmarked(comparison):
    wheels = [
        replace(one, windows=replace(one.windows, samples=replace(one.windows.samples, aside=None)))
        for one in comparison.wheels
    ]
    return replace(comparison, wheels=wheels)


def table(found):
    """Write what was counted."""
    some = [one for one in found if one["effect"]]
    none = [one for one in found if not one["effect"]]
    lines = [
        "What --keep-aside 0.5 costs `diagnose`, and what it gives `model add`",
        "",
        "Drives of 128 s and 2,560 samples with 3 % of noise, white or AR(1) 0.8, rich or at one load. Whole: all of the log",
        "is diagnosed. Half: without the eight stretches kept aside. In brackets 95 % intervals of the shares, in %.",
        "",
        f"1. {len(some)} drives with an effect of half or full size, seeds from {FIRST}",
        _row("", "whole", "half"),
        _both("detected", some, lambda one, _: one["alarm"]),
        *(
            _both(
                f"  {size:g} × full size", [d for d in some if d["size"] == size], lambda one, _: one["alarm"]
            )
            for size in SIZES
        ),
        _both("the effect is in the family", some, lambda one, effect: effect in one["family"]),
        _both("it is the one name", some, lambda one, effect: one["effect"] == effect),
        _both("another is the one name", some, lambda one, effect: one["effect"] not in {effect, None}),
        _both("members of the family, mean", some, lambda one, _: len(one["family"]), mean=True),
        "",
        "2. The right effect is added to the model of each of these drives",
        _row("", "all", "kept aside"),
        _both("it pays", some, lambda one, _: one["pays"], ("on_all", "on_aside")),
        _both(
            "blocks that judge, mean", some, lambda one, _: one["blocks"], ("on_all", "on_aside"), mean=True
        ),
        _both(
            "ratio of errors, mean", some, lambda one, _: one["ratio"][0], ("on_all", "on_aside"), mean=True
        ),
        "",
        f"3. {len(none)} drives with none, seeds from {FIRST_CLEAN}",
        _row("", "whole", "half"),
        _both("alarm", none, lambda one, _: one["alarm"]),
        _row("the effect of the highest score on the whole", "all", "kept aside"),
        _both("  would be added", none, lambda one, _: one["pays"], ("on_all", "on_aside")),
        _both(
            "  ratio of errors, mean", none, lambda one, _: one["ratio"][0], ("on_all", "on_aside"), mean=True
        ),
    ]
    return "\n".join(lines)


def _both(what, drives, says, names=("whole", "half"), *, mean=False):
    cells = []
    for name in names:
        values = [says(one[name], one["effect"]) for one in drives]
        total = sum(values)
        cells.append(f"{total / len(values):.3g}" if mean else f"{total:3d}  {percent(total, len(values))}")
    return _row(what, *cells)


def _row(what, first, second):
    return f"{what:44s} {first:>28s} {second:>28s}".rstrip()


def main():
    hidden, clean = (int(one) for one in (sys.argv[1:] + [32, 15][len(sys.argv) - 1 :])[:2])
    found = []
    for number in range(hidden + clean):
        found.append(run(number if number < hidden else number - hidden, clean=number >= hidden))
        print(json.dumps(found[-1]), file=sys.stderr, flush=True)
    print(text := table(found))
    RESULT.write_text(text + "\n", "utf-8")


if __name__ == "__main__":
    main()
