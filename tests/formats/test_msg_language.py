"""Plain definitions parsed here are what rosbags parses, and the others are left to it."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st
from profiles import examples
from rosbags.typesys import Stores, TypesysError, get_types_from_msg, get_typestore

from formats.rosbag.decoding.definition_texts import msg_text, plain_types

BAR = "=" * 80


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
