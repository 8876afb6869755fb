"""Things a worker may be sent to do that no input should make it do."""

from __future__ import annotations

import os
import signal
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

from terrain_cli.batch.worker_tasks import Reply


@dataclass(frozen=True)
class Say:
    word: str

    def run(self):
        return Reply(sha256=self.word)


@dataclass(frozen=True)
class Die:
    how: int = signal.SIGKILL

    def run(self):
        sys.stderr.write("these were its last words\n")
        sys.stderr.flush()
        os.kill(os.getpid(), self.how)
        time.sleep(60)


@dataclass(frozen=True)
class Copy:
    """Be lost over a copy, as one of an object of a store."""

    hang: bool = False

    def run(self):
        Path(tempfile.mkdtemp(), "copy").write_bytes(b"x" * 1000)
        if self.hang:
            time.sleep(600.0)
        os.kill(os.getpid(), signal.SIGKILL)


@dataclass(frozen=True)
class Leave:
    def run(self):
        os._exit(3)


@dataclass(frozen=True)
class Hang:
    seconds: float = 600.0

    def run(self):
        time.sleep(self.seconds)
        return Reply(sha256="awake")


@dataclass(frozen=True)
class Eat:
    size: int

    def run(self):
        return Reply(sha256=str(len(bytearray(self.size))))


@dataclass(frozen=True)
class Raise:
    def run(self):
        raise ZeroDivisionError("a fault of the program")


@dataclass(frozen=True)
class Pour:
    """Answer with more than the system keeps for a reader."""

    size: int

    def run(self):
        return Reply(result=b"x" * self.size)
