"""Bags: ROS 1, and MCAP, which may also grow, and SQLite of ROS 2. The same messages give the same bytes."""

import heapq
import shutil
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray
from rosbags.interfaces import Nodetype
from rosbags.rosbag1 import Writer as Ros1Writer
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Ros2Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

from formats.errors import CannotWriteError
from formats.output.whole_files import explained, replacing

STAMP = "header.stamp"
_TIMES = frozenset({"builtin_interfaces/msg/Time", "builtin_interfaces/msg/Duration"})
_STORAGE = {"mcap": StoragePlugin.MCAP, "db3": StoragePlugin.SQLITE3}
#: The name of a bag is inside it: files of other names would have other bytes.
_NAME = "telemetry"
_SECOND = 1_000_000_000


@dataclass(frozen=True)
class Topic:
    """Messages of one topic, as columns."""

    name: str
    type: str  # As ROS 2 names it: ``sensor_msgs/msg/JointState``
    #: Log time in ns since 1970, rising; also the stamp of the header where the type has one; shape (n,).
    time: NDArray[np.int64]
    #: Dotted path of a field → one value per message, or one for all. A list in a message is a row of an
    #: array of shape (n, m), or a list of str. What is not named is zero or empty.
    columns: Mapping[str, Any] = field(default_factory=dict)
    definition: str = ""  # Text of the .msg file, of a type that does not come with ROS


def write_bag(topics: Sequence[Topic], destination: str, kind: str) -> None:
    """Write a bag ("ros1", "mcap" or "db3"), whole or not at all; a folder of ROS 2 ends in a slash."""
    if destination.endswith("/"):
        target = Path(destination)
        with explained(destination):
            if target.exists():
                raise CannotWriteError(destination, "is there already", hint="remove it, or name another")
            with TemporaryDirectory(dir=target.parent) as scratch:
                # The files in it have the name of the folder.
                written = Path(scratch) / target.name
                _write_ros2(topics, written, kind)
                written.rename(target)
        return
    with replacing(destination) as temporary, TemporaryDirectory(dir=Path(temporary).parent) as scratch:
        inner = Path(scratch) / _NAME
        if kind == "ros1":
            with Ros1Writer(inner) as writer:
                _add(writer, get_typestore(Stores.ROS1_NOETIC), topics)
            written = inner
        else:
            _write_ros2(topics, inner, kind)
            (written,) = (file for file in inner.iterdir() if file.name != "metadata.yaml")
        shutil.move(written, temporary)


def _write_ros2(topics: Sequence[Topic], path: Path, kind: str) -> None:
    with Ros2Writer(path, version=Ros2Writer.VERSION_LATEST, storage_plugin=_STORAGE[kind]) as writer:
        _add(writer, get_typestore(Stores.ROS2_HUMBLE), topics)


def _add(writer: Ros1Writer | Ros2Writer, store: Typestore, topics: Sequence[Topic]) -> None:
    """Write messages, of topics that are there already or not."""
    serialize = store.serialize_ros1 if isinstance(writer, Ros1Writer) else store.serialize_cdr
    there = {connection.topic: connection for connection in writer.connections}
    for topic in topics:
        if topic.definition and topic.type not in store.fielddefs:
            store.register(get_types_from_msg(topic.definition, topic.type))
    for topic in topics:
        if topic.name not in there:
            there[topic.name] = writer.add_connection(topic.name, topic.type, typestore=store)
    for place, time, message in _messages(topics, store):
        topic = topics[place]
        writer.write(there[topic.name], time, serialize(message, topic.type))


class GrowingBag:
    """An MCAP file of which all messages so far can be read; it gets its index when it is closed."""

    def __init__(self, destination: str) -> None:
        self._destination = destination
        self._store = get_typestore(Stores.ROS2_HUMBLE)

    def __enter__(self) -> Self:
        """Make the file; one that is there is replaced."""
        target = Path(self._destination).resolve()
        with explained(self._destination):
            if target.exists() and not target.is_file():
                raise CannotWriteError(self._destination, "is no file, and an MCAP that grows must be one")
            with TemporaryDirectory(prefix=".", dir=target.parent) as scratch:
                inner = Path(scratch) / _NAME
                self._writer = Ros2Writer(
                    inner, version=Ros2Writer.VERSION_LATEST, storage_plugin=StoragePlugin.MCAP
                )
                self._writer.open()
                # The writer makes a folder of its own: its file is moved while it is open.
                (inner / f"{_NAME}.mcap").replace(target)
        return self

    def __exit__(self, *_: object) -> None:
        """Write the index, whatever happened: the messages before are right."""
        with explained(self._destination), TemporaryDirectory() as scratch:
            self._writer.metapath = Path(scratch) / "metadata.yaml"
            self._writer.close()

    def add(self, topics: Sequence[Topic]) -> None:
        """Write messages as a chunk of their own, which can be read at once; a topic keeps its type."""
        with explained(self._destination):
            _add(self._writer, self._store, topics)
            storage: Any = self._writer.storage
            storage.close_chunk()
            storage.bio.flush()


def _messages(topics: Sequence[Topic], store: Typestore) -> Iterator[tuple[int, int, Any]]:
    """Yield the place of the topic, the time and the message, by time, then by topic."""

    def of_topic(place: int) -> Iterator[tuple[int, int, int]]:
        return ((int(time), place, row) for row, time in enumerate(topics[place].time))

    trees = [_tree(topic) for topic in topics]
    for time, place, row in heapq.merge(*map(of_topic, range(len(topics)))):
        yield place, time, _message(store, topics[place].type, trees[place], row)


def _tree(topic: Topic) -> dict[str, Any]:
    """Nest the columns as the fields are."""
    columns = dict(topic.columns)
    columns.setdefault(STAMP, topic.time)
    tree: dict[str, Any] = {}
    for path, column in columns.items():
        *above, leaf = path.split(".")
        node = tree
        for name in above:
            node = node.setdefault(name, {})
        node[leaf] = column
    return tree


def _message(store: Typestore, type_name: str, tree: Mapping[str, Any], row: int) -> Any:
    fields = (_value(store, kind, tree.get(name), row) for name, kind in store.fielddefs[type_name][1])
    return store.types[type_name](*fields)


def _value(store: Typestore, kind: Any, column: Any, row: int) -> Any:
    node, rest = kind
    if node == Nodetype.NAME and rest in _TIMES:
        return store.types[rest](*divmod(0 if column is None else int(_at(column, row)), _SECOND))
    if node == Nodetype.NAME:
        return _message(store, rest, column if isinstance(column, Mapping) else {}, row)
    if node == Nodetype.BASE:
        return _at(column, row) if column is not None else {"string": "", "bool": False}.get(rest[0], 0)
    (element_node, element), length = rest
    if element_node != Nodetype.BASE or element[0] == "string":
        return list(column) if column is not None else []
    if column is None:
        return np.zeros(length if node == Nodetype.ARRAY else 0, dtype=element[0])
    return np.ascontiguousarray(column[row], dtype=element[0])


def _at(column: Any, row: int) -> Any:
    return column[row].item() if isinstance(column, np.ndarray) else column
