"""What a name of a file leads to: the file itself, whatever it is called, and the files that it names."""

from __future__ import annotations

import os
import stat
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Hashable, Iterator, Mapping


def identity(path: str) -> Hashable:
    """Return what tells a file from others, also one that is not there yet; None for pipes and devices."""
    try:
        status, rest = os.fstat(0) if path == "-" else os.stat(path), ""  # noqa: PTH116 - also /dev/fd/63
    except OSError:
        place = resolved(path)
        # A slash behind the name of a file is none to whoever writes it.
        there = next(above for above in (place, *place.parents) if os.path.exists(above))  # noqa: PTH110 - never raises
        status, rest = there.stat(), str(place).removeprefix(str(there))
    known = stat.S_ISREG(status.st_mode) or stat.S_ISDIR(status.st_mode)
    return (status.st_dev, status.st_ino, rest) if known else None


def resolved(path: str) -> Path:
    """Return the place of a file, links followed."""
    try:
        return Path(os.path.realpath(path))
    except OSError:
        # The working folder is gone, and with it all that a relative path may name.
        return Path(os.sep, path)


def logs_of(name: str) -> list[str]:
    """Return the logs that a name stands for; none where it is wrong, which whoever opens it will tell."""
    import formats

    try:
        return formats.expand([name])
    except formats.FormatError:
        return []


def effects_of(name: str) -> Iterator[str]:
    """Yield the effect files that a model, or a drive, names."""
    from terrain_cli import models

    for effect in content(name).get("effects") or ():
        if isinstance(effect, str) and models.is_path(effect):
            yield str(Path(name).parent / effect)


def content(name: str) -> Mapping[str, Any]:
    """Return what a file says in TOML, nothing where it is wrong: whoever reads it will tell."""
    from terrain_cli.errors import ConfigurationError
    from terrain_cli.vocabulary import toml_files

    try:
        # A pipe can be read only once.
        return toml_files.parse(toml_files.read_text(name), name) if os.path.isfile(name) else {}  # noqa: PTH113
    except ConfigurationError:
        return {}


def text(path: str) -> str:
    """Return a name as a message shows it."""
    from formats.errors import shown

    return shown(path)
