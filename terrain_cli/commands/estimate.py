"""`terrain-est estimate INPUT…`."""

from __future__ import annotations

import json
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from terrain_cli.commands import options
from terrain_cli.settings import CUT_SAMPLES, FIT_SAMPLES, METHODS, Settings

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

    from terrain_cli.pipeline import Outcome
    from terrain_cli.rover import Rover


@click.command(
    "estimate",
    context_settings=options.CONTEXT,
    short_help="Estimate cohesion and friction angle, segment by segment.",
    epilog="""\b
Examples:
  terrain-est estimate run.bag > soil.csv
  terrain-est estimate run.mcap -o soil.gpkg --crs IAU_2015:49900 --summary soil.json
  terrain-est estimate day1/ day2/*.parquet --segments terrain -o soil.parquet
  terrain-est estimate bench.csv --where "slip_angle_deg == 0" --segments none
  terrain-est estimate run.bag --method recursive --trace convergence.csv
  terrain-est estimate run.bag --method wong-reece --summary soil.json
  terrain-est estimate run.bag --model model.toml --plot pictures
  terrain-est estimate run.bag | ogr2ogr -f GPKG soil.gpkg CSV:/vsistdin/ \\
      -oo AUTODETECT_TYPE=YES -oo EMPTY_STRING_AS_NULL=YES -a_srs IAU_2015:49900
""",
)
@options.inputs
@click.option(
    "-o",
    "--output",
    type=options.FILE,
    metavar="FILE",
    help="Write the table here, by its ending: .csv .parquet .json .geojson .gpkg. Otherwise CSV on stdout.",
)
@click.option("--summary", type=options.FILE, metavar="FILE", help="Write the summary here, as JSON.")
@options.rover
@options.model
@options.wheel
@click.option(
    "--method",
    type=click.Choice(METHODS),
    default=METHODS[0],
    show_default=True,
    help="Estimator. auto: what fits the model; of the linear one least squares where well conditioned, "
    "ridge else. recursive: Kalman filter. wong-reece: the full model, with k estimated.",
)
@options.segments
@click.option(
    "--min-samples",
    type=click.IntRange(min=3),
    metavar="N",
    help=f"Fewest samples of a window.  [{CUT_SAMPLES} to cut, {FIT_SAMPLES} to estimate]",
)
@options.window_distance
@options.window_samples
@click.option(
    "--folds",
    type=click.IntRange(min=2),
    metavar="N",
    help="Choose the ridge's δ over N contiguous blocks.  [leave-one-out]",
)
@click.option(
    "--robust", is_flag=True, help="Give wild samples little weight; with the full model or effects."
)
@options.where
@click.option(
    "--crs",
    metavar="CODE",
    help="Reference system of longitude and latitude, such as IAU_2015:49900 (Mars) or IAU_2015:30100 "
    "(Moon). Positions in x and y stay a site frame.  [EPSG:4326]",
)
@click.option(
    "--rejects",
    type=options.FILE,
    metavar="FILE",
    help="Write the samples set aside here, each with its reason.",
)
@click.option(
    "--trace",
    type=options.FILE,
    metavar="FILE",
    help="With --method recursive: write the estimate after each sample here.",
)
@click.option(
    "--plot",
    type=options.FILE,
    metavar="DIR",
    help="Write pictures into this folder, as PNG and SVG (extra: plot). With --method recursive also "
    "how it converges.",
)
@click.option(
    "--jobs",
    type=click.IntRange(min=1),
    default=1,
    show_default=True,
    metavar="N",
    help="Inputs read at the same time.",
)
@click.option(
    "--seed", type=int, metavar="N", help="Accepted by every verb; estimate draws nothing at random."
)
@options.quiet
@options.verbose
@click.pass_context
def command(context: click.Context, /, **_: Any) -> None:
    """Estimate cohesion and friction angle under each wheel, one row per segment.

    INPUT is a file (CSV, Parquet, ROS 1 or ROS 2 bag), a folder, a pattern, or - for the standard
    input. Each row carries standard errors and a status; where c and φ cannot be told apart it
    says not-separable, and the strength at the stress σ* still holds.
    """
    import formats
    from terrain_cli import fitting
    from terrain_cli.errors import UsageError

    paths = formats.expand(context.params["inputs"])
    rover = options.load_rover(context.params["rover"], paths)
    options.with_defaults(context, rover.estimate)
    given = context.params
    if given["trace"] and given["method"] != "recursive":
        raise UsageError("--trace shows the recursive estimate", hint="add --method recursive")
    # Before the work, not after it.
    if given["plot"]:
        from terrain_cli.views import extras

        extras.need("plot")
    for name in ("output", "rejects", "trace"):
        if given[name]:
            formats.output_kind(given[name])
    if given["crs"]:
        try:
            formats.check_crs(given["crs"])
        except formats.FormatError as error:
            raise UsageError(f"--crs {error}", hint=error.hint) from None
    settings = Settings(
        method=given["method"],
        segments=given["segments"],
        min_samples=given["min_samples"],
        window_samples=given["window_samples"],
        window_distance=given["window_distance"],
        folds=given["folds"],
        wheels=tuple(given["wheels"]),
        where=given["where"],
        model=given["model"],
        robust=given["robust"],
    )
    # Also before the work: whether the model can be read, and goes with the method.
    fitting.choose(settings.method, settings.model, robust=settings.robust)
    outcomes = list(_outcomes(paths, rover, settings, jobs=given["jobs"], quiet=given["quiet"]))
    _write(outcomes, settings, given)


def _write(outcomes: Sequence[Outcome], settings: Settings, given: Mapping[str, Any]) -> None:
    """Write all that was asked for, the table last: what reads it may stop early."""
    import formats
    from terrain_cli import estimation, results, summary

    if given["rejects"]:
        formats.write_table(
            results.join([t for outcome in outcomes for t in outcome.rejects]), given["rejects"]
        )
    for outcome in outcomes:
        if outcome.error:
            raise outcome.error
    table = results.join([outcome.table for outcome in outcomes])
    if given["trace"]:
        formats.write_table(results.join([t for outcome in outcomes for t in outcome.trace]), given["trace"])
    estimates = estimation.join([part for outcome in outcomes for part in outcome.estimates])
    document = summary.document(table, estimates, [outcome.account for outcome in outcomes], settings)
    if given["plot"]:
        from terrain_cli.views import plots

        plots.write(outcomes, given["plot"])
    if given["summary"]:
        text = json.dumps(document, ensure_ascii=False, indent=2, allow_nan=False)
        with formats.replacing(given["summary"]) as temporary:
            Path(temporary).write_text(text + "\n", encoding="utf-8")
    crs = results.reference_system(table, given["crs"])
    formats.write_table(table, given["output"] or "-", crs=crs)
    if given["quiet"]:
        return
    if given["crs"] and crs is None:
        click.echo(f"positions are x and y of a site frame: --crs {given['crs']} does not apply", err=True)
    click.echo(summary.text(document, table, verbose=given["verbose"]), err=True)


def _outcomes(
    paths: Sequence[str], rover: Rover, settings: Settings, *, jobs: int, quiet: bool
) -> Iterable[Outcome]:
    """Run every input, in order, with a progress bar once it has taken a second."""
    from terrain_cli import pipeline
    from terrain_cli.commands.progress import Progress

    with Progress(len(paths), enabled=not quiet) as progress:
        if jobs == 1 or len(paths) == 1:
            for path in paths:
                yield pipeline.run(path, rover, settings, progress=partial(progress.say, path))
                progress.advance()
            return
        from concurrent.futures import ProcessPoolExecutor

        with ProcessPoolExecutor(min(jobs, len(paths))) as pool:
            futures = [pool.submit(pipeline.run, path, rover, settings) for path in paths]
            try:
                for path, future in zip(paths, futures, strict=True):
                    progress.say(path, "")
                    yield future.result()
                    progress.advance()
            finally:
                pool.shutdown(cancel_futures=True)
