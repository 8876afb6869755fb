"""A bag that is still being recorded: its messages as they are appended."""

import time
from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path
from sqlite3 import DatabaseError

from formats.errors import NotFoundError
from formats.recovery import Recovery, set_aside
from formats.rosbag.bag_files import check, damaged, first_part, next_part
from formats.rosbag.bag_source import BagSource, Reading
from formats.rosbag.containers import Container, Reader, reader_of
from formats.rosbag.decoder import Decodable
from formats.rosbag.definitions import UnusableError
from formats.rosbag.storage.chunks import RUN_BYTES, Run
from formats.rosbag.storage.db3 import GrowingDb3
from formats.rosbag.storage.raw_messages import DAMAGE
from formats.rosbag.storage.record_file import RecordFile
from formats.table import Batch

#: Log times in ns from which the topics are told: one that has a message each second is among them. If one
#: is missing, it may begin later. Judged: drivers start one after the other within seconds.
_SHOWN, _YOUNG = 1_000_000_000, 10_000_000_000
#: Seconds within which a recorder that closes a file opens the next one. Judged: it does so at once.
_OPENS = 2.0


class _Arrivals(Container):
    """The messages that came, until they are taken; connections are added as the file tells of them."""

    def __init__(self, path: str, kind: str) -> None:
        part = first_part(Path(path))
        super().__init__(str(part or path), kind)
        self.path = path
        self._came: list[Run] = []
        #: What is wrong with the files, each once; and bytes that are no whole record.
        self.damage: dict[str, None] = {}
        self.rest = 0
        self.recovered = Recovery()
        #: The file that is read is one of a folder, and another may follow.
        self._split = part is not None
        self._opened_part = self._stack.enter_context(ExitStack())
        self._begin(part or Path(path))

    def _begin(self, file: Path) -> None:
        self._opened_part.close()
        self._part, self._closed = file, 0.0
        self._known: dict[int, int] = {}
        try:
            check(file, self.kind, self.path, salvage=True)
            # A recorder may give the file another name at the end.
            self._file = self._opened_part.enter_context(file.open("rb"))
        except OSError as error:
            raise NotFoundError(self.path, f"cannot be read: {error.strerror or error}") from error
        self.reader: RecordFile | GrowingDb3
        if self.kind == "db3":
            self.reader = GrowingDb3(file)
        else:
            self.reader = records = reader_of(file, self.kind, salvage=True)
            self._opened_part.callback(records.close)
        self.reader.recovery = self.recovered

    def _opened(self) -> Iterator[Reader]:
        return iter(())

    def look(self) -> int:
        """Take in what was appended, of a long file some; return how many messages came."""
        # All of this file was written before the next one began.
        following = self._following
        came = self._look()
        if following and not came and not self.reader.full:
            self.rest += self.reader.rest
            self._begin(following)
            came = self._look()
        if self.reader.ended and not self._closed:
            self._closed = time.monotonic()
        return came

    @property
    def _following(self) -> Path | None:
        return next_part(self._part, self.kind) if self._split else None

    @property
    def full(self) -> bool:
        """More was there than was taken."""
        return self.reader.full or self._following is not None

    @property
    def ended(self) -> bool:
        """The recorder has written the index, and opened no other file."""
        waited = not self._split or (self._closed > 0.0 and time.monotonic() - self._closed > _OPENS)
        return self.reader.ended and waited and self._following is None

    def _look(self) -> int:
        try:
            found = self.reader.grow(self._file, RUN_BYTES)
        except OSError as error:
            raise NotFoundError(self.path, f"cannot be read: {error.strerror or error}") from error
        except (*DAMAGE, DatabaseError) as error:
            raise damaged(self.path, self.kind, error) from error
        for connection in self.reader.connections:
            if connection.id not in self._known:
                self._known[connection.id] = len(self.connections)
                self.connections.append(connection)
        self._check_connections()
        runs = [{self._known[number]: messages for number, messages in run.items()} for run in found]
        self._came += runs
        self.damage |= dict.fromkeys(self.recovered.damage)
        self.recovered.damage.clear()
        return sum(len(messages) for run in runs for messages in run.values())

    def runs(self, wanted: Collection[int], size: int = RUN_BYTES) -> Iterator[Run]:  # noqa: ARG002
        for run in self._came:
            own = {place: messages for place, messages in run.items() if place in wanted}
            if own:
                yield own

    def span(self, wanted: Collection[int]) -> None:  # noqa: ARG002 - nobody knows the end
        return None

    @property
    def shown(self) -> int:
        """Log time between the first message and the last, in ns."""
        ends = [(int(m.times[0]), int(m.times[-1])) for run in self._came for m in run.values()]
        return max(end for _, end in ends) - min(start for start, _ in ends) if ends else 0

    def drop(self) -> None:
        self._came.clear()


class ArrivingBag(BagSource):
    """Messages of a bag as they are appended: first `prepare` until the topics are known, then `take`."""

    counted = "messages"
    repeated = 0

    def __init__(self, path: str, kind: str) -> None:
        self._arrivals = _Arrivals(path, kind)
        super().__init__(path, kind, container=self._arrivals)
        # What cannot be decoded is counted, and told by `faults`.
        self._decodable = Decodable(self._arrivals.recovered, [])
        #: Topic → fields that are read of it; set before the first is taken.
        self.wanted: Mapping[str, Sequence[str]] = {}
        self._found: dict[int, Reading] | None = None
        self._unusable: set[int] = set()
        self.count = 0  # Messages so far

    @property
    def ended(self) -> bool:
        return self._arrivals.ended

    @property
    def begun(self) -> bool:
        return self.count > 0

    @property
    def young(self) -> bool:
        """A topic may not have begun yet."""
        return not self.ended and self._arrivals.shown < _YOUNG

    @property
    def full(self) -> bool:
        return self._arrivals.full

    def prepare(self, data: bytes, *, hurry: bool) -> bool:  # noqa: ARG002 - the file is read in larger pieces
        """Look for messages until the topics can be told, in a `hurry` from one; those taken come again."""
        self.count += self._arrivals.look()
        self._found = None
        self.__dict__.pop("_topics", None)
        self.remarks.clear()
        return self.count > 0 and (hurry or self.ended or self._arrivals.shown >= _SHOWN)

    def take(self, data: bytes = b"", *, last: bool = False) -> dict[str, Batch] | None:  # noqa: ARG002
        """Return the columns of the messages that came, by topic; at the `last` all that is whole."""
        if self._found is None:
            self._found = self._readings(self.wanted, 1 << 40)
        else:
            self._arrivals.drop()
            self.count += self._arrivals.look()
        self._add_publishers(self._found)
        for _ in self._full(self._found):
            pass
        readings = dict.fromkeys(self._found.values())
        batches = {reading.topic: batch for reading in readings for batch in reading.batches(last=True)}
        return batches or None

    def _add_publishers(self, readings: dict[int, Reading]) -> None:
        """Read the topics from connections that came later too."""
        by_topic = {reading.topic: reading for reading in readings.values()}
        for place, connection in enumerate(self._arrivals.connections):
            reading = by_topic.get(connection.topic)
            if reading and place not in readings and place not in self._unusable:
                try:
                    reading.definitions[place] = self._definition(connection)
                except UnusableError as error:
                    self._unusable.add(place)
                    self.remarks.append(f"{connection.topic} cannot be read: {error}")
                else:
                    readings[place] = reading

    def faults(self) -> list[str]:
        aside, rest = self._arrivals.recovered.aside, self._arrivals.rest + self._arrivals.reader.rest
        return [
            *self._arrivals.damage,
            *[set_aside(aside, self.counted)] * bool(aside),
            *[f"the last {rest:,} bytes are no whole record, and left out"] * bool(rest),
        ]
