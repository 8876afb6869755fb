"""The bytes of a pipe, of the standard input, or of a file that grows, as they arrive."""

from __future__ import annotations

import os
import select
import stat
import sys
import time
from contextlib import contextmanager
from typing import TYPE_CHECKING

from formats.content import SIDE_FILES, failure
from formats.copies import readable
from formats.errors import FormatError, NotFoundError
from formats.table import STANDARD_INPUT

if TYPE_CHECKING:
    from collections.abc import Iterator

#: Bytes taken at once, as many as a pipe of Linux holds: nothing waits long for what came with it.
_BLOCK = 1 << 16
#: What is still taken from a pipe once the process was asked to end: its writer may never stop.
_LEFT = 1 << 20
#: Seconds between two looks at a file, and between two empty blocks while nothing arrives.
_LOOK = 0.1


class ArrivingBytes:
    """What arrives from one input, until it ends, until somebody asks, or until nothing more comes.

    Nothing is read before it is asked for, so that a writer waits for whoever works on it.
    """

    def __init__(self, path: str, *, stop: int, idle: float | None = None, folder: str = "") -> None:
        """Open it; a descriptor `stop` that can be read asks to end, as do so many seconds without a byte.

        Bytes of other files in a `folder` count too, though they are not read.
        """
        self.label = STANDARD_INPUT if path == "-" else path
        self._path, self._stop, self._idle, self._folder = path, stop, idle, folder
        #: Whether somebody asked to end.
        self.stopped = False
        #: Whether nothing came for too long.
        self.idled = False

    def __iter__(self) -> Iterator[bytes]:
        """Yield blocks as they arrive, empty ones while nothing does."""
        with self._opened() as descriptor:
            #: It is a file, which may become longer.
            self._grows = self._path != "-" and stat.S_ISREG(os.fstat(descriptor).st_mode)
            last, changed, left = time.monotonic(), self._changed(), _LEFT
            while (block := self._next(descriptor)) is not None:
                if block or changed != (changed := self._changed()):
                    last = time.monotonic()
                elif self.stopped or (self._idle is not None and time.monotonic() - last >= self._idle):
                    self.idled = not self.stopped
                    return
                yield block
                left -= len(block) * self.stopped
                if left <= 0:
                    return

    def _next(self, descriptor: int) -> bytes | None:
        """Wait for a block; empty where none came, None at the end. Asked to end, wait for nothing."""
        ready, _, _ = select.select(
            [self._stop, *([] if self._grows else [descriptor])], [], [], 0 if self._grows else _LOOK
        )
        self.stopped = self._stop in ready
        if not (self._grows or descriptor in ready):
            return b""
        try:
            block = os.read(descriptor, _BLOCK)
        except BlockingIOError:
            return b""
        if block or not self._grows:
            return block or None
        if self.stopped:
            return b""
        if os.lseek(descriptor, 0, os.SEEK_CUR) > os.fstat(descriptor).st_size:
            raise FormatError(self.label, "became shorter while it was followed", hint="follow the new file")
        ready, _, _ = select.select([self._stop], [], [], _LOOK)
        self.stopped = bool(ready)
        return b""

    def _changed(self) -> list[int]:
        """Return when a file was changed, and what SQLite keeps beside it: it need not become longer."""
        files = [self._path, *(f"{self._path}{ending}" for ending in SIDE_FILES)] if self._grows else []
        files += [entry.path for entry in os.scandir(self._folder)] if self._folder else []
        return [os.stat(file).st_mtime_ns for file in files if os.path.exists(file)]  # noqa: PTH110, PTH116

    @contextmanager
    def _opened(self) -> Iterator[int]:
        if self._path == "-":
            if sys.stdin is None:
                raise NotFoundError(STANDARD_INPUT, "is closed")
            yield sys.stdin.fileno()
            return
        try:
            if stat.S_ISDIR(readable(self._path).st_mode):
                raise FormatError(
                    self.label, "is a folder", hint="follow one file; batch --watch takes folders"
                )
            # A pipe that nobody has opened yet would hold up the open itself.
            descriptor = os.open(self._path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
        except OSError as error:
            raise failure(self._path, error) from error
        try:
            yield descriptor
        finally:
            os.close(descriptor)
