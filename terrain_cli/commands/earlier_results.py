"""How a result that this program wrote before is told from any other file.

By what each kind of result begins with, whatever the ending of its name: the first columns of a table never
change, since scripts are built on them.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

_OF_SEGMENT = ("source", "wheel", "segment")
_SEGMENTS, _SAMPLES = (*_OF_SEGMENT, "terrain", "t_start_s"), (*_OF_SEGMENT, "sample", "time_s")


class Sign(NamedTuple):
    """What shows that a result of one kind was written by this program."""

    #: The first columns of a table, of each kind that may be in the file.
    columns: Sequence[tuple[str, ...]] = ()
    #: What is in the first bytes of a file that is no table.
    mark: bytes = b""

    def on(self, path: str) -> bool:
        """Tell whether a file has it, or holds nothing that could be lost."""
        from formats.output import written_tables

        try:
            with Path(path).open("rb") as file:
                head = file.read(written_tables.HEAD)
            if not head or (self.mark and self.mark in head):
                return True
            tables = written_tables.columns(path) if self.columns else None
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
_PICTURE = Sign(mark=b"Matplotlib")
_MANIFEST = Sign(mark=b'{"path": "')
_PICTURES = re.compile(
    r"(predicted-measured|residual-.+|strength|track(-.+)?|rim-stress|ladder|valley.*|convergence.*)\.(png|svg)"
)


def pictures_of_others(folder: str) -> Iterator[str]:
    """Yield the pictures in a folder that have a name which is written, and were not drawn by Matplotlib."""
    for path in _files(folder):
        if _PICTURES.fullmatch(path.name) and not _PICTURE.on(str(path)):
            yield str(path)


def files_of_others(folder: str) -> Iterator[str]:
    """Yield the files in a folder that have the name of a result of a batch, but are none."""
    from terrain_cli.batch.batch_folder import MANIFEST, is_batch
    from terrain_cli.batch.batch_run import SUMMARY as BRIEF
    from terrain_cli.batch.batch_run import TABLE

    if is_batch(folder):
        return
    signs = {BRIEF: SUMMARY, MANIFEST: _MANIFEST}
    for path in _files(folder):
        sign = SEGMENTS if path.stem == TABLE else signs.get(path.name)
        if sign and not sign.on(str(path)):
            yield str(path)


def _files(folder: str) -> list[Path]:
    """Return the files in a folder; none where it is none, which whoever writes there will tell."""
    try:
        return sorted(path for path in Path(folder).iterdir() if path.is_file())
    except OSError:
        return []
