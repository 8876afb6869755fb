"""One function of many items, in as many processes as a command was given.

What comes of it does not depend on how many these are.
"""

from __future__ import annotations

import signal
from contextlib import contextmanager
from contextvars import ContextVar
from typing import TYPE_CHECKING, Any, TypeVar

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

Item = TypeVar("Item")
Result = TypeVar("Result")

_jobs: ContextVar[int] = ContextVar("jobs", default=1)
#: In a process that was started here, the function.
_held: list[Callable[[Any], Any]] = []


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
    # A key that interrupts reaches all processes; the first one ends the others.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    _jobs.set(1)
    _held[:] = [function]


def _of(item: Any) -> Any:
    return _held[0](item)
