"""Bytes of files, of pipes and of what grows, as they come; copies of what comes only once. No devices."""

import errno
import os
import select
import shutil
import stat
import sys
import tempfile
import time
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import BinaryIO, cast

from formats.content import SIDE_FILES, failure
from formats.errors import CannotWriteError, FormatError, NotFoundError
from formats.limits import PIPE_SECONDS, SPARE_BYTES, largest_copy
from formats.table import STANDARD_INPUT

_BLOCK = 1 << 20
_OPEN_FILES = "/proc/self/fd"  # Where Linux shows the open files of a process
#: Bytes taken at once, as many as a pipe of Linux holds: nothing waits long for what came with it.
_ARRIVING = 1 << 16
#: What is still taken from a pipe once the process was asked to end: its writer may never stop.
_LEFT = 1 << 20
_LOOK = 0.1  # Seconds between two looks at a file, and between two empty blocks while nothing arrives


def readable(path: str) -> os.stat_result:
    """Look at what is to be read, and refuse devices, which have no end."""
    status = os.stat(path)  # noqa: PTH116 (follows /dev/fd/63 as open does)
    if not any(kind(status.st_mode) for kind in (stat.S_ISREG, stat.S_ISDIR, stat.S_ISFIFO)):
        raise no_file(path, status.st_mode)
    return status


def no_file(path: str, mode: int) -> FormatError:
    kind = "a socket" if stat.S_ISSOCK(mode) else "a device"
    return FormatError(path, f"is {kind}, not a file", hint="give a file, a pipe, or - for standard input")


def read_short(path: str, most: int) -> bytes:
    """Read so many bytes at most of what a person has written, from a file or a pipe such as <(…)."""
    if not stat.S_ISFIFO(readable(path).st_mode):
        with Path(path).open("rb") as stream:
            return stream.read(most)
    data = bytearray()
    for block in piped(path, seconds=PIPE_SECONDS):
        data += block
        if len(data) >= most:
            break
    return bytes(data[:most])


def piped(path: str, *, seconds: float | None = None) -> Iterator[bytes]:
    """Read a pipe to its end, in some seconds if given. If nobody begins to write into it, it is given up."""
    descriptor = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
    began = time.monotonic()
    come = False
    try:
        while True:
            waited = time.monotonic() - began
            try:
                block = os.read(descriptor, _BLOCK)
            except BlockingIOError:
                # Somebody has opened it, and may take his time.
                if seconds is not None and waited > seconds:
                    raise NotFoundError(path, f"this pipe was not closed within {seconds:g} s") from None
                select.select([descriptor], [], [], None if seconds is None else seconds)
                continue
            if block:
                come = True
                yield block
            elif come:
                return
            elif waited > PIPE_SECONDS:
                raise NotFoundError(path, f"nobody wrote into this pipe for {PIPE_SECONDS:g} s")
            else:
                time.sleep(0.01)
    finally:
        os.close(descriptor)


class ArrivingBytes:
    """What arrives from one input, until it ends, somebody asks or nothing comes; read as it is asked for."""

    def __init__(self, path: str, *, stop: int, idle: float | None = None, folder: str = "") -> None:
        """Open it; a descriptor `stop` that can be read asks to end, as do so many seconds without a byte."""
        # Bytes of other files in a `folder` count too, though they are not read.
        self.label = STANDARD_INPUT if path == "-" else path
        self._path, self._stop, self._idle, self._folder = path, stop, idle, folder
        self.stopped = False  # Whether somebody asked to end

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
                    return
                yield block
                left -= len(block) * self.stopped
                if left <= 0:
                    return

    def _next(self, descriptor: int) -> bytes | None:
        """Wait for a block; empty where none came, None at the end. Asked to end, wait for nothing."""
        read = [] if self._grows else [descriptor]
        ready, _, _ = select.select([self._stop, *read], [], [], 0 if self._grows else _LOOK)
        self.stopped = self._stop in ready
        if not (self._grows or descriptor in ready):
            return b""
        try:
            block = os.read(descriptor, _ARRIVING)
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
                hint = "follow one file; batch --watch takes folders"
                raise FormatError(self.label, "is a folder", hint=hint)
            # A pipe that nobody has opened yet would hold up the open itself.
            descriptor = os.open(self._path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
        except OSError as error:
            raise failure(self._path, error) from error
        try:
            yield descriptor
        finally:
            os.close(descriptor)


@contextmanager
def named(path: str, name: str | None = None) -> Iterator[str]:
    """Give a file that has no name, or shall have another, one for as long as a library needs to open it."""
    if name is None and not (path.startswith(_OPEN_FILES) and os.stat(path).st_nlink == 0):  # noqa: PTH116
        yield path
        return
    name = name or os.path.join(tempfile.gettempdir(), f"terrain-est-{os.urandom(8).hex()}")  # noqa: PTH118
    try:
        # Given any folder, Python follows the link to the file; an absolute path does not need it.
        os.link(path, name, src_dir_fd=0, follow_symlinks=True)
        yield name
    finally:
        Path(name).unlink(missing_ok=True)


def kept(
    label: str, blocks: Iterable[bytes], *, most: int | None = None, stated: int | None = None
) -> tuple[BinaryIO, str]:
    """Keep what can be read only once in a file that goes when it is closed; return it and its path."""
    # There must be room at once for the bytes `stated`, and no more than `most` are taken.
    try:
        file = _temporary()
    except OSError as error:
        raise _no_room(label, error) from error
    try:
        _write(label, blocks, file, largest_copy() if most is None else most, stated or 0)
    except BaseException:
        file.close()
        raise
    return file, file.name if isinstance(file.name, str) else f"{_OPEN_FILES}/{file.fileno()}"


def _temporary() -> BinaryIO:
    """Open a file that never has a name; where no system or disk makes such, one whose name goes with it."""
    if hasattr(os, "O_TMPFILE") and Path(_OPEN_FILES).is_dir():
        # Not by tempfile: its files can be given no name, which SQLite needs.
        with suppress(OSError):
            flags = os.O_TMPFILE | os.O_RDWR | os.O_CLOEXEC
            return os.fdopen(os.open(tempfile.gettempdir(), flags, 0o600), "w+b")
    return cast("BinaryIO", tempfile.NamedTemporaryFile(prefix="terrain-est-"))


def _write(label: str, blocks: Iterable[bytes], file: BinaryIO, most: int, stated: int) -> None:
    """Write what must not be larger than `most`, and leave some of the disk free."""
    size = 0
    blocks = iter(blocks)
    while block := next(blocks, b""):
        size += len(block)
        if size > most:
            raise too_large(label, most)
        try:
            needed = max(stated - size, 0) + len(block) + SPARE_BYTES
            if shutil.disk_usage(file.fileno()).free < needed:
                raise OSError(errno.ENOSPC, f"less than {SPARE_BYTES >> 20} MiB would be left free")
            file.write(block)
            file.flush()
        except OSError as error:
            raise _no_room(label, error) from error


def too_large(label: str, most: int) -> CannotWriteError:
    what = f"is larger than the {most / 1e9:g} GB that are copied"
    return CannotWriteError(label, what, hint="raise --largest")


def _no_room(label: str, error: OSError) -> CannotWriteError:
    message = f"no room for a copy of {label}: {error.strerror or error}"
    return CannotWriteError(tempfile.gettempdir(), message, hint="set TMPDIR to a larger disk")
