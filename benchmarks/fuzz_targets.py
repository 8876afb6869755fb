"""What the hostile inputs are fed to, and the small whole inputs of which they are made."""

from __future__ import annotations

import json
import tempfile
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Callable

    Target = Callable[[bytes], None]

HERE = Path(__file__).resolve().parent


def text_target(parse: Callable[[str], object]) -> Target:
    """Return a target for what takes a text."""
    return lambda data: _ignore(
        parse(data.decode("utf-8", "surrogateescape").encode("utf-8", "replace").decode())
    )


def _ignore(_: object) -> None:
    pass


def file_target(name: str, read: Callable[[str], object]) -> Target:
    """Return a target for what takes the path of a file."""
    folder = Path(tempfile.mkdtemp(prefix="fuzz-", dir="/dev/shm" if Path("/dev/shm").is_dir() else None))  # noqa: S108
    path = folder / name

    def run(data: bytes) -> None:
        path.write_bytes(data)
        read(str(path))

    return run


def read_source(path: str, *, salvage: bool = False) -> None:
    """Open a file and read every column of it."""
    import formats

    source = formats.open_source(path, salvage=salvage)
    for stream in source.streams():
        asked = [
            f"{field.name}[{element}]" if field.elements else field.name
            for field in stream.fields[:40]
            for element in (field.elements[:3] or [""])
            if field.kind in {"number", "text", "time"} or field.elements
        ]
        for batch in source.read(stream.topic, asked):
            sizes = {len(column) for column in batch.values()}
            if len(sizes) > 1:
                raise AssertionError(f"columns of different lengths: {sizes}")
    if source.recovery:
        if "\n" in "".join(source.recovery.sentences()):
            raise AssertionError("a sentence of several lines")
        json.dumps(source.recovery.document(), allow_nan=False)


def read_recording(path: str) -> None:
    """Take the bytes as metadata.yaml of a folder with a bag."""
    import formats

    folder = Path(path).parent
    if not (folder / "run.mcap").exists():
        (folder / "run.mcap").write_bytes(small_bags(lists=False)["mcap"][0])
    try:
        formats.open_source(str(folder))
    except formats.FormatError:
        formats.open_source(str(folder), salvage=True)


def define(text: str, *, idl: bool) -> None:
    """Take the text as the definition of a message, and decode one."""
    from rosbags.interfaces import (
        Connection,
        ConnectionExtRosbag2,
        MessageDefinition,
        MessageDefinitionFormat,
    )

    from formats.rosbag.decoder import UndecodableError, columns
    from formats.rosbag.definitions import FieldRequest, UnusableError
    from formats.rosbag.definitions import define as find
    from formats.rosbag.storage.raw_messages import Messages

    kind = MessageDefinitionFormat.IDL if idl else MessageDefinitionFormat.MSG
    ext = ConnectionExtRosbag2("cdr", [])
    connection = Connection(1, "/a", "a/msg/B", MessageDefinition(kind, text), "", 1, ext, None)
    payload, first = b"\0\1\0\0" + bytes(range(200)), np.zeros(1, dtype=np.intp)
    message = Messages(payload, first, first + len(payload), first, first)
    for ros1 in (False, True):
        with suppress(UnusableError, UndecodableError):
            definition = find(connection, ros1=ros1)
            every = ((leaf, leaf.kind.endswith("s")) for leaf in definition.leaves.values())
            asked = [
                FieldRequest(leaf.name, leaf.name, leaf.kind.removesuffix("s"), 0 if several else None)
                for leaf, several in every
            ]
            columns(definition, message, asked)


def targets() -> dict[str, tuple[Target, list[bytes]]]:
    """Return each target and the whole inputs it begins with."""
    from terrain_cli import models
    from terrain_cli import rover as rovers
    from terrain_cli.effects.laws import effect_file, grammar
    from terrain_cli.telemetry import Condition
    from terrain_cli.vocabulary import toml_files

    rover = (HERE.parent / "sample_data" / "rover.toml").read_bytes()
    effect = EFFECT.encode()
    bags, plain = small_bags(), small_bags(lists=False)
    found = {
        "laws": (text_target(grammar.parse), [b"a + b*sin(c)^2", b"where(slip > 0.2 and not a < 1, 1e-3, -x)"]),
        "conditions": (text_target(Condition), [b"slip_angle_deg == 0 and terrain != 'rock'", b"`a [b]` > 1 or not (c <= 2)"]),
        "toml": (text_target(lambda text: toml_files.parse(text, "x")), [rover, effect, b'a.b."c" = [1, {d = 2}]\n[[e]]\nf = 1979-05-27T07:32:00Z']),
        "rover": (file_target("rover.toml", rovers.load), [rover]),
        "effect": (text_target(effect_file.parse), [effect]),
        "model": (file_target("model.toml", models.resolve), [MODEL.encode()]),
        "msg": (text_target(lambda text: define(text, idl=False)), [m.encode() for m in MESSAGES]),
        "idl": (text_target(lambda text: define(text, idl=True)), [IDL.encode()]),
        "metadata": (file_target("metadata.yaml", read_recording), [bags["metadata"][0]]),
        "csv": (file_target("a.csv", read_source), TABLES),
        "csv-salvage": (file_target("a.csv", lambda path: read_source(path, salvage=True)), TABLES),
        "packed": (file_target("a.csv.gz", lambda path: read_source(path, salvage=True)), packed()),
        "parquet": (file_target("a.parquet", read_source), parquet()),
    }  # fmt: skip
    for kind in ("ros1", "mcap", "db3"):
        found[kind] = file_target("a", read_source), bags[kind]
        read = file_target("a", lambda path: read_source(path, salvage=True))
        found[f"{kind}-salvage"] = read, [bags[kind][0], *plain[kind]]
    return found


MESSAGES = [
    "std_msgs/Header header\nstring[] name\nfloat64[] effort\nfloat64[9] k\nint32 A=3\n"
    + "=" * 80
    + "\nMSG: std_msgs/Header\nbuiltin_interfaces/Time stamp\nstring frame_id\n",
    "float32 x 1.5\nstring<=5 s\nC[<=3] c # none\n" + "=" * 80 + "\nMSG: a/C\nuint8 d\nbool e\n",
]
IDL = """module a { module msg { module B_Constants { const uint8 X = 1; };
typedef double double__3[3];
@verbatim (language="comment", text="text")
struct C { string<8> e; };
struct B { sequence<double, 3> y; double__3 z; a::msg::C c; sequence<a::msg::C> f; };
}; };"""
EFFECT = """id = "cable-drag"
title = "Umbilical drags on the carriage"
changes = "drawbar_pull"
law = "drawbar_pull - cd * abs(yaw_rate)"
needs = ["yaw_rate"]
[parameters.cd]
unit = "N s/rad"
null = 0.0
scale = 10.0
lower = 0.0
reference = "none"
"""
MODEL = """format = "terrain-est/model/1"
base = "wong-reece"
effects = ["slip-sinkage"]
[fixed]
shear_modulus = 0.018
"""
TABLES = [
    b"time,load,torque\n0,80.5,1.5\n0.1,81,-2e-3\n0.2,,nan\n",
    b'# x\n"time";"load [kN]"\r\n2024-01-01T00:00:00Z;0,5\r\n2024-01-01T00:00:01Z;1,25e1\r\n',
    "time\tterrain\n1\tsand\n2\tBöschung\n".encode(),
]


def packed() -> list[bytes]:
    """Return tables packed in each way."""
    import bz2
    import gzip

    from formats.rosbag.storage.raw_messages import zstd

    return [pack(TABLES[0] * 3) for pack in (gzip.compress, bz2.compress, zstd.compress)]


def parquet() -> list[bytes]:
    """Return a small table in several encodings."""
    import io

    import pyarrow as pa
    import pyarrow.parquet as pq

    table = pa.table({"time": [0.0, 0.1, None], "n": [1, 2, 3], "terrain": ["a", "b", "a"]})
    files = []
    for options in (
        {},
        {"compression": "gzip", "use_dictionary": False},
        {"data_page_version": "2.0", "write_page_checksum": True},
    ):
        sink = io.BytesIO()
        pq.write_table(table, sink, **options)
        files.append(sink.getvalue())
    return files


def small_bags(*, lists: bool = True) -> dict[str, list[bytes]]:
    """Return small bags of each kind, packed in each way; with lists in their messages or without."""
    from bags import typestore, write_ros1, write_ros2

    def rows():
        for i in range(5):
            name = ["fl", "fr"] if lists else "fl"
            yield "/j", "a/msg/J", 10**18 + i, {"name": name, "effort": [i / 8, -i] if lists else i / 8}
            yield "/s", "a/msg/F", 10**18 + i, {"data": i / 4}

    # Of lists rosbags writes code, which takes most of the time of a small file.
    brackets = "[]" * lists
    own = {"a/msg/J": f"string{brackets} name\nfloat64{brackets} effort\n", "a/msg/F": "float64 data\n"}

    found: dict[str, list[bytes]] = {"ros1": [], "mcap": [], "db3": [], "metadata": []}
    with tempfile.TemporaryDirectory() as folder:
        for k, compression in enumerate(("none", "bz2", "lz4")):
            file = write_ros1(Path(folder, f"{k}.bag"), rows(), typestore(own, ros1=True), compression, 300)
            found["ros1"].append(file.read_bytes())
        for k, compression in enumerate(("none", "zstd", "lz4")):
            target = Path(folder, f"m{k}")
            file = write_ros2(target, rows(), typestore(own, ros1=False), "mcap", compression, chunk=400)
            found["mcap"].append(file.read_bytes())
            found["metadata"].append(
                (target / "metadata.yaml").read_bytes().replace(file.name.encode(), b"run.mcap")
            )
        file = write_ros2(Path(folder, "d"), rows(), typestore(own, ros1=False), "db3")
        found["db3"].append(file.read_bytes())
    return found
