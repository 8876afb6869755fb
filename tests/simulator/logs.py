"""A run as the files that rovers write: CSV, Parquet, ROS 1 and ROS 2 bags."""

from __future__ import annotations

import csv
import shutil
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from rosbags import rosbag1, rosbag2
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin
from rosbags.typesys import Stores, get_typestore

from simulator.messages import messages

if TYPE_CHECKING:
    from simulator.run import Run


def write_csv(run: Run, path: Path, *, terrain: bool = False) -> None:
    """Write the table with full precision and empty cells for what was not measured."""
    table = run.columns(terrain=terrain)
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(table)
        for row in zip(*(column.tolist() for column in table.values()), strict=True):
            writer.writerow("" if value != value else value for value in row)  # noqa: PLR0124 - NaN


def write_parquet(run: Run, path: Path, *, terrain: bool = False) -> None:
    """Write the table, null where nothing was measured."""
    import pyarrow as pa
    from pyarrow import parquet

    table = {name: pa.array(c, from_pandas=True) for name, c in run.columns(terrain=terrain).items()}
    parquet.write_table(pa.table(table), path)


def write_ros1(
    run: Run,
    path: Path,
    *,
    compression: Literal["none", "bz2", "lz4"] = "none",
    custom: bool = False,
    latency: float = 0.0,
) -> None:
    """Write a ROS 1 bag.

    Parameters
    ----------
    run : Run
    path : Path
        A file; it must not exist.
    compression : {"none", "bz2", "lz4"}
    custom : bool
        WheelTelemetry messages instead of the standard ones.
    latency : float
        Log time after the stamp, in s: all the time a Float64 has.
    """
    store = get_typestore(Stores.ROS1_NOETIC)
    writer = rosbag1.Writer(path)
    if compression != "none":
        writer.set_compression(rosbag1.Writer.CompressionFormat[compression.upper()])
    with writer:
        connections: dict[str, Any] = {}
        for message in messages(run, store, custom=custom):
            if message.topic not in connections:
                connections[message.topic] = writer.add_connection(
                    message.topic, message.type, typestore=store
                )
            writer.write(
                connections[message.topic],
                message.stamp + round(latency * 1e9),
                store.serialize_ros1(message.content, message.type),
            )


def write_ros2(
    run: Run,
    path: Path,
    *,
    storage: Literal["mcap", "sqlite3"] = "mcap",
    compression: Literal["none", "storage", "file", "message"] = "none",
    folder: bool = False,
    custom: bool = False,
    latency: float = 0.0,
) -> None:
    """Write a ROS 2 bag.

    Parameters
    ----------
    run : Run
    path : Path
        A file, or the folder; it must not exist.
    storage : {"mcap", "sqlite3"}
    compression : {"none", "storage", "file", "message"}
        All zstd; "storage" is the chunks of an mcap, the last two only make sense in a folder.
    folder : bool
        Keep the folder with its metadata.yaml, instead of the one file in it.
    custom, latency
        As for `write_ros1`.
    """
    store = get_typestore(Stores.ROS2_HUMBLE)
    with tempfile.TemporaryDirectory(dir=path.parent) as scratch:
        # The name of the folder is inside the file: it must not be one made up anew each time.
        bag = path if folder else Path(scratch) / path.stem
        writer = rosbag2.Writer(bag, version=9, storage_plugin=StoragePlugin[storage.upper()])
        writer.set_compression(CompressionMode[compression.upper()], CompressionFormat.ZSTD)
        with writer:
            connections: dict[str, Any] = {}
            for message in messages(run, store, custom=custom):
                if message.topic not in connections:
                    connections[message.topic] = writer.add_connection(
                        message.topic, message.type, typestore=store
                    )
                writer.write(
                    connections[message.topic],
                    message.stamp + round(latency * 1e9),
                    store.serialize_cdr(message.content, message.type),
                )
        if not folder:
            (content,) = (file for file in bag.iterdir() if file.name != "metadata.yaml")
            shutil.move(content, path)
