"""Inputs in a store: s3://, gs://, https:// and whatever else fsspec knows (extra `remote`)."""

from __future__ import annotations

import re
from contextlib import ExitStack, contextmanager
from functools import partial
from typing import TYPE_CHECKING, Any

from formats.copies import kept, too_large
from formats.errors import FormatError, NotFoundError
from formats.input_paths import natural, promised_kind
from terrain_cli import installation
from terrain_cli.batch.batch_input import Input
from terrain_cli.errors import ConfigurationError

if TYPE_CHECKING:
    from collections.abc import Iterator

_ADDRESS = re.compile(r"[a-z][a-z0-9+.-]+://", re.IGNORECASE)
#: What a store may say of the version of an object, in the words of the stores.
_VERSION = ("ETag", "etag", "VersionId", "generation", "md5Hash", "Content-MD5", "Digest", "content_hash")
_TIME = ("LastModified", "Last-Modified", "last_modified", "updated", "mtime", "created")
_BLOCK = 1 << 20


def is_address(name: str) -> bool:
    """Tell the address of a store from the name of a file."""
    return _ADDRESS.match(name) is not None


def discover(name: str) -> list[Input]:
    """Find the inputs that an address stands for.

    Parameters
    ----------
    name : str
        Of an object, a pattern, or a folder whose logs are taken.

    Returns
    -------
    list of Input
        In natural order. What is not there is an input with a problem.

    Raises
    ------
    ConfigurationError
        fsspec, or what it needs for this kind of store, is not installed.
    """
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
        return [_look(store, store.unstrip_protocol(item)) for item in found]
    except FormatError as error:
        return [Input(name, name, None, None, error)]
    except Exception as error:  # noqa: BLE001 - every store has errors of its own
        return [Input(name, name, None, None, _failure(name, error))]


def look(address: str) -> Input:
    """Look at an object."""
    return _look(_open(address)[0], address)


def _look(store: Any, address: str) -> Input:
    try:
        info = store.info(store._strip_protocol(address))  # noqa: SLF001 - fsspec's own name for it
    except Exception as error:  # noqa: BLE001
        return Input(address, address, None, None, _failure(address, error))
    size = info.get("size")
    told = [f"{key}={info[key]}" for key in (*_VERSION, *_TIME) if info.get(key)]
    return Input(address, address, None if size is None else int(size), " ".join(told) or None)


@contextmanager
def copied(item: Input, largest: int) -> Iterator[str]:
    """Keep a copy of an object while it is read.

    Parameters
    ----------
    largest : int
        Bytes at the most; nothing that a store says is believed.

    Yields
    ------
    str
        Leads to the copy.

    Raises
    ------
    NotFoundError
        There is no such object, or the store does not answer.
    CannotWriteError
        It is larger than allowed, or there is no room for it.
    """
    store, path = _open(item.location)
    if item.size is not None and item.size > largest:
        raise too_large(item.path, largest)
    with ExitStack() as stack:
        try:
            source = stack.enter_context(
                store.open(path, "rb", block_size=_BLOCK * 4, cache_type="readahead")
            )
            blocks = iter(partial(source.read, _BLOCK), b"")
            copy, name = kept(item.path, blocks, most=largest, stated=item.size)
            stack.enter_context(copy)
        except (FormatError, MemoryError):
            raise
        except Exception as error:
            raise _failure(item.path, error) from error
        size = copy.tell()
        if item.size is not None and size != item.size:
            raise NotFoundError(item.path, f"gave {size} of {item.size} bytes", hint="run again")
        if look(item.location).stamp != item.stamp:
            raise NotFoundError(item.path, "was written to while it was read", hint="run again")
        yield name


def _open(address: str) -> tuple[Any, str]:
    try:
        import fsspec
    except ModuleNotFoundError:
        raise ConfigurationError(
            f"{address}: inputs in a store need fsspec", hint=installation.command_for("remote")
        ) from None
    try:
        store, path = fsspec.core.url_to_fs(address)
    except (ImportError, ValueError) as error:
        hint = f"{installation.command_for('remote')}, or gcsfs, adlfs, … for the other stores"
        raise ConfigurationError(f"{address}: {str(error).splitlines()[0]}", hint=hint) from error
    # What it listed a minute ago may not be so any more.
    store.invalidate_cache()
    return store, path


def _failure(address: str, error: Exception) -> NotFoundError:
    if isinstance(error, FileNotFoundError):
        return NotFoundError(address, "no such object, or its store does not answer")
    if isinstance(error, PermissionError):
        return NotFoundError(address, "no permission to read it")
    told = " ".join(str(error).split()) or type(error).__name__
    return NotFoundError(address, f"the store cannot be read: {told}")
