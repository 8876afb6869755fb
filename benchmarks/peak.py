"""Peak memory of one way of one stage, in MB: ``python -m benchmarks.peak STAGE SIZE WAY``."""

from __future__ import annotations

import resource
import sys
import threading

import psutil

from benchmarks.harness import inputs_folder
from benchmarks.stages import STAGES

#: Seconds between two looks at what all processes hold.
_EVERY = 0.02


class _Together(threading.Thread):
    """Looks now and then at what the processes below this one hold together, in bytes."""

    def __init__(self) -> None:
        super().__init__(daemon=True)
        self.peak = 0
        self._end = threading.Event()

    def run(self) -> None:
        while not self._end.wait(_EVERY):
            self.peak = max(self.peak, sum(map(_held, psutil.Process().children(recursive=True))))

    def end(self) -> int:
        self._end.set()
        self.join()
        return self.peak


def _held(process: psutil.Process) -> int:
    """Return what a process holds, of what is shared its share where the system tells."""
    try:
        used = process.memory_full_info()
    except psutil.Error:
        return 0
    return int(getattr(used, "pss", used.uss))


def main(name: str, size: str, way: str) -> None:
    """Run it once and print what the operating system says of it."""
    case = STAGES[name].make(size, inputs_folder())
    run = {"inputs": None, "ours": case.ours, "peer": case.peer}[way]
    children = case.processes and run is not None
    together = _Together()
    if children:
        together.start()
    kept = run() if run is not None else None
    who = resource.RUSAGE_CHILDREN if children else resource.RUSAGE_SELF
    # Linux counts in KiB, macOS in bytes.
    largest = resource.getrusage(who).ru_maxrss / (1e6 if sys.platform == "darwin" else 1e6 / 1024)
    # The system knows the peak of the largest process alone.
    print(max(largest, together.end() / 1e6) if children else largest)
    del kept


if __name__ == "__main__":
    main(*sys.argv[1:])
