"""A bag as a source of columns."""

from __future__ import annotations

from dataclasses import dataclass
from difflib import get_close_matches
from functools import cached_property
from typing import TYPE_CHECKING, NoReturn

import numpy as np

from formats.errors import DamagedError, FormatError
from formats.rosbag.columns import NAT, Request, elements_of, labels
from formats.rosbag.containers import Container
from formats.rosbag.damage import damaged
from formats.rosbag.decoder import Decoder, UndecodableError
from formats.rosbag.definitions import STAMP as HEADER_STAMP
from formats.rosbag.definitions import UnusableError, define
from formats.table import BATCH_ROWS, LOG_TIME, STAMP, Field, Source, Stream

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Sequence

    from numpy.typing import NDArray

    from formats.rosbag.columns import Values
    from formats.rosbag.definitions import Leaf
    from formats.table import Batch

#: A batch ends when its messages have this many bytes, however few they are.
BATCH_BYTES = 16 << 20
#: A list with more elements is cut in what `streams` tells; any place of it can be read.
MOST_ELEMENTS = 256
ZERO = np.datetime64(0, "ns")


@dataclass(frozen=True, slots=True)
class _Topic:
    """The connections that carry one topic, by their place in the container."""

    stream: Stream
    decoders: dict[int, Decoder]
    unusable: dict[int, str]
    #: The names of the elements of each list, where they have names.
    names: dict[str, frozenset[str]]


class BagSource(Source):
    """A ROS 1 bag, an MCAP or SQLite file of ROS 2, or the folder of a recording.

    Parameters
    ----------
    path : str
    kind : {"ros1", "mcap", "db3"}

    Raises
    ------
    NotFoundError
        No such file, or no permission to read it.
    DamagedError
        Cut off, corrupt or without index.
    FormatError
    """

    def __init__(self, path: str, kind: str) -> None:
        super().__init__(path, kind)
        self._container = Container(path, kind)
        self.remarks += self._container.remarks

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
        topics = {name: self._topic(name, of_topic) for name, of_topic in places.items()}
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

    def _topic(self, name: str, places: list[int]) -> _Topic:
        connections = self._container.connections
        decoders: dict[int, Decoder] = {}
        unusable: dict[int, str] = {}
        for place in places:
            try:
                decoders[place] = Decoder(define(connections[place], ros1=self.kind == "ros1"))
            except UnusableError as error:
                unusable[place] = f"{connections[place].msgtype}: {error}"
        self.remarks += sorted({f"{name} cannot be read: {reason}" for reason in unusable.values()})
        leaves: dict[str, Leaf] = {}
        for decoder in decoders.values():
            for leaf in decoder.definition.leaves.values():
                if leaves.setdefault(leaf.name, leaf).kind != leaf.kind:
                    self.remarks.append(
                        f"{name}: {leaf.name} is {leaves[leaf.name].kind} to one publisher and {leaf.kind}"
                        " to another; only the former is read"
                    )
        elements = self._elements(name, decoders)
        stream = Stream(
            name,
            connections[places[0]].msgtype,
            tuple(
                Field(leaf.name, leaf.kind, elements.get(leaf.name, ((), False))[0][:MOST_ELEMENTS])
                for leaf in leaves.values()
            ),
            sum(connections[place].msgcount for place in places),
            *(self._container.span(places) or (None, None)),
        )
        names = {field: frozenset(texts) for field, (texts, named) in elements.items() if named}
        return _Topic(stream, decoders, unusable, names)

    def _elements(self, topic: str, decoders: dict[int, Decoder]) -> dict[str, tuple[tuple[str, ...], bool]]:
        """Return the elements of each list in the first message, and whether they are names."""
        lists = [
            leaf
            for decoder in decoders.values()
            for leaf in decoder.definition.leaves.values()
            if leaf.kind in {"numbers", "texts"}
        ]
        if not lists:
            return {}
        for place, _, payload in self._container.messages(decoders.keys()):
            try:
                message = decoders[place].message(payload)
            except UndecodableError as error:
                self.remarks.append(f"{topic}: message 1 cannot be decoded ({error})")
                return {}
            own = decoders[place].definition.leaves
            return {leaf.name: elements_of(message, leaf) for leaf in lists if own.get(leaf.name) == leaf}
        return {}

    def read(self, topic: str, fields: Sequence[str], batch_rows: int = BATCH_ROWS) -> Iterator[Batch]:
        """Read the named fields of one topic, in the order of the log times.

        Parameters
        ----------
        topic : str
        fields : sequence of str
            Names from `Stream.fields`; elements of lists as ``effort[wheel_fl]`` or ``effort[2]``.
            A name among `Field.elements` is looked up in each message; digits are a place.
        batch_rows : int
            Largest number of rows in one batch.

        Yields
        ------
        dict of str to ndarray or Labels
            Each field under the name asked for, and `LOG_TIME` and `STAMP`. What a message does
            not have is NaN, NaT or the code −1.

        Raises
        ------
        DamagedError
            The bag, or one message of it, cannot be decoded.
        FormatError
            There is no such topic, field or element, or no definition of the type.
        """
        found = self._topics.get(topic)
        if found is None:
            raise FormatError(
                self.path, f"has no topic {topic!r}", hint=_nearest(topic, self._topics, "topics")
            )
        for reason in found.unusable.values():
            raise FormatError(
                self.path,
                f"{topic} cannot be read: {reason}",
                hint="record it where the message package is installed, or export the topic to CSV",
            )
        return self._batches(found, [self._request(found, name) for name in fields], batch_rows)

    def _request(self, topic: _Topic, asked: str) -> Request:
        stream = topic.stream
        fields = {field.name: field for field in stream.fields}
        name, bracket, element = asked.partition("[")
        field = fields.get(name)
        if field is None or (bracket and not element.endswith("]")):
            raise FormatError(
                self.path,
                f"{stream.topic} has no field {asked!r}",
                hint=_nearest(name, fields, "fields"),
            )
        if field.kind not in {"numbers", "texts"}:
            if bracket:
                raise FormatError(
                    self.path,
                    f"{stream.topic}: {name} is one value, not a list",
                    hint=f"ask for {name}",
                )
            return Request(asked, name, field.kind)
        if not bracket:
            example = field.elements[0] if field.elements else "0"
            raise FormatError(
                self.path,
                f"{stream.topic}: {name} is a list",
                hint=f"ask for one element of it, such as {name}[{example}]",
            )
        text = element.removesuffix("]")
        by_place = text.isascii() and text.isdigit() and text not in topic.names.get(name, ())
        return Request(
            asked, name, "number" if field.kind == "numbers" else "text", int(text) if by_place else text
        )

    def _batches(self, topic: _Topic, requests: list[Request], batch_rows: int) -> Iterator[Batch]:
        asked = [*requests, Request(STAMP, HEADER_STAMP, "time")]
        absent = {request.asked: request for request in requests if request.key is not None}
        done = 0
        for places, times, payloads in self._rows(topic, batch_rows):
            values = [request.blank(len(payloads)) for request in asked]
            for place in np.unique(places):
                rows = np.flatnonzero(places == place)
                columns = self._decode(topic, place, [payloads[row] for row in rows], asked, done + 1 + rows)
                for request, whole, (part, present) in zip(asked, values, columns, strict=True):
                    whole[rows] = part
                    if present:
                        absent.pop(request.asked, None)
            done += len(payloads)
            stamps = values.pop()
            stamps[stamps == ZERO] = NAT
            batch: Batch = {
                request.asked: labels(column) if request.kind == "text" else column
                for request, column in zip(requests, values, strict=True)
            }
            yield batch | {LOG_TIME: times, STAMP: stamps}
        if done:
            for request in absent.values():
                self._absent(topic.stream, request)

    def _rows(
        self, topic: _Topic, batch_rows: int
    ) -> Iterator[tuple[NDArray[np.int64], NDArray[np.datetime64], list[bytes]]]:
        """Gather raw messages: place of their connection, log time, payload."""
        messages = self._container.messages(topic.decoders.keys())
        while True:
            rows, size = [], 0
            for message in messages:
                rows.append(message)
                size += len(message[2])
                if len(rows) >= batch_rows or size >= BATCH_BYTES:
                    break
            if not rows:
                return
            places, times, payloads = zip(*rows, strict=True)
            try:
                clock = np.array(times, dtype=np.int64).view("datetime64[ns]")
            except OverflowError as error:
                raise damaged(self.path, self.kind, error) from error
            yield np.array(places), clock, list(payloads)

    def _decode(
        self,
        topic: _Topic,
        place: int,
        payloads: list[bytes],
        asked: list[Request],
        numbers: NDArray[np.int64],
    ) -> list[tuple[Values, bool]]:
        try:
            return topic.decoders[place].columns(payloads, asked)
        except UndecodableError as error:
            raise DamagedError(
                self.path,
                f"{topic.stream.topic}: message {numbers[error.row]} does not fit its definition ({error})",
                hint="the recording is damaged there, or its definition is not the one it was written with",
            ) from error

    def _absent(self, stream: Stream, request: Request) -> NoReturn:
        elements = next(field.elements for field in stream.fields if field.name == request.field)
        raise FormatError(
            self.path,
            f"{stream.topic}: no message has the element {request.key!r} of {request.field}",
            hint=_nearest(str(request.key), elements, "elements"),
        )


def _nearest(name: str, choices: Iterable[str], what: str) -> str:
    choices = list(choices)
    close = get_close_matches(name, choices, n=3, cutoff=0.5)
    return (
        f"did you mean {' or '.join(close)}?" if close else f"its {what}: {', '.join(choices[:20]) or 'none'}"
    )


def open_bag(path: str, kind: str) -> BagSource:
    """Open a bag.

    Parameters
    ----------
    path : str
        A file, or the folder of a rosbag2 recording.
    kind : {"ros1", "mcap", "db3"}
        By content, not by the ending of the name.

    Returns
    -------
    BagSource

    Raises
    ------
    NotFoundError, DamagedError, FormatError
    """
    return BagSource(path, kind)
