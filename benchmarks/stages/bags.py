"""Bags to columns: every number and time of fifteen topics, with elements of lists by name."""

from __future__ import annotations

from functools import partial
from operator import attrgetter
from typing import TYPE_CHECKING

import numpy as np
from rosbags.highlevel import AnyReader
from rosbags.rosbag2.storage_mcap import McapReader, decompress

from benchmarks import rover_bag
from benchmarks.harness import Case, Stage
from formats.rosbag.bag_source import BagSource
from formats.rosbag.storage.ros1 import Ros1File

if TYPE_CHECKING:
    from pathlib import Path

SECONDS = {"small": 6.0, "medium": 60.0, "full": 600.0}
TARGETS = {
    "none": (20.0, 35.0),
    "lz4": (20.0, 35.0),
    "zstd": (12.0, 25.0),
    "bz2": (2.0, 4.0),
    "db3": (12.0, 25.0),
}


def path_of(container: tuple[str, str], size: str, folder: Path) -> Path:
    """Return the bag of a size, written if it is not there."""
    return rover_bag.write(folder / f"bags-{size}", SECONDS[size], (container,))[container]


def wanted(source) -> dict[str, list[str]]:
    """Return the fields read of each topic."""
    return {
        stream.topic: [
            name
            for field in stream.fields
            for name in (
                [field.name]
                if field.kind in {"number", "time"}
                else [f"{field.name}[{element}]" for element in field.elements if not element.isdigit()]
                if field.kind == "numbers"
                else []
            )
        ]
        for stream in source.streams()
    }


def columns(path: Path, kind: str) -> dict[str, dict[str, list]]:
    """Read with terrain-est: the pieces of each column."""
    source = BagSource(str(path), kind)
    fields = wanted(source)
    read: dict = {topic: {name: [] for name in names} for topic, names in fields.items()}
    for topic, batch in source.read_together(fields):
        for name, pieces in read[topic].items():
            pieces.append(batch[name])
    return read


def drained(path: Path, kind: str) -> int:
    """Read with terrain-est, and keep nothing."""
    source = BagSource(str(path), kind)
    return sum(len(next(iter(batch.values()))) for _, batch in source.read_together(wanted(source)))


def with_rosbags(path: Path, fields: dict[str, list[str]]) -> dict[str, dict[str, np.ndarray]]:
    """Read with rosbags, message by message."""
    with AnyReader([path]) as reader:
        messages: dict = {connection.topic: [] for connection in reader.connections}
        for connection, _, raw in reader.messages():
            messages[connection.topic].append(reader.deserialize(raw, connection.msgtype))
    return {
        topic: {name: _column(messages[topic], name) for name in names} for topic, names in fields.items()
    }


def _column(messages: list, asked: str) -> np.ndarray:
    name, _, element = asked.partition("[")
    get = attrgetter(name)
    if element:
        return np.array([get(m)[m.name.index(element[:-1])] for m in messages], dtype=float)
    values = [get(m) for m in messages]
    if values and hasattr(values[0], "nanosec"):
        return np.array([v.sec * 10**9 + v.nanosec for v in values]).view("datetime64[ns]")
    return np.array(values, dtype=float)


def same(ours: dict, peer: dict) -> str:
    """Check that all columns are equal, bit by bit."""
    values = 0
    for topic, of_topic in peer.items():
        for name, column in of_topic.items():
            np.testing.assert_array_equal(
                np.concatenate(ours[topic][name]), column, err_msg=f"{topic} {name}"
            )
            values += len(column)
    return f"{values:,} values equal"


def contents(path: Path, kind: str) -> int:
    """Read and decompress the file, and nothing else."""
    if kind == "db3":
        return len(path.read_bytes())
    size = 0
    with path.open("rb") as file:
        for position, stored, unpack in _chunks(path, kind):
            file.seek(position)
            size += len(unpack(file.read(stored)))
    return size


def _chunks(path: Path, kind: str) -> list:
    """Return where chunks begin, how long they are, and what unpacks them."""
    file = Ros1File(path) if kind == "ros1" else McapReader(path)
    file.open()
    if kind == "ros1":
        chunks = [(c.position, c.stored, c.unpack) for c in file.chunks]
    else:
        chunks = [
            (
                c.chunk_start_offset + 49 + len(c.compression),
                c.compressed_size,
                partial(decompress, compression=c.compression, size=c.uncompressed_size, crc=0),
            )
            for c in file.chunks
        ]
    file.close()
    return chunks


def make(container: tuple[str, str], size: str, folder: Path) -> Case:
    """Make the case of one container."""
    kind, _ = container
    path = path_of(container, size, folder)
    fields = wanted(BagSource(str(path), kind))
    return Case(
        partial(columns, path, kind),
        partial(with_rosbags, path, fields),
        same,
        partial(contents, path, kind),
        unit="bag",
    )


STAGES = tuple(
    Stage(
        f"bag {kind} {compression}" if kind != "db3" else "bag db3",
        "rosbags AnyReader, deserialize, NumPy",
        partial(make, (kind, compression)),
        *TARGETS["db3" if kind == "db3" else compression],
        rounds=5,
    )
    for kind, compression in rover_bag.CONTAINERS
)
