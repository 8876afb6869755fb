"""Kills a batch, or fills its disk, at every single write: python kill_points.py MODE FOLDER.

Each try is a process of its own, forked from this one, which has all imported and no threads. Prints
as JSON how many points there were, and those after which a second run did not end with the bytes of
an undisturbed one.
"""

from __future__ import annotations

import errno
import importlib
import json
import os
import shutil
import signal
import sys
from contextlib import suppress
from pathlib import Path

HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE.parent.parent), str(HERE.parent)]

import missions  # noqa: E402

from formats.errors import CannotWriteError  # noqa: E402
from terrain_cli.batch import batch_run  # noqa: E402
from terrain_cli.errors import TerrainError  # noqa: E402

#: What changes files. All that batch and formats write goes through these, but for the content of
#: files under a temporary name.
WRITES = ("open", "write", "pwrite", "fsync", "ftruncate", "replace", "rename", "unlink", "mkdir")
CREATING = os.O_CREAT | os.O_TRUNC | os.O_WRONLY | os.O_RDWR


def disturb(point, mode):
    """Have the write of this number, from 1, fail: by a kill before or in it, or by a full disk."""
    count = 0

    def wrapped(name, own):
        def call(*args, **options):
            nonlocal count
            if (name == "open" and not args[1] & CREATING) or (mode == "torn" and name != "write"):
                return own(*args, **options)
            count += 1
            if mode == "full" and count >= point and name in {"open", "write", "pwrite", "fsync", "mkdir"}:
                if name == "write" and count == point:
                    own(args[0], bytes(args[1])[: len(args[1]) // 2])
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
            if mode != "full" and count == point:
                if mode == "torn" and name == "write":
                    own(args[0], bytes(args[1])[: len(args[1]) // 2])
                os.kill(os.getpid(), signal.SIGKILL)
            return own(*args, **options)

        return call

    for name in WRITES:
        setattr(os, name, wrapped(name, getattr(os, name)))


def attempt(source, output, point=0, mode=""):
    """Run a batch in a process of its own; return its signal or exit code."""
    child = os.fork()
    if child == 0:
        code = 1
        try:
            batch_run.LocalPool = missions.Inline
            if point:
                disturb(point, mode)
            missions.batch([source, *(source / day for day in ("day1", "day2"))], output)
            code = 0
            if not point:
                (source.parent / "modules").write_text("\n".join(sys.modules))
        except (CannotWriteError, TerrainError) as error:
            code = error.exit_code
        finally:
            os._exit(code)
    return os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])


def main(mode, folder, first=1, step=1):
    """Try every point, or every so many."""
    source = missions.mission(folder / "in")
    if attempt(source, folder / "undisturbed"):
        raise SystemExit("the undisturbed run failed")
    # Those that come after need not import what it did.
    for name in (folder / "modules").read_text().splitlines():
        with suppress(ImportError):
            importlib.import_module(name)
    wanted = missions.files(folder / "undisturbed")
    wrong, point, ends = [], first, []
    while True:
        output = folder / "out"
        shutil.rmtree(output, ignore_errors=True)
        end = attempt(source, output, point, mode)
        if end == 0:
            break
        ends.append(end)
        if attempt(source, output) or missions.files(output) != wanted:
            wrong.append(point)
        rest = [entry.name for entry in (output / ".state").iterdir()]
        if sorted(rest) != ["assembled", "lock", "records"]:
            wrong.append(point)
        point += step
    sys.stdout.write(json.dumps({"points": len(ends), "ends": sorted(set(ends)), "wrong": wrong}) + "\n")


if __name__ == "__main__":
    main(sys.argv[1], Path(sys.argv[2]), *map(int, sys.argv[3:]))
