"""Options of the verbs that compare a model with measurements, and the reading of their inputs."""

from __future__ import annotations

from itertools import chain, count
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from terrain_cli.commands import options
from terrain_cli.errors import InputError
from terrain_cli.vocabulary.choices import CUT_SAMPLES
from terrain_cli.vocabulary.quantities import counted

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from formats import Source
    from terrain_cli.estimation.estimators import EstimateRequest
    from terrain_cli.models import ModelFile
    from terrain_cli.presentation.terminal import Progress
    from terrain_cli.telemetry import Samples
    from terrain_cli.views.plots import Drawn
    from terrain_cli.vocabulary.next_commands import Asked
    from terrain_cli.windows.cut_windows import Windows

#: By which windows are cut, samples are kept and chance is drawn.
cutting = options.together(
    options.segments,
    options.value(
        "--min-samples N", options.Count(3), f"Fewest samples of a segment that auto cuts.  [{CUT_SAMPLES}]"
    ),
    options.window_distance,
    options.window_samples,
    options.where,
    options.salvage,
    options.largest,
    options.value(
        "--seed N", click.IntRange(0), "Seed of the random draws of the tests.", default=0, show_default=True
    ),
    options.jobs("Processes that fit wheels and effects; the result is the same."),
    options.verbose,
)

#: Options that decide which samples are looked at, and how they are cut.
_REPEATED = frozenset(
    {"rover", "wheels", "segments", "min_samples", "window_distance", "window_samples", "where"}
    | {"salvage", "largest", "keep_aside"}
)

keep_aside = options.value(
    "--keep-aside SHARE",
    options.Amount(0, 1, min_open=True, max_open=True),
    "Keep this share of each input aside, in eight stretches: diagnose does not see them, and model add "
    "judges on them alone. Give both the same share, such as 0.5.  [none]",
)

#: Options of `estimate` that decide on c and φ of the segments, and on nothing else.
soils = options.together(options.folds, options.robust, options.at_stress)


def draw(found: Drawn, given: Mapping[str, Any], nothing: str = "") -> None:
    """Write the pictures of a result, if they are asked for."""
    if not given["plot"]:
        return
    from terrain_cli.views import plots

    written = plots.write(found, given["plot"])
    if not given["quiet"]:
        said = counted(len(written), "picture") if written else "there is nothing to draw: no picture"
        click.echo(f"{said} in {given['plot']}" if written or not nothing else nothing, err=True)


def read(
    context: click.Context,
    model: Sequence[ModelFile],
    progress: Progress,
    inputs: Sequence[str] | None = None,
    *,
    noted: bool = True,
) -> list[Windows]:
    """Read every input with all that the models need, cut it, and mark what --keep-aside hides.

    What every command says of an input is told on stderr, unless it is `noted` in what is written. Where
    nothing is written, as something fails, it is told all the same: it may be why.
    """
    import formats
    from terrain_cli import processes, telemetry
    from terrain_cli.comparison import kept_aside
    from terrain_cli.telemetry.long_logs import MOST_ROWS
    from terrain_cli.windows import cut_windows

    paths = formats.expand(context.params["inputs"] if inputs is None else inputs)
    # What is compared is cut as `estimate` cuts it.
    rover = options.configured(context, paths, but="model")
    given = context.params
    context.with_resource(processes.jobs(given["jobs"]))
    effects = {effect.id: effect for file in model for effect in file.model.effects}
    asked: dict[str, Any] = {"wheels": given["wheels"], "effects": list(effects.values()), "compared": True}
    lengths = {name: given[name] for name in ("min_samples", "window_samples", "window_distance")}
    cut: list[Windows] = []
    for path in paths:
        progress.say(path, "reading")
        where = telemetry.Condition(given["where"]) if given["where"] else None
        source = formats.open_source(path, salvage=given.get("salvage", False))
        wheels = telemetry.read_source(source, rover, where=where, most=MOST_ROWS // len(paths), **asked)
        _tell(path, source, wheels, progress, noted=noted, verbose=given["verbose"])
        usable = (samples for samples in wheels if len(samples.usable))
        cut += [cut_windows.cut(samples, given["segments"], **lengths) for samples in usable]
        progress.advance()
    if not cut:
        raise InputError(
            f"{', '.join(paths)}: no sample can be used",
            hint="terrain-est inspect shows what each channel is read from",
        )
    share = given.get("keep_aside")
    return cut if share is None else kept_aside.marked(cut, share)


def _tell(
    path: str, source: Source, wheels: Sequence[Samples], progress: Progress, *, noted: bool, verbose: bool
) -> None:
    """Tell what was salvaged of an input, what is remarked of it, and what was set aside."""
    from formats.recovery import Notice

    for sentence in source.recovery.sentences() if source.recovery else ():
        progress.tell(f"{path}: {sentence}")
    notices = (r for samples in wheels for r in samples.remarks if isinstance(r, Notice))
    for remark in dict.fromkeys(notices):
        progress.tell(f"{path}: {remark}", later=noted)
    for samples in wheels:
        used = f"{len(samples.usable)} of {len(samples)} samples used"
        told = [f"set aside: {count} · {reason}" for reason, count in samples.reasons().items()]
        told += [f"{name}: {how}" for name, how in samples.origins.items()] if verbose else []
        if told:
            progress.tell("\n  ".join([f"{samples.source}  {samples.wheel}: {used}", *told]))


def repeated(context: click.Context, model: str) -> Asked:
    """Return what was asked, so that the next command can ask it again of a model."""
    from formats.errors import shown
    from terrain_cli.vocabulary.next_commands import Asked

    said = click.core.ParameterSource.COMMANDLINE
    words: list[str] = []
    for parameter in context.command.params:
        name, value = parameter.name or "", context.params.get(parameter.name or "")
        if name not in _REPEATED or context.get_parameter_source(name) is not said:
            continue
        if isinstance(parameter, click.Option) and parameter.is_flag:
            words.append(parameter.opts[0])
            continue
        for one in value if isinstance(value, (list, tuple)) else (value,):
            words += [parameter.opts[0], str(one)]
    return Asked(
        inputs=tuple(map(shown, context.params["inputs"])),
        model=shown(model),
        options=tuple(map(shown, words)),
        confirm=tuple(map(shown, context.params.get("confirm", ()))),
        fresh=str(free(Path("model.toml"))),
        law=str(free(Path("law.toml"))),
    )


def free(path: Path) -> Path:
    """Return a name, or one beside it with a number, that no file has."""
    numbered = (path.with_stem(f"{path.stem}-{number}") for number in count(2))
    return next(one for one in chain([path], numbered) if not one.exists())


def asked(given: Mapping[str, Any], cut: Sequence[Windows], file: ModelFile) -> EstimateRequest:
    """Return what `estimate` is asked for the segments of a comparison."""
    from terrain_cli.comparison.compare import needed_segments
    from terrain_cli.estimation import estimators
    from terrain_cli.estimation.estimators import EstimateRequest, FitOptions

    # Before the work, not after it.
    estimators.choose("auto", file, robust=given["robust"])
    stress = None if given["at_stress"] is None else 1e3 * given["at_stress"]
    fits = FitOptions(**{name: given[name] for name in ("min_samples", "folds", "robust")}, at_stress=stress)
    return EstimateRequest(wheels=cut, file=file, options=fits, needed=needed_segments)
