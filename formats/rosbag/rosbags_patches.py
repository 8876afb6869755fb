"""What of rosbags 0.11.9 is replaced, for the whole process: `McapReader` takes these from its module.

For rosbags to do, and then to go from here:

- bounds on what a chunk unpacks to, `decompress(data, size)` used with the size that the chunk states: a
  few bytes become gigabytes;
- `McapReader.read_index` and `meta_scan` that pass over a schema of an unknown encoding, as over one without
  any: a log with one topic that is not of ROS is refused whole;
- profiles of quality, in YAML, parsed when they are asked for.
"""

from __future__ import annotations

from functools import lru_cache, partial
from typing import TYPE_CHECKING

from rosbags.interfaces import MessageDefinition, MessageDefinitionFormat
from rosbags.rosbag2 import storage_mcap
from rosbags.rosbag2.storage_mcap import McapReader

from formats.rosbag.storage.raw_messages import unpack

if TYPE_CHECKING:
    from rosbags.rosbag2.storage_mcap import Schema

__all__ = ["McapReader"]

#: Of definitions that rosbags reads; the last is that of types without one.
_ENCODINGS = ("ros2msg", "ros2idl", "omgidl", "")
_get_msgdef = storage_mcap.get_msgdef


def _bounded(packing: str, data: bytes, _size: int) -> bytes:
    return unpack(data, packing)


def _definition(schema: Schema | None) -> MessageDefinition:
    known = schema is None or schema.encoding in _ENCODINGS
    return _get_msgdef(schema) if known else MessageDefinition(MessageDefinitionFormat.NONE, "")


storage_mcap.DECOMPRESSORS.update({packing: partial(_bounded, packing) for packing in ("lz4", "zstd")})
storage_mcap.get_msgdef = _definition
storage_mcap.get_qos = lru_cache(256)(storage_mcap.get_qos)
