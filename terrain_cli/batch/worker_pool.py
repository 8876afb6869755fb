"""Workers on this machine, and what any set of workers must be able to do."""

from __future__ import annotations

import time
from multiprocessing.connection import wait
from typing import TYPE_CHECKING, Protocol

from terrain_cli.batch.worker import Child

if TYPE_CHECKING:
    from terrain_cli.batch.worker_tasks import Reply, Task


class Pool(Protocol):
    """Workers, wherever they are."""

    @property
    def free(self) -> int:
        """Tasks that can be submitted now."""
        ...

    def submit(self, ticket: int, task: Task) -> None:
        """Have a task done; at most `free` of them."""
        ...

    def collect(self, seconds: float) -> list[tuple[int, Reply]]:
        """Return what was done, with the tickets; wait so many seconds for the first."""
        ...

    def close(self) -> None:
        """End all work at once."""
        ...


class LocalPool:
    """Processes on this machine. One that dies or hangs costs its own task, and is replaced."""

    def __init__(self, jobs: int, timeout: float | None = None, memory: int | None = None) -> None:
        self._jobs = jobs
        self._limits = timeout, memory
        self._idle: list[Child] = []
        self._busy: dict[Child, tuple[int, Task | None]] = {}

    @property
    def free(self) -> int:
        """Tasks that can be submitted now."""
        return self._jobs - len(self._busy)

    @property
    def pids(self) -> list[int]:
        """Numbers of the processes."""
        return [child.pid for child in (*self._idle, *self._busy)]

    def submit(self, ticket: int, task: Task) -> None:
        """Have a task done."""
        while self._idle:
            child = self._idle.pop()
            if child.alive:
                child.begin(task)
                self._busy[child] = ticket, None
                return
            child.close()
        # Begun when the process has started.
        self._busy[Child(*self._limits)] = ticket, task

    def collect(self, seconds: float) -> list[tuple[int, Reply]]:
        """Return what was done, after some seconds at the most."""
        now = time.monotonic()
        patience = min([seconds, *(max(child.deadline - now, 0.0) for child in self._busy)])
        wait([child.fileno() for child in self._busy], patience)
        done = []
        for child, (ticket, task) in list(self._busy.items()):
            reply = child.collect()
            if reply is not None:
                done.append((ticket, reply))
                del self._busy[child]
                if child.alive:
                    self._idle.append(child)
                else:
                    child.close()
            elif child.ready and task is not None:
                child.begin(task)
                self._busy[child] = ticket, None
        return done

    def close(self) -> None:
        """End all processes at once."""
        children = (*self._idle, *self._busy)
        for child in children:
            child.kill()
        for child in children:
            child.close()
        self._idle.clear()
        self._busy.clear()
