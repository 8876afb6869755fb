"""One input from file to table: read, cut into windows, estimate."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import formats
from terrain_cli import models, telemetry
from terrain_cli.errors import InputError
from terrain_cli.estimation import WindowEstimates, estimators, strength
from terrain_cli.presentation import segment_table
from terrain_cli.rover import Rover
from terrain_cli.run import long_log
from terrain_cli.run.settings import Settings
from terrain_cli.telemetry import Samples
from terrain_cli.telemetry.mapping import is_table
from terrain_cli.telemetry.unit_doubts import Doubt
from terrain_cli.vocabulary.quantities import the_wheel
from terrain_cli.windows import cut_windows, locations

Progress = Callable[[str, str, float], None]  # Path, step and share of it that is done


@dataclass(kw_only=True)
class Outcome:
    """What became of one input."""

    table: segment_table.Table  # The rows of its segments, from `segment_table.table`
    # Samples read, used, set aside by wheel and reason, origins of channels, remarks: as the summary has it
    account: dict[str, Any]
    # Behind the rows of `table`, one for each wheel
    estimates: list[WindowEstimates] = field(default_factory=list)
    # Tables of the samples set aside, of the recursive estimate, of the samples of every window, and of joint
    # posteriors, where they were asked for, one for each wheel
    rejects: list[segment_table.Table] = field(default_factory=list)
    trace: list[segment_table.Table] = field(default_factory=list)
    samples: list[segment_table.Table] = field(default_factory=list)
    posterior: list[segment_table.Table] = field(default_factory=list)
    # Why there are no rows: no sample can be used. The samples set aside are worth keeping then.
    error: InputError | None = None


def run(
    path: str,
    rover: Rover,
    settings: Settings,
    *,
    progress: Progress = lambda _path, _step, _share: None,
    ahead: bool = False,
) -> Outcome:
    """Estimate the soil under every wheel of one input, of which some is read `ahead` where it is long."""
    progress(path, "reading", 0.0)
    file = estimators.choose(settings.method, settings.model, robust=settings.robust)
    where = telemetry.Condition(settings.where) if settings.where else None
    source = formats.open_source(path, salvage=settings.salvage)
    effects = None if file is None else file.model.effects
    asked: dict[str, Any] = {
        "wheels": settings.wheels,
        "where": where,
        "effects": effects,
        "beside": [] if file is None else models.rivals(file),
    }
    hindrance = long_log.hindrance(settings, file)
    if hindrance is None:
        found = telemetry.read_parts(source, rover, long_log.MOST_ROWS, **asked)
        if not isinstance(found, list):
            return _in_reaches(source, found, settings, progress, ahead=ahead)
        wheels = found
    else:
        kept = locations.KEYS if settings.places else ()
        wheels = telemetry.read_source(source, rover, kept=kept, **asked)
        if is_table(source) and sum(map(len, wheels)) > long_log.MOST_ROWS:
            wheels[0].remarks.append(f"a long log, read whole: {hindrance}")
    outcome = Outcome(table={}, account=_of_source(source) | {"wheels": []})
    tables = []
    count, stress = 0, settings.stress
    # Reading, and of each wheel the cuts and the estimates.
    steps = 1 + 2 * len(wheels)
    for number, samples in enumerate(wheels):
        progress(path, f"{the_wheel(samples.wheel)}: segments", (1 + 2 * number) / steps)
        placed = locations.locate(samples, settings.places) if settings.places else None
        used = len(samples.usable)
        if settings.stress is not None:
            samples.remarks += strength.extrapolation_notes(
                samples.wheel, [strength.stress_range(samples)], settings.stress
            )
        told = long_log.account(samples, len(samples), used, samples.reasons(), samples.remarks)
        told["places"] = placed._asdict() if placed else None
        outcome.account["wheels"].append(told)
        outcome.rejects.append(segment_table.rejects(samples))
        if not used:
            continue
        cut = long_log.windows_of(samples, settings)
        count += len(cut)
        cut_windows.check_number(source.path, count)
        progress(path, f"{the_wheel(samples.wheel)}: estimates of {len(cut)}", (2 + 2 * number) / steps)
        fitted = estimators.estimate(
            cut,
            settings.method,
            file,
            replace(settings.of_fits, at_stress=stress),
            joint=settings.joint,
            needed=_needed_segments,
        )
        cut = fitted.windows
        # Wheels of one log are compared at one stress.
        stress = estimators.common_stress(stress, fitted.estimates)
        told["model"] = fitted.account
        tables.append(segment_table.table(cut, fitted.estimates))
        mixed = segment_table.several_terrains(samples, tables[-1])
        told["remarks"] = [*samples.remarks, *segment_table.mixed_terrain_notes(samples.wheel, mixed)]
        outcome.estimates.append(fitted.estimates)
        if settings.method == "recursive":
            outcome.trace.append(segment_table.trace(cut))
        if settings.joint:
            outcome.posterior.append(segment_table.posterior_table(cut, fitted.estimates, fitted.joint))
        if settings.samples:
            outcome.samples.append(segment_table.samples(cut))
    return _finished(outcome, tables)


def _needed_segments(cut: cut_windows.Windows, file: models.ModelFile) -> cut_windows.Windows:
    from terrain_cli.comparison.compare import needed_segments  # Few logs need it

    return needed_segments(cut, file)


def _in_reaches(
    source: formats.Source, parts: Iterable[Samples], settings: Settings, progress: Progress, *, ahead: bool
) -> Outcome:
    """Estimate a log of which no more than a reach is held."""
    # They grow until the log ends.
    remarks: dict[str, list[str]] = {}
    stresses: dict[str, list[tuple[float, float]]] = {}
    # A table of text does not say how long it is.
    rows = source.streams()[0].count

    def lean() -> Iterator[Samples]:
        count = 0
        for part in parts:
            remarks[part.wheel] = part.remarks
            if settings.stress is not None:
                stresses.setdefault(part.wheel, []).append(strength.stress_range(part))
            count += len(part)
            progress(source.path, f"{count:,} samples", count / rows if rows else 0.0)
            yield long_log.lean(part)

    wheels = long_log.work(long_log.read_ahead(lean()) if ahead else lean(), settings)
    done = [wheels[name] for name in sorted(wheels)]
    if not any(len(wheel) for wheel in done):
        where = f" where {settings.where}" if settings.where else ""
        raise InputError(f"{source.path}: there are no samples{where}")
    for name, ranges in stresses.items():
        remarks[name] = [*remarks[name], *strength.extrapolation_notes(name, ranges, settings.stress)]
    told = [wheels[name].account(remarks[name]) | {"places": None} for name in sorted(wheels)]
    outcome = Outcome(table={}, account=_of_source(source) | {"wheels": told})
    outcome.estimates = [wheel.estimates for wheel in done if wheel.table is not None]
    return _finished(outcome, [wheel.table for wheel in done if wheel.table is not None])


def _finished(outcome: Outcome, tables: Sequence[segment_table.Table]) -> Outcome:
    """Put in the rows of its wheels, or why there are none."""
    if tables:
        outcome.table = segment_table.join(tables)
    else:
        outcome.error = nothing_usable(outcome.account["source"], outcome.account["wheels"])
    return outcome


def _of_source(source: formats.Source) -> dict[str, Any]:
    salvage = source.recovery.document() if source.recovery else None
    return {"source": source.path, "rows_skipped": getattr(source, "skipped", 0), "salvage": salvage}


def nothing_usable(path: str, wheels: Sequence[dict[str, Any]]) -> InputError:
    """Say why no sample can be used: the frequent reasons of the wheel that has most samples."""
    fullest = max(wheels, key=lambda wheel: int(wheel["samples"]))
    reasons = dict(fullest["set_aside"])
    shown = ", ".join(f"{reason}: {count}" for reason, count in list(reasons.items())[:4])
    hint = "terrain-est inspect shows what each channel is read from"
    for reason, channel in (("load not positive", "load"), ("rolls against its drive", "angular_velocity")):
        if reason in next(iter(reasons)):
            line = f"{channel} = {{ …, scale = -1 }} in rover.toml"
            hint = f"if the sensor's sign is the other way round: {line}"
    # A wrong unit is the likelier reason.
    doubts = [remark for remark in fullest["remarks"] if isinstance(remark, Doubt)]
    hint = "\n".join(doubts) or hint
    return InputError(f"{path}: none of {fullest['samples']} samples can be used ({shown})", hint=hint)
