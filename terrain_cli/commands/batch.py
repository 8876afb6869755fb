"""Many inputs, into one folder."""

from __future__ import annotations

import signal
import sys
import time
from typing import TYPE_CHECKING, Any

import click

from terrain_cli.commands import options, paths
from terrain_cli.errors import InterruptedBatchError, UnfinishedError, UsageError
from terrain_cli.presentation import terminal
from terrain_cli.presentation.terminal import PATIENCE, StatusLine
from terrain_cli.processes import ENDINGS, EndedError

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from terrain_cli.batch.batch_inputs import Input
    from terrain_cli.batch.coordinator import Tally
    from terrain_cli.batch.manifest import ManifestEntry
    from terrain_cli.batch.worker_tasks import Order

#: Seconds between two pictures on a terminal, and between two lines in a file.
_ON_TERMINAL, _IN_FILE = 0.2, 10.0
_GIGA = 1e9
_TOLD = 5  # Remarks that are told; a mission may have thousands


class Rate:
    """Shows the state of a batch: on a terminal in one line, in a file now and then in a new one."""

    def __init__(self, *, enabled: bool = True) -> None:
        self._enabled = enabled
        self._terminal = sys.stderr.isatty()
        self._started = time.monotonic()
        self._next = self._started + PATIENCE
        self._line = StatusLine()
        self.close = self._line.wipe
        self.tally: Tally | None = None

    @property
    def seconds(self) -> float:
        return time.monotonic() - self._started

    def show(self, tally: Tally) -> None:
        self.tally = tally
        now = time.monotonic()
        if not self._enabled or now < self._next or tally.done == tally.total:
            return
        self._next = now + (_ON_TERMINAL if self._terminal else _IN_FILE)
        if self._terminal:
            self._line.draw(line(tally, self.seconds))
        else:
            click.echo(line(tally, self.seconds), err=True)


def line(tally: Tally, seconds: float) -> str:
    """Return the state of a batch, some seconds after its start, in one line."""
    parts = [f"{tally.done}/{tally.total} inputs", f"{seconds:.0f} s"]
    if tally.done:
        parts.append(f"{tally.done / seconds:.3g} inputs/s")
        # By bytes: a large input at the end is not one of many.
        left = seconds * (tally.bytes_total - tally.bytes_done) / tally.bytes_done
        parts.append(f"{duration(left)} left")
    if tally.counts["failed"]:
        parts.append(f"{tally.counts['failed']} failed")
    return " · ".join(parts)


def duration(seconds: float) -> str:
    if seconds < 90:
        return f"{seconds:.0f} s"
    if seconds < 5400:
        return f"{seconds / 60:.0f} min"
    return f"{seconds / 3600:.1f} h"


@options.verb(
    "batch",
    "terrain-est batch downlink/ -o mission",
    "terrain-est batch sol*/*.bag -o mission --method wong-reece --timeout 600",
    "terrain-est batch downlink/ -o mission --dry-run",
    "terrain-est batch downlink/ -o mission --retry-failed",
    "terrain-est batch downlink/ -o mission --watch",
    "terrain-est batch 's3://rover/sol*/*.mcap' -o mission --scheduler tcp://cluster:8786",
)
@options.inputs
@options.value(
    "-o --output DIR",
    paths.BATCH,
    "The folder of the batch: results, manifest.jsonl, segments.parquet and summary.json.",
    required=True,
)
@click.option(
    "--format",
    "kind",
    envvar="TERRAIN_EST_FORMAT",
    type=click.Choice(("parquet", "csv")),
    default="parquet",
    show_default=True,
    help="Format of the result of each input.",
)
@click.option(
    "--also",
    multiple=True,
    metavar="KIND",
    help="Write the mission table as this kind too, such as gpkg, geojson or csv (repeatable).",
)
@options.estimation
@options.value("--jobs N", options.JOBS, "Worker processes.  [one for each core]")
@click.option(
    "--scheduler",
    metavar="ADDRESS",
    help="Use the workers of this Dask scheduler instead, such as tcp://host:8786 (extra: distributed).",
)
@options.value("--timeout S", options.POSITIVE, "Give up an input after this many seconds.  [never]")
@options.value(
    "--memory GB",
    options.POSITIVE,
    "Give up an input whose worker needs more address space than this.  [no limit]",
)
@click.option("--force", is_flag=True, help="Process all inputs again.")
@click.option("--retry-failed", is_flag=True, help="Try failed inputs again, although nothing has changed.")
@click.option("--fail-fast", is_flag=True, help="Stop at the first failure.")
@click.option("--dry-run", is_flag=True, help="Only list what would be done, and why.")
@click.option("--watch", is_flag=True, help="Process new inputs as they arrive, until interrupted.")
@options.value(
    "--settle S",
    options.Amount(0),
    "With --watch: take a file when it has not changed for this many seconds.",
    default=5.0,
    show_default=True,
)
@options.value("--seed N", int, "Not used here; other commands use it.")
@options.quiet
@options.verbose
@click.pass_context
def command(context: click.Context, /, **_: Any) -> int:
    """Estimate many inputs, each as estimate does, into one folder.

    INPUT is a file, a folder, a pattern, or the address of a store (s3://…, https://…; extra:
    remote). A second run processes only what is new or changed: inputs, options, rover file, model,
    version. A file that fails is listed, and does not stop the rest.

    However a batch ends, no finished work is lost: the same command continues it.
    """
    from formats.limits import largest_copy
    from terrain_cli.batch import batch_inputs, batch_run, worker_tasks
    from terrain_cli.processes import cores

    names = context.params["inputs"]
    found = batch_inputs.discover(names)
    rover = options.configured(context, [item.location for item in found] or names)
    given = context.params
    _check_kinds(given["also"])
    order = worker_tasks.Order(
        configuration=worker_tasks.gather(rover, options.settings(given), given["crs"]),
        **{name: given[name] for name in ("kind", "scheduler", "timeout")},
        **{name: given[name] for name in ("force", "retry_failed", "fail_fast")},
        also=tuple(given["also"]),
        jobs=given["jobs"] or cores(),
        memory=int(given["memory"] * _GIGA) if given["memory"] else None,
        largest=largest_copy(),
        settle=given["settle"] if given["watch"] else None,
    )
    if given["dry_run"]:
        for why, item in batch_run.preview(found, given["output"], order):
            terminal.say(f"{why}\t{terminal.in_line(item.path)}")
        return 0
    return _run(found, order, given)


def _check_kinds(kinds: tuple[str, ...]) -> None:
    import formats

    for kind in kinds:
        try:
            formats.output_kind(f"segments.{kind}")
        except formats.CannotWriteError as error:
            raise UsageError(f"--also {kind}: no such kind of table", hint=error.hint) from None


def _run(found: Sequence[Input], order: Order, given: dict[str, Any]) -> int:
    from terrain_cli.batch import batch_run

    before = signal.signal(signal.SIGTERM, signal.default_int_handler)
    progress = Rate(enabled=not given["quiet"])
    try:
        tally = batch_run.run(given["inputs"], found, given["output"], order, progress.show)
    except (KeyboardInterrupt, EndedError) as end:
        # A second one is for the same.
        for name in (signal.SIGINT, *ENDINGS):
            signal.signal(name, signal.SIG_IGN)
        progress.close()
        known = progress.tally
        done = f"{known.done} of {known.total} inputs done" if known else "no input done"
        error = InterruptedBatchError(
            f"{given['output']}: interrupted; {done}, and kept",
            hint="run the same command again to go on; the mission table is written at the end",
        )
        error.exit_code = end.code if isinstance(end, EndedError) else error.exit_code
        raise error from None
    finally:
        signal.signal(signal.SIGTERM, before)
        progress.close()
    if not given["quiet"]:
        remarks = _remarks(tally.remarks, given["output"])
        for line in (_told(tally, progress.seconds), *map(_saved, tally.salvaged), *remarks):
            click.echo(terminal.in_line(line), err=True)
    for entry in tally.failures.values():
        click.echo(terminal.in_line(f"failed ({entry.exit_code}): {entry.error}"), err=True)
    if not tally.failures:
        return 0
    if any(not entry.passing for entry in tally.failures.values()) and not given["quiet"]:
        click.echo(
            f"  hints: {given['output']}/manifest.jsonl; --retry-failed tries again what has not changed",
            err=True,
        )
    return UnfinishedError.exit_code


def _told(tally: Tally, seconds: float) -> str:
    words = {
        "ok": "done",
        "restored": "known already",
        "duplicate": "duplicates",
        "as before": "as before",
        "failed": "failed",
        "failed before": "failed before and unchanged",
    }
    counts = [f"{tally.counts[name]} {word}" for name, word in words.items() if tally.counts[name]]
    return f"{', '.join(counts) or 'nothing to do'} · {seconds:.1f} s"


def _saved(entry: ManifestEntry) -> str:
    # Never 100 % of what is not whole.
    percent = "" if entry.recovered is None else f"{min(100 * entry.recovered, 99.9):.1f} % of "
    return f"salvaged ({percent}{entry.recovered_of}): {entry.path}"


def _remarks(remarks: Mapping[str, Sequence[str]], folder: str) -> Iterator[str]:
    """Yield what was remarked on most inputs first, and where the rest stands."""
    common = sorted(remarks, key=lambda remark: -len(remarks[remark]))
    for remark in common[:_TOLD]:
        first, *others = sorted(remarks[remark])
        yield f"  {first}{f' and {len(others)} more' if others else ''}: {remark}"
    if len(common) > _TOLD:
        yield f"  {len(common) - _TOLD} more remarks: {folder}/manifest.jsonl"
