"""`terrain-est estimate INPUT…`, and with --follow who is told what, and how it ends."""

from __future__ import annotations

import sys
from contextlib import ExitStack
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from terrain_cli.commands import comparison_options, options, paths
from terrain_cli.errors import UsageError
from terrain_cli.presentation.terminal import Progress, StatusLine, as_json, in_lines, put, say

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from terrain_cli.presentation.segment_files import GrowingTable
    from terrain_cli.presentation.segment_table import Table
    from terrain_cli.rover import Rover
    from terrain_cli.run.one_log import Outcome
    from terrain_cli.run.settings import Settings
    from terrain_cli.views.plots import LivePictures

#: What needs the whole log, and what is about several inputs.
_WHOLE = ("summary", "samples", "rejects", "trace", "posterior", "places", "salvage")


@options.verb(
    "estimate",
    "terrain-est estimate run.bag",
    "terrain-est estimate run.bag > soil.csv",
    "terrain-est estimate run.mcap -o soil.gpkg --crs IAU_2015:49900 --summary soil.json",
    "terrain-est estimate run.bag -o soil.gpkg --samples soil.gpkg",
    "terrain-est estimate sol1200.csv --places localized_interp.csv --crs IAU_2015:49900 -o soil.parquet",
    "terrain-est estimate run.mcap -o soil.mcap",
    "terrain-est estimate day1/ day2/*.parquet --segments terrain -o soil.parquet",
    'terrain-est estimate bench.csv --where "slip_angle_deg == 0" --segments none',
    "terrain-est estimate run.bag --method recursive --trace convergence.csv",
    "terrain-est estimate run.bag --method wong-reece --summary soil.json",
    "terrain-est estimate run.bag --model model.toml --plot pictures",
    "terrain-est estimate run.bag -o soil.csv --posterior posterior.parquet",
    "terrain-est estimate --follow growing.csv --every 1s --idle-timeout 10min",
    "terrain-est estimate --follow day1 -o soil.mcap",
    "mosquitto_sub -t rover/wheels | terrain-est estimate --follow - -o soil.geojsons",
    "terrain-est estimate run.bag | ogr2ogr -f GPKG soil.gpkg CSV:/vsistdin/ \\\n"
    "      -oo AUTODETECT_TYPE=YES -oo EMPTY_STRING_AS_NULL=YES -a_srs IAU_2015:49900",
)
@options.inputs
@options.value(
    "-o --output FILE",
    paths.SEGMENTS,
    "Write the table here, by its ending: .csv .parquet .json .geojson .geojsonl .geojsons .gpkg .mcap. "
    "Otherwise CSV on stdout, and on a terminal a table to read.",
)
@click.option("--csv", is_flag=True, help="Write CSV to stdout on a terminal too, as into a pipe.")
@options.value("--summary FILE", paths.SUMMARY, "Write the summary here, as JSON.")
@options.estimation
@options.value(
    "--samples FILE",
    paths.SAMPLES,
    "Write the samples of every segment here, as points; into the .gpkg of -o, if it is the same file, "
    "as its second layer.",
)
@options.value("--rejects FILE", paths.REJECTS, "Write the samples set aside here, each with its reason.")
@options.value(
    "--trace FILE", paths.TRACE, "With --method recursive: write the estimate after each sample here."
)
@options.value(
    "--posterior FILE",
    paths.POSTERIOR,
    "Write the joint posterior of c and φ here: for each segment a grid, and the covariance of all its "
    "parameters. Takes a second or two a segment.",
)
@options.plot(
    "Write pictures into this folder, as PNG and SVG (extra: plot). With --method recursive also "
    "how it converges. With --follow only that, by any method, drawn anew as rows come.",
)
@click.option(
    "--follow",
    is_flag=True,
    help="Take INPUT as it arrives, and write the row of a segment when it closes: CSV with a header or "
    "JSON Lines from a pipe, - or a file that grows; or a bag, or rosbag2's folder, while it is recorded. "
    "Ends with the pipe or the bag, or by Ctrl-C.",
)
@options.value(
    "--every TIME",
    options.Duration(),
    "With --follow: also write the segments that are still open, every 1s or so; the last column, "
    "open, marks them.",
)
@click.option(
    "--again",
    is_flag=True,
    help="With --follow: at the end, write the rows again, as the full model has them after the whole "
    "drive: the last 64 segments of each wheel. The column again marks them.",
)
@options.value(
    "--idle-timeout TIME",
    options.Duration(),
    "With --follow: end when nothing has arrived for this long.  [never]",
)
@options.force
@options.jobs("Inputs read at the same time.")
@options.value("--seed N", int, "Not used here; other commands use it.")
@options.quiet
@options.verbose
@click.pass_context
def command(context: click.Context, /, **_: Any) -> None:
    """Estimate cohesion and friction angle under each wheel, one row per segment.

    A terminal shows a table to read. A pipe, a file and --csv get CSV with every column, and the
    table to read is on stderr.

    INPUT is a file (CSV, Parquet, ROS 1 or ROS 2 bag), a folder, a pattern, or - for the standard
    input. Each row has standard errors and a status, which says whether c and φ can be used:
    where c and φ cannot be told apart (not-separable), the strength at the stress σ* may still be
    known.
    """
    import formats
    from terrain_cli.presentation import segment_files

    logs = formats.expand(context.params["inputs"])
    rover = options.configured(context, logs)
    given = context.params
    if given["csv"] and given["output"]:
        raise UsageError("--csv and -o both say where the table goes", hint="leave one of them out")
    if given["follow"]:
        _follow(context.params["inputs"], logs, rover, given)
        return
    for name in ("every", "again", "idle_timeout"):
        if given[name] not in {None, False}:
            raise UsageError(
                f"--{name.replace('_', '-')} needs --follow", hint="add --follow, or leave it out"
            )
    if given["trace"] and given["method"] != "recursive":
        raise UsageError("--trace shows the recursive estimate", hint="add --method recursive")
    for name in ("rejects", "trace", "posterior"):
        if given[name]:
            formats.output_kind(given[name])
    segment_files.check(given["output"], given["samples"], given["crs"])
    settings = options.settings(given)
    outcomes = _outcomes(logs, rover, settings, jobs=given["jobs"], quiet=given["quiet"])
    _write(outcomes, settings, context)


def _write(  # noqa: C901 - one branch for each thing asked for
    outcomes: Sequence[Outcome], settings: Settings, context: click.Context
) -> None:
    """Write all that was asked for, the table last: what reads it may stop early."""
    import formats
    from terrain_cli import estimation
    from terrain_cli.presentation import segment_files, segment_table, summary

    given = context.params

    def joined(name: str) -> Table:
        return segment_table.join([one for outcome in outcomes for one in getattr(outcome, name)])

    if given["rejects"]:
        formats.write_table(joined("rejects"), given["rejects"])
    for outcome in outcomes:
        if outcome.error:
            raise outcome.error
    table = segment_table.join([outcome.table for outcome in outcomes])
    for name in ("trace", "posterior"):
        if given[name]:
            formats.write_table(joined(name), given[name])
    estimates = estimation.join([part for outcome in outcomes for part in outcome.estimates])
    document = summary.document(
        table, estimates, [outcome.account for outcome in outcomes], settings.document()
    )
    if given["plot"]:
        from terrain_cli.views import plots

        plots.write(outcomes, given["plot"])
    if given["summary"]:
        put(as_json(document) + "\n", given["summary"])
    crs = segment_table.reference_system(table, given["crs"])
    points = (joined("samples"), given["samples"]) if given["samples"] else None
    # Nobody reads WKT on a screen.
    for_reading = given["output"] is None and not given["csv"] and sys.stdout.isatty()
    segment_files.write(table, None if for_reading else given["output"] or "-", crs, points)
    site = f"positions are x and y of a site frame: --crs {given['crs']} does not apply"
    remarks = [site * bool(given["crs"] and crs is None), segment_files.remark(given["output"], crs)]
    for remark in () if given["quiet"] else filter(None, remarks):
        click.echo(remark, err=True)

    def diagnosed() -> str:
        return comparison_options.repeated(context, given["model"] or "wong-reece").looked("diagnose")

    if for_reading or not given["quiet"]:
        readable = summary.text(in_lines(document), table, diagnosed=diagnosed, verbose=given["verbose"])
        if for_reading:
            say(readable)
        else:
            click.echo(readable, err=True)


def _outcomes(
    logs: Sequence[str], rover: Rover, settings: Settings, *, jobs: int, quiet: bool
) -> list[Outcome]:
    """Run every input, in order, with a progress bar once it has taken a second.

    Strengths of all are at one stress: that of the first input which has one. The others then wait for it.
    """
    from terrain_cli import processes
    from terrain_cli.estimation.estimators import common_stress
    from terrain_cli.run import one_log

    with Progress(len(logs), enabled=not quiet) as progress, processes.jobs(jobs):

        def begin(path: str) -> None:
            if path != logs[0]:
                progress.advance()
            progress.say(path, "")

        def run(paths: Sequence[str], settings: Settings) -> list[Outcome]:
            work = partial(one_log.run, rover=rover, settings=settings)
            if min(jobs, len(paths)) == 1:
                # What shows the progress cannot be sent to another process.
                work = partial(work, progress=progress.say, ahead=processes.cores() > 1)
            return processes.each(work, paths, begin)

        done: list[Outcome] = []
        stress = settings.stress
        while stress is None and len(done) < len(logs):
            done += run(logs[len(done) : len(done) + 1], settings)
            for estimates in done[-1].estimates:
                stress = common_stress(stress, estimates)
        if stress is not None:
            settings = replace(settings, at_stress=stress / 1e3)
        return done + run(logs[len(done) :], settings)


def _follow(inputs: Sequence[str], logs: Sequence[str], rover: Rover, given: Mapping[str, Any]) -> None:
    """Follow one input to its end; a first signal to end is an end as any other."""
    from formats.byte_sources import ArrivingBytes
    from terrain_cli import processes
    from terrain_cli.estimation import estimators
    from terrain_cli.presentation.segment_files import AGAIN, OPEN, GrowingTable
    from terrain_cli.stream.follow import Follow

    path, file = _followed(inputs, logs)
    for name in _WHOLE:
        if given[name]:
            raise UsageError(
                f"--{name} needs the whole log, and --follow writes while it goes on",
                hint="leave one of them out; record the log for the other",
            )
    if given["segments"] == "fixed" and given["window_samples"] is None:
        raise UsageError(
            "--follow counts fixed segments in samples",
            hint="give --window-samples N, or leave out --segments fixed",
        )
    settings = options.settings(given)
    if given["again"] and estimators.choose(settings.method, settings.model, robust=settings.robust) is None:
        raise UsageError(
            "--again is for the full model: with the linear model, later segments change nothing",
            hint="leave out --again or --method",
        )
    shown = given["output"] is None and not given["csv"] and sys.stdout.isatty()
    with ExitStack() as stack:
        table = None
        if not shown:
            marks = {AGAIN: given["again"], OPEN: given["every"] is not None}
            marked = [name for name, wanted in marks.items() if wanted]
            table = GrowingTable(given["output"] or "-", given["crs"], marked)
        stop = stack.enter_context(processes.noted())
        if table:
            stack.enter_context(table)
        pictures = None
        if given["plot"]:
            from terrain_cli.views.plots import LivePictures

            pictures = LivePictures(given["plot"])
        teller = _Teller(table, pictures, quiet=given["quiet"])
        stack.callback(teller.wipe)
        folder = path if file != path else ""
        arriving = ArrivingBytes(file, stop=stop, idle=given["idle_timeout"], folder=folder)
        Follow(rover, settings, teller, every=given["every"], again=given["again"]).run(arriving, path)
        if pictures:
            pictures.draw(last=True)


def _followed(inputs: Sequence[str], logs: Sequence[str]) -> tuple[str, str]:
    """Return the input, and the file that is followed: of a recording in a folder the first."""
    from formats.rosbag.bag_files import first_part

    part = first_part(Path(inputs[0])) if len(inputs) == 1 else None
    if part is not None and {Path(log).suffix for log in logs} <= {part.suffix, Path(inputs[0]).suffix}:
        return inputs[0], str(part)
    if len(logs) != 1:
        there = [(Path(path).stat().st_mtime_ns, path) for path in logs if Path(path).exists()]
        newest = max(there)[1] if there else logs[-1]
        raise UsageError(
            f"--follow takes one input, not {len(logs)}",
            hint=f"start a process for each; last written to was {newest}",
        )
    return logs[0], logs[0]


class _Teller:
    """Rows to the table, or to the terminal, and to the pictures; what is said besides to stderr."""

    def __init__(self, table: GrowingTable | None, pictures: LivePictures | None, *, quiet: bool) -> None:
        self._table, self._pictures, self._quiet = table, pictures, quiet
        self._drawing = not quiet and sys.stderr.isatty()
        self._line = StatusLine()
        self.wipe = self._line.wipe  # Leaves an empty line for what is written next

    def closed(self, row: Table) -> None:
        self._write(row)
        self._draw([row])

    def again(self, row: Table) -> None:
        self._write(row, "again")

    def _write(self, row: Table, mark: str = "") -> None:
        self.wipe()
        if self._table:
            self._table.add(row, mark)
        else:
            from terrain_cli.presentation.segment_files import readable

            say(f"{mark}  {readable(row)}" if mark else readable(row))

    def open(self, rows: Sequence[Table]) -> None:
        """Write rows that are not the last word on their segments; a terminal shows them in its one line."""
        if self._table:
            for row in rows:
                self._table.add(row, "open")
        self._draw(rows)

    def _draw(self, rows: Sequence[Table]) -> None:
        if self._pictures:
            for row in rows:
                self._pictures.add(row)
            self._pictures.draw()

    def now(self, text: str) -> None:
        """Draw over the one line of a terminal."""
        if self._drawing:
            self._line.draw(text)

    def remark(self, text: str) -> None:
        self.wipe()
        if not self._quiet:
            click.echo(text, err=True)
