"""The files of a bag, one or those in the folder that rosbag2 wrote, and what is wrong with one."""

import re
import shlex
import struct
import sys
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path, PurePosixPath
from typing import Any

from formats.byte_sources import kept
from formats.content import SIDE_FILES
from formats.errors import DamagedError, FormatError, NotFoundError
from formats.limits import METADATA_BYTES, TooMuchError, unpacked_limit
from formats.recovery import HINT, Recovery

if sys.version_info >= (3, 14):
    from compression import zstd
else:
    from backports import zstd

MAGIC = {"ros1": b"#ROSBAG V2.0\n", "mcap": b"\x89MCAP0\r\n", "db3": b"SQLite format 3\x00"}
TITLES = {"ros1": "a ROS 1 bag (version 2.0)", "mcap": "an MCAP file", "db3": "an SQLite file"}
HINTS = {
    "ros1": f"{HINT}, or repair a copy with: rosbag reindex FILE",
    "mcap": f"{HINT}, or save that with: mcap recover FILE -o RECOVERED.mcap",
    "db3": f"{HINT}, or save that with: sqlite3 FILE .recover | sqlite3 RECOVERED.db3",
}
HEAD = 4_200
_BLOCK = 1 << 20
#: How rosbag2 names the files of a recording, which it may split.
_PART = re.compile(r"(.*_)(\d+)(\.mcap|\.db3)")
_INDEX_AT = re.compile(rb"index_pos=(.{8})", re.DOTALL)  # In the header of ROS 1
_LARGEST = 1 << 40  # A file of a recording is never larger than this, however it is packed


def first_part(folder: Path) -> Path | None:
    """Return the first file of the one recording that is in a folder; None where there is not one."""
    parts: dict[tuple[str, str], dict[int, Path]] = {}
    for file in folder.iterdir() if folder.is_dir() else ():
        if match := _PART.fullmatch(file.name):
            parts.setdefault((match[1], match[3]), {})[int(match[2])] = file
    if len(parts) != 1:
        return None
    (numbered,) = parts.values()
    return numbered[min(numbered)]


def next_part(file: Path, kind: str) -> Path | None:
    """Return the file in which a recording that is split goes on, as soon as that has begun."""
    match = _PART.fullmatch(file.name)
    if match is None:
        return None
    following = file.with_name(f"{match[1]}{int(match[2]) + 1}{match[3]}")
    try:
        with following.open("rb") as begun:
            return following if begun.read(len(MAGIC[kind])) == MAGIC[kind] else None
    except OSError:
        return None


def check(path: Path, kind: str, name: str, *, salvage: bool = False) -> None:
    """Look at both ends of a file for what shows there; `salvage` lets pass what is cut off or not closed."""
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
        hint = "play it and record it again with ROS 1" if older else "check that this is the file you meant"
        raise DamagedError(name, f"is not {TITLES[kind]}: it begins with {head[:13]!r}", hint=hint)
    if salvage:
        return
    if kind == "ros1":
        _check_ros1(name, head, size)
    elif kind == "mcap":
        _check_profile(name, head)
        if tail != magic:
            cut = f"cut off at byte {size:,}: the end of the file and with it the index are missing"
            raise DamagedError(name, cut, hint=HINTS["mcap"])
    else:
        _check_db3(path, name, head, size)


def _check_ros1(name: str, head: bytes, size: int) -> None:
    match = _INDEX_AT.search(head)
    if match is None:
        raise DamagedError(name, f"cut off after {size} bytes, in its header", hint=HINTS["ros1"])
    index = int.from_bytes(match[1], "little")
    if 0 < index < size:
        return
    wrong = "its index is missing: the recording was not closed properly"
    if index:
        places = f"it should begin at byte {index:,}, the file ends at {size:,}"
        wrong = f"cut off: its index is missing ({places})"
    raise DamagedError(name, wrong, hint=HINTS["ros1"])


def _check_profile(name: str, head: bytes) -> None:
    # Record header of opcode 1: length of the record (8 bytes), length of the profile, profile.
    if len(head) < 21:
        return
    (length,) = struct.unpack_from("<I", head, 17)
    profile = head[21 : 21 + length]
    if profile != b"ros2" and len(head) >= 21 + length:
        told = profile[:40].decode(errors="replace")
        hint = "convert the recording to ROS 2, or export the topics to CSV"
        raise FormatError(name, f"its MCAP profile is {told!r}, and only 'ros2' can be read", hint=hint)


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
            wrong = f"the recording was not closed: messages are left in {beside.name}"
            raise DamagedError(name, wrong, hint=f"{HINT}, or finish it once with: {finish}")


def damaged(name: str, kind: str, error: Exception) -> DamagedError:
    """Say in one line what a library said of damaged bytes."""
    if isinstance(error, TooMuchError):
        return DamagedError(name, f"is not read, for {error}", hint="docs/damage.md tells the limits")
    detail = " ".join(str(error).split()) or type(error).__name__
    return DamagedError(name, f"corrupt or cut off ({detail[:160]})", hint=HINTS[kind])


class Recording:
    """The files of a bag, unpacked where they were packed as a whole; `stack` removes what was unpacked."""

    def __init__(self, path: str, kind: str, stack: ExitStack, *, salvage: bool) -> None:
        self.path, self.kind = path, kind
        self.remarks: list[str] = []
        self.damage: list[str] = []
        self.missing = False
        #: Each message is packed by itself.
        self.compressed_messages = False
        self._salvage = salvage
        self._told: dict[str, Any] = {}
        #: Of the files that were unpacked, which have no names of their own.
        self._names: dict[Path, str] = {}
        folder = Path(path)
        self.files = [folder]
        if folder.is_dir():
            self.files, mode = self._listed(folder)
            self.compressed_messages = mode == "message"
            if mode == "file":
                self.files = self._unpack(stack)

    def name(self, file: Path) -> str:
        inside = Path(self.path, self._names.get(file, file.name))
        return self.path if file == Path(self.path) else str(inside)

    def complete(self, recovery: Recovery) -> None:
        """Fill in what metadata.yaml tells of the log as a whole."""
        try:
            count = int(self._told["message_count"])
            start = int(self._told["starting_time"]["nanoseconds_since_epoch"])
            end = start + int(self._told["duration"]["nanoseconds"])
        except (KeyError, TypeError, ValueError):
            return
        if recovery.damage and recovery.expected is None and count >= recovery.read:
            recovery.expected = count
        recovery.lost = [
            (begin, end if last is None and begin is not None and begin <= end else last)
            for begin, last in recovery.lost
        ]

    def _listed(self, folder: Path) -> tuple[list[Path], str]:
        """Return the files of a folder, and what of them is packed: "none", "file" or "message"."""
        metadata = folder / "metadata.yaml"
        if not metadata.exists():
            self.remarks.append("metadata.yaml is missing; every bag file in the folder is read")
            return self._found(folder), "none"
        try:
            self._told = _load(metadata)
            # Older versions wrote the paths with the folder in front.
            files = [folder / PurePosixPath(name).name for name in self._told["relative_file_paths"]]
            mode = str(self._told.get("compression_mode") or "none").lower()
            compression = str(self._told.get("compression_format") or "")
        except Exception as error:  # ruamel.yaml has no common class for what it raises
            if not self._salvage:
                raise damaged(str(metadata), self.kind, error) from error
            self.damage.append("metadata.yaml is damaged; every bag file in the folder is read")
            return self._found(folder), "none"
        if missing := [file.name for file in files if not file.is_file()]:
            text = f"metadata.yaml names files that are not there: {', '.join(missing)}"
            files = [file for file in files if file.is_file()]
            if not (self._salvage and files):
                raise NotFoundError(self.path, text)
            self.damage.append(text)
            self.missing = True
        if mode != "none" and compression != "zstd":
            raise FormatError(self.path, f"compressed with {compression!r}; only zstd can be read")
        return files, mode

    def _found(self, folder: Path) -> list[Path]:
        # Split recordings are numbered: run_9 comes before run_10.
        found = (file for file in folder.glob(f"*.{self.kind}") if file.is_file())
        files = sorted(found, key=lambda file: (len(file.name), file.name))
        if not files:
            raise NotFoundError(self.path, f"the folder has neither metadata.yaml nor a {self.kind} file")
        return files

    def _unpack(self, stack: ExitStack) -> list[Path]:
        unpacked = []
        for file in self.files:
            try:
                copy, path = kept(str(file), self._unpacked(file))
            except (zstd.ZstdError, EOFError, TooMuchError) as error:
                raise damaged(str(file), self.kind, error) from error
            stack.callback(copy.close)
            unpacked.append(Path(path))
            self._names[unpacked[-1]] = file.stem
        return unpacked

    def _unpacked(self, file: Path) -> Iterator[bytes]:
        limit = unpacked_limit(file.stat().st_size, _LARGEST)
        size = 0
        try:
            with zstd.open(file, "rb") as source:
                while block := source.read(_BLOCK):
                    size += len(block)
                    if size > limit:
                        raise TooMuchError(f"it unpacks to more than {limit:,} bytes")
                    yield block
        except (zstd.ZstdError, EOFError):
            if not self._salvage:
                raise
            self.damage.append(f"{file.name}: its zstd data are cut off or damaged")


def _load(metadata: Path) -> dict[str, Any]:
    from ruamel.yaml import YAML
    from ruamel.yaml.events import AliasEvent

    with metadata.open("rb") as file:
        text = file.read(METADATA_BYTES + 1)
    if len(text) > METADATA_BYTES:
        raise DamagedError(str(metadata), f"is longer than {METADATA_BYTES:,} bytes")
    if b"*" in text and any(isinstance(event, AliasEvent) for event in YAML(typ="safe").parse(text)):
        # No recorder writes them, and a few lines of them stand for gigabytes.
        raise TooMuchError("it has aliases (*name), which no recorder writes")
    content: dict[str, Any] = YAML(typ="safe").load(text)["rosbag2_bagfile_information"]
    return content
