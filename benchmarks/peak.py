"""Peak memory of one way of one stage, in MB: ``python -m benchmarks.peak STAGE SIZE WAY``."""

from __future__ import annotations

import resource
import sys

from benchmarks.harness import inputs_folder
from benchmarks.stages import STAGES


def main(name: str, size: str, way: str) -> None:
    """Run it once and print what the operating system says of it."""
    case = STAGES[name].make(size, inputs_folder())
    run = {"inputs": None, "ours": case.ours, "peer": case.peer}[way]
    kept = run() if run is not None else None
    who = resource.RUSAGE_CHILDREN if case.processes and run is not None else resource.RUSAGE_SELF
    # Linux counts in KiB, macOS in bytes.
    unit = 1e6 if sys.platform == "darwin" else 1e6 / 1024
    print(resource.getrusage(who).ru_maxrss / unit)
    del kept


if __name__ == "__main__":
    main(*sys.argv[1:])
