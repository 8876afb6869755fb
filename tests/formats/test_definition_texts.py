"""What many small parts of a definition may cost together; plain ones are parsed as rosbags does."""

from __future__ import annotations

import bz2
import gzip

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from hypothesis import given
from hypothesis import strategies as st
from profiles import examples
from rosbags.typesys import Stores, TypesysError, get_types_from_msg, get_typestore
from salvage_cases import opened, samples, write

from formats import DamagedError, FormatError, content, limits, open_source
from formats.rosbag.definition_texts import msg_text, plain_types
from formats.rosbag.storage.raw_messages import unpack, zstd

salvage = pytest.mark.parametrize("salvage", [True, False])
BAR = "=" * 80


@salvage
@pytest.mark.parametrize(("kind", "packing"), [("ros1", "bz2"), ("mcap", "zstd"), ("mcap", "message")])
def test_all_chunks_of_a_bag_together(tmp_path, kind, packing, salvage, monkeypatch):
    """Each is within its own bound."""
    path = write(tmp_path, kind, packing)
    path = path.parent if packing == "message" else path
    assert samples(opened(path, kind, salvage=salvage))
    monkeypatch.setattr(limits, "FILE_BYTES", 8_000)
    monkeypatch.setattr(limits, "UNPACKED_RATIO", 0)
    with pytest.raises(DamagedError, match="its parts unpack to more than 8,000 bytes together"):
        samples(opened(path, kind, salvage=salvage))


@pytest.mark.parametrize("packing", ["bz2", "zstd", "lz4"])
def test_a_chunk_becomes_no_more_than_it_says(packing):
    import lz4.frame

    pack = {"bz2": bz2.compress, "zstd": zstd.compress, "lz4": lz4.frame.compress}[packing]
    packed = pack(bytes(5_000))
    assert unpack(packed, packing, 5_000) == bytes(5_000)
    with pytest.raises(limits.TooMuchError, match="more than 4,999 bytes"):
        unpack(packed, packing, 4_999)


@salvage
@pytest.mark.parametrize("pack", [bytes, gzip.compress], ids=["plain", "gzip"])
def test_nul_bytes_without_end(tmp_path, pack, salvage, monkeypatch):
    monkeypatch.setattr(content, "NUL_BYTES", 1 << 20)
    path = tmp_path / "log.csv"
    head = b"time,load\n" + b"0.5,81.25\n" * 30_000
    for count in (1000, 3 << 20):
        path.write_bytes(pack(head + bytes(count)))
        if count == 1000:
            source = open_source(str(path), salvage=salvage)
            assert sum(len(batch["time"]) for batch in source.read("", ["time"])) == 30_000
            continue
        with pytest.raises(DamagedError, match=r"up to line 30002 .* than 1,048,576 NUL") as caught:
            list(open_source(str(path), salvage=salvage).read("", ["time"]))
        assert "tr -d" in caught.value.hint


@salvage
def test_a_line_without_end(tmp_path, salvage):
    path = tmp_path / "log.csv"
    path.write_bytes(b"time,load\n" + b"0.5,81.25\n" * 30_000 + b"7" * (40 << 20))
    with pytest.raises(FormatError) as caught:
        list(open_source(str(path), salvage=salvage).read("", ["time"]))
    assert "\n" not in str(caught.value)


def test_equal_rows_of_parquet(tmp_path):
    """Within the bound of rows, but far beyond that of what they become."""
    path = tmp_path / "log.parquet"
    rows = 10_000_000
    same = pa.DictionaryArray.from_arrays(np.zeros(rows, np.int8), pa.array([81.25]))
    pq.write_table(pa.table({f"c{k}": same for k in range(15)}), path)
    source = open_source(str(path))
    assert len(next(iter(source.read("", ["c0"])))["c0"])
    with pytest.raises(DamagedError, match=r"15 columns of it become 1,200,000,000 bytes") as caught:
        next(iter(source.read("", [f"c{k}" for k in range(15)])))
    assert "CSV" in caught.value.hint


def test_columns_of_parquet(tmp_path, monkeypatch):
    path = tmp_path / "log.parquet"
    monkeypatch.setattr("formats.limits.COLUMNS", 4)
    pq.write_table(pa.table({f"c{k}": [1.0] for k in range(5)}), path)
    with pytest.raises(FormatError, match="has 5 columns; 4 at most are read"):
        open_source(str(path))


def test_aliases_in_metadata(tmp_path):
    """Nine lines of them stand for a thousand million texts."""
    path = write(tmp_path, "mcap")
    lines = ["a0: &a0 [x, x, x, x, x, x, x, x, x, x]"]
    lines += [f"a{k}: &a{k} [{', '.join([f'*a{k - 1}'] * 10)}]" for k in range(1, 9)]
    told = path.with_name("metadata.yaml")
    told.write_text("\n".join(lines) + "\n" + told.read_text() + "  compression_mode: *a8\n")
    with pytest.raises(DamagedError, match="aliases"):
        opened(path.parent, "mcap", salvage=False)
    assert "metadata.yaml is damaged" in "\n".join(opened(path.parent, "mcap").remarks)


def by_rosbags(text, name="a/msg/B"):
    return {key: ([], fields) for key, (_, fields) in get_types_from_msg(text, name).items()}


@pytest.mark.parametrize("store", [Stores.ROS1_NOETIC, Stores.ROS2_HUMBLE], ids=["ros1", "ros2"])
def test_all_standard_definitions(store):
    types = get_typestore(store)
    left = 0
    for number, name in enumerate(sorted(types.fielddefs)):
        text = msg_text(types.generate_msgdef(name, ros_version=1 if store == Stores.ROS1_NOETIC else 2)[0])
        found = plain_types(text, name)
        left += found is None
        if found is not None and number % 4 == 0:
            assert found == by_rosbags(text, name)
            assert list(found) == list(by_rosbags(text, name))
    assert left < 0.05 * len(types.fielddefs)


#: What lines are made of, right or nearly so.
_TYPES = [
    *("float64", "int8", "int8x", "int8/X", "string", "string<=8", "string<=", "time", "duration", "Header"),
    *("std_msgs/Header", "a_b/msg/C_D", "a__b/C", "a/b/C", "C", "C_", "c", "wstring", "/C", "bool"),
]
_LISTS = ["", "", "", "[]", "[3]", "[<=4]", "[<=]", "[-1]", "[ 3]", "[3", "[99999999999]"]
_NAMES = ["x", "X", "x_", "_x", "x__y", "A_B", "class", "x1", "1x", "ä", ""]
_ENDS = [
    *("", "", "  ", "\t", "\r", "# y", " # y = 2", " #"),
    *("=3", " = -3", "=018", "=0x10", "=yes", " = 3 # z", " 3", " 'a'"),
]
lines = st.builds(
    lambda *parts: "".join(parts),
    st.sampled_from(["", "", "", " ", "\t"]),
    st.sampled_from(_TYPES),
    st.sampled_from(_LISTS),
    st.sampled_from([" ", " ", "  ", "\t", ""]),
    st.sampled_from(_NAMES),
    st.sampled_from(_ENDS),
)
heads = st.sampled_from(
    [
        f"{BAR}\nMSG: a/C",
        f"{BAR}\nMSG: b_c/msg/D ",
        f"{BAR}\nMSG:C",
        f"{BAR} \nMSG: a/C",
        BAR,
        "@key",
        "MSG: a/C",
    ]
)


@examples(500)
@given(st.lists(st.one_of(lines, lines, lines, heads), max_size=4).map("\n".join))
def test_any_text_is_parsed_alike_or_left(text):
    cleaned = msg_text(text)
    found = plain_types(cleaned, "a/msg/B")
    if found is not None:
        assert found == by_rosbags(cleaned)


@pytest.mark.parametrize(
    ("text", "alike"),
    [
        ("float64 x\nuint8 A=3\nint32[<=4] y # z\nstring<=8[2] z\ntime t\nC c\n", True),
        ("float64 x 1.5\n", False),
        ("string A=text\nfloat64 x\n", False),
        ("float64 [[[\n", False),
        (f"C c\n{BAR}\nMSG: a/C\nHeader header\nd/E e\n", True),
        ("\n", True),
    ],
)
def test_what_is_left_to_rosbags(text, alike):
    found = plain_types(msg_text(text), "a/msg/B")
    assert (found is not None) == alike
    if alike:
        assert found == by_rosbags(text)


def test_long_names_take_no_time():
    text = msg_text("a" * 5_000 + "/" + "B_" * 5_000 + " x!\n")
    assert plain_types(text, "a/msg/B") is None
    with pytest.raises(TypesysError):
        by_rosbags(text)
