"""Writes that survive a kill, a full disk and a loss of power."""

from __future__ import annotations

import os
import signal
import threading
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

from formats.output.whole_files import explained
from terrain_cli.processes.signals import ENDINGS

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path


@contextmanager
def uninterrupted() -> Iterator[None]:
    """Have Ctrl-C, SIGTERM and SIGHUP wait until what belongs together is done.

    Their handlers run in the main thread alone, whichever thread the system gives them to: a mask would
    keep them from one thread only.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    waiting: list[int] = []
    before: dict[int, Any] = {}
    try:
        for name in (signal.SIGINT, *ENDINGS):
            if signal.getsignal(name) is not signal.SIG_IGN:
                before[name] = signal.signal(name, lambda number, _: waiting.append(number))
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, signal.SIG_DFL if handler is None else handler)
        for number in waiting:
            signal.raise_signal(number)


def read_all(path: Path) -> bytes:
    """Return what a file holds; nothing if it is not there."""
    with explained(str(path)):
        try:
            return path.read_bytes()
        except FileNotFoundError:
            return b""


def lines(path: Path) -> Iterator[bytes]:
    """Read a file line by line, ends of lines included; nothing if it is not there."""
    with explained(str(path)):
        try:
            stream = path.open("rb")
        except FileNotFoundError:
            return
        with stream:
            yield from stream


def write_all(descriptor: int, data: bytes) -> None:
    """Write every byte: one call may write fewer."""
    view = memoryview(data)
    while view:
        view = view[os.write(descriptor, view) :]


def append(descriptor: int, size: int, data: bytes, path: str) -> int:
    """Add to the end of a file of some size, all or nothing; `path` is for the message."""
    with explained(path):
        try:
            write_all(descriptor, data)
            os.fsync(descriptor)
        except OSError:
            os.ftruncate(descriptor, size)
            raise
    return len(data)


def put(data: bytes, temporary: Path, target: Path) -> None:
    """Write a file whole, by way of a temporary one on the same disk. A link at its place is replaced."""
    with explained(str(target)):
        descriptor = os.open(temporary, os.O_WRONLY | os.O_CREAT | os.O_TRUNC | os.O_NOFOLLOW, 0o666)
        try:
            write_all(descriptor, data)
            os.fsync(descriptor)
        except OSError:
            # The room it took may be what the manifest needs.
            os.ftruncate(descriptor, 0)
            raise
        finally:
            os.close(descriptor)
    place(temporary, target)


def place(temporary: Path, target: Path) -> None:
    """Put a file that is complete where it belongs."""
    with explained(str(target)):
        # Its name is on the disk when the manifest, which is written next, is: in that order.
        os.replace(temporary, target)  # noqa: PTH105 - as all writes here, by the system's own name


def remove(path: Path) -> None:
    """Remove a file that may be there."""
    with explained(str(path)):
        try:
            os.unlink(path)  # noqa: PTH108
        except FileNotFoundError:
            return
