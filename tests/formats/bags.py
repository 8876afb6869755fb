"""Bags for tests, written with rosbags' own writers."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import lz4.frame
import numpy as np
from rosbags.interfaces import Nodetype
from rosbags.rosbag1 import Writer as Ros1Writer
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin
from rosbags.rosbag2 import Writer as Ros2Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping
    from pathlib import Path

    from rosbags.typesys.store import Typestore

#: (topic, type, log time in ns, members of the message, publisher)
Row = tuple[str, str, int, dict[str, Any]] | tuple[str, str, int, dict[str, Any], str]

ROS1 = ("none", "bz2", "lz4")
MCAP = ("none", "zstd", "lz4")
FOLDER = ("none", "file", "message")


def typestore(definitions: Mapping[str, str] | None = None, *, ros1: bool) -> Typestore:
    """Return the standard types and some custom ones, given as the text of a .msg file."""
    store = get_typestore(Stores.ROS1_NOETIC if ros1 else Stores.ROS2_HUMBLE)
    for name, text in (definitions or {}).items():
        store.register(get_types_from_msg(text, name))
    return store


def message(store: Typestore, type_name: str, values: Mapping[str, Any]) -> Any:
    """Build a message; members not given are zero or empty."""
    unknown = set(values) - {name for name, _ in store.fielddefs[type_name][1]}
    assert not unknown, f"{type_name} has no {unknown}"
    return store.types[type_name](
        *(_value(store, desc, values.get(name)) for name, desc in store.fielddefs[type_name][1])
    )


def _value(store: Typestore, desc: Any, value: Any) -> Any:
    kind, rest = desc
    if kind == Nodetype.NAME:
        if rest in {"builtin_interfaces/msg/Time", "builtin_interfaces/msg/Duration"}:
            sec, nanosec = divmod(value or 0, 10**9)
            return store.types[rest](sec, nanosec)
        return message(store, rest, value or {})
    if kind == Nodetype.BASE:
        return value if value is not None else {"string": "", "bool": False}.get(rest[0], 0)
    (element_kind, element), length = rest
    if value is None:
        value = [None] * (length if kind == Nodetype.ARRAY else 0)
    items = [_value(store, (element_kind, element), item) for item in value]
    if element_kind == Nodetype.BASE and element[0] != "string":
        dtype = {"bool": np.bool_, "char": np.uint8, "byte": np.int8}.get(element[0], element[0])
        return np.array(items, dtype=dtype)
    return items


def write_ros1(
    path: Path, rows: Iterable[Row], store: Typestore, compression: str = "none", chunk: int = 1 << 20
) -> Path:
    """Write a ROS 1 bag; a new chunk begins after `chunk` bytes."""
    writer = Ros1Writer(path)
    if compression != "none":
        writer.set_compression(Ros1Writer.CompressionFormat[compression.upper()])
    writer.chunk_threshold = chunk
    with writer:
        connections: dict[tuple[str, str, str], Any] = {}
        for topic, type_name, time, values, *publisher in rows:
            key = (topic, type_name, *publisher)
            if key not in connections:
                connections[key] = writer.add_connection(
                    topic, type_name, typestore=store, callerid=publisher[0] if publisher else None
                )
            payload = store.serialize_ros1(message(store, type_name, values), type_name)
            writer.write(connections[key], time, payload)
    return path


def write_ros2(
    folder: Path,
    rows: Iterable[Row],
    store: Typestore,
    kind: str,
    compression: str = "none",
    *,
    little_endian: bool = True,
    chunk: int = 1 << 20,
) -> Path:
    """Write the folder of a recording and return the path of its one file."""
    writer = Ros2Writer(
        folder, version=9, storage_plugin=StoragePlugin.MCAP if kind == "mcap" else StoragePlugin.SQLITE3
    )
    modes = {
        "zstd": CompressionMode.STORAGE,
        "file": CompressionMode.FILE,
        "message": CompressionMode.MESSAGE,
    }
    if compression in modes:
        writer.set_compression(modes[compression], CompressionFormat.ZSTD)
    with writer:
        if compression == "lz4":
            writer.storage.compression, writer.storage.compressor = "lz4", lz4.frame.compress
        connections: dict[tuple[str, str], Any] = {}
        for topic, type_name, time, values, *_ in rows:
            if (topic, type_name) not in connections:
                connections[topic, type_name] = writer.add_connection(topic, type_name, typestore=store)
            payload = store.serialize_cdr(
                message(store, type_name, values), type_name, little_endian=little_endian
            )
            writer.write(connections[topic, type_name], time, payload)
            if kind == "mcap" and writer.storage.chunk.bio.tell() > chunk:
                writer.storage.close_chunk()
    return next(file for file in folder.iterdir() if file.name != "metadata.yaml")
