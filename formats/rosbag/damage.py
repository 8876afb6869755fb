"""What is wrong with a bag that cannot be read, in words a person can act on."""

from __future__ import annotations

import shlex
import struct
from typing import TYPE_CHECKING

from formats.content import SIDE_FILES
from formats.errors import DamagedError, FormatError
from formats.limits import TooMuchError
from formats.recovery import HINT

if TYPE_CHECKING:
    from pathlib import Path

MAGIC = {"ros1": b"#ROSBAG V2.0\n", "mcap": b"\x89MCAP0\r\n", "db3": b"SQLite format 3\x00"}
TITLES = {"ros1": "a ROS 1 bag (version 2.0)", "mcap": "an MCAP file", "db3": "an SQLite file"}
HINTS = {
    "ros1": f"{HINT}, or repair a copy with: rosbag reindex FILE",
    "mcap": f"{HINT}, or save that with: mcap recover FILE -o RECOVERED.mcap",
    "db3": f"{HINT}, or save that with: sqlite3 FILE .recover | sqlite3 RECOVERED.db3",
}
HEAD = 4_200


def check(path: Path, kind: str, name: str, *, salvage: bool = False) -> None:
    """Look at both ends of a file for what can be seen without reading it.

    Parameters
    ----------
    kind : {"ros1", "mcap", "db3"}
    name : str
        What to call the file.
    salvage : bool
        Let pass what is cut off or never closed.

    Raises
    ------
    DamagedError
        Empty, cut off or never closed.
    FormatError
        Something else than its kind.
    OSError
        It cannot be opened.
    """
    with path.open("rb") as file:
        head = file.read(HEAD)
        size = file.seek(0, 2)
        file.seek(max(0, size - len(MAGIC["mcap"])))
        tail = file.read()
    if not head:
        raise DamagedError(name, "the file is empty (0 bytes)", hint="copy or record it again")
    magic = MAGIC[kind]
    if len(head) < len(magic) and magic.startswith(head):
        raise DamagedError(name, f"cut off after {len(head)} bytes", hint="copy or record it again")
    if not head.startswith(magic):
        older = head.startswith(b"#ROSBAG V")
        raise DamagedError(
            name,
            f"is not {TITLES[kind]}: it begins with {head[:13]!r}",
            hint="play it and record it again with ROS 1"
            if older
            else "check that this is the file you meant",
        )
    if salvage:
        return
    if kind == "ros1":
        _check_ros1(name, head, size)
    elif kind == "mcap":
        _check_profile(name, head)
        _check_mcap(name, tail, size)
    else:
        _check_db3(path, name, head, size)


def _check_ros1(name: str, head: bytes, size: int) -> None:
    key, width = b"index_pos=", 8
    at = head.find(key) + len(key)
    if at < len(key) or len(head) < at + width:
        raise DamagedError(name, f"cut off after {size} bytes, in its header", hint=HINTS["ros1"])
    (index,) = struct.unpack_from("<Q", head, at)
    if index == 0:
        raise DamagedError(
            name, "its index is missing: the recording was not closed properly", hint=HINTS["ros1"]
        )
    if index >= size:
        raise DamagedError(
            name,
            f"cut off: its index is missing (it should begin at byte {index:,}, the file ends at {size:,})",
            hint=HINTS["ros1"],
        )


def _check_mcap(name: str, tail: bytes, size: int) -> None:
    if tail != MAGIC["mcap"]:
        raise DamagedError(
            name,
            f"cut off at byte {size:,}: the end of the file and with it the index are missing",
            hint=HINTS["mcap"],
        )


def _check_profile(name: str, head: bytes) -> None:
    # Record header of opcode 1: length of the record (8 bytes), length of the profile, profile.
    if len(head) < 21:
        return
    (length,) = struct.unpack_from("<I", head, 17)
    profile = head[21 : 21 + length]
    if profile != b"ros2" and len(head) >= 21 + length:
        raise FormatError(
            name,
            f"its MCAP profile is {profile[:40].decode(errors='replace')!r}, and only 'ros2' can be read",
            hint="convert the recording to ROS 2, or export the topics to CSV",
        )


def _check_db3(path: Path, name: str, head: bytes, size: int) -> None:
    if len(head) < 100:
        raise DamagedError(name, f"cut off after {size} bytes, in its header", hint=HINTS["db3"])
    page, pages = struct.unpack_from(">H", head, 16)[0], struct.unpack_from(">I", head, 28)[0]
    whole = (65_536 if page == 1 else page) * pages
    if size < whole:
        raise DamagedError(name, f"cut off: {size:,} of {whole:,} bytes are there", hint=HINTS["db3"])
    for ending in SIDE_FILES:
        beside = path.with_name(path.name + ending)
        if beside.exists() and beside.stat().st_size > 0:
            finish = f"sqlite3 {shlex.quote(str(path))} 'PRAGMA journal_mode=DELETE'"
            raise DamagedError(
                name,
                f"the recording was not closed: messages are left in {beside.name}",
                hint=f"{HINT}, or finish it once with: {finish}",
            )


def damaged(name: str, kind: str, error: Exception) -> DamagedError:
    """Say in one line what a library said of damaged bytes.

    Parameters
    ----------
    name : str
        What to call the file.
    kind : {"ros1", "mcap", "db3"}
    error : Exception
        From rosbags, or from a library below it.
    """
    if isinstance(error, TooMuchError):
        return DamagedError(name, f"is not read, for {error}", hint="docs/damage.md tells the limits")
    detail = " ".join(str(error).split()) or type(error).__name__
    return DamagedError(name, f"corrupt or cut off ({detail[:160]})", hint=HINTS[kind])
