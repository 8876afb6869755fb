"""Progress on stderr: a bar for a person who has waited for a second, and lines that stay."""

from __future__ import annotations

import shutil
import sys
import threading
import time
from typing import TYPE_CHECKING, Self

from terrain_cli.presentation.terminal import escaped, in_line

if TYPE_CHECKING:
    from types import TracebackType

#: Seconds of work before anything is shown.
PATIENCE = 1.0
WIDTH = 24


class Progress:
    """Shows how many inputs are done and what is being done now.

    Drawn only on a terminal, only after a second, and wiped when the work ends. What is told stays, and is
    written to a file or a pipe too.
    """

    def __init__(self, total: int, *, enabled: bool = True) -> None:
        self._total, self._enabled = total, enabled
        self._done, self._share = 0, 0.0
        self._text = ""
        self._drawn = False
        self._started = time.monotonic()
        self._stop = threading.Event()
        shown = enabled and sys.stderr.isatty()
        # A thread, so that a single long step is shown too.
        self._thread = threading.Thread(target=self._run, daemon=True) if shown else None

    def __enter__(self) -> Self:
        if self._thread:
            self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, value: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._stop.set()
        if self._thread:
            self._thread.join()
        if self._drawn:
            wipe()

    def say(self, path: str, step: str, share: float = 0.0) -> None:
        """Set what is being done, and which share of this input is done."""
        self._text, self._share = f"{path}  {step}", share

    def advance(self) -> None:
        self._done, self._share = self._done + 1, 0.0

    def tell(self, text: str) -> None:
        """Write a result that is there before the work ends."""
        if self._enabled:
            # In one call, or the bar could be drawn between wiping it and the text.
            _write(("\r" + over("") + "\r" if self._drawn else "") + escaped(text) + "\n")

    def _run(self) -> None:
        if self._stop.wait(PATIENCE):
            return
        while not self._stop.wait(0.1):
            elapsed = time.monotonic() - self._started
            filled = min(int(WIDTH * (self._done + self._share) / self._total), WIDTH)
            bar = "█" * filled + "░" * (WIDTH - filled)
            line = f"{bar} {self._done}/{self._total}  {elapsed:.0f} s  {self._text}"
            draw(line)
            self._drawn = True


def draw(line: str) -> None:
    """Write over the line on the terminal, with spaces in place of escape codes."""
    _write("\r" + over(in_line(line)))


def _write(text: str) -> None:
    """Write to stderr text that may go back to the start of its line."""
    getattr(sys.stderr, "draw", sys.stderr.write)(text)
    sys.stderr.flush()


def wipe() -> None:
    """Leave an empty line, for what is written next."""
    _write("\r" + over("") + "\r")


def over(line: str) -> str:
    """Cut or fill a line to the width of the terminal."""
    width = shutil.get_terminal_size().columns - 1
    return line[:width].ljust(width)
