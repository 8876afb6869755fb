"""Progress of a batch on stderr: how far it is, its rate, the time left."""

from __future__ import annotations

import sys
import time
from typing import TYPE_CHECKING

import click

from terrain_cli.commands.progress import PATIENCE, draw, wipe

if TYPE_CHECKING:
    from terrain_cli.batch.coordinator import Tally

#: Seconds between two pictures on a terminal, and between two lines in a file.
_ON_TERMINAL, _IN_FILE = 0.2, 10.0


class Rate:
    """Shows the state of a batch: on a terminal in one line, in a file now and then in a new one."""

    def __init__(self, *, enabled: bool = True) -> None:
        self._enabled = enabled
        self._terminal = sys.stderr.isatty()
        self._started = time.monotonic()
        self._next = self._started + PATIENCE
        self._drawn = False
        self.tally: Tally | None = None

    @property
    def seconds(self) -> float:
        """Since the start."""
        return time.monotonic() - self._started

    def show(self, tally: Tally) -> None:
        """Show the state, if it is time to."""
        self.tally = tally
        now = time.monotonic()
        if not self._enabled or now < self._next or tally.done == tally.total:
            return
        self._next = now + (_ON_TERMINAL if self._terminal else _IN_FILE)
        if self._terminal:
            draw(line(tally, self.seconds))
            self._drawn = True
        else:
            click.echo(line(tally, self.seconds), err=True)

    def close(self) -> None:
        """Wipe the line on the terminal."""
        if self._drawn:
            wipe()
            self._drawn = False


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
    """Return a time as people say it."""
    if seconds < 90:
        return f"{seconds:.0f} s"
    if seconds < 5400:
        return f"{seconds / 60:.0f} min"
    return f"{seconds / 3600:.1f} h"
