"""What can be read of files that are cut off, damaged or without their index.

Knows what whole files look like; what reads those is in the modules beside this package. Nothing is
guessed: a message is given as it was recorded, or not at all.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from pathlib import Path

    from formats.salvage.record_file import RecordFile
    from formats.salvage.salvaged_file import SalvagedFile

__all__ = ["of_records", "salvaged"]


def salvaged(file: Path, kind: str) -> SalvagedFile:
    """Return what reads one damaged file of a bag, not opened yet."""
    if kind == "db3":
        from formats.salvage.salvaged_db3 import SalvagedDb3

        return SalvagedDb3(file)
    return of_records(file, kind)


def of_records(file: Path, kind: str) -> RecordFile:
    """Return the same of an MCAP or ROS 1 file, which may still be written."""
    if kind == "ros1":
        from formats.salvage.salvaged_ros1 import SalvagedRos1

        return SalvagedRos1(file)
    from formats.salvage.salvaged_mcap import SalvagedMcap

    return SalvagedMcap(file)
