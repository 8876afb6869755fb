"""Workers of Dask distributed (extra `distributed`): a cluster that users already run.

The cluster reads inputs and hands back bytes; only the keeper writes. So the guarantees are those of one
machine: a worker that dies costs the time it has spent, and each task runs in a process of its own.
"""

import contextlib
import logging
import queue
import threading
from typing import Any
from uuid import uuid4

from terrain_cli import version
from terrain_cli.batch.worker_pool import LocalPool
from terrain_cli.batch.worker_tasks import Failure, Reply, Task, differing, versions
from terrain_cli.errors import ConfigurationError, TerrainError, UsageError

#: Seconds to reach the scheduler, and for a first worker to be there.
_PATIENCE = 10.0
_SCHEMES = ("tcp://", "tls://", "ws://", "wss://", "ucx://")
_ENCRYPTED = ("tls://", "wss://")
_of_thread = threading.local()


class SchedulerError(TerrainError):
    """The cluster cannot be used."""

    exit_code = 66


class Cluster:
    """The workers of a Dask scheduler, of the same versions as this program."""

    def __init__(self, address: str, timeout: float | None = None, memory: int | None = None) -> None:
        try:
            import distributed
        except ModuleNotFoundError:
            what = "--scheduler needs Dask distributed, which is not installed"
            raise ConfigurationError(what, hint=version.command_for("distributed")) from None
        _check_address(address)
        # It tells of each connection that ends; what matters is told below.
        logging.disable(logging.CRITICAL)
        self._address, self._limits = address, (timeout, memory)
        self._run = uuid4().hex
        self._done: queue.SimpleQueue[Any] = queue.SimpleQueue()
        self._client: Any = None
        self._tickets: dict[Any, int] = {}
        try:
            make: Any = distributed.Client
            self._client = make(address, timeout=_PATIENCE, set_as_default=False)
        except Exception as error:  # each kind of connection has errors of its own
            what = f"{address}: no scheduler answers: {' '.join(str(error).split())}"
            raise SchedulerError(what, hint="start one with: dask scheduler") from error
        try:
            self._client.wait_for_workers(1, timeout=_PATIENCE)
            _check_versions(address, self._client)
        except TimeoutError:
            self.close()
            hint = f"start some with: dask worker {address}"
            raise SchedulerError(f"{address}: the scheduler has no workers", hint=hint) from None
        except BaseException:
            self.close()
            raise

    @property
    def free(self) -> int:
        # One more for each thread: none waits for the keeper to answer.
        try:
            return 2 * int(sum(self._client.nthreads().values())) - len(self._tickets)
        except OSError:
            raise self._gone() from None

    def submit(self, ticket: int, task: Task) -> None:
        key = f"terrain-est-{self._run}-{ticket}"
        future = self._client.submit(run_apart, task, *self._limits, key=key, pure=False)
        self._tickets[future] = ticket
        future.add_done_callback(self._done.put)

    def collect(self, seconds: float) -> list[tuple[int, Reply]]:
        done = []
        try:
            future = self._done.get(timeout=seconds)
            while True:
                done.append((self._tickets.pop(future), self._reply(future)))
                future = self._done.get_nowait()
        except queue.Empty:
            pass
        # A scheduler that comes back has forgotten what it was asked.
        if self._client.status != "running":
            raise self._gone()
        return done

    def close(self) -> None:
        with contextlib.suppress(Exception):
            self._client.cancel(list(self._tickets), force=True)
        self._tickets.clear()
        with contextlib.suppress(Exception):
            self._client.close(timeout=0.5)

    def _gone(self) -> SchedulerError:
        hint = "run the same command again when it is back: what is done is kept"
        return SchedulerError(f"{self._address}: the scheduler has gone", hint=hint)

    def _reply(self, future: Any) -> Reply:
        if future.status == "finished":
            reply: Reply = future.result()
            return reply
        if future.status in {"cancelled", "lost"}:
            raise self._gone()
        error = future.exception()
        text = f"the cluster could not do it: {' '.join(str(error).split())[:300]}"
        return Reply(failure=Failure("WorkerLostError", text, "run again", passing=True))


def _check_address(address: str) -> None:
    """Refuse what cannot be connected to: a client that is made for it takes long to end."""
    from distributed.comm.addressing import get_address_host_port
    from distributed.security import Security

    try:
        if not address.startswith(_SCHEMES):
            raise ValueError
        get_address_host_port(address, strict=True)
    except ValueError:
        hint = "such as tcp://host:8786"
        raise UsageError(f"--scheduler {address}: no address of a scheduler", hint=hint) from None
    of_client = Security().get_connection_args("client")  # type: ignore[no-untyped-call]
    certified = of_client["ssl_context"] is not None
    if address.startswith(_ENCRYPTED) and not certified:
        hint = "distributed.comm.tls in Dask's configuration"
        raise UsageError(f"--scheduler {address}: no certificates for it", hint=hint)


def tell_versions() -> dict[str, str]:
    """Return the versions that must be the same everywhere: they give the numbers, or are sent."""
    from importlib.metadata import version

    return {**versions(), **{name: version(name) for name in ("dask", "distributed")}}


def _check_versions(address: str, client: Any) -> None:
    """Refuse workers that would compute with other versions, or not understand what they are sent."""
    own = tell_versions()
    told: dict[str, Any] = {}
    try:
        told["the scheduler"] = client.run_on_scheduler(tell_versions)
    except Exception as error:  # noqa: BLE001 - whatever it cannot import
        told["the scheduler"] = error
    workers = client.run(tell_versions, on_error="return")
    told |= {f"worker {name}": numbers for name, numbers in workers.items()}
    for place, theirs in told.items():
        if not isinstance(theirs, dict):
            what = f"cannot say its versions ({type(theirs).__name__}: {theirs})"
        else:
            what = differing(own, theirs)
        if what:
            same = f"install terrain-est {own['terrain-est']} and the same versions"
            hint = f"{same} of Python and its packages everywhere"
            raise SchedulerError(f"{address}: {place} {what}", hint=hint)


def run_apart(task: Task, timeout: float | None, memory: int | None) -> Reply:
    """Do a task in a process beside the worker: what the cluster calls."""
    limits = timeout, memory
    before, pool = getattr(_of_thread, "pool", (None, None))
    if pool is None or before != limits:
        if pool is not None:
            pool.close()
        pool = LocalPool(1, *limits)
        _of_thread.pool = limits, pool
    return pool.do(task)
