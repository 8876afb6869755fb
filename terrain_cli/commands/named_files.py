"""What a name of a file leads to: the file itself, the files that it names, or a result of an earlier run.

A result that this program wrote before is told by what each kind begins with, whatever the ending of its
name: the first columns of a table never change, since scripts are built on them.
"""

import os
import re
import stat
from collections.abc import Hashable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from terrain_cli.errors import ConfigurationError

_OF_SEGMENT = ("source", "wheel", "segment")
_SEGMENTS, _SAMPLES = (*_OF_SEGMENT, "terrain", "t_start_s"), (*_OF_SEGMENT, "sample", "time_s")


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


def content(name: str) -> Mapping[str, Any]:
    """Return what a file says in TOML, nothing where it is wrong: whoever reads it will tell."""
    from terrain_cli.vocabulary import toml_files

    try:
        # A pipe can be read only once.
        return toml_files.parse(toml_files.read_text(name), name) if os.path.isfile(name) else {}  # noqa: PTH113
    except ConfigurationError:
        return {}


def text(path: str) -> str:
    from formats.errors import shown

    return shown(path)


class Sign(NamedTuple):
    """What shows that a result of one kind was written by this program."""

    #: The first columns of a table, of each kind that may be in the file.
    columns: Sequence[tuple[str, ...]] = ()
    mark: bytes = b""  # What is in the first bytes of a file that is no table

    def on(self, path: str) -> bool:
        """Tell whether a file has it, or holds nothing that could be lost."""
        from formats.output import whole_files

        try:
            with Path(path).open("rb") as file:
                head = file.read(whole_files.HEAD)
            if not head or (self.mark and self.mark in head):
                return True
            tables = whole_files.first_columns(path) if self.columns else None
        except OSError:
            return False
        return tables is not None and all(
            any(tuple(names[: len(own)]) == own for own in self.columns) for names in tables
        )


SEGMENTS = Sign((_SEGMENTS, _SAMPLES), b"terrain_est_msgs/msg/Segment")
SAMPLES = Sign((_SEGMENTS, _SAMPLES))
REJECTS = Sign((("source", "wheel", "sample", "time_s", "reason"),))
TRACE = Sign(((*_OF_SEGMENT, "time_s", "c_kPa"),))
POSTERIOR = Sign((("kind", *_OF_SEGMENT, "method"),))
SUMMARY = Sign(mark=b'"format": "terrain-est/summary/')
PAGE = Sign(mark=b'name="generator" content="terrain-est ')
PICTURE = Sign(mark=b"Matplotlib")
MANIFEST = Sign(mark=b'{"path": "')
PICTURES = re.compile(
    r"(predicted-measured|residual-.+|strength|track(-.+)?|rim-stress|ladder|candidates|valley.*|convergence.*)\.(png|svg)"
)


def files(folder: str) -> list[Path]:
    """Return the files in a folder; none where it is none, which whoever writes there will tell."""
    try:
        return sorted(path for path in Path(folder).iterdir() if path.is_file())
    except OSError:
        return []
