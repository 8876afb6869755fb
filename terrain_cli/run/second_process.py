"""Reaches of a long log worked through in a second process, while this one reads on.

Reading with all that is derived takes about as long as windows and estimates. With both at once, and
fewer passes in each, 10⁸ rows of Parquet take 3.2 times their reading, before it was 6.8 times.
"""

from __future__ import annotations

import os
import pickle
import signal
from contextlib import contextmanager, suppress
from typing import TYPE_CHECKING, Any, Self

import numpy as np

from terrain_cli.errors import TerrainError
from terrain_cli.run import long_log

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator
    from multiprocessing.connection import Connection

    from terrain_cli.run.long_log import LongWheel
    from terrain_cli.run.settings import Settings
    from terrain_cli.telemetry import Samples

#: Parts that may wait for the other process: as many as make a reach, and one that is being read. What
#: is longer than this many bytes goes through the pipe.
_SLOTS, _ROOM = 5, 12 << 20
_ALIGNED = 64


def cores() -> int:
    """Return how many processors this process may use, where the system says so."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def work(parts: Iterable[Samples], settings: Settings) -> dict[str, LongWheel]:
    """Do what `long_log.work` does in another process; in this one where no other can be started.

    The samples are read here. Raises what the other process raised, or TerrainError if it was killed.
    """
    try:
        other = _Beside(settings)
    except OSError:
        return long_log.work(parts, settings)
    with other:
        for part in parts:
            other.take(part)
        return other.end()


class _Beside:
    """The other process; OSError if it cannot be started."""

    def __init__(self, settings: Settings) -> None:
        # Short logs need none of it.
        from multiprocessing import get_context

        # A fork would copy the locks of the threads that read.
        context = get_context("spawn")
        self._shared = context.RawArray("B", _SLOTS * _ROOM)
        self._room = np.frombuffer(self._shared, dtype=np.uint8).reshape(_SLOTS, _ROOM)
        self._link, theirs = context.Pipe()
        self._sent = self._done = 0
        self._process = context.Process(target=_work, args=(theirs, self._shared, settings), daemon=True)
        if hasattr(signal, "pthread_sigmask"):
            from multiprocessing import resource_tracker

            # Python 3.11 lets signals in again as it starts this one with the first process.
            resource_tracker.ensure_running()
        with _uninterrupted(), theirs:
            self._process.start()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._link.close()
        self._process.kill()
        self._process.join()

    def take(self, part: Samples) -> None:
        """Hand a part over; wait while too many are not yet fetched."""
        if self._sent - self._done == _SLOTS:
            self._hear()
            self._done += 1
        slot = self._sent % _SLOTS
        buffers: list[pickle.PickleBuffer] = []
        head = pickle.dumps(part, protocol=5, buffer_callback=buffers.append)
        pieces = [np.frombuffer(buffer.raw(), dtype=np.uint8) for buffer in buffers]
        sizes = [len(piece) for piece in pieces]
        places = _places(sizes)
        if places[-1] > _ROOM:
            head, places, pieces = pickle.dumps(part, protocol=5), [0], []
        for place, piece in zip(places, pieces, strict=False):
            self._room[slot, place : place + len(piece)] = piece
        self._tell((slot, sizes if pieces else [], head))
        self._sent += 1

    def end(self) -> dict[str, LongWheel]:
        """Return the wheels by their names, once all of their windows are made."""
        self._tell(None)
        while self._done < self._sent:
            self._hear()
            self._done += 1
        wheels: dict[str, LongWheel] = self._hear()
        return wheels

    def _tell(self, message: object) -> None:
        try:
            self._link.send(message)
        except OSError:
            # It has died, and perhaps said of what.
            while True:
                self._hear()

    def _hear(self) -> Any:
        try:
            reply = self._link.recv()
        except (EOFError, OSError):
            raise TerrainError(
                "the process that makes windows and estimates was killed; out of memory?",
                hint="free some memory, and run again",
            ) from None
        if isinstance(reply, Exception):
            raise reply
        return reply


def _places(sizes: list[int]) -> list[int]:
    """Return where pieces of these sizes begin in a slot, and where the last one ends."""
    places = [0]
    for size in sizes:
        places.append(-(-(places[-1] + size) // _ALIGNED) * _ALIGNED)
    return places


@contextmanager
def _uninterrupted() -> Iterator[None]:
    """Start a process that Ctrl-C does not reach: who started it answers."""
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _work(link: Connection, shared: Any, settings: Settings) -> None:
    """Work through what comes, and send the wheels when all has come: the life of the other process."""
    # Where who started this process has gone, there is nobody to tell.
    with suppress(EOFError, OSError):
        try:
            reply: object = long_log.work(_received(link, shared), settings)
        except (EOFError, OSError):
            raise
        except Exception as error:  # noqa: BLE001 - it is raised there
            reply = error
        link.send(reply)


def _received(link: Connection, shared: Any) -> Iterator[Samples]:
    room = np.frombuffer(shared, dtype=np.uint8).reshape(_SLOTS, -1)
    for slot, sizes, head in iter(link.recv, None):
        places = _places(sizes)
        # A copy, so that the next part can come while windows still hold this one.
        own = room[slot, : places[-1]].copy().data
        buffers = [own[place : place + size] for place, size in zip(places, sizes, strict=False)]
        part: Samples = pickle.loads(head, buffers=buffers)  # noqa: S301 - of our own parent
        link.send(None)
        yield part
