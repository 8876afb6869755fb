"""What `diagnosis_study` runs: the drives of each of its sections, and what is noted of each."""

from __future__ import annotations

import hashlib
import sys
import tempfile
import time
import traceback
from dataclasses import replace
from pathlib import Path

HERE = Path(__file__).resolve().parent
sys.path[:0] = [
    str(HERE.parent),
    str(HERE.parent / "tests"),
    str(HERE.parent / "tests" / "diagnosis"),
    str(HERE),
]

import numpy as np  # noqa: E402 - found through the path above
from hidden_drives import (  # noqa: E402 - as above
    FULL,
    LASTING,
    PAIRS,
    SEPARABLE,
    WHEEL,
    Kind,
    Rover,
    sized,
    two,
    windows_of,
)
from next_drives import appended  # noqa: E402 - as above
from simulator import EFFECTS, Wheel, base_contact, sinkage_under  # noqa: E402 - as above
from simulator import SOILS as ALL_SOILS  # noqa: E402 - as above
from uncatalogued import OUTSIDE  # noqa: E402 - as above
from window_coverage_study import VEHICLES, wander  # noqa: E402 - as above

from terrain_cli import models  # noqa: E402 - as above
from terrain_cli.comparison.compare import fit_wheels  # noqa: E402 - as above
from terrain_cli.diagnosis import diagnose  # noqa: E402 - as above
from terrain_cli.effects import catalogue  # noqa: E402 - as above
from terrain_cli.estimation.estimators import FitSettings  # noqa: E402 - as above
from terrain_cli.improvement import Stopped, until_quiet  # noqa: E402 - as above
from terrain_cli.improvement.change_trial import compared  # noqa: E402 - as above
from terrain_cli.mechanics.wheel_model import Model  # noqa: E402 - as above
from terrain_cli.windows.joined_inputs import by_wheel  # noqa: E402 - as above

#: Seeds: below, thresholds were tuned; from here on, they are scored. And how far apart rows are.
FIRST, APART = 157_000_000, 100
#: And where sections begin that have seeds of their own.
FIRST_ANEW = {
    "vehicles": 158_000_000,
    "next": 159_000_000,
    "removed": 160_000_000,
    "outside": 161_000_000,
}
NOISES = ("white", "ar1", "soil", "soil-unlabelled")
COURSES = ("rich", "poor-load", "rich", "poor", "rich", "poor-speed")
SIZES = (0.5, 1.0, 2.0)
#: Drives of each row: of a class of noise; of an effect, its size, form and course; of a pair; …
FULL_NUMBERS = {"clean": 400, "effects": 1, "pairs": 5, "removed": 2, "outside": 8, "next": 3, "vehicles": 3}
QUICK_NUMBERS = {"clean": 6, "effects": 1, "pairs": 1, "removed": 1, "outside": 1, "next": 1, "vehicles": 1}
#: Drives of the vehicles with nothing hidden, of each three with an effect.
NOTHING = 20
#: k in m; the rover file says 18 mm of all.
MODULI = (0.01, 0.018, 0.03)
#: Candidates of which a note is kept.
_NOTED = 5


# The drives


def jobs(section, number, first=FIRST):
    """Return the drives of a section, as tables that JSON can hold; `number` of each row.

    Rows that a goal is about are driven four times as often. No two drives of a section have one seed,
    but clean ones: classes of noise are compared on the same courses. More drives of a row are the same
    ones and further seeds.
    """
    for place, row in enumerate(_rows(section)):
        begin = FIRST_ANEW.get(section, first) if first == FIRST else first
        often = 4 if row.get("course") == "rich" and row.get("size") == 1.0 else 1
        for drive in range(number * often):
            apart = 0 if section == "clean" else APART * place
            job = {"section": section, "seed": begin + apart + drive, **row}
            if section == "clean":
                job["course"] = COURSES[drive % len(COURSES)]
            elif section != "next":
                job["noise"] = ("white", "ar1")[(place // 2 + drive) % 2]
            yield job


def _rows(section):
    """Return what distinguishes the rows of a section."""
    return {
        "clean": [{"noise": noise} for noise in NOISES],
        "effects": [
            {"effect": effect, "size": size, "form": form, "course": course}
            for effect in FULL
            for form in EFFECTS[effect].forms
            for size in SIZES
            for course in ("rich", "poor")
        ],
        "pairs": [{"pair": list(pair)} for pair in PAIRS],
        "removed": [{"effect": effect} for effect in FULL],
        "outside": [{"effect": effect} for effect in OUTSIDE],
        "next": [
            {"effect": hidden, "other": other, "course": course, "noise": "white"}
            for first, second, course in SEPARABLE
            for hidden, other in ((first, second), (second, first))
        ],
        "vehicles": [{"effect": effect} for effect in FULL] + [{"effect": None}] * NOTHING,
    }[section]


# What is noted


def run(job):
    """Simulate a drive, diagnose it, and return the job with what was found."""
    began = time.process_time()
    try:
        found = _RUNS[job["section"]](job)
    except Exception as error:  # noqa: BLE001 - one drive that fails must not end a study of thousands
        calls = traceback.extract_tb(error.__traceback__)
        last = next((one for one in reversed(calls) if "terrain_cli" in one.filename), calls[-1])
        place = f"{Path(last.filename).name}, line {last.lineno}"
        found = {"error": f"{type(error).__name__}: {error} ({place})"}
    return {**job, "found": found, "seconds": round(time.process_time() - began, 2), "code": CODE}


def _code():
    digest = hashlib.sha256()
    for path in sorted((HERE.parent / "terrain_cli").rglob("*.py")):
        digest.update(path.read_bytes())
    return digest.hexdigest()[:10]


#: Names the code that is judged: every file of the package, as it is when the study begins.
CODE = _code()


def _wheels(job, **kind):
    drive = windows_of(job["seed"], Kind(**kind, seconds=job.get("length", Kind.seconds)))
    return by_wheel(drive, catalogue().values())


def _noted(found, truth=()):
    """Return what a diagnosis says, without its arrays."""
    candidates = [
        {
            **{
                name: round(float(getattr(one, name)), 6)
                for name in ("score", "p_value", "surviving", "explained", "loss", "loss_se")
            },
            "effect": one.effect,
            "place": place,
            "refitted": one.refitted,
            "in_family": one.in_family,
        }
        for place, one in enumerate(found.candidates)
        if place < _NOTED or one.effect in truth
    ]
    unknown = found.unknown
    return {
        "alarm": bool(found.alarm.raised),
        "p_value": float(found.alarm.p_value),
        "level": float(found.alarm.level),
        "gain": float(found.alarm.gain),
        "gain_se": float(found.alarm.gain_se),
        "verdict": found.verdict,
        "effect": found.effect,
        "family": list(found.family),
        "together": list(found.together),
        "candidates": candidates,
        "unknown": {name: getattr(unknown, name) for name in ("channel", "driver", "form")}
        if unknown
        else None,
        "next": [
            {"pair": list(one.pair), "manoeuvre": one.manoeuvre, "power": one.power}
            for one in found.next_drive
        ],
        "not_testable": [one.effect for one in found.not_testable],
        "sentence": found.sentence,
    }


def _errors(comparison):
    """Return the held-out error of each channel over its noise, and that of all of them together."""
    ratios = {
        name: one.heldout_rmse / one.noise if one.noise > 0.0 else float("nan")
        for name, one in comparison.channels.items()
    }
    known = [ratio for ratio in ratios.values() if np.isfinite(ratio)]
    return {**ratios, "all": float(np.sqrt(np.mean(np.square(known)))) if known else float("nan")}


def _after(wheels, found, name, seed):
    """Return these errors with an effect added, on the same blocks."""
    file = models.added(models.ModelFile(), [name], wheels[0].samples.geometry.shear_modulus).file
    return _errors(compared(wheels, file, like=found.comparison, seed=seed))


def _bare(job):
    """Return these errors of the same drive, with the same noise, where nothing is hidden."""
    return _errors(compared(_wheels(job, noise=job["noise"]), models.ModelFile(), seed=job["seed"]))


def _clean(job):
    wheels = _wheels(job, noise=job["noise"], course=job["course"])
    return _noted(diagnose(wheels, models.ModelFile(), seed=job["seed"]))


def _effects(job):
    hidden = sized(job["effect"], job["size"], job["form"])
    wheels = _wheels(job, effects=hidden, noise=job["noise"], course=job["course"])
    found = diagnose(wheels, models.ModelFile(), seed=job["seed"])
    noted = _noted(found, {job["effect"]})
    if job["size"] == 1.0 and job["course"] == "rich":
        noted["before"] = _errors(found.comparison)
        noted["after"] = _after(wheels, found, job["effect"], job["seed"])
        noted["bare"] = _bare(job)
        noted["strength"] = strength(job["seed"], Kind(hidden, noise=job["noise"]))
    return noted


def vehicle(seed):
    """Draw what drives, on which soil, with which noise."""
    rng = np.random.default_rng(np.hstack([13, seed]))
    while True:
        radius, width, load = VEHICLES[rng.integers(len(VEHICLES))]
        wheel = Wheel(radius=radius, width=width, grouser_height=0.08 * radius, grouser_count=12)
        soil = list(ALL_SOILS.values())[rng.integers(len(ALL_SOILS))]
        soil = replace(soil, shear_modulus=MODULI[rng.integers(len(MODULI))])
        try:
            deep = sinkage_under(base_contact(soil), wheel, 1.6 * load, 0.7)
        except ValueError:
            continue
        if deep < 0.4 * radius:
            break
    kind = Kind(noise=("white", "ar1")[rng.integers(2)], share=float(rng.choice([0.01, 0.03, 0.06])))
    roughness, steps = rng.choice(["white", "AR(1) 0.95", "smooth"]), int(kind.seconds * kind.rate) + 1
    away = np.clip(1.0 + 0.15 * wander(roughness, rng, steps), 0.5, 1.6)
    rover = Rover(
        wheel=wheel,
        load=load,
        speed=Rover.speed * radius / WHEEL.radius,
        soils=(soil, soil),
        rough=lambda t: np.interp(t, np.arange(steps) / kind.rate, away),
    )
    return replace(kind, rover=rover)


def _driven(job):
    """Return what drives and its windows: the first of several vehicles whose soil carries it with the effect."""
    for attempt in range(10):
        kind = vehicle([job["seed"], attempt] if attempt else job["seed"])
        kind = replace(kind, effects=sized(job["effect"], rover=kind.rover) if job["effect"] else {})
        try:
            return kind, windows_of(job["seed"], kind)
        except (ValueError, ArithmeticError):
            continue
    raise ValueError(f"no soil carries a wheel with {job['effect']}")


def _vehicles(job):
    effect = job["effect"]
    kind, windows = _driven(job)
    wheels = by_wheel(windows, catalogue().values())
    found = diagnose(wheels, models.ModelFile(), seed=job["seed"])
    noted = _noted(found, {effect})
    noted["about"] = {
        "radius": kind.rover.wheel.radius,
        "soil": kind.rover.soils[0].name,
        "modulus": kind.rover.soils[0].shear_modulus,
        "share": kind.share,
        "noise": kind.noise,
    }
    if effect:
        bare = by_wheel(windows_of(job["seed"], replace(kind, effects={})), catalogue().values())
        noted["after"] = _after(wheels, found, effect, job["seed"])
        noted["bare"] = _errors(compared(bare, models.ModelFile(), seed=job["seed"]))
        noted["strength"] = strength(job["seed"], kind)
    return noted


def strength(seed, kind):
    """Return how much of an effect is left for anyone to see, once the soil has been fitted to it.

    Norm over all samples and channels of the residuals of the model without it, in units of the noise,
    from a drive with a tenth of that: one known direction below some 5 is lost among so many others. Of noise
    that lasts counts what each sample adds to the one before.
    """
    kept = LASTING if kind.noise == "ar1" else 0.0
    clean = _residuals(seed, replace(kind, effects={}, noise="white"))
    bent = _residuals(seed, replace(kind, share=0.1 * kind.share, noise="white"))
    total = 0.0
    for name, error in bent.items():
        known = error[np.isfinite(error)] / np.sqrt(np.nanmean(clean[name] ** 2))
        new = (known[1:] - kept * known[:-1]) / np.sqrt(1.0 - kept**2)
        total += max(float(np.sum(new**2)) - 0.01 * len(new) * (1.0 + kept**2) / (1.0 - kept**2), 0.0)
    return float(np.sqrt(total))


def _residuals(seed, kind):
    (wheel,), _ = fit_wheels(windows_of(seed, kind, "none"), Model(), FitSettings({}, {}, (), None))
    return wheel.residuals


def _pairs(job):
    wheels = _wheels(job, effects=two(*job["pair"]), noise=job["noise"])
    steps, end = [], None
    with tempfile.TemporaryDirectory() as folder:

        def draft(unknown):
            path = Path(folder) / f"draft-{len(steps)}.toml"
            path.write_text(unknown.draft, encoding="utf-8")
            return str(path)

        for step in until_quiet(
            wheels,
            models.ModelFile(),
            diagnose=lambda wheels, file: diagnose(wheels, file, seed=job["seed"]),
            draft=draft,
            seed=job["seed"],
        ):
            if isinstance(step, Stopped):
                end = step
            else:
                steps.append(f"{'' if step.kept else 'not '}{step.action} {', '.join(step.changed)}")
    return {
        "effects": [effect.id for effect in end.file.model.effects],
        "quiet": bool(end.silent),
        "steps": steps,
        "because": end.because,
    }


def _removed(job):
    wheels = _wheels(job, effects=sized(job["effect"]), noise=job["noise"])
    others = [effect for effect in catalogue().values() if effect.id != job["effect"]]
    return _noted(diagnose(wheels, models.ModelFile(), effects=others, seed=job["seed"]))


def _outside(job):
    wheels = _wheels(job, outside=job["effect"], noise=job["noise"])
    found = diagnose(wheels, models.ModelFile(), seed=job["seed"])
    noted = {**_noted(found), "before": _errors(found.comparison)}
    near = OUTSIDE[job["effect"]].near
    if found.effect in near:
        noted["after"] = _after(wheels, found, found.effect, job["seed"])
    elif found.unknown is not None:
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "draft.toml"
            path.write_text(found.unknown.draft, encoding="utf-8")
            noted["after"] = _after(wheels, found, str(path), job["seed"])
            noted["draft"] = found.unknown.draft
    return noted


def _next(job):
    """Diagnose a poor drive, drive what it recommends, and diagnose both drives together."""
    kind = Kind(sized(job["effect"]), noise=job["noise"], course=job["course"])
    drives = windows_of(job["seed"], kind)
    rounds = []
    for number in range(3):
        found = diagnose(by_wheel(drives, catalogue().values()), models.ModelFile(), seed=job["seed"])
        rounds.append(_noted(found, {job["effect"], job["other"]}))
        if found.verdict != "family" or not found.next_drive:
            break
        best = found.next_drive[0]
        drives = [*drives, *appended(job["seed"] + 100_000 * (number + 1), kind, job["seed"], best.settings)]
        rounds[-1]["settings"] = best.settings
    return {"rounds": rounds}


_RUNS = {
    "clean": _clean,
    "effects": _effects,
    "pairs": _pairs,
    "removed": _removed,
    "outside": _outside,
    "next": _next,
    "vehicles": _vehicles,
}
#: Those of the whole study, and the drives of other vehicles.
SECTIONS, VEHICLE_DRIVES = tuple(_RUNS)[:-1], tuple(_RUNS)[-1]
