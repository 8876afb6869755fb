"""A bag as a source of columns."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

from formats.errors import FormatError
from formats.rosbag.containers import Container
from formats.rosbag.decoding.decoder import Decodable, Decoder, UndecodableError
from formats.rosbag.decoding.definitions import UnusableError, define
from formats.rosbag.decoding.plain_extraction import FieldRequest
from formats.rosbag.storage.chunks import RUN_BYTES
from formats.rosbag.topic_columns import Reading, nearest
from formats.table import BATCH_ROWS, Field, Source, Stream

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from rosbags.interfaces import Connection

    from formats.rosbag.decoding.bulk_extraction import Elements
    from formats.rosbag.decoding.definitions import Leaf
    from formats.rosbag.storage.chunks import Run
    from formats.table import Batch

#: A list with more elements is cut in what `streams` tells; any place of it can be read.
MOST_ELEMENTS = 256


@dataclass(frozen=True, slots=True)
class _Topic:
    """The connections that carry one topic, by their place in the container."""

    stream: Stream
    decoders: dict[int, Decoder]
    unusable: dict[int, str]
    #: The names of the elements of each list, where they have names.
    names: dict[str, frozenset[str]]


class BagSource(Source):
    """A ROS 1 bag, an MCAP or SQLite file of ROS 2, or the folder of a recording."""

    def __init__(self, path: str, kind: str, *, salvage: bool = False) -> None:
        super().__init__(path, kind)
        self._container = Container(path, kind, salvage=salvage)
        self.remarks += self._container.remarks
        self.recovery = self._container.recovery
        self._decodable = Decodable(self.recovery, self.remarks) if self.recovery else None
        self._decoders: dict[tuple[object, ...], Decoder] = {}

    def streams(self) -> tuple[Stream, ...]:
        """Return the topics, in the order in which the file names them.

        Types are named as in ROS 2 (``sensor_msgs/msg/Imu``), also for ROS 1.
        """
        return tuple(topic.stream for topic in self._topics.values())

    @cached_property
    def _topics(self) -> dict[str, _Topic]:
        places: dict[str, list[int]] = {}
        for place, connection in enumerate(self._container.connections):
            places.setdefault(connection.topic, []).append(place)
        made = {name: self._decoders_of(name, of_topic) for name, of_topic in places.items()}
        elements = self._elements({name: decoders for name, (decoders, _) in made.items()})
        topics = {name: self._topic(name, places[name], *made[name], elements[name]) for name in made}
        for origin in ("ROS 1 Noetic", "ROS 2 Humble"):
            types = {
                decoder.definition.type
                for topic in topics.values()
                for decoder in topic.decoders.values()
                if decoder.definition.origin == origin
            }
            if types:
                self.remarks.append(
                    f"no definition in the file of {', '.join(sorted(types))}: read as {origin} defines it"
                )
        return topics

    def _decoders_of(self, name: str, places: list[int]) -> tuple[dict[int, Decoder], dict[int, str]]:
        """Return the decoders of a topic's connections, and why others have none."""
        connections = self._container.connections
        decoders: dict[int, Decoder] = {}
        unusable: dict[int, str] = {}
        for place in places:
            try:
                decoders[place] = self._decoder(connections[place])
            except UnusableError as error:
                unusable[place] = f"{connections[place].msgtype}: {error}"
        self.remarks += sorted({f"{name} cannot be read: {reason}" for reason in unusable.values()})
        return decoders, unusable

    def _topic(
        self,
        name: str,
        places: list[int],
        decoders: dict[int, Decoder],
        unusable: dict[int, str],
        elements: Mapping[str, Elements],
    ) -> _Topic:
        connections = self._container.connections
        leaves: dict[str, Leaf] = {}
        for decoder in decoders.values():
            for leaf in decoder.definition.leaves.values():
                if leaves.setdefault(leaf.name, leaf).kind != leaf.kind:
                    self.remarks.append(
                        f"{name}: {leaf.name} is {leaves[leaf.name].kind} to one publisher and {leaf.kind}"
                        " to another; only the former is read"
                    )
        start, end = self._container.span(places) or (None, None)
        stream = Stream(
            topic=name,
            type=connections[places[0]].msgtype,
            fields=tuple(
                Field(leaf.name, leaf.kind, elements.get(leaf.name, ((), False))[0][:MOST_ELEMENTS])
                for leaf in leaves.values()
            ),
            count=sum(connections[place].msgcount for place in places),
            start=start,
            end=end,
        )
        names = {field: frozenset(texts) for field, (texts, named) in elements.items() if named}
        return _Topic(stream, decoders, unusable, names)

    def _decoder(self, connection: Connection) -> Decoder:
        """Return the decoder of a type; wheels of one kind often have a topic each."""
        key = connection.msgtype, connection.msgdef, connection.digest
        if key not in self._decoders:
            self._decoders[key] = Decoder(define(connection, ros1=self.kind == "ros1"))
        return self._decoders[key]

    def _elements(self, topics: Mapping[str, dict[int, Decoder]]) -> dict[str, dict[str, Elements]]:
        """Return the elements of each list in the first message of each topic, and whether they are names.

        Topics that begin in one chunk are told together, so that it is unpacked once: a third of the
        time of a short compressed bag.
        """
        told: dict[str, dict[str, Elements]] = {name: {} for name in topics}
        waiting = {name for name, decoders in topics.items() if any(map(_lists, decoders.values()))}
        while waiting:
            decoders = {place: decoder for name in waiting for place, decoder in topics[name].items()}
            run = next(filter(None, self._runs(decoders, 1)), {})
            begun = {name for name in waiting if not run.keys().isdisjoint(topics[name])}
            for name in sorted(begun):
                told[name] = self._elements_in(
                    {p: run[p] for p in topics[name] if p in run}, topics[name], name
                )
            waiting = waiting - begun if begun else set()
        return told

    def _elements_in(self, run: Run, decoders: Mapping[int, Decoder], topic: str) -> dict[str, Elements]:
        """Return the elements of each list in the first message of a run of one topic."""
        place = min(run, key=lambda place: (int(run[place].times[0]), int(run[place].order[0])))
        own = decoders[place].definition.leaves
        lists = [leaf for decoder in decoders.values() for leaf in _lists(decoder)]
        found = [leaf for leaf in lists if own.get(leaf.name) == leaf]
        try:
            elements = decoders[place].elements(run[place].take(slice(1)), found)
        except UndecodableError as error:
            self.remarks.append(f"{topic}: message 1 cannot be decoded ({error})")
            return {}
        return {leaf.name: named for leaf, named in zip(found, elements, strict=True)}

    def read(self, topic: str, fields: Sequence[str], batch_rows: int = BATCH_ROWS) -> Iterator[Batch]:
        """Read the named fields of one topic, in the order of the log times.

        A name among `Field.elements` is looked up in each message; digits are a place. What a message does
        not have is NaN, NaT or the code −1.
        """
        return (batch for _, batch in self.read_together({topic: fields}, batch_rows))

    def read_together(
        self, fields: Mapping[str, Sequence[str]], batch_rows: int = BATCH_ROWS
    ) -> Iterator[tuple[str, Batch]]:
        """Read several topics in one pass: what decompresses a bag once instead of once for each."""
        readings: dict[int, Reading] = {}
        for topic, names in fields.items():
            found = self._usable(topic)
            reading = Reading(
                self.path, found.stream, found.decoders, [self._request(found, n) for n in names], batch_rows
            )
            readings |= dict.fromkeys(found.decoders, reading)
        return self._batches(readings)

    def _usable(self, topic: str) -> _Topic:
        found = self._topics.get(topic)
        if found is None:
            raise FormatError(
                self.path, f"has no topic {topic!r}", hint=nearest(topic, self._topics, "topics")
            )
        for reason in found.unusable.values():
            raise FormatError(
                self.path,
                f"{topic} cannot be read: {reason}",
                hint="record it where the message package is installed, or export the topic to CSV",
            )
        return found

    def _request(self, topic: _Topic, asked: str) -> FieldRequest:
        stream = topic.stream
        fields = {field.name: field for field in stream.fields}
        name, bracket, element = asked.partition("[")
        field = fields.get(name)
        if field is None or (bracket and not element.endswith("]")):
            raise FormatError(
                self.path, f"{stream.topic} has no field {asked!r}", hint=nearest(name, fields, "fields")
            )
        if field.kind not in {"numbers", "texts"}:
            if bracket:
                raise FormatError(
                    self.path, f"{stream.topic}: {name} is one value, not a list", hint=f"ask for {name}"
                )
            return FieldRequest(asked, name, field.kind)
        if not bracket:
            example = field.elements[0] if field.elements else "0"
            raise FormatError(
                self.path,
                f"{stream.topic}: {name} is a list",
                hint=f"ask for one element of it, such as {name}[{example}]",
            )
        text = element.removesuffix("]")
        by_place = text.isascii() and text.isdigit() and text not in topic.names.get(name, ())
        return FieldRequest(
            asked, name, "number" if field.kind == "numbers" else "text", int(text) if by_place else text
        )

    def _runs(self, decoders: Mapping[int, Decoder], size: int = RUN_BYTES) -> Iterator[Run]:
        runs = self._container.runs(decoders.keys(), size)
        return self._decodable.only(runs, decoders) if self._decodable else runs

    def _batches(self, readings: Mapping[int, Reading]) -> Iterator[tuple[str, Batch]]:
        every = list(dict.fromkeys(readings.values()))
        decoders = {place: reading.decoders[place] for place, reading in readings.items()}
        for run in self._runs(decoders):
            for reading in every:
                own = {place: run[place] for place in sorted(run) if readings[place] is reading}
                for piece in reading.pieces(own):
                    reading.add(piece)
                    yield from ((reading.topic, batch) for batch in reading.batches())
        for reading in every:
            yield from ((reading.topic, batch) for batch in reading.batches(last=True))


def _lists(decoder: Decoder) -> list[Leaf]:
    return [leaf for leaf in decoder.definition.leaves.values() if leaf.kind in {"numbers", "texts"}]
