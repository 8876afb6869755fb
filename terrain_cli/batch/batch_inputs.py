"""The inputs that files, folders, patterns and addresses in stores (extra `remote`) stand for."""

import os
import re
import stat
import time
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from functools import partial
from hashlib import file_digest, sha256
from pathlib import Path
from typing import Any

import formats
from formats.byte_sources import kept, too_large
from formats.content import failure
from formats.errors import FormatError, NotFoundError, shown
from formats.source import natural, promised_kind
from terrain_cli import version
from terrain_cli.errors import ConfigurationError, UsageError


@dataclass(frozen=True)
class Input:
    path: str  # As it was named, for people and for the column `source`
    location: str  # Its absolute path, or its address: what makes it the same input next time
    size: int | None  # Bytes; of a folder, of all its files
    stamp: str | None  # Changes when the input is written; None where nothing tells
    problem: FormatError | None = None  # Why it cannot be read


class Arrivals:
    """Tells inputs whose size and stamp stayed for `settle` seconds from those that are still written."""

    def __init__(self, settle: float) -> None:
        self._settle = settle
        #: What was seen last at a location, since when, and whether it was taken.
        self._seen: dict[str, tuple[object, float, bool]] = {}

    def rested(self, items: Sequence[Input], now: float | None = None) -> list[Input]:
        """Return the inputs that are at rest and were not returned before."""
        now = time.monotonic() if now is None else now
        found = []
        for item in items:
            # What is not there (yet), or cannot be read (yet), is no failure of a batch that waits.
            if item.problem:
                continue
            look = item.size, item.stamp
            before, since, taken = self._seen.get(item.location, (None, now, False))
            if look != before:
                since, taken = now, False
            if not taken and now - since >= self._settle:
                found.append(item)
                taken = True
            self._seen[item.location] = look, since, taken
        return found


_ADDRESS = re.compile(r"[a-z][a-z0-9+.-]+://", re.IGNORECASE)
#: What a store may say of the version of an object, in the words of the stores.
_VERSION = ("ETag", "etag", "VersionId", "generation", "md5Hash", "Content-MD5", "Digest", "content_hash")
_TIME = ("LastModified", "Last-Modified", "last_modified", "updated", "mtime", "created")
_BLOCK = 1 << 20


def is_address(name: str) -> bool:
    """Tell the address of a store from the name of a file."""
    return _ADDRESS.match(name) is not None


def _in_store(name: str) -> list[Input]:
    """Find what an address, a pattern or a folder stands for, in natural order."""
    store, path = _open(name)
    try:
        if "*" in path or "[" in path or ("?" in path and not name.startswith("http")):
            found = sorted(store.glob(path), key=natural)
            if not found:
                raise NotFoundError(name, "matches no object")
        elif name.endswith("/") or (not promised_kind(path) and store.isdir(path)):
            found = sorted(store.ls(path, detail=False), key=natural)
            found = [item for item in found if promised_kind(item.rstrip("/"))]
            if not found:
                raise NotFoundError(name, "no log in this folder")
        else:
            found = [path]
        return [_look_in(store, store.unstrip_protocol(item)) for item in found]
    except FormatError as error:
        return [Input(name, name, None, None, error)]
    except Exception as error:  # noqa: BLE001 - every store has errors of its own
        return [Input(name, name, None, None, _store_failure(name, error))]


def _look_in(store: Any, address: str) -> Input:
    try:
        info = store.info(store._strip_protocol(address))  # noqa: SLF001 - fsspec's own name for it
    except Exception as error:  # noqa: BLE001
        return Input(address, address, None, None, _store_failure(address, error))
    size = info.get("size")
    told = [f"{key}={info[key]}" for key in (*_VERSION, *_TIME) if info.get(key)]
    return Input(address, address, None if size is None else int(size), " ".join(told) or None)


@contextmanager
def copied(item: Input, largest: int) -> Iterator[str]:
    """Keep a copy of an object while it is read; of so many bytes at the most, whatever the store says."""
    store, path = _open(item.location)
    if item.size is not None and item.size > largest:
        raise too_large(item.path, largest)
    with ExitStack() as stack:
        try:
            opened = store.open(path, "rb", block_size=_BLOCK * 4, cache_type="readahead")
            source = stack.enter_context(opened)
            blocks = iter(partial(source.read, _BLOCK), b"")
            copy, name = kept(item.path, blocks, most=largest, stated=item.size)
            stack.enter_context(copy)
        except (FormatError, MemoryError):
            raise
        except Exception as error:
            raise _store_failure(item.path, error) from error
        size = copy.tell()
        if item.size is not None and size != item.size:
            raise NotFoundError(item.path, f"gave {size} of {item.size} bytes", hint="run again")
        if _look_in(_open(item.location)[0], item.location).stamp != item.stamp:
            raise NotFoundError(item.path, "was written to while it was read", hint="run again")
        yield name


def _open(address: str) -> tuple[Any, str]:
    try:
        import fsspec
    except ModuleNotFoundError:
        what = f"{address}: inputs in a store need fsspec"
        raise ConfigurationError(what, hint=version.command_for("remote")) from None
    try:
        store, path = fsspec.core.url_to_fs(address)
    except (ImportError, ValueError) as error:
        hint = f"{version.command_for('remote')}, or gcsfs, adlfs, … for the other stores"
        raise ConfigurationError(f"{address}: {str(error).splitlines()[0]}", hint=hint) from error
    # What it listed a minute ago may not be so any more.
    store.invalidate_cache()
    return store, path


def _store_failure(address: str, error: Exception) -> NotFoundError:
    if isinstance(error, FileNotFoundError):
        return NotFoundError(address, "no such object, or its store does not answer")
    if isinstance(error, PermissionError):
        return NotFoundError(address, "no permission to read it")
    told = " ".join(str(error).split()) or type(error).__name__
    return NotFoundError(address, f"the store cannot be read: {told}")


def discover(names: Sequence[str]) -> list[Input]:
    """Find the inputs of some names, in their order, nothing twice; what is not there has a problem."""
    found: dict[str, Input] = {}
    for name in names:
        if name == "-":
            hint = "use terrain-est estimate, or save it first"
            raise UsageError("batch reads files, not the standard input", hint=hint)
        for item in _in_store(name) if is_address(name) else _on_disk(name):
            found.setdefault(item.location, item)
    return list(found.values())


def _on_disk(name: str) -> list[Input]:
    try:
        return [local(path) for path in formats.expand([name])]
    except FormatError as error:
        return [Input(shown(name), os.path.abspath(name), None, None, error)]  # noqa: PTH100 - keeps links


def local(path: str) -> Input:
    # Not resolved: a link to today's log is an input of its own.
    location = os.path.abspath(path)  # noqa: PTH100
    label = shown(os.path.normpath(path))
    try:
        status = os.stat(location)  # noqa: PTH116
        if stat.S_ISDIR(status.st_mode):
            return Input(label, location, *_folder_stamp(location))
        if stat.S_ISREG(status.st_mode):
            return Input(label, location, status.st_size, _file_stamp(status))
        problem = FormatError(label, "is a pipe or a device, and batch reads files")
    except OSError as error:
        problem = failure(label, error)
    return Input(label, location, None, None, problem)


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
    with Path(path).open("rb", buffering=0) as stream:
        return file_digest(stream, "sha256").hexdigest()


def check_unchanged(item: Input) -> None:
    """Make sure that an input is still there, and what it was when it was found."""
    now = local(item.location)
    if now.problem:
        raise now.problem
    if (now.size, now.stamp) != (item.size, item.stamp):
        hint = "run again when it is complete"
        raise NotFoundError(item.path, "was written to while it was read", hint=hint)
