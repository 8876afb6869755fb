"""SIGTERM and SIGHUP end a command as Ctrl-C does: what is unfinished is removed on the way, or completed."""

from __future__ import annotations

import math
import os
import signal
import sys
import threading
import time
from contextlib import contextmanager
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterator

#: Those of the system's wishes to end; Windows lacks the second.
ENDINGS = tuple(getattr(signal, name) for name in ("SIGTERM", "SIGHUP") if hasattr(signal, name))
#: Seconds in which two signals are one wish: a system that shuts down sends both (judged).
_TOGETHER = 1.0


@contextmanager
def noted() -> Iterator[int]:
    """Note the first wish to end instead of ending; yield what can be read from then on (`select`).

    The second does what the first would have done, so that nobody has to wait. Wishes that were ignored
    before, as nohup does, are ignored still.
    """
    reader, writer = os.pipe()

    def note(number: int, _: object) -> None:
        os.write(writer, b"!")
        signal.signal(number, before[number])

    names = [signal.SIGINT, *ENDINGS] if threading.current_thread() is threading.main_thread() else []
    before = {name: signal.getsignal(name) for name in names if signal.getsignal(name) != signal.SIG_IGN}
    try:
        for name in before:
            signal.signal(name, note)
        yield reader
    finally:
        for name, handler in before.items():
            signal.signal(name, handler)
        os.close(reader)
        os.close(writer)


class EndedError(SystemExit):
    """The system wants this process to end, by the signal of this number.

    Also a process that nobody watches ends on it without a word.
    """

    def __init__(self, number: int) -> None:
        super().__init__(number)
        self.name = signal.Signals(number).name
        self.code: int = 128 + number


@contextmanager
def heeded() -> Iterator[None]:
    """Raise `EndedError` in the main thread on SIGTERM and SIGHUP, where they would end the process.

    Who starts it with one of them ignored, as nohup does, has that kept.
    """
    heard = -math.inf

    def end(number: int, _: object) -> None:
        nonlocal heard
        # The second must not break off what the first has begun.
        if time.monotonic() - heard < _TOGETHER:
            return
        heard = time.monotonic()
        if started := sys.modules.get("multiprocessing"):
            # A pool waits for the work that its processes are at.
            for child in started.active_children():
                child.terminate()
        raise EndedError(number)

    main = threading.current_thread() is threading.main_thread()
    taken = [name for name in ENDINGS if main and signal.getsignal(name) is signal.SIG_DFL]
    try:
        for name in taken:
            signal.signal(name, end)
        yield
    finally:
        for name in taken:
            signal.signal(name, signal.SIG_DFL)
