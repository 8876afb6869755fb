"""What the system says of other processes (Linux)."""

from __future__ import annotations

import sys
from pathlib import Path

#: The command as a process that SIGHUP ends: tests that run under nohup hand on that it is ignored.
TERRAIN_EST = ["env", "--default-signal=HUP", sys.executable, "-m", "terrain_cli"]


def children(pid):
    """Return the processes that a process has started."""
    try:
        return [int(word) for word in Path(f"/proc/{pid}/task/{pid}/children").read_text().split()]
    except OSError:
        return []


def alive(pid):
    """Tell whether a process is there and not over."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


def peak(pid):
    """Return the most memory that a process has held so far in KiB, 0 if it is over."""
    try:
        lines = Path(f"/proc/{pid}/status").read_text().splitlines()
    except OSError:
        return 0
    return next((int(line.split()[1]) for line in lines if line.startswith("VmHWM")), 0)
