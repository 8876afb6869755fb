"""The comparison of a model with the measurements of wheels: errors, held-out errors, findings."""

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from terrain_cli import processes
from terrain_cli.comparison import blocks, held_out
from terrain_cli.comparison import comparison_criteria as criteria
from terrain_cli.comparison.comparison_outcome import (
    UNITS,
    ChannelErrors,
    Comparison,
    Finding,
    Series,
    WheelComparison,
)
from terrain_cli.comparison.findings import Residuals
from terrain_cli.comparison.fitted_wheel import FittedWheel
from terrain_cli.comparison.smoothed_channels import INTERPOLATED
from terrain_cli.estimation.estimators import FitSettings
from terrain_cli.estimation.wheel_fit import Fit
from terrain_cli.mechanics.effect import CERTAIN
from terrain_cli.mechanics.wheel_model import Model
from terrain_cli.models import ModelFile
from terrain_cli.vocabulary.arrays import Array, Index
from terrain_cli.vocabulary.quantities import counted, listed, the_wheel
from terrain_cli.windows.cut_windows import Windows, thinned, unbroken

#: Parameters of the soil that are never negative: what is shown of them, and how.
NEVER_NEGATIVE = {"cohesion": ("cohesion", " kPa", 1e-3), "tan_phi": ("tan φ", "", 1.0)}
#: More samples than these are thinned: they bound time and memory, and tell what there is to tell.
MOST_SAMPLES = 200_000


def on_few_soils(
    wheels: Sequence[Windows],
    model: Model,
    settings: FitSettings,
    *,
    further: Collection[str] = (),
    progress: Callable[[str], None] = lambda _: None,
) -> tuple[list[FittedWheel], list[str]]:
    """Fit a model to each wheel on its own as `fit_wheels` does, on as few soils as predict as well."""
    fitted, warnings = fit_wheels(wheels, model, settings, further=further, progress=progress)
    fitted, joined = held_out.join_segments(fitted, progress)
    return fitted, [*warnings, *joined]


def needed_segments(windows: Windows, file: ModelFile, fit: Fit | None = None) -> Windows:
    """Take the cuts of a wheel back where one soil for each terrain predicts as well as their soils do.

    Soils that differ plainly, by a `fit` that misses none, are not looked at further.
    """
    if fit is not None and not fit.missed.any() and _differ(fit):
        return windows
    (fitted,), told = on_few_soils([windows], file.model, FitSettings.of([windows], file))
    if len(fitted.windows) == len(windows):
        return windows
    remarks = windows.samples.remarks
    remarks += [one for one in told[-1:] if one not in remarks]
    return unbroken(windows)


def _differ(fit: Fit) -> bool:
    """Tell whether a property of the soil differs between neighbours by clearly more than its errors."""
    return any(
        bool(np.any(np.abs(np.diff(own)) > criteria.MOVED * np.hypot(error[1:], error[:-1])))
        for own, error in ((fit.values[name], fit.errors[name]) for name in fit.values)
    )


def fit_wheels(
    wheels: Sequence[Windows],
    model: Model,
    settings: FitSettings,
    *,
    further: Collection[str] = (),
    progress: Callable[[str], None] = lambda _: None,
) -> tuple[list[FittedWheel], list[str]]:
    """Fit a model to wheels, of which not more samples are taken than can be compared.

    Channels of `further` are kept although the model does not read them. Also returned is what has to be
    said about it.
    """
    warnings: list[str] = []
    total = sum(len(windows.rows) for windows in wheels)
    if total > MOST_SAMPLES:
        wheels = [thinned(windows, MOST_SAMPLES / total) for windows in wheels]
        used = sum(len(windows.rows) for windows in wheels)
        warnings.append(
            f"{used} of {total} samples are compared, in unbroken pieces spread over every segment"
        )
    fit = partial(FittedWheel, model=model, settings=settings, further=further)
    return processes.each(
        fit, wheels, lambda one: progress(f"fitting {the_wheel(one.samples.wheel)}")
    ), warnings


def of_fitted(
    fitted: Sequence[FittedWheel],
    *,
    like: Comparison | None = None,
    findings: bool = True,
    seed: int = 0,
    warnings: Sequence[str] = (),
    progress: Callable[[str], None] = lambda _: None,
) -> Comparison:
    """Compare wheels to which a model was fitted with what they measured; all have the same model.

    Blocks are the runs where there are enough of them, else stretches so long that the noise forgets, and
    that the scores of neighbouring ones are unrelated. They are those of `like`, another model with the same
    windows, so that `two_models` compares like with like. Without `findings` it is not looked for where the
    model fails. `warnings` come before its own.
    """
    model, warnings = fitted[0].model, list(warnings)
    channels = [name for name in UNITS if any(name in wheel.measured for wheel in fitted)]
    noise = [wheel.levels for wheel in fitted]
    levels = {name: pooled_noise(fitted, name, noise) for name in channels}
    scale = {name: scale_of(fitted, name, levels[name]) for name in channels}
    channels = [name for name in channels if scale[name] > 0.0]
    scale = {name: scale[name] for name in channels}
    made, chain = _blocks(fitted) if like is None else ([one.blocks for one in like.wheels], None)
    count = 1 + max(int(block.max(initial=-1)) for block in made)
    failures = []
    if findings:
        progress("looking for where the model fails")
    if not scale:
        warnings.append("the model predicts what was measured exactly: there is nothing to look for")
    elif count < criteria.FEWEST_BLOCKS:
        stretches = counted(count, "independent stretch", "es")
        warnings.append(f"only {stretches} of data: too few to tell where the model fails")
    elif findings:
        residuals = Residuals(fitted, made, scale)
        if chain is not None:
            label = residuals.join(chain)
            made = [label[block] for block in made]
        failures = residuals.findings(levels, seed)
        if failures and all(wheel.ordered for wheel in fitted):
            noise = _without_findings(residuals, failures, noise)
            levels = {name: pooled_noise(fitted, name, noise) for name in channels}
        failures += _between_segments(fitted, failures, levels, seed)
    ordered = any(wheel.ordered for wheel in fitted)
    why = "too few samples" if ordered else "too few test points were repeated"
    warnings += [
        f"the noise of {name.replace('_', ' ')} cannot be separated from misfit: {why}"
        for name in channels
        if not np.isfinite(levels[name])
    ]
    warnings += _unpredicted(fitted)
    warnings += [
        f"{one.windows.samples}: {text}" for one in fitted for text in one.fit.impossible(one.settings.fixed)
    ]
    impossible = dict(_impossible_soils(fitted, made))
    warnings += impossible.values()
    progress("predicting blocks left out")
    compared = [_compared(*one, scale) for one in zip(fitted, made, noise, strict=True)]
    return Comparison(
        model={"base": model.base, "effects": [effect.id for effect in model.effects]},
        wheels=compared,
        channels={
            name: _errors(
                name,
                [(one.series[name], one.blocks) for one in compared if name in one.series],
                levels[name],
            )
            for name in levels
        },
        failures=failures,
        warnings=warnings,
        impossible=tuple(impossible),
    )


def _impossible_soils(fitted: Sequence[FittedWheel], made: Sequence[Index]) -> Iterator[tuple[str, str]]:
    """Say where the model has a cohesion or friction angle clearly below nought, on data that suffice.

    Yields the value, and what is said of it.
    """
    model = fitted[0].model
    called = " + ".join([model.base, *(effect.id for effect in model.effects)])
    missing = "an effect is wrong or missing" if model.effects else "an effect is missing"
    shown = [name.replace("_", " ") for name in UNITS if any(name in wheel.measured for wheel in fitted)]
    sensors = ["load", *shown]
    soils = [
        (wheel.fit, j, len(np.unique(block[wheel.window == j])) >= criteria.FEWEST_BLOCKS)
        for wheel, block in zip(fitted, made, strict=True)
        for j in range(len(wheel.windows))
    ]
    for name, (what, unit, factor) in NEVER_NEGATIVE.items():
        there = [
            (fit.values[name][j], fit.errors[name][j])
            for fit, j, long in soils
            if long and name in fit.values
        ]
        wrong = [value for value, error in there if value < -CERTAIN * np.nan_to_num(error)]
        if wrong:
            value = f"a {what} of {min(wrong) * factor:.2g}{unit}"
            note = (
                f"{called} gives {value} in {len(wrong)} of {counted(len(soils), 'soil')}, which is "
                f"physically impossible: {missing}, or {listed(sensors, 'or')} is measured wrongly or with "
                "too much noise"
            )
            yield value, note


def _without_findings(
    residuals: Residuals, failures: Sequence[Finding], noise: Sequence[Mapping[str, float]]
) -> list[dict[str, float]]:
    """Return each wheel's noise by channel, less what findings explain of it."""
    found = residuals.noise_beside({one.channel for one in failures})
    return [
        {**known, **{name: float(np.fmin(known[name], one.deviation)) for name, one in beside.items()}}
        for known, beside in zip(noise, found, strict=True)
    ]


def _between_segments(
    wheels: Sequence[FittedWheel], before: Sequence[Finding], levels: Mapping[str, float], seed: int
) -> list[Finding]:
    """Find what makes one soil look like several: what each segment's own soil hides.

    With one soil for all segments of a terrain, what follows a pass, a temperature or a wheel that
    differs from segment to segment is in the residuals, together with how soil varies; segments are
    the blocks, so that the latter counts as chance.
    """
    if sum(len(wheel.windows) for wheel in wheels) < criteria.FEWEST_BLOCKS:
        return []
    joined = [wheel.on_common_soil() for wheel in wheels]
    chosen = [(wheel, *one) for wheel, one in zip(wheels, joined, strict=True) if one is not None]
    if not chosen:
        return []
    block, first = [], 0
    for wheel, _, order in chosen:
        block.append(first + wheel.window[order])
        first += len(wheel.windows)
    if first < criteria.FEWEST_BLOCKS:
        return []
    common = [one for _, one, _ in chosen]
    names = [name for name in levels if any(name in wheel.measured for wheel in common)]
    scale = {name: size for name in names if (size := scale_of(common, name, np.nan)) > 0.0}
    known = {(finding.channel, finding.driver) for finding in before}
    found = Residuals(common, block, scale, found=known).findings(levels, seed)
    return [replace(one, sentence=f"with one soil for all segments, {one.sentence}") for one in found]


def _unpredicted(wheels: Sequence[FittedWheel]) -> Iterator[str]:
    """Say where channels are measured and the model has no answer."""
    for wheel in wheels:
        for name, measured in wheel.measured.items():
            known = np.isfinite(measured)
            missing = known & ~np.isfinite(wheel.predicted[name])
            if missing.sum() > criteria.UNPREDICTED * known.sum():
                lost = f"in {missing.sum()} of {known.sum()} samples"
                yield (
                    f"{wheel.windows.samples}: {name.replace('_', ' ')} cannot be predicted {lost}: "
                    "the fitted soil cannot carry the load, or a channel is missing"
                )


def pooled_noise(
    wheels: Sequence[FittedWheel], name: str, noise: Sequence[Mapping[str, float]] | None = None
) -> float:
    """Average the wheels' noise, by default that of their residuals, weighted by their samples."""
    known = [
        (int(np.isfinite(wheel.residuals[name]).sum()), levels[name])
        for wheel, levels in zip(wheels, noise or [wheel.levels for wheel in wheels], strict=True)
        if np.isfinite(levels.get(name, np.nan))
    ]
    total = sum(count for count, _ in known)
    return float(np.sqrt(sum(count * level**2 for count, level in known) / total)) if total else np.nan


def scale_of(wheels: Sequence[FittedWheel], name: str, level: float) -> float:
    """Return what weighs the residuals of a channel: its noise, if that is known, else their size."""
    errors = np.concatenate([wheel.residuals[name] for wheel in wheels if name in wheel.measured])
    errors = errors[np.isfinite(errors)]
    rms = float(np.sqrt(np.mean(errors**2))) if len(errors) else 0.0
    return max(level, criteria.LEAST_NOISE_OF_SCALE * rms) if np.isfinite(level) else rms


def _blocks(wheels: Sequence[FittedWheel]) -> tuple[list[Index], Index | None]:
    """Cut the data into blocks: at the same times for all wheels of an input.

    Returns the block of each usable sample of each wheel; and the chain of each block, if they may be joined.
    """
    memory = min(max(wheel.memory for wheel in wheels), criteria.LONGEST_MEMORY)
    longer = max(criteria.BLOCK_SAMPLES, criteria.BLOCK_MEMORIES * (memory + 1))
    shortest = longer if any(wheel.ordered for wheel in wheels) else 1
    inputs: dict[str, list[int]] = {}
    for index, wheel in enumerate(wheels):
        samples = wheel.windows.samples
        inputs.setdefault(samples.source if wheel.ordered else f"{samples.source}\0{index}", []).append(index)

    def times(index: int) -> Array:
        windows = wheels[index].windows
        assert windows.samples.time is not None  # noqa: S101 - test points have inputs of their own
        return windows.samples.time[windows.rows]

    runs = [_runs(wheel) for wheel in wheels]
    leaders = [max(members, key=lambda index: len(wheels[index])) for members in inputs.values()]
    lengths: list[int] = []
    for leader in leaders:
        _, sizes = np.unique(runs[leader], return_counts=True)
        lengths += sizes.tolist()
    enough = len(lengths) >= criteria.ENOUGH_RUNS
    cut = blocks.fine(lengths, max(lengths) if enough else shortest, most=criteria.MOST_BLOCKS)
    of: list[Index] = [np.zeros(0, dtype=np.intp)] * len(wheels)
    parts = iter(cut)
    for members, leader in zip(inputs.values(), leaders, strict=True):
        own = np.empty(len(wheels[leader]), dtype=np.intp)
        for label in np.unique(runs[leader]):
            own[runs[leader] == label] = next(parts)
        for index in members:
            # Another wheel's samples have the block of the leader's last one before them.
            of[index] = own if index == leader else own[blocks.at_times(times(leader), times(index))]
    return of, None if enough else np.repeat(np.arange(len(cut)), [len(np.unique(part)) for part in cut])


def _runs(wheel: FittedWheel) -> Index:
    samples, rows = wheel.windows.samples, wheel.windows.rows
    labels = samples.labels.get("run")
    return np.zeros(len(rows), dtype=np.intp) if labels is None else labels.codes[rows].astype(np.intp)


def _compared(
    wheel: FittedWheel, block: Index, noise: Mapping[str, float], scale: dict[str, float]
) -> WheelComparison:
    known = {name: scale.get(name, 1.0) for name in wheel.measured}
    out = held_out.predict(wheel, block, known)
    series = {
        name: Series(column, wheel.predicted[name], out[name]) for name, column in wheel.measured.items()
    }
    errors = {name: _errors(name, [(one, block)], noise[name]) for name, one in series.items()}
    samples, segment, inner = wheel.windows.samples, wheel.segment, wheel.interpolated(wheel.gaps)
    bounds = np.searchsorted(segment, np.arange(int(segment.max(initial=-1)) + 2))
    return WheelComparison(
        source=samples.source,
        wheel=samples.wheel,
        samples=samples,
        windows=wheel.windows,
        segments=replace(wheel.windows, bounds=bounds),
        fit=wheel.fit,
        model=wheel.model,
        series=series,
        errors=errors,
        # Their own noise is in the predictions too: residuals would follow it.
        drivers={
            name: replace(driver, values=inner[name]) if name in INTERPOLATED else driver
            for name, driver in wheel.drivers.items()
        },
        blocks=block,
    )


def _errors(name: str, parts: Sequence[tuple[Series, Index]], level: float) -> ChannelErrors:
    measured = np.concatenate([one.measured for one, _ in parts])
    error = measured - np.concatenate([one.predicted for one, _ in parts])
    known = np.isfinite(error)
    n = int(known.sum())
    rmse = float(np.sqrt(np.mean(error[known] ** 2))) if n else np.nan
    size = float(np.sqrt(np.mean(measured[known] ** 2))) if n else np.nan
    sums = blocks.squares(parts)
    held_out_error = blocks.root_intervals(sums)[0] if len(sums) else blocks.Interval(np.nan, np.nan, np.nan)
    return ChannelErrors(
        name=name,
        unit=UNITS[name],
        n=n,
        rmse=rmse,
        bias=float(np.mean(error[known])) if n else np.nan,
        nrmse=rmse / size if size > 0.0 else np.nan,
        noise=level,
        heldout_rmse=held_out_error.value,
        heldout_low=held_out_error.low,
        heldout_high=held_out_error.high,
    )
