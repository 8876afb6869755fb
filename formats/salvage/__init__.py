"""What can be read of files that are cut off, damaged or without their index.

Knows what whole files look like; what reads those is in the modules beside this package. Nothing is
guessed: a message is given as it was recorded, or not at all.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from pathlib import Path

    from formats.salvage.salvaged_file import SalvagedFile

__all__ = ["salvaged"]


def salvaged(file: Path, kind: str) -> SalvagedFile:
    """Return what reads one damaged file of a bag, not opened yet."""
    if kind == "ros1":
        from formats.salvage.salvaged_ros1 import SalvagedRos1

        return SalvagedRos1(file)
    if kind == "mcap":
        from formats.salvage.salvaged_mcap import SalvagedMcap

        return SalvagedMcap(file)
    from formats.salvage.salvaged_db3 import SalvagedDb3

    return SalvagedDb3(file)
