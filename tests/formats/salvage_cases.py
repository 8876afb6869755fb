"""Whole bags of which every message is known, and what is left of them."""

from __future__ import annotations

import json
import struct
from binascii import crc32

import numpy as np
from bags import MCAP, ROS1, typestore, write_ros1, write_ros2

from formats.rosbag.bag_source import BagSource

JOINTS, FLOAT = "sensor_msgs/msg/JointState", "std_msgs/msg/Float64"
N = 120
START = 1_700_000_000 * 10**9

CASES = [("ros1", c) for c in ROS1] + [("mcap", c) for c in [*MCAP, "crc"]] + [("db3", "none")]


def rows(n=N):
    for i in range(n):
        time = START + i * 10**8
        yield "/joints", JOINTS, time, {"name": ["fl", "fr"], "effort": [i / 8, -i]}
        yield "/speed", FLOAT, time + 1, {"data": (i + 1) / 4}


def write(folder, kind, compression="none", n=N):
    """Write a bag in chunks of 3,000 bytes and return its path."""
    store = typestore(ros1=kind == "ros1")
    if kind == "ros1":
        return write_ros1(folder / "run.bag", rows(n), store, compression, chunk=3_000)
    path = write_ros2(
        folder / "run", rows(n), store, kind, {"crc": "none"}.get(compression, compression), chunk=3_000
    )
    if compression == "crc":
        path.write_bytes(with_checksums(path.read_bytes()))
    return path


def with_checksums(data):
    """Fill in the checksums of an MCAP file, which rosbags leaves out."""
    data = bytearray(data)
    at = 8
    while at < len(data) - 8:
        code, length = struct.unpack_from("<BQ", data, at)
        begin = at + 9
        if code == 0x06:
            letters = struct.unpack_from("<I", data, begin + 28)[0]
            contents = bytes(data[begin + 40 + letters : begin + length])
            struct.pack_into("<I", data, begin + 24, crc32(contents))
        elif code == 0x0F:
            struct.pack_into("<I", data, begin, crc32(bytes(data[:at])))
        elif code == 0x02:
            summary = struct.unpack_from("<Q", data, begin)[0]
            struct.pack_into("<I", data, begin + 16, crc32(bytes(data[summary : begin + 16])))
        at = begin + length
    return bytes(data)


def opened(path, kind, *, salvage=True):
    return BagSource(str(path), kind, salvage=salvage)


def samples(source):
    """Return every value of every message: (topic, log time) to values, bit for bit."""
    found = {}
    for stream in source.streams():
        asked = [
            f"{field.name}[{element}]" if field.elements else field.name
            for field in stream.fields
            for element in (field.elements or [""])
            if field.kind in {"number", "text", "time"} or field.elements
        ]
        for batch in source.read(stream.topic, asked, 50):
            columns = [column_bits(batch[name]) for name in asked]
            for row, time in enumerate(batch["@log"].astype(np.int64).tolist()):
                key = stream.topic, time
                assert key not in found
                found[key] = dict(zip(asked, (column[row] for column in columns), strict=True))
    return found


def column_bits(column):
    if hasattr(column, "codes"):
        return [column.names[code] if code >= 0 else None for code in column.codes]
    return column.view(np.int64).tolist()


def told(source):
    """Return what a source says of itself, once a machine could read it too."""
    document = json.loads(json.dumps(source.recovery.document(), allow_nan=False))
    assert document["read"] == source.recovery.read
    assert document["fraction"] is None or 0.0 <= document["fraction"] <= 1.0
    assert all("\n" not in remark for remark in source.remarks)
    return "\n".join(source.remarks)
