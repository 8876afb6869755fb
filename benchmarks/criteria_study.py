"""What each criterion does: a few blind drives are diagnosed with it moved, down and up.

    python benchmarks/criteria_study.py [--only NAME …] [--number N] [--cache FOLDER] [--jobs N] [--table]

A count or a level is halved and doubled; a number between 0.5 and 2 by its distance from 1, so that 0.9
becomes 0.95 and 0.8, and 1.5 becomes 1.25 and 2. Whole numbers stay whole. Drives have seeds below those
that are scored. Each is diagnosed as it is first, and it is noted which criteria that reads: others
cannot change it and are not tried. What is found is kept in FOLDER (build/criteria_study by default): a
study that was stopped goes on where it was, and `--table` makes the table of what is there. Without
`--only` that is written to benchmarks/results/criteria_study.txt.
"""

from __future__ import annotations

import argparse
import importlib
import os
import sys
from contextlib import contextmanager
from pathlib import Path
from types import ModuleType

HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE), str(HERE.parent)]

import diagnosis_drives  # noqa: E402 - found through the path above
import diagnosis_study  # noqa: E402 - as above
import steady_points_study  # noqa: E402 - as above

from man import criteria_page  # noqa: E402 - as above

RESULT = HERE / "results" / "criteria_study.txt"
CACHE = HERE.parent / "build" / "criteria_study"
#: Seeds of the drives: below those that are scored.
FIRST = 2000


def _hidden(effect, size=1.0, course="rich"):
    return {"section": "effects", "effect": effect, "size": size, "form": "catalogue", "course": course}


#: Nothing hidden, small effects, families, names, a law of no catalogue, soils that change, other wheels, test points.
DRIVES = (
    {"section": "clean", "course": "rich"},
    _hidden("slip-sinkage", 0.5, "poor"),
    _hidden("motor-temperature", 0.5),
    _hidden("drivetrain-friction", 2.0),
    {"section": "outside", "effect": "eccentric"},
    {"section": "clean", "course": "rich", "noise": "soil-unlabelled"},
    _hidden("load-transfer", 0.5),
    {"section": "vehicles", "effect": "gear-efficiency"},
    _hidden("sinkage-relaxation"),
    {"section": "points", "effect": "max-stress-angle", "slips": 12, "loads": 2},
    _hidden("bulldozing", 1.0, "poor-load"),
    {"section": "points", "effect": "", "slips": 8, "loads": 1},
)
#: Seconds of a drive, and noises in turn.
LENGTH, NOISES = 64.0, ("white", "ar1")


def drives(number):
    """Return the drives that are diagnosed again and again."""
    for place in range(number):
        one = DRIVES[place % len(DRIVES)]
        yield {"noise": NOISES[place % 2], **one, "seed": FIRST + place, "length": LENGTH}


def moved(value):
    """Return a criterion halved and doubled; what is between 0.5 and 2 by its distance from 1."""
    if 0.5 < value < 2.0 and value != 1.0:
        return [1.0 + factor * (value - 1.0) for factor in (0.5, 2.0)]
    halves = [0.5 * value, 2.0 * value]
    return [max(1, round(one)) for one in halves] if isinstance(value, int) else halves


def _module(name):
    return importlib.import_module(next(one.module for one in criteria_page.criteria() if one.name == name))


@contextmanager
def set_to(name, value):
    """Move a criterion, wherever it is read, for a while."""
    module = _module(name)
    before = getattr(module, name)
    setattr(module, name, value)
    try:
        yield
    finally:
        setattr(module, name, before)


@contextmanager
def noting():
    """Note which criteria are read."""
    names, read = {one.name for one in criteria_page.criteria()}, set()

    class Noting(ModuleType):
        def __getattribute__(self, name):
            if name in names:
                read.add(name)
            return super().__getattribute__(name)

    for module in criteria_page.MODULES:
        module.__class__ = Noting
    try:
        yield read
    finally:
        for module in criteria_page.MODULES:
            module.__class__ = ModuleType


def run(job):
    """Diagnose a drive as it is, or with a criterion moved."""
    if job["criterion"] is None:
        with noting() as read:
            one = diagnosed(job)
        one["found"]["read"] = sorted(read)
        return one
    with set_to(job["criterion"], job["value"]):
        return diagnosed(job)


def diagnosed(job):
    """Return a drive, or a table of test points, with what is said of it."""
    if job["section"] != "points":
        return diagnosis_drives.run(job)
    table = (job["seed"], job["slips"], job["loads"], job["effect"], "catalogue")
    raised, effect, family = steady_points_study.asked(table)
    verdict = "effect" if effect else "family" if family else "unknown" if raised else "none"
    return {**job, "found": {"verdict": verdict, "effect": effect, "family": list(family)}}


def told(one):
    """Return what a user is told of a drive, in a word or two."""
    found = one["found"]
    if "error" in found:
        return f"error, {found['error']}"
    if found["verdict"] == "unknown" and "unknown" in found:
        return f"{found['unknown']['channel']} follows {found['unknown']['driver']}"
    if found["verdict"] == "family":
        return f"one of {', '.join(found['family'])}"
    return found["effect"] or found["verdict"]


def study(number, only, folder, workers, *, run_missing):
    """Return the drives as they are, and for each criterion and value the drives with it moved."""

    def found(section, jobs):
        if run_missing:
            return diagnosis_study.study(section, jobs, folder, workers, run)
        done = diagnosis_study.known(folder, section)
        return [done[key] for key in map(diagnosis_study.key, jobs) if key in done]

    plain = found("plain", [{**drive, "criterion": None} for drive in drives(number)])
    several = {}
    for one in criteria_page.criteria():
        if only and one.name not in only:
            continue
        own = [{**drive, "criterion": one.name} for drive in drives(number) if _reads(plain, drive, one.name)]
        jobs = [{**job, "value": value} for value in moved(one.value) for job in own]
        several[one.name] = (found(one.name, jobs) if jobs else [], len(jobs))
    return plain, several


def _reads(plain, drive, name):
    return any(one["seed"] == drive["seed"] and name in one["found"].get("read", ()) for one in plain)


def table(plain, several):
    """Yield the lines of what was found."""
    as_it_is = {one["seed"]: one for one in plain}
    yield f"What becomes of {len(plain)} blind drives of {LENGTH:g} s when a criterion is moved"
    yield "Halved and doubled; between 0.5 and 2 by the distance from 1. So few drives show what a criterion can"
    yield "do, and not that it does nothing. What only `model add` reads is not tried: nothing is added here."
    yield ""
    for seed, one in as_it_is.items():
        what = "table" if one["section"] == "points" else "drive"
        yield f"{what} {seed}: {one.get('effect') or 'nothing'} hidden; told: {told(one)}"
    never, unfinished, silent = [], [], []
    yield ""
    for one in criteria_page.criteria():
        if one.name not in several:
            continue
        runs, planned = several[one.name]
        if planned == 0:
            never.append(one.name)
        elif len(runs) < planned:
            unfinished.append(one.name)
        else:
            other = [run for run in runs if told(run) != told(as_it_is[run["seed"]])]
            if not other:
                silent.append(one.name)
            for run in other:
                yield f"{one.name} {one.value:g} → {run['value']:g}: drive {run['seed']}: {told(run)}"
    yield ""
    yield f"Moved both ways on every drive that reads them, and nothing else is told ({len(silent)}): {_listed(silent)}"
    yield f"Read by none of these drives ({len(never)}): {_listed(never)}"
    yield f"Not tried yet on every drive that reads them ({len(unfinished)}): {_listed(unfinished)}"


def _listed(names):
    return ", ".join(names) or "none"


def main(arguments=None):
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--only", action="append", default=[], metavar="NAME", help="this one (repeatable)")
    parser.add_argument("--number", type=int, default=len(DRIVES), help="drives")
    parser.add_argument("--cache", type=Path, default=CACHE, metavar="FOLDER")
    parser.add_argument("--jobs", type=int, default=os.cpu_count())
    parser.add_argument("--table", action="store_true", help="run nothing")
    given = parser.parse_args(arguments)
    found = study(given.number, given.only, given.cache, given.jobs, run_missing=not given.table)
    lines = list(table(*found))
    print("\n".join(lines))
    if not given.only:
        RESULT.write_text("\n".join(lines) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
