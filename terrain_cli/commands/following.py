"""`terrain-est estimate --follow`: who is told what, and how it ends."""

from __future__ import annotations

import sys
from contextlib import ExitStack
from typing import TYPE_CHECKING, Any

import click

from terrain_cli.commands import options
from terrain_cli.commands.progress import draw, wipe
from terrain_cli.presentation.terminal import say

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from terrain_cli.presentation.segment_table import Table
    from terrain_cli.rover import Rover
    from terrain_cli.stream.growing_table import GrowingTable
    from terrain_cli.views.plots import LivePictures

#: What needs the whole log, and what is about several inputs.
_NOT = ("summary", "samples", "rejects", "trace", "posterior", "places", "salvage")


def run(logs: Sequence[str], rover: Rover, given: Mapping[str, Any]) -> None:
    """Follow one input to its end; a first signal to end is an end as any other."""
    from formats.text.arriving_bytes import ArrivingBytes
    from terrain_cli import processes
    from terrain_cli.errors import UsageError
    from terrain_cli.estimation import estimators
    from terrain_cli.presentation import segment_files
    from terrain_cli.stream.follow import Follow
    from terrain_cli.stream.growing_table import AGAIN, OPEN, GrowingTable

    if len(logs) != 1:
        raise UsageError(f"--follow takes one input, not {len(logs)}", hint="start a process for each")
    for name in _NOT:
        if given[name]:
            raise UsageError(
                f"--{name} needs the whole log, and --follow writes while it goes on",
                hint="leave one of them out; record the log for the other",
            )
    if given["segments"] == "fixed" and given["window_samples"] is None:
        raise UsageError(
            "--follow counts fixed windows in samples",
            hint="give --window-samples N, or leave out --segments fixed",
        )
    segment_files.check(None, None, given["crs"])
    settings = options.settings(given)
    if given["again"] and estimators.choose(settings.method, settings.model, robust=settings.robust) is None:
        raise UsageError(
            "--again is for the full model: by an estimator of the line, later segments change nothing",
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
        arriving = ArrivingBytes(logs[0], stop=stop, idle=given["idle_timeout"])
        Follow(rover, settings, teller, every=given["every"], again=given["again"]).run(arriving, logs[0])
        if pictures:
            pictures.draw(last=True)


class _Teller:
    """Rows to the table, or to the terminal, and to the pictures; what is said besides to stderr."""

    def __init__(self, table: GrowingTable | None, pictures: LivePictures | None, *, quiet: bool) -> None:
        self._table, self._pictures, self._quiet = table, pictures, quiet
        self._drawing = not quiet and sys.stderr.isatty()
        self._drawn = False

    def closed(self, row: Table) -> None:
        """Write a row that stays."""
        self._write(row)
        self._draw([row])

    def again(self, row: Table) -> None:
        """Write a row of a segment that was told before."""
        self._write(row, "again")

    def _write(self, row: Table, mark: str = "") -> None:
        self.wipe()
        if self._table:
            self._table.add(row, mark)
        else:
            from terrain_cli.stream.growing_table import readable

            say(f"{mark}  {readable(row)}" if mark else readable(row))

    def open(self, rows: Sequence[Table]) -> None:
        """Write rows that are not the last word on their segments; a terminal shows them in its one line."""
        for row in rows if self._table else ():
            assert self._table is not None  # noqa: S101 - asked above
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
            draw(text)
            self._drawn = True

    def remark(self, text: str) -> None:
        """Say something on stderr."""
        self.wipe()
        if not self._quiet:
            click.echo(text, err=True)

    def wipe(self) -> None:
        """Leave an empty line for what is written next."""
        if self._drawn:
            wipe()
            self._drawn = False
