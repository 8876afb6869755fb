"""Worker processes: one task at a time, with an end to its time and to its memory."""
# Not concurrent.futures: there one process that the system kills takes all the others' tasks with it, and
# none can be stopped. Not multiprocessing.Process: the workers of a cluster may start none.

import contextlib
import os
import pickle
import signal
import socket
import struct
import subprocess
import sys
import tempfile
import time
from multiprocessing.connection import wait
from typing import BinaryIO

from terrain_cli import processes
from terrain_cli.batch.worker_tasks import Failure, Reply, Task, failure

_PATIENCE = 120.0  # Seconds that a process may take to start, and to accept a task
#: What libraries say as they end a process that got no memory.
_NO_MEMORY = ("bad_alloc", "MemoryError", "annot allocate memory", "failed to map segment", "OpenBLAS error")
_HEADER = struct.Struct("!Q")
_BLOCK = 1 << 20
#: The process gets the module path of its parent: it may not be installed, or be another one.
_START = """\
import sys, pickle, socket
link = socket.socket(fileno={})
orders = link.makefile("rb")
sys.path[:], parent, memory = pickle.load(orders)
if memory is not None:
    import resource
    resource.setrlimit(resource.RLIMIT_AS, (memory, memory))
from terrain_cli.batch.worker_pool import serve
serve(link, orders, parent)
"""
#: One worker for each core is enough: threads of their own would only be in each other's way, and
#: their number must not decide on the last digit of a sum.
_THREADS = ("OMP_NUM_THREADS", *processes.ALGEBRA)


class Child:
    """A worker process, seen from its parent; `ready` once it waits for a task."""

    def __init__(self, timeout: float | None = None, memory: int | None = None) -> None:
        self._timeout = timeout
        self.ready = False
        #: When it is out of time, on the monotonic clock.
        self.deadline = time.monotonic() + _PATIENCE
        self._seconds = _PATIENCE
        self._started = time.monotonic()
        self._buffer = bytearray()
        self._link, theirs = socket.socketpair()
        # What a library says as it dies.
        self._said = tempfile.TemporaryFile()  # noqa: SIM115 - closed with the process
        # What a process that is killed leaves behind, such as the copy of an object of a store.
        self._room = tempfile.TemporaryDirectory(prefix="terrain-est-", ignore_cleanup_errors=True)
        with theirs:
            self._process = subprocess.Popen(  # noqa: S603 - this Python, with our own text
                [sys.executable, "-P", "-c", _START.format(theirs.fileno())],
                pass_fds=[theirs.fileno()],
                stdin=subprocess.DEVNULL,
                stdout=self._said,
                stderr=self._said,
                env={**dict.fromkeys(_THREADS, "1"), **os.environ, "TMPDIR": self._room.name},
                # Ctrl-C is the keeper's to answer.
                process_group=0,
            )
        self._tell((sys.path, os.getpid(), memory))

    def fileno(self) -> int:
        """Return what to wait on for `collect`."""
        return self._link.fileno()

    def begin(self, task: Task) -> None:
        """Send a task to a process that is ready."""
        self.ready = False
        self._started = time.monotonic()
        self._seconds = _PATIENCE if self._timeout is None else self._timeout
        self.deadline = float("inf") if self._timeout is None else self._started + self._timeout
        self._tell(task)

    def collect(self) -> Reply | None:
        """Take what has arrived, and end a process out of time; None until there is a whole answer."""
        # That a process has become ready, or died before it was, shows in `ready` and `alive`.
        try:
            data = self._link.recv(_BLOCK)
        except BlockingIOError:
            if time.monotonic() < self.deadline:
                return None
            self._kill()
            text = f"took longer than {self._seconds:g} s"
            why = Failure("TimeoutError", text, "run again with a longer --timeout", passing=True)
            return self._reply(why)
        except OSError:
            data = b""
        if not data:
            return self._lost()
        self._buffer += data
        if len(self._buffer) < _HEADER.size:
            return None
        end = _HEADER.size + _HEADER.unpack_from(self._buffer)[0]
        if len(self._buffer) < end:
            return None
        message: Reply | None = pickle.loads(self._buffer[_HEADER.size : end])  # noqa: S301 - of our own child
        del self._buffer[:end]
        self.ready, self.deadline = True, float("inf")
        if message and message.failure and message.failure.error_class == "MemoryError":
            # What is left of the process is no good start for the next task.
            self._kill()
        return message

    @property
    def alive(self) -> bool:
        return self._process.poll() is None

    def kill(self) -> None:
        """End the process, and do not wait until it has."""
        self._process.kill()

    def close(self) -> None:
        if self._process.returncode is None:
            self.kill()
            # One that hangs in the system cannot be ended; it must not hold up the others.
            with contextlib.suppress(subprocess.TimeoutExpired):
                self._process.wait(1.0)
        self._link.close()
        self._said.close()
        self._room.cleanup()

    def _tell(self, message: object) -> None:
        self._link.settimeout(_PATIENCE)
        # A process that has died is found out by who waits for its answer.
        with contextlib.suppress(OSError):
            self._link.sendall(pickle.dumps(message, pickle.HIGHEST_PROTOCOL))
        self._link.setblocking(False)

    def _lost(self) -> Reply:
        self._kill()
        code = self._process.returncode
        if code is not None and code < 0:
            name = signal.Signals(-code).name
            how = f"was killed ({name}{'; out of memory?' if -code == signal.SIGKILL else ''})"
        else:
            how = f"ended with exit code {code}"
        self._said.seek(0)
        said = self._said.read()[-4000:].decode("utf-8", "replace").strip()
        if any(sign in said for sign in _NO_MEMORY):
            return self._reply(failure(MemoryError()))
        last = f": {said.splitlines()[-1]}" if said else ""
        return self._reply(Failure("WorkerLostError", f"its worker {how}{last}", "run again", passing=True))

    def _kill(self) -> None:
        self._process.kill()
        try:
            self._process.wait(5.0)
        except subprocess.TimeoutExpired:
            self._process.returncode = -signal.SIGKILL
        self.ready, self.deadline = False, float("inf")

    def _reply(self, why: Failure) -> Reply:
        return Reply(failure=why, seconds=time.monotonic() - self._started)


def _answer(link: socket.socket, reply: Reply | None) -> None:
    data = pickle.dumps(reply, pickle.HIGHEST_PROTOCOL)
    link.sendall(_HEADER.pack(len(data)) + data)


def serve(link: socket.socket, orders: BinaryIO, parent: int) -> None:
    """Do tasks until there are none: the life of a worker process."""
    _die_with(parent)
    # Now, so that it does not count as time of the first task.
    from terrain_cli.run import one_log  # noqa: F401

    _answer(link, None)
    while True:
        try:
            task: Task = pickle.load(orders)  # noqa: S301 - of our own parent
        except (EOFError, pickle.UnpicklingError):
            # The keeper is gone.
            os._exit(0)
        try:
            reply = task.run()
        except Exception as error:  # noqa: BLE001 - one task must not stop the rest
            reply = Reply(failure=failure(error))
        _answer(link, reply)


def _die_with(parent: int) -> None:
    """Have the system end this process when its parent ends, however that came."""
    if sys.platform == "linux":
        import ctypes

        set_parent_death_signal = 1
        ctypes.CDLL(None).prctl(set_parent_death_signal, signal.SIGKILL)
    if os.getppid() != parent:
        os._exit(0)


class LocalPool:
    """Processes on this machine. One that dies or hangs costs its own task, and is replaced."""

    def __init__(self, jobs: int, timeout: float | None = None, memory: int | None = None) -> None:
        self._jobs = jobs
        self._limits = timeout, memory
        self._idle: list[Child] = []
        self._busy: dict[Child, tuple[int, Task | None]] = {}

    @property
    def free(self) -> int:
        """How many tasks may be submitted."""
        return self._jobs - len(self._busy)

    def submit(self, ticket: int, task: Task) -> None:
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
        """Wait so long for the first answer, and return those that have come, with their tickets."""
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

    def do(self, task: Task) -> Reply:
        """Do one task, and wait for its answer."""
        self.submit(0, task)
        while not (done := self.collect(60.0)):
            pass
        return done[0][1]

    def close(self) -> None:
        children = (*self._idle, *self._busy)
        for child in children:
            child.kill()
        for child in children:
            child.close()
        self._idle.clear()
        self._busy.clear()
