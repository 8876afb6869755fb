"""A real terminal for the program under test."""

from __future__ import annotations

import contextlib
import os
import pty
import subprocess


def on_terminal(command, *, stderr=None, code=None, **environment):
    """Run a command on a terminal, and return all that it shows there.

    Parameters
    ----------
    stderr : file, optional
        Takes the standard error, which is on the terminal too if not given.
    code : int, optional
        What it must end with.
    """
    main, side = pty.openpty()
    process = subprocess.Popen(
        command,
        stdin=side,
        stdout=side,
        stderr=stderr or side,
        env={**os.environ, "TERM": "xterm-256color", **environment},
    )
    os.close(side)
    shown = b""
    # Linux says by an error that nobody writes any more, others by an empty read.
    with contextlib.suppress(OSError):
        while block := os.read(main, 4096):
            shown += block
    os.close(main)
    process.wait()
    assert code is None or process.returncode == code, shown
    return shown.decode("utf-8")
