"""A bag as a source of columns."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from difflib import get_close_matches
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from rosbags.interfaces import Connection

from formats.errors import DamagedError, FormatError
from formats.rosbag.bulk_extraction import Elements
from formats.rosbag.containers import Container
from formats.rosbag.decoder import Decodable, UndecodableError, columns, first_elements, labels
from formats.rosbag.definitions import NAT, Definition, FieldRequest, Leaf, UnusableError, Values, define
from formats.rosbag.definitions import STAMP as HEADER_STAMP
from formats.rosbag.storage.chunks import RUN_BYTES, Run
from formats.rosbag.storage.raw_messages import Messages
from formats.table import BATCH_ROWS, LOG_TIME, STAMP, Batch, Field, Source, Stream

_ZERO = np.datetime64(0, "ns")
MOST_ELEMENTS = 256  # A list with more elements is cut in what `streams` tells; any place of it can be read


@dataclass(eq=False)
class Reading:
    """The columns of one topic, collected until they fill a batch; definitions are by connection."""

    path: str
    stream: Stream
    definitions: dict[int, Definition]
    asked: Sequence[FieldRequest]
    batch_rows: int

    def __post_init__(self) -> None:
        self.topic = self.stream.topic
        self._requests = [*self.asked, FieldRequest(STAMP, HEADER_STAMP, "time")]
        self._absent = {request.asked: request for request in self.asked if request.key is not None}
        #: Which of two messages logged at one time comes first is for rosbags a matter of their
        #: connections in ROS 1, of their place in the file in ROS 2.
        self._ties_by_connection = any(one.ros1 for one in self.definitions.values())
        self._done = 0
        #: Log times and columns that are not in a batch yet.
        self._waiting: list[list[Values]] = []
        self._rows = 0

    def pieces(self, run: Run) -> Iterator[Run]:
        """Part messages so that those of the batches before a damaged one are read."""
        if len(run) > 1:
            yield run
            return
        for place, messages in run.items():
            for begin in range(0, len(messages), self.batch_rows):
                yield {place: messages.take(slice(begin, begin + self.batch_rows))}

    def add(self, run: Run) -> None:
        """Decode messages of each connection, and put them in the order of their log times."""
        times = np.concatenate([messages.times for messages in run.values()])
        order = np.concatenate([messages.order for messages in run.values()])
        if self._ties_by_connection:
            order = np.arange(len(times))
        sequence = np.lexsort((order, times)) if len(run) > 1 else np.arange(len(times))
        numbers = self._done + 1 + np.argsort(sequence, kind="stable")
        columns: list[list[Values]] = []
        first = 0
        for place, messages in run.items():
            rows = slice(first, first := first + len(messages))
            columns.append(self._decode(place, messages, numbers[rows]))
        whole = _joined(columns)
        whole.insert(0, times.view("datetime64[ns]"))
        self._waiting.append(whole if len(run) == 1 else [column[sequence] for column in whole])
        self._done += len(times)
        self._rows += len(times)

    def batches(self, *, last: bool = False) -> Iterator[Batch]:
        """Yield the batches that are full; the `last` time also the rest."""
        if self._rows >= self.batch_rows or (last and self._rows):
            columns = _joined(self._waiting)
            full = self._rows if last else self._rows - self._rows % self.batch_rows
            for begin in range(0, full, self.batch_rows):
                yield self._batch([column[begin : min(begin + self.batch_rows, full)] for column in columns])
            self._rows -= full
            self._waiting = [[column[full:].copy() for column in columns]] if self._rows else []

    def check(self) -> None:
        """Refuse an element that no message had."""
        for request in self._absent.values() if self._done else ():
            elements = next(field.elements for field in self.stream.fields if field.name == request.field)
            what = f"{self.topic}: no message has the element {request.key!r} of {request.field}"
            raise FormatError(self.path, what, hint=nearest(str(request.key), elements, "elements"))

    def _batch(self, columns: list[Values]) -> Batch:
        clock, *values, stamps = columns
        batch: Batch = {
            request.asked: labels(column) if request.kind == "text" else column
            for request, column in zip(self._requests[:-1], values, strict=True)
        }
        return batch | {LOG_TIME: clock, STAMP: np.where(stamps == _ZERO, NAT, stamps)}

    def _decode(self, place: int, messages: Messages, numbers: NDArray[np.int64]) -> list[Values]:
        try:
            found = columns(self.definitions[place], messages, self._requests)
        except UndecodableError as error:
            what = f"{self.topic}: message {numbers[error.row]} does not fit its definition ({error})"
            hint = "the recording is damaged there, or its definition is not the one it was written with"
            raise DamagedError(self.path, what, hint=hint) from error
        for request, (_, present) in zip(self._requests, found, strict=True):
            if present:
                self._absent.pop(request.asked, None)
        return [values for values, _ in found]


def _joined(parts: Iterable[list[Values]]) -> list[Values]:
    return [np.concatenate(c) if len(c) > 1 else c[0] for c in zip(*parts, strict=True)]


def nearest(name: str, choices: Iterable[str], what: str) -> str:
    """Say which name may have been meant, of topics, fields or whatever they are."""
    choices = list(choices)
    close = get_close_matches(name, choices, n=3, cutoff=0.5)
    if close:
        return f"did you mean {' or '.join(close)}?"
    return f"its {what}: {', '.join(choices[:20]) or 'none'}"


@dataclass
class _Topic:
    """The connections that carry one topic, by their place in the container."""

    places: list[int] = field(default_factory=list)
    definitions: dict[int, Definition] = field(default_factory=dict)
    unusable: dict[int, str] = field(default_factory=dict)  # Why others have none
    stream: Stream = field(init=False)
    #: The names of the elements of each list, where they have names.
    names: dict[str, frozenset[str]] = field(init=False)


class BagSource(Source):
    """A ROS 1 bag, an MCAP or SQLite file of ROS 2, or the folder of a recording."""

    def __init__(
        self, path: str, kind: str, *, salvage: bool = False, container: Container | None = None
    ) -> None:
        super().__init__(path, kind)
        self._container = container or Container(path, kind, salvage=salvage)
        self.remarks += self._container.remarks
        self.recovery = self._container.recovery
        self._decodable = Decodable(self.recovery, self.remarks) if self.recovery else None
        self._definitions: dict[tuple[object, ...], Definition] = {}

    def streams(self) -> tuple[Stream, ...]:
        """Return the topics in the order of the file; types are called as in ROS 2: sensor_msgs/msg/Imu."""
        return tuple(topic.stream for topic in self._topics.values())

    @cached_property
    def _topics(self) -> dict[str, _Topic]:
        topics: dict[str, _Topic] = {}
        for place, connection in enumerate(self._container.connections):
            topic = topics.setdefault(connection.topic, _Topic())
            topic.places.append(place)
            try:
                topic.definitions[place] = self._definition(connection)
            except UnusableError as error:
                topic.unusable[place] = f"{connection.msgtype}: {error}"
        for name, topic in topics.items():
            reasons = sorted(set(topic.unusable.values()))
            self.remarks += [f"{name} cannot be read: {reason}" for reason in reasons]
        elements = self._elements({name: topic.definitions for name, topic in topics.items()})
        for name, topic in topics.items():
            topic.stream = self._stream(name, topic, elements[name])
            topic.names = {of: frozenset(texts) for of, (texts, named) in elements[name].items() if named}
        standard = [one for one in self._definitions.values() if one.origin]
        if standard:
            types, origin = ", ".join(sorted({one.type for one in standard})), standard[0].origin
            self.remarks.append(f"no definition in the file of {types}: read as {origin} defines it")
        return topics

    def _stream(self, name: str, topic: _Topic, elements: Mapping[str, Elements]) -> Stream:
        connections = self._container.connections
        leaves: dict[str, Leaf] = {}
        for definition in topic.definitions.values():
            for leaf in definition.leaves.values():
                if leaves.setdefault(leaf.name, leaf).kind != leaf.kind:
                    kinds = f"{leaves[leaf.name].kind} to one publisher and {leaf.kind} to another"
                    self.remarks.append(f"{name}: {leaf.name} is {kinds}; only the former is read")
        start, end = self._container.span(topic.places) or (None, None)
        told = {of: texts[:MOST_ELEMENTS] for of, (texts, _) in elements.items()}
        fields = tuple(Field(leaf.name, leaf.kind, told.get(leaf.name, ())) for leaf in leaves.values())
        kind = connections[topic.places[0]].msgtype
        count = sum(connections[place].msgcount for place in topic.places)
        return Stream(topic=name, type=kind, fields=fields, count=count, start=start, end=end)

    def _definition(self, connection: Connection) -> Definition:
        """Return the definition of a type; wheels of one kind often have a topic each."""
        key = connection.msgtype, connection.msgdef, connection.digest
        if key not in self._definitions:
            self._definitions[key] = define(connection, ros1=self.kind == "ros1")
        return self._definitions[key]

    def _elements(self, topics: Mapping[str, dict[int, Definition]]) -> dict[str, dict[str, Elements]]:
        """Return the elements of each list in the first message of each topic, and whether they are names."""
        # Topics that begin in one chunk are told together, so that it is unpacked once.
        told: dict[str, dict[str, Elements]] = {name: {} for name in topics}
        waiting = {name for name, own in topics.items() if any(map(_lists, own.values()))}
        while waiting:
            definitions = {place: one for name in waiting for place, one in topics[name].items()}
            run = next(filter(None, self._runs(definitions, 1)), {})
            begun = {name for name in waiting if not run.keys().isdisjoint(topics[name])}
            for name in sorted(begun):
                run_of = {place: run[place] for place in topics[name] if place in run}
                told[name] = self._elements_in(run_of, topics[name], name)
            waiting = waiting - begun if begun else set()
        return told

    def _elements_in(
        self, run: Run, definitions: Mapping[int, Definition], topic: str
    ) -> dict[str, Elements]:
        """Return the elements of each list in the first message of a run of one topic."""
        place = min(run, key=lambda place: (int(run[place].times[0]), int(run[place].order[0])))
        own = definitions[place].leaves
        lists = [leaf for one in definitions.values() for leaf in _lists(one)]
        found = [leaf for leaf in lists if own.get(leaf.name) == leaf]
        try:
            elements = first_elements(definitions[place], run[place].take(slice(1)), found)
        except UndecodableError as error:
            self.remarks.append(f"{topic}: message 1 cannot be decoded ({error})")
            return {}
        return {leaf.name: named for leaf, named in zip(found, elements, strict=True)}

    def read(self, topic: str, fields: Sequence[str], batch_rows: int = BATCH_ROWS) -> Iterator[Batch]:
        """Read the named fields of one topic, by log time; what a message does not have is NaN, NaT or −1."""
        return (batch for _, batch in self.read_together({topic: fields}, batch_rows))

    def read_together(
        self, fields: Mapping[str, Sequence[str]], batch_rows: int = BATCH_ROWS
    ) -> Iterator[tuple[str, Batch]]:
        """Read several topics in one pass: what decompresses a bag once instead of once for each."""
        return self._batches(self._readings(fields, batch_rows))

    def _readings(self, fields: Mapping[str, Sequence[str]], batch_rows: int) -> dict[int, Reading]:
        """Return what reads the fields of some topics, by the places of their connections."""
        readings: dict[int, Reading] = {}
        for topic, names in fields.items():
            found = self._usable(topic)
            asked = [self._request(found, name) for name in names]
            reading = Reading(self.path, found.stream, found.definitions, asked, batch_rows)
            readings |= dict.fromkeys(found.definitions, reading)
        return readings

    def _usable(self, topic: str) -> _Topic:
        found = self._topics.get(topic)
        if found is None:
            near = nearest(topic, self._topics, "topics")
            raise FormatError(self.path, f"has no topic {topic!r}", hint=near)
        for reason in found.unusable.values():
            hint = "record it where the message package is installed, or export the topic to CSV"
            raise FormatError(self.path, f"{topic} cannot be read: {reason}", hint=hint)
        return found

    def _request(self, topic: _Topic, asked: str) -> FieldRequest:
        stream = topic.stream
        fields = {field.name: field for field in stream.fields}
        name, bracket, element = asked.partition("[")
        field = fields.get(name)
        if field is None or (bracket and not element.endswith("]")):
            near = nearest(name, fields, "fields")
            raise FormatError(self.path, f"{stream.topic} has no field {asked!r}", hint=near)
        if field.kind not in {"numbers", "texts"}:
            if bracket:
                what = f"{stream.topic}: {name} is one value, not a list"
                raise FormatError(self.path, what, hint=f"ask for {name}")
            return FieldRequest(asked, name, field.kind)
        if not bracket:
            example = field.elements[0] if field.elements else "0"
            hint = f"ask for one element of it, such as {name}[{example}]"
            raise FormatError(self.path, f"{stream.topic}: {name} is a list", hint=hint)
        text = element.removesuffix("]")
        by_place = text.isascii() and text.isdigit() and text not in topic.names.get(name, ())
        key = int(text) if by_place else text
        return FieldRequest(asked, name, "number" if field.kind == "numbers" else "text", key)

    def _runs(self, definitions: Mapping[int, Definition], size: int = RUN_BYTES) -> Iterator[Run]:
        runs = self._container.runs(definitions.keys(), size)
        return self._decodable.only(runs, definitions) if self._decodable else runs

    def _batches(self, readings: Mapping[int, Reading]) -> Iterator[tuple[str, Batch]]:
        yield from self._full(readings)
        for reading in dict.fromkeys(readings.values()):
            yield from ((reading.topic, batch) for batch in reading.batches(last=True))
            reading.check()

    def _full(self, readings: Mapping[int, Reading]) -> Iterator[tuple[str, Batch]]:
        """Read all messages, and yield the batches that are full."""
        definitions = {place: reading.definitions[place] for place, reading in readings.items()}
        for run in self._runs(definitions):
            for reading in dict.fromkeys(readings.values()):
                own = {place: run[place] for place in sorted(run) if readings[place] is reading}
                for piece in reading.pieces(own):
                    reading.add(piece)
                    yield from ((reading.topic, batch) for batch in reading.batches())


def _lists(definition: Definition) -> list[Leaf]:
    return [leaf for leaf in definition.leaves.values() if leaf.kind in {"numbers", "texts"}]
