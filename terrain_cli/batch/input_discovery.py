"""What the files, folders, patterns and addresses of a command line stand for."""

from __future__ import annotations

import os
import stat
from hashlib import sha256
from pathlib import Path
from typing import TYPE_CHECKING

import formats
from formats.content import failure
from formats.errors import FormatError, NotFoundError, shown
from terrain_cli.batch import remote_inputs
from terrain_cli.batch.batch_input import Input
from terrain_cli.errors import UsageError

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

_BLOCK = 1 << 20


def discover(names: Sequence[str]) -> list[Input]:
    """Find the inputs that names or addresses stand for, in the order given, nothing twice.

    What is not there is an input with a problem. The standard input cannot be read again: UsageError.
    """
    found: dict[str, Input] = {}
    for name in names:
        if name == "-":
            raise UsageError(
                "batch reads files, not the standard input", hint="use terrain-est estimate, or save it first"
            )
        for item in remote_inputs.discover(name) if remote_inputs.is_address(name) else _discover(name):
            found.setdefault(item.location, item)
    return list(found.values())


def _discover(name: str) -> list[Input]:
    try:
        return [local(path) for path in formats.expand([name])]
    except FormatError as error:
        return [Input(shown(name), os.path.abspath(name), None, None, error)]  # noqa: PTH100 - keeps links


def local(path: str) -> Input:
    """Look at a file or folder."""
    # Not resolved: a link to today's log is an input of its own.
    location = os.path.abspath(path)  # noqa: PTH100
    label = shown(os.path.normpath(path))
    try:
        status = os.stat(location)  # noqa: PTH116
        if stat.S_ISDIR(status.st_mode):
            size, stamp = _folder_stamp(location)
        elif stat.S_ISREG(status.st_mode):
            size, stamp = status.st_size, _file_stamp(status)
        else:
            problem = FormatError(label, "is a pipe or a device, and batch reads files")
            return Input(label, location, None, None, problem)
    except OSError as error:
        return Input(label, location, None, None, failure(label, error))
    return Input(label, location, size, stamp)


def _file_stamp(status: os.stat_result) -> str:
    # The time of the last change of the entry cannot be set back, as that of the content can.
    return f"{status.st_mtime_ns}-{status.st_ctime_ns}"


def _folder_stamp(folder: str) -> tuple[int, str]:
    size, stamp = 0, sha256()
    for file in _files(folder):
        status = os.stat(file)  # noqa: PTH116
        size += status.st_size
        stamp.update(f"{file}\0{status.st_size}\0{_file_stamp(status)}\0".encode("utf-8", "surrogateescape"))
    return size, stamp.hexdigest()[:32]


def _files(folder: str) -> Iterator[str]:
    for root, folders, names in os.walk(folder):
        folders.sort()
        for name in sorted(names):
            if Path(root, name).is_file():
                yield os.path.join(root, name)  # noqa: PTH118


def content_hash(path: str) -> str:
    """Return the hash of what a file holds, or of the files of a folder and their names in it."""
    digest = sha256()
    try:
        if Path(path).is_dir():
            for file in _files(path):
                name = os.path.relpath(file, path).encode("utf-8", "surrogateescape")
                digest.update(b"%d\0%b\0%b\0" % (len(name), name, _of_file(file).encode()))
            return digest.hexdigest()
        return _of_file(path)
    except OSError as error:
        raise failure(path, error) from error


def _of_file(path: str) -> str:
    digest = sha256()
    with Path(path).open("rb", buffering=0) as stream:
        while block := stream.read(_BLOCK):
            digest.update(block)
    return digest.hexdigest()


def check_unchanged(item: Input) -> None:
    """Make sure that an input is still there, and what it was when it was found."""
    now = local(item.location)
    if now.problem:
        raise now.problem
    if (now.size, now.stamp) != (item.size, item.stamp):
        raise NotFoundError(
            item.path, "was written to while it was read", hint="run again when it is complete"
        )
