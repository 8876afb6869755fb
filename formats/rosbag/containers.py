"""Raw messages out of the files of a bag: ROS 1, MCAP, SQLite, and rosbag2 folders of these."""

import weakref
from collections.abc import Collection, Iterator
from contextlib import ExitStack, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

from rosbags.interfaces import Connection

from formats.errors import DamagedError, FormatError, NotFoundError
from formats.limits import CONNECTIONS, DEFINITIONS_CHARACTERS, Allowance, TooMuchError
from formats.recovery import Recovery
from formats.rosbag.bag_files import HINTS, Recording, check, damaged
from formats.rosbag.storage.chunks import RUN_BYTES, Run
from formats.rosbag.storage.raw_messages import CORRUPT, Messages, of_payloads, unpack
from formats.rosbag.storage.stored_file import StoredFile

if TYPE_CHECKING:
    from formats.rosbag.storage.db3 import Db3File

#: What reads a file: its index with `open`, its messages in the order of their log times with `runs`.
#: `spans` are first and last log time in ns of connections, by their number, where an index tells them.
Reader: TypeAlias = "StoredFile | Db3File"

LOST = "copy or record it again"  # What to do where not even salvage helps


class Container:
    """One bag, opened: its connections, and their raw messages."""

    def __init__(self, path: str, kind: str, *, salvage: bool = False) -> None:
        self.path = path
        self.kind = kind
        self.recovery = Recovery() if salvage else None
        self._stack = ExitStack()
        # A source has no end that a caller would announce.
        self.close = weakref.finalize(self, self._stack.close)
        #: Those of all files; a message names its own by the place in this list.
        self.connections: list[Connection] = []
        #: Each file, and the places of its connections by their number in it.
        self._readers: list[tuple[Reader, dict[int, int]]] = []
        try:
            self._recording = Recording(path, kind, self._stack, salvage=salvage)
            self.remarks = self._recording.remarks  # What a person should know about which files were read
            for reader in self._opened():
                numbered = enumerate(reader.connections, len(self.connections))
                places = {connection.id: place for place, connection in numbered}
                self._readers.append((reader, places))
                self.connections += reader.connections
                self._check_connections()
        except OSError as error:
            self.close()
            reason = f"cannot be read: {error.strerror or error}"
            if isinstance(error, FileNotFoundError):
                reason = "no such file"
            raise NotFoundError(str(error.filename or path), reason) from error
        except BaseException:
            self.close()
            raise

    def _check_connections(self) -> None:
        """Refuse more connections, or more text of their definitions, than any log has."""
        texts = {connection.msgdef.data for connection in self.connections}
        if len(self.connections) > CONNECTIONS:
            raise damaged(self.path, self.kind, TooMuchError(f"it has more than {CONNECTIONS:,} connections"))
        if sum(map(len, texts)) > DEFINITIONS_CHARACTERS:
            most = f"{DEFINITIONS_CHARACTERS:,} characters"
            too_much = TooMuchError(f"its message definitions have more than {most}")
            raise damaged(self.path, self.kind, too_much)

    def runs(self, wanted: Collection[int], size: int = RUN_BYTES) -> Iterator[Run]:
        """Read the messages of some connections (places in `connections`), by log time within each file."""
        allowance = Allowance(sum(file.stat().st_size for file in self._recording.files))
        for reader, places in self._readers:
            chosen = [connection for connection in reader.connections if places[connection.id] in wanted]
            if not chosen:
                continue
            count = 0
            try:
                for run in reader.runs({connection.id for connection in chosen}, size):
                    count += sum(map(len, run.values()))
                    decompressed = {n: self._decompressed(messages, allowance) for n, messages in run.items()}
                    yield {places[number]: messages for number, messages in decompressed.items()}
            except Exception as error:
                raise damaged(self.path, self.kind, error) from error
            stated = sum(connection.msgcount for connection in chosen)
            if count != stated:
                # rosbags passes over what no index mentions without a word.
                what = f"{chosen[0].topic}: the file states {stated} messages, {count} can be found"
                raise DamagedError(self.path, what, hint=HINTS[self.kind])

    def _decompressed(self, messages: Messages, allowance: Allowance) -> Messages:
        if not self._recording.compressed_messages:
            return messages
        rows, payloads = [], []
        for row in range(len(messages)):
            try:
                payloads.append(unpack(messages.payload(row), "zstd"))
            except CORRUPT:
                if self.recovery is None:
                    raise
            else:
                rows.append(row)
        allowance.take(sum(map(len, payloads)))
        return of_payloads(payloads, messages.times[rows], messages.order[rows])

    def span(self, wanted: Collection[int]) -> tuple[int, int] | None:
        """Return first and last log time of some connections in ns, if the indexes tell them."""
        spans = []
        for reader, places in self._readers:
            for connection in reader.connections:
                if places[connection.id] in wanted and connection.msgcount:
                    if connection.id not in reader.spans:
                        return None
                    spans.append(reader.spans[connection.id])
        return (min(start for start, _ in spans), max(end for _, end in spans)) if spans else None

    def _opened(self) -> Iterator[Reader]:
        if self.recovery is None:
            yield from map(self._open, self._recording.files)
            return
        errors: list[FormatError] = []
        found = False
        self.recovery.damage += self._recording.damage
        for file in self._recording.files:
            try:
                reader = self._open(file)
            except FormatError as error:
                errors.append(error)
                self.recovery.damage.append(str(error).removeprefix(f"{self.path}: "))
                continue
            if found:
                self.recovery.add(reader.recovery)
            else:
                reader.recovery.damage[:0] = self.recovery.damage
                self.recovery, found = reader.recovery, True
            yield reader
        if errors and not found:
            raise errors[0]
        if errors or self._recording.missing:
            self.recovery.expected = None
            self.recovery.lost.append((None, None))
        self._recording.complete(self.recovery)

    def _open(self, file: Path) -> Any:
        name, salvage = self._recording.name(file), self.recovery is not None
        check(file, self.kind, name, salvage=salvage)
        reader = reader_of(file, self.kind, salvage=salvage)
        try:
            reader.open()
        except Exception as error:  # damaged bytes make what reads them fail in any way
            with suppress(Exception):
                reader.close()
            if salvage and isinstance(error, OSError):
                raise
            if not salvage or isinstance(error, TooMuchError):
                raise damaged(name, self.kind, error) from error
            reason = " ".join(str(error).split())[:160] or type(error).__name__
            raise DamagedError(name, f"nothing can be read of it: {reason}", hint=LOST) from error
        self._stack.callback(reader.close)
        if salvage and reader.recovery.damaged and not reader.recovery.read:
            told = "; ".join(reader.recovery.damage[:2])
            raise DamagedError(name, f"nothing can be read of it: {told}", hint=LOST)
        return reader


def reader_of(file: Path, kind: str, *, salvage: bool) -> Any:
    """Return what reads a file that is whole, or with `salvage` damaged or still written; not opened yet."""
    # To import what reads the other kinds takes longer than to read a minute of one.
    if kind == "ros1":
        from formats.rosbag.storage.ros1 import Ros1File

        return Ros1File(file, salvage=salvage)
    if kind == "mcap":
        from formats.rosbag.storage.mcap import McapFile

        return McapFile(file, salvage=salvage)
    if salvage:
        from formats.rosbag.storage.salvaged_db3 import SalvagedDb3

        return SalvagedDb3(file)
    from formats.rosbag.storage.db3 import Db3File

    return Db3File(file)
