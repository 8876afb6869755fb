"""What the operating system says of one command."""

from __future__ import annotations

import os
import subprocess
import sys
from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

#: Linux counts what a process holds before it becomes the command for the command: so a small one starts it.
_STARTER = """\
import os, sys, time
began = time.monotonic()
_, status, used = os.wait4(os.posix_spawn(sys.executable, [sys.executable, *sys.argv[1:]], os.environ), 0)
sys.stderr.write(f"{time.monotonic() - began} {used.ru_utime + used.ru_stime} {used.ru_maxrss}")
sys.exit(os.waitstatus_to_exitcode(status))
"""
#: The system counts memory in KiB, but on macOS in bytes.
_UNIT = 1 if sys.platform == "darwin" else 1024


class Used(NamedTuple):
    """Wall and processor seconds, the peak of resident memory of its largest process in MB, and what it printed."""

    seconds: float
    busy: float
    peak: float
    output: str


def alone(arguments: Sequence[str], folder: Path | None = None) -> Used:
    """Run Python with some arguments, and return what that took.

    Parameters
    ----------
    arguments : sequence of str
    folder : Path, optional
        To run it in.

    Returns
    -------
    Used

    Raises
    ------
    SystemExit
        It failed.
    """
    root = os.path.dirname(os.path.dirname(os.path.abspath(__file__)))  # noqa: PTH100, PTH120
    done = subprocess.run(
        [sys.executable, "-c", _STARTER, *arguments],
        cwd=folder,
        env={**os.environ, "PYTHONPATH": root},
        capture_output=True,
        text=True,
        check=False,
    )
    if done.returncode:
        raise SystemExit(f"{' '.join(arguments)} ended with {done.returncode}: {done.stderr}")
    seconds, busy, peak = map(float, done.stderr.splitlines()[-1].split())
    return Used(seconds, busy, peak * _UNIT / 1e6, done.stdout)
