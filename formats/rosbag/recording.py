"""The files of a bag: one, or those in the folder that rosbag2 wrote."""

from __future__ import annotations

import sys
from pathlib import Path, PurePosixPath
from typing import TYPE_CHECKING, Any

from formats.copies import kept
from formats.errors import DamagedError, FormatError, NotFoundError
from formats.limits import METADATA_BYTES, TooMuchError, unpacked_limit
from formats.rosbag.damage import damaged

if sys.version_info >= (3, 14):
    from compression import zstd
else:
    from backports import zstd

if TYPE_CHECKING:
    from collections.abc import Iterator
    from contextlib import ExitStack

    from formats.recovery import Recovery

_BLOCK = 1 << 20
#: A file of a recording is never larger than this, however it is packed.
_LARGEST = 1 << 40


class Recording:
    """The files of a bag, unpacked where they were packed as a whole.

    With `salvage` it goes on where metadata.yaml is damaged, files are missing or packed data are cut off.
    `stack` removes what was unpacked.
    """

    def __init__(self, path: str, kind: str, stack: ExitStack, *, salvage: bool) -> None:
        self.path, self.kind = path, kind
        self.remarks: list[str] = []
        self.damage: list[str] = []
        #: Files are not there.
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
        """Return how messages name one of the files."""
        return (
            self.path if file == Path(self.path) else str(Path(self.path, self._names.get(file, file.name)))
        )

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
