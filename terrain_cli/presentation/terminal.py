"""Safe output and progress: control characters escaped, faults of the terminal harmless, no NaN in JSON."""

import io
import json
import os
import re
import shutil
import sys
import threading
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, Self, cast

import click

#: What moves the cursor, changes colours, turns the direction of writing or ends a line: C0, DEL, C1, the
#: marks for bidirectional text and for lines, and halves of characters, which no file of text can hold.
_CONTROLS = r"\x00-\x1f\x7f-\x9f\u061c\u200e\u200f\u2028-\u202e\u2066-\u2069\ud800-\udfff"
_IN_LINE = re.compile(f"[{_CONTROLS}]")
_IN_TEXT = re.compile(rf"(?![\n\t])[{_CONTROLS}]")

#: Seconds of work before anything is shown.
PATIENCE = 1.0
WIDTH = 24


def _named(match: re.Match[str]) -> str:
    return match[0].encode("unicode_escape").decode("ascii")


def escaped(text: str) -> str:
    r"""Return text as a terminal can show it: control characters as ``\x1b``; lines and tabs are left."""
    return _IN_TEXT.sub(_named, text)


def in_line(text: str) -> str:
    return _IN_LINE.sub(_named, text)


def in_lines(value: Any) -> Any:
    """Return a document with each of its texts in one line."""
    if isinstance(value, str):
        return in_line(value)
    if isinstance(value, dict):
        return {in_lines(key): in_lines(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return type(value)(in_lines(item) for item in value)
    return value


def aligned(rows: Sequence[Sequence[str]], indent: str = "") -> list[str]:
    cells = [[in_line(cell) for cell in row] for row in rows]
    widths = [max(map(len, column)) for column in zip(*cells, strict=True)]
    return [
        f"{indent}{'  '.join(cell.ljust(width) for cell, width in zip(row, widths, strict=True))}".rstrip()
        for row in cells
    ]


def say(result: str | Mapping[str, Any] = "") -> None:
    """Write what people read to the standard output, or a document as JSON."""
    click.echo(escaped(result) if isinstance(result, str) else as_json(result))


def put(text: str, path: str) -> None:
    """Write a text into a file, all of it or nothing; "-" is the standard output."""
    if path == "-":
        click.echo(text, nl=False)
        return
    from formats import replacing

    with replacing(path) as temporary:
        Path(temporary).write_text(text, encoding="utf-8")


def complain(message: str, hint: str) -> None:
    """Say on the standard error what went wrong in one line, and what to do in the next."""
    click.echo(f"terrain-est: {in_line(message)}", err=True)
    if hint:
        click.echo(f"  {hint}".replace("\n", "\n  "), err=True)


class Screen(io.TextIOWrapper):
    """The standard error: what is written to it is for people, and lost where nobody can read it."""

    def write(self, text: str, /) -> int:
        """Write text in which no control character is left."""
        return self.draw(escaped(text))

    def draw(self, text: str) -> int:
        """Write text as it is, and at once."""
        try:
            super().write(text)
            super().flush()
        except OSError:
            # Closed, or full: a second attempt, at the latest as Python ends, would fail again.
            _discard(self.fileno())
        return len(text)


@contextmanager
def prepared() -> Iterator[None]:
    """Run a command with standard streams in UTF-8, whose numbers no other file takes where one is closed."""
    for number in range(3):
        try:
            os.fstat(number)
        except OSError:
            # The lowest that is free; to write to it fails.
            os.open(os.devnull, os.O_RDONLY)
    before = sys.stdout, sys.stderr
    # Python has nothing where there was nothing to open.
    stdout, stderr = cast("tuple[io.TextIOWrapper | None, io.TextIOWrapper | None]", before)
    if stdout is None:
        sys.stdout = open(1, "w", encoding="utf-8", closefd=False)  # noqa: SIM115
    elif hasattr(stdout, "reconfigure"):
        stdout.reconfigure(encoding="utf-8")
    buffer = getattr(stderr, "buffer", None) or open(2, "wb", buffering=0, closefd=False)  # noqa: SIM115
    encoding = getattr(stderr, "encoding", None) or "utf-8"
    # Of ASCII alone click would make a stream of its own.
    encoding = "utf-8" if encoding.lower() in {"ascii", "ansi_x3.4-1968", "us-ascii"} else encoding
    sys.stderr = screen = Screen(buffer, encoding, "backslashreplace")
    try:
        yield
    finally:
        try:
            sys.stdout.flush()
        except OSError:
            _discard(1)
        with suppress(OSError):
            screen.detach()
        sys.stdout, sys.stderr = before


def _discard(descriptor: int) -> None:
    """Let all that is still written there go nowhere."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), descriptor)


def as_json(document: Mapping[str, Any]) -> str:
    """Write a document of a result; it holds None, never NaN, where something is not known."""
    return json.dumps(document, ensure_ascii=False, indent=2, allow_nan=False)


class Progress:
    """Shows on a terminal, after a second, what is done; what is told stays, in a file or a pipe too."""

    def __init__(self, total: int, *, enabled: bool = True) -> None:
        self._total, self._enabled = total, enabled
        self._done, self._share = 0, 0.0
        self._text = ""
        self._line = StatusLine()
        self._later: list[str] = []
        self._started = time.monotonic()
        self._stop = threading.Event()
        shown = enabled and sys.stderr.isatty()
        # A thread, so that a single long step is shown too.
        self._thread = threading.Thread(target=self._run, daemon=True) if shown else None

    def __enter__(self) -> Self:
        if self._thread:
            self._thread.start()
        return self

    def __exit__(self, error: type[BaseException] | None, *_: object) -> None:
        self._stop.set()
        if self._thread:
            self._thread.join()
        self._line.wipe()
        if error is not None and issubclass(error, Exception):
            for text in self._later:
                self.tell(text)

    def say(self, path: str, step: str, share: float = 0.0) -> None:
        """Set what is being done, and which share of this input is done."""
        self._text, self._share = f"{path}  {step}", share

    def advance(self) -> None:
        self._done, self._share = self._done + 1, 0.0

    def tell(self, text: str, *, later: bool = False) -> None:
        """Write a result that is there before the work ends, or `later` only if it ends with an error."""
        if later:
            self._later.append(text)
        elif self._enabled:
            # In one call, or the bar could be drawn between wiping it and the text.
            self._line.wipe(escaped(text) + "\n")

    def _run(self) -> None:
        if self._stop.wait(PATIENCE):
            return
        while not self._stop.wait(0.1):
            elapsed = time.monotonic() - self._started
            filled = min(int(WIDTH * (self._done + self._share) / self._total), WIDTH)
            bar = "█" * filled + "░" * (WIDTH - filled)
            self._line.draw(f"{bar} {self._done}/{self._total}  {elapsed:.0f} s  {self._text}")


class StatusLine:
    """The one line of a terminal that is drawn over until it is wiped."""

    def __init__(self) -> None:
        self._drawn = False

    def draw(self, text: str) -> None:
        """Write over it, with spaces in place of escape codes."""
        self._write("\r" + self._over(in_line(text)))
        self._drawn = True

    def wipe(self, then: str = "") -> None:
        """Leave an empty line, and write what comes then in the same call."""
        if self._drawn or then:
            self._write(("\r" + self._over("") + "\r" if self._drawn else "") + then)
        # Behind what stays, a thread may have drawn it again.
        self._drawn = self._drawn and bool(then)

    def _over(self, line: str) -> str:
        """Cut or fill a line to the width of the terminal."""
        width = shutil.get_terminal_size().columns - 1
        return line[:width].ljust(width)

    def _write(self, text: str) -> None:
        """Write to stderr text that may go back to the start of its line."""
        getattr(sys.stderr, "draw", sys.stderr.write)(text)
        sys.stderr.flush()
