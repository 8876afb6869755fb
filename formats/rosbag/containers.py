"""Raw messages out of the files of a bag: ROS 1, MCAP, SQLite, and rosbag2 folders of these."""

from __future__ import annotations

import shutil
import struct
import sys
import weakref
from contextlib import ExitStack, closing
from pathlib import Path, PurePosixPath
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Protocol

import numpy as np
from rosbags.rosbag1 import Reader as Ros1Reader
from rosbags.rosbag2.storage_mcap import McapReader
from ruamel.yaml import YAML

from formats.errors import DamagedError, FormatError, NotFoundError
from formats.rosbag.damage import HINTS, check, damaged
from formats.rosbag.db3 import Db3Reader

if sys.version_info >= (3, 14):
    from compression import zstd
else:
    from backports import zstd

if TYPE_CHECKING:
    from collections.abc import Collection, Iterator, Sequence

    from rosbags.interfaces import Connection


class Reader(Protocol):
    """What rosbags' readers of one file have in common."""

    connections: list[Connection]

    def open(self) -> None:
        """Read the index."""

    def close(self) -> None:
        """Close the file."""

    def messages(self, connections: Collection[Connection]) -> Iterator[tuple[Connection, int, bytes]]:
        """Yield connection, log time in ns and payload."""


class Container:
    """One bag, opened: its connections, and their raw messages.

    Parameters
    ----------
    path : str
        A file, or the folder of a rosbag2 recording.
    kind : {"ros1", "mcap", "db3"}

    Raises
    ------
    NotFoundError, DamagedError, FormatError
    """

    def __init__(self, path: str, kind: str) -> None:
        self.path = path
        self.kind = kind
        self.remarks: list[str] = []
        self._compressed_messages = False
        self._stack = ExitStack()
        # A source has no end that a caller would announce.
        self.close = weakref.finalize(self, self._stack.close)
        #: Those of all files; a message names its own by the place in this list.
        self.connections: list[Connection] = []
        #: Each file, and the places of its connections by their number in it.
        self._readers: list[tuple[Reader, dict[int, int]]] = []
        try:
            for file in self._files():
                reader = self._open(file)
                places = {
                    connection.id: place
                    for place, connection in enumerate(reader.connections, len(self.connections))
                }
                self._readers.append((reader, places))
                self.connections += reader.connections
        except OSError as error:
            self.close()
            reason = f"cannot be read: {error.strerror}"
            if isinstance(error, FileNotFoundError):
                reason = "no such file"
            raise NotFoundError(str(error.filename or path), reason) from error
        except BaseException:
            self.close()
            raise

    def messages(self, wanted: Collection[int]) -> Iterator[tuple[int, int, bytes]]:
        """Yield the messages of some connections, file after file, in the order of their log times.

        Parameters
        ----------
        wanted : collection of int
            Places in `connections`.

        Yields
        ------
        place : int
        log_time : int
            ns
        payload : bytes
        """
        for reader, places in self._readers:
            chosen = [connection for connection in reader.connections if places[connection.id] in wanted]
            count = 0
            try:
                for connection, log_time, payload in _messages(reader, chosen):
                    count += 1
                    data = zstd.decompress(payload) if self._compressed_messages else payload
                    yield places[connection.id], log_time, data
            except Exception as error:
                raise damaged(self.path, self.kind, error) from error
            stated = sum(connection.msgcount for connection in chosen)
            if count != stated:
                # rosbags passes over what no index mentions without a word.
                raise DamagedError(
                    self.path,
                    f"{chosen[0].topic}: the file states {stated} messages, {count} can be found",
                    hint=HINTS[self.kind],
                )

    def span(self, wanted: Collection[int]) -> tuple[int, int] | None:
        """Return first and last log time of some connections in ns, if the indexes tell them."""
        try:
            spans = [
                _span(reader, connection.id)
                for reader, places in self._readers
                for connection in reader.connections
                if places[connection.id] in wanted and connection.msgcount
            ]
        except Exception as error:  # a damaged index, see _open
            raise damaged(self.path, self.kind, error) from error
        known = [span for span in spans if span is not None]
        if not known or len(known) < len(spans):
            return None
        return min(start for start, _ in known), max(end for _, end in known)

    def _open(self, file: Path) -> Reader:
        name = self.path if file == Path(self.path) else str(Path(self.path, file.name))
        check(file, self.kind, name)
        reader: Reader
        if self.kind == "ros1":
            reader = Ros1Reader(file)
        elif self.kind == "mcap":
            reader = McapReader(file)
        else:
            reader = Db3Reader(file)
        try:
            reader.open()
        except Exception as error:  # rosbags answers damaged bytes with any exception there is
            raise damaged(name, self.kind, error) from error
        self._stack.callback(reader.close)
        return reader

    def _files(self) -> Sequence[Path]:
        path = Path(self.path)
        if not path.is_dir():
            return [path]
        metadata = path / "metadata.yaml"
        if not metadata.exists():
            # Split recordings are numbered: run_9 comes before run_10.
            files = sorted(path.glob(f"*.{self.kind}"), key=lambda file: (len(file.name), file.name))
            if not files:
                raise NotFoundError(self.path, f"the folder has neither metadata.yaml nor a {self.kind} file")
            self.remarks.append("metadata.yaml is missing; every bag file in the folder is read")
            return files
        text = metadata.read_bytes()
        try:
            content = YAML(typ="safe").load(text)["rosbag2_bagfile_information"]
            # Older versions wrote the paths with the folder in front.
            files = [path / PurePosixPath(name).name for name in content["relative_file_paths"]]
            mode = (content.get("compression_mode") or "none").lower()
            compression = content.get("compression_format") or ""
        except Exception as error:  # ruamel.yaml has no common class for what it raises
            raise damaged(str(metadata), self.kind, error) from error
        if missing := [file.name for file in files if not file.exists()]:
            raise NotFoundError(
                self.path, f"metadata.yaml names files that are not there: {', '.join(missing)}"
            )
        if mode != "none" and compression != "zstd":
            raise FormatError(self.path, f"compressed with {compression!r}; only zstd can be read")
        self._compressed_messages = mode == "message"
        return self._unpack(files) if mode == "file" else files

    def _unpack(self, files: Sequence[Path]) -> list[Path]:
        folder = Path(self._stack.enter_context(TemporaryDirectory(prefix="bag-")))
        unpacked = []
        for file in files:
            target = folder / file.stem
            try:
                with zstd.open(file, "rb") as source, target.open("wb") as sink:
                    shutil.copyfileobj(source, sink)
            except (zstd.ZstdError, EOFError) as error:
                raise damaged(str(file), self.kind, error) from error
            unpacked.append(target)
        return unpacked


def _messages(reader: Reader, connections: Collection[Connection]) -> Iterator[tuple[Connection, int, bytes]]:
    if not connections:
        return
    if not isinstance(reader, McapReader) or reader.chunks:
        yield from reader.messages(connections)
        return
    # rosbags walks a file without chunks with the one position it has, so that two topics read by
    # turns would disturb each other; and its messages() wants the log times in order.
    walker = McapReader(reader.path)
    walker.open()
    with closing(walker):
        yield from walker.messages_scan(connections)


def _span(reader: Reader, connection: int) -> tuple[int, int] | None:
    if isinstance(reader, Ros1Reader):
        index = reader.indexes[connection]
        return index[0].time, index[-1].time
    if isinstance(reader, Db3Reader):
        return reader.spans[connection]
    return _span_mcap(reader, connection) if isinstance(reader, McapReader) else None


def _span_mcap(reader: McapReader, connection: int) -> tuple[int, int] | None:
    """Least and greatest time in the message indexes of one channel, which stand behind each chunk."""
    times = []
    for chunk in reader.chunks:
        if (offset := chunk.message_index_offsets.get(connection)) is not None and reader.bio is not None:
            reader.bio.seek(offset)
            # Opcode (1 byte), length of the record (8), channel (2), length of the list (4);
            # then pairs of time and offset.
            (size,) = struct.unpack_from("<I", reader.bio.read(15), 11)
            times.append(np.frombuffer(reader.bio.read(size), "<u8")[::2])
    if not times:
        return None
    return int(min(part.min() for part in times)), int(max(part.max() for part in times))
