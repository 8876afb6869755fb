"""One input of a batch, as it was found: on a disk or in a store."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from formats.errors import FormatError


@dataclass(frozen=True)
class Input:
    """One input, as it was found."""

    path: str  # As it was named, for people and for the column `source`
    location: str  # Its absolute path, or its address: what makes it the same input next time
    size: int | None  # Bytes; of a folder, of all its files
    stamp: str | None  # Changes when the input is written; None where nothing tells
    problem: FormatError | None = None  # Why it cannot be read
