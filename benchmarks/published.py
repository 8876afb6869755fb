"""The lines of a study, on the screen as they come and in its file of results."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterable
    from pathlib import Path


def publish(lines: Iterable[str], result: Path) -> None:
    """Print lines as they come, and write them to a file once all are there."""
    told = []
    for line in lines:
        print(line, flush=True)
        told.append(line)
    result.write_text("\n".join(told) + "\n", encoding="utf-8")
