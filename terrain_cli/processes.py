"""Processes of this machine: their memory, their signals, several side by side."""

from __future__ import annotations

import math
import os
import signal
import sys
import threading
import time
from contextlib import contextmanager, suppress
from contextvars import ContextVar
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Sequence
    from multiprocessing.connection import Connection

#: In bytes: a little less than the largest piece whose size the C library of Linux learns from.
_LARGE = 31 * 2**20
#: Where Linux says what a container may take, in bytes, or "max".
_CONTAINER = Path("/sys/fs/cgroup/memory.max")
#: Of the memory that the columns of a log may take. With all that is made of them `estimate --segments none`
#: took 3.8 times as much as seven columns, 4.6 times as much as four (2 and 33 million rows), and 6.7 times
#: with `--samples`.
_SHARE = 8
_UNKNOWN = 8 << 30  # Bytes of a machine that does not say how many it has
#: What NumPy's linear algebra asks for its number of threads. That of OpenMP also counts for Arrow, which
#: reads files in as many.
ALGEBRA = ("OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
Item = TypeVar("Item")
Result = TypeVar("Result")

_jobs: ContextVar[int] = ContextVar("jobs", default=1)
_held: list[Callable[[Any], Any]] = []  # In a process that was started here, the function
#: Those of the system's wishes to end; Windows lacks the second.
ENDINGS = tuple(getattr(signal, name) for name in ("SIGTERM", "SIGHUP") if hasattr(signal, name))
_TOGETHER = 1.0  # Seconds in which two signals are one wish: a system that shuts down sends both (judged)


@cache
def most_held() -> int:
    """Return how many bytes the columns of a log may have that are held whole.

    A share of the memory of this machine, of the container, or of what ``ulimit -v`` leaves, whichever is
    least.
    """
    limits = []
    with suppress(OSError, ValueError, AttributeError):
        limits.append(os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE"))
    with suppress(OSError, ValueError):
        limits.append(int(_CONTAINER.read_text()))
    with suppress(ImportError):
        from resource import RLIM_INFINITY, RLIMIT_AS, getrlimit

        limits += [limit for limit in getrlimit(RLIMIT_AS)[:1] if limit != RLIM_INFINITY]
    return min(limits, default=_UNKNOWN) // _SHARE


def cores() -> int:
    """Return how many processors this process may use, where the system says so."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def one_thread_of_algebra() -> None:
    """Keep linear algebra to one thread, unless the environment says how many; before NumPy is imported.

    Matrices here are so small that threads wait for each other longer than they work, and the number of cores
    would decide on the last digit of a sum.
    """
    for name in ALGEBRA:
        os.environ.setdefault(name, "1")


@cache
def keep_freed() -> None:
    """Keep memory that is freed for the next arrays, instead of asking the operating system every time.

    Pages that come from there are cleared first, which took a third of the time of a fit. The C library
    of Linux keeps pieces as large as the largest that was freed so far (mallopt(3), M_MMAP_THRESHOLD),
    and up to twice as much of what lies at the end; nothing is ever written to this one. Elsewhere it
    does nothing.
    """
    import numpy as np

    np.empty(_LARGE, dtype=np.uint8)


@contextmanager
def jobs(count: int) -> Iterator[None]:
    """Let `each` start so many processes; with 1 none is started."""
    token = _jobs.set(count)
    try:
        yield
    finally:
        _jobs.reset(token)


def each(
    function: Callable[[Item], Result], items: Sequence[Item], before: Callable[[Item], None] = lambda _: None
) -> list[Result]:
    """Return what a function makes of each item, in their order.

    Where no process can be started, or one is killed, the work is done in this one. The function, with all
    that is bound to it, and its results can be pickled: what is bound goes to a process once, items one by
    one. `before` is called in this process with each item before it is done, or waited for.
    """
    count = min(_jobs.get(), len(items))
    results = _in_processes(function, items, before, count) if count > 1 else []
    for item in items[len(results) :]:
        before(item)
        results.append(function(item))
    return results


def _in_processes(
    function: Callable[[Item], Result], items: Sequence[Item], before: Callable[[Item], None], count: int
) -> list[Result]:
    """Return the results of the first items, of all but where a process could not be started or died."""
    from concurrent.futures import ProcessPoolExecutor
    from concurrent.futures.process import BrokenProcessPool

    results: list[Result] = []
    try:
        with ProcessPoolExecutor(count, initializer=_hold, initargs=(function,)) as pool:
            futures = [pool.submit(_of, item) for item in items]
            try:
                for item, future in zip(items, futures, strict=True):
                    before(item)
                    results.append(future.result())
            finally:
                pool.shutdown(cancel_futures=True)
    except (BrokenProcessPool, OSError):
        pass
    return results


def _hold(function: Callable[[Any], Any]) -> None:
    _alone()
    _held[:] = [function]


def _alone() -> None:
    # A key that interrupts reaches all processes; the first one ends the others.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    _jobs.set(1)


def _of(item: Any) -> Any:
    return _held[0](item)


def beside(work: Callable[[], Result]) -> Callable[[], Result]:
    """Begin work in another process, and return what waits for its result.

    Where none can be started, or it is killed, that does the work in this one, and raises what it raises.
    Work and result can be pickled.
    """
    from multiprocessing import get_context

    context = get_context()
    link, theirs = context.Pipe(duplex=False)
    process = context.Process(target=_send, args=(link, theirs, work), daemon=True)
    try:
        process.start()
    except OSError:
        return work
    theirs.close()

    def result() -> Result:
        try:
            found: Result = link.recv()
        except (EOFError, OSError):
            return work()
        return found

    return result


def _send(waits: Connection, link: Connection, work: Callable[[], Any]) -> None:
    _alone()
    # Where who waits has gone, sending fails, and does not wait for this process to read.
    waits.close()
    # Who waits meets the same error, and says it.
    with suppress(Exception):
        link.send(work())


@contextmanager
def answered(names: Iterable[int], answer: Callable[[int, Any], None]) -> Iterator[None]:
    """Answer signals with a function of each and of what answered it before, in the main thread alone.

    Those that are ignored, as nohup has it, are ignored still.
    """
    main = threading.current_thread() is threading.main_thread()
    before = {name: signal.getsignal(name) for name in names if main}
    before = {name: handler for name, handler in before.items() if handler is not signal.SIG_IGN}
    try:
        for name in before:
            signal.signal(name, lambda number, _: answer(number, before[number]))
        yield
    finally:
        for name, handler in before.items():
            signal.signal(name, signal.SIG_DFL if handler is None else handler)


@contextmanager
def noted() -> Iterator[int]:
    """Note the first wish to end instead of ending; yield what can be read from then on (`select`).

    The second does what the first would have done, so that nobody has to wait.
    """
    reader, writer = os.pipe()

    def note(number: int, before: Any) -> None:
        os.write(writer, b"!")
        signal.signal(number, before)

    try:
        with answered((signal.SIGINT, *ENDINGS), note):
            yield reader
    finally:
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
    """Raise `EndedError` in the main thread on SIGTERM and SIGHUP, where they would end the process."""
    heard = -math.inf

    def end(number: int, _: Any) -> None:
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

    with answered([name for name in ENDINGS if signal.getsignal(name) is signal.SIG_DFL], end):
        yield
