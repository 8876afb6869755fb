"""One input from file to table: read, cut into windows, estimate."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import formats
from terrain_cli import fitting, results, telemetry, windows
from terrain_cli.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Callable

    from terrain_cli.estimation import WindowEstimates
    from terrain_cli.rover import Rover
    from terrain_cli.settings import Settings
    from terrain_cli.telemetry import Samples


@dataclass
class Outcome:
    """What became of one input.

    Parameters
    ----------
    table : dict
        The rows of its segments, from `results.table`.
    account : dict
        Samples read, used and set aside by wheel and reason, origins of the channels, remarks;
        as the summary shows it.
    estimates : list of WindowEstimates
        Behind the rows of `table`, one for each wheel.
    rejects, trace : list of dict
        Tables of the samples set aside, and of the recursive estimate, one for each wheel.
    error : InputError or None
        Why there are no rows: no sample can be used. The samples set aside are worth keeping then.
    """

    table: results.Table
    account: dict[str, Any]
    estimates: list[WindowEstimates] = field(default_factory=list)
    rejects: list[results.Table] = field(default_factory=list)
    trace: list[results.Table] = field(default_factory=list)
    error: InputError | None = None


def run(
    path: str, rover: Rover, settings: Settings, *, progress: Callable[[str], None] = lambda _: None
) -> Outcome:
    """Estimate the soil under every wheel of one input.

    Parameters
    ----------
    path : str
    rover : Rover
    settings : Settings
    progress : callable
        Called with the name of each step before it begins.

    Returns
    -------
    Outcome

    Raises
    ------
    formats.errors.FormatError, TerrainError
        The input cannot be read.
    """
    progress("reading")
    file = fitting.choose(settings.method, settings.model, robust=settings.robust)
    where = telemetry.Condition(settings.where) if settings.where else None
    source = formats.open_source(path)
    effects = None if file is None else file.model.effects
    wheels = telemetry.read_source(source, rover, wheels=settings.wheels, where=where, effects=effects)
    outcome = Outcome({}, {"source": path, "rows_skipped": getattr(source, "skipped", 0), "wheels": []})
    tables = []
    for samples in wheels:
        progress(f"wheel {samples.wheel}")
        outcome.account["wheels"].append(_account(samples))
        outcome.rejects.append(results.rejects(samples))
        if len(samples.usable) == 0:
            continue
        cut = windows.cut(
            samples,
            settings.segments,
            min_samples=settings.min_samples,
            window_samples=settings.window_samples,
            window_distance=settings.window_distance,
        )
        fitted = fitting.estimate(
            cut,
            settings.method,
            file,
            min_samples=settings.min_samples,
            folds=settings.folds,
            robust=settings.robust,
        )
        outcome.account["wheels"][-1]["model"] = fitted.account
        tables.append(results.table(cut, fitted.estimates))
        outcome.estimates.append(fitted.estimates)
        if settings.method == "recursive":
            outcome.trace.append(results.trace(cut))
    if tables:
        outcome.table = results.join(tables)
    else:
        outcome.error = _nothing_usable(path, wheels)
    return outcome


def _account(samples: Samples) -> dict[str, Any]:
    return {
        "wheel": samples.wheel,
        "samples": len(samples),
        "used": len(samples.usable),
        "set_aside": samples.reasons(),
        "channels": samples.origins,
        "remarks": samples.remarks,
        "model": None,
    }


def _nothing_usable(path: str, wheels: list[Samples]) -> InputError:
    """Say why no sample can be used: the frequent reasons of the wheel that has most samples."""
    fullest = max(wheels, key=len)
    reasons = ", ".join(f"{reason}: {count}" for reason, count in list(fullest.reasons().items())[:4])
    hint = "terrain-est inspect shows what each channel is read from"
    for reason, channel in (("load not positive", "load"), ("rolls against its drive", "angular_velocity")):
        if reason in next(iter(fullest.reasons())):
            hint = (
                f"if the sensor's sign is the other way round: {channel} = {{ …, scale = -1 }} in rover.toml"
            )
    return InputError(f"{path}: none of {len(fullest)} samples can be used ({reasons})", hint=hint)
