"""The fast way gives bit for bit what decoding message by message gives."""

from __future__ import annotations

from functools import cache

import numpy as np
import plain_decoding
import pytest
from bags import message, typestore
from drawn import NAMES, Values, types
from hypothesis import HealthCheck, assume, given
from hypothesis import strategies as st
from plain_decoding import extract
from profiles import examples
from rosbags.serde import SerdeError
from rosbags.typesys import Stores, get_typestore

from formats.rosbag import decoder
from formats.rosbag.bulk_extraction import UnevenError, gather
from formats.rosbag.decoder import UndecodableError
from formats.rosbag.definitions import Definition, FieldRequest, find_leaves
from formats.rosbag.storage.raw_messages import of_payloads


def requests(definition):
    wanted = []
    for leaf in definition.leaves.values():
        if leaf.kind in {"number", "text", "time"}:
            wanted.append((leaf, FieldRequest(leaf.name, leaf.name, leaf.kind)))
            continue
        kind = {"numbers": "number", "texts": "text"}[leaf.kind]
        keys = [0, 2, *([*NAMES, "nobody"] if leaf.names else [])]
        wanted += [(leaf, FieldRequest(f"{leaf.name}[{key}]", leaf.name, kind, key)) for key in keys]
    return wanted


def same(fast, slow, wanted):
    for (values, present), (expected, expected_present), (_, request) in zip(fast, slow, wanted, strict=True):
        assert present == expected_present, request
        assert values.dtype == expected.dtype, request
        if values.dtype == float:  # −0.0 is not 0.0
            np.testing.assert_array_equal(np.signbit(values), np.signbit(expected))
        np.testing.assert_array_equal(values, expected, err_msg=str(request))


def compare(definition, payloads, *, must_be_fast):
    wanted = requests(definition)
    messages = list(map(plain_decoding.decoder(definition), payloads))
    slow = [extract(messages, *pair) for pair in wanted]
    try:
        fast = gather(definition, of_payloads(payloads), wanted)
    except UnevenError:
        assert not must_be_fast
        fast = slow
    same(fast, slow, wanted)
    same(decoder.columns(definition, of_payloads(payloads), [request for _, request in wanted]), slow, wanted)
    return dict(zip((request.asked for _, request in wanted), (values for values, _ in fast), strict=True))


def define(store, name, *, ros1):
    return Definition(
        type=name,
        ros1=ros1,
        types=store.fielddefs,
        leaves=find_leaves(store.fielddefs, name),
    )


@examples(250, suppress_health_check=list(HealthCheck))
@given(
    types(),
    st.integers(0, 2**32),
    st.integers(1, 6),
    st.sampled_from(["ros1", "<", ">"]),
    st.booleans(),
    st.booleans(),
)
def test_fast_equals_plain(made, seed, rows, order, even_numbers, even_items):
    store = get_typestore(Stores.EMPTY)
    store.register(made)
    name = list(made)[-1]
    ros1 = order == "ros1"
    definition = define(store, name, ros1=ros1)
    values = Values(store, seed, even_numbers=even_numbers, even_items=even_items)
    messages = [values.message(name) for _ in range(rows)]
    payloads = [
        bytes(
            store.serialize_ros1(message, name)
            if ros1
            else store.serialize_cdr(message, name, little_endian=order == "<")
        )
        for message in messages
    ]
    compare(definition, payloads, must_be_fast=even_items)


def pack(text, rows, order):
    """Serialise messages of one custom type; return its definition and their payloads."""
    ros1 = order == "ros1"
    store = typestore({"x_msgs/msg/T": text, "x_msgs/msg/Wheel": WHEEL}, ros1=ros1)
    messages = [message(store, "x_msgs/msg/T", row) for row in rows]
    payloads = [
        bytes(
            store.serialize_ros1(m, "x_msgs/msg/T")
            if ros1
            else store.serialize_cdr(m, "x_msgs/msg/T", little_endian=order == "<")
        )
        for m in messages
    ]
    return define(store, "x_msgs/msg/T", ros1=ros1), payloads


WHEEL = "string name\nfloat32 torque\nfloat64 sinkage\n"
orders = pytest.mark.parametrize("order", ["ros1", "<", ">"])


@orders
@pytest.mark.parametrize("lengths", [(0, 0, 0), (0, 2, 0), (1, 1, 1), (3, 0, 1)])
def test_an_empty_list_adds_no_gap(order, lengths):
    rows = [{"a": [0.5] * n, "b": 7, "c": [1] * n, "d": -3} for n in lengths]
    definition, payloads = pack("float64[] a\nint32 b\nuint64[] c\nint16 d\n", rows, order)
    columns = compare(definition, payloads, must_be_fast=True)
    assert columns["b"].tolist() == [7, 7, 7]
    assert columns["d"].tolist() == [-3, -3, -3]


@orders
def test_any_byte_but_zero_is_true(order):
    definition, payloads = pack("bool a\nbool[2] b\n", [{"a": True, "b": [False, True]}], order)
    payload = payloads[0].replace(b"\x01\x00\x01", b"\x02\x00\x80")
    assert payload != payloads[0]
    columns = compare(definition, [payload], must_be_fast=True)
    assert (columns["a"].item(), columns["b[0]"].item()) == (1.0, 0.0)


@orders
def test_names_may_change_their_order_and_number_of_letters(order):
    rows = [
        {"name": ["fl", "front_right"], "effort": [1.0, 2.0]},
        {"name": ["front_right", "fl"], "effort": [2.5, 1.5]},
        {"name": ["fl", "fl"], "effort": [1.25, 9.0]},
        {"name": ["rl", "fl"], "effort": [9.0]},
    ]
    definition, payloads = pack("string[] name\nfloat64[] effort\n", rows, order)
    leaf = definition.leaves["effort"]
    wanted = [(leaf, FieldRequest("e", "effort", "number", key)) for key in ("fl", "front_right", "rl", 1)]
    columns = [values.tolist() for values, _ in gather(definition, of_payloads(payloads), wanted)]
    np.testing.assert_array_equal(
        columns, [[1, 1.5, 1.25, np.nan], [2, 2.5, np.nan, np.nan], [np.nan] * 3 + [9], [2, 1.5, 9, np.nan]]
    )
    compare(definition, payloads, must_be_fast=True)


@orders
def test_lists_of_messages_by_place_and_by_name(order):
    def wheel(name, torque):
        return {"name": name, "torque": torque, "sinkage": torque / 8}

    rows = [
        {"wheels": [wheel("fl", 1.0), wheel("rear", 2.0)]},
        {"wheels": [wheel("rear", 4.0), wheel("fl", 3.0)]},
        {"wheels": [wheel("x", 4.0), wheel("x", 3.0)]},
    ]
    definition, payloads = pack("Wheel[] wheels\nuint8 end\n", rows, order)
    assert list(definition.leaves) == ["wheels.name", "wheels.torque", "wheels.sinkage", "end"]
    leaf = definition.leaves["wheels.sinkage"]
    wanted = [(leaf, FieldRequest("s", "wheels.sinkage", "number", key)) for key in ("fl", "rear", "x", 1, 2)]
    results = gather(definition, of_payloads(payloads), wanted)
    nan = np.nan
    np.testing.assert_array_equal(
        [values for values, _ in results],
        [[1 / 8, 3 / 8, nan], [2 / 8, 4 / 8, nan], [nan, nan, 4 / 8], [2 / 8, 3 / 8, 3 / 8], [nan] * 3],
    )
    assert [present for _, present in results] == [True, True, True, True, False]
    compare(definition, payloads, must_be_fast=True)


@orders
@pytest.mark.parametrize("counts", [(1, 2), (2, 1), (300, 300)])
def test_lists_of_as_many_messages_or_not(order, counts):
    rows = [{"wheels": [{"name": f"w{i}", "torque": i} for i in range(n)], "end": 5} for n in counts]
    definition, payloads = pack("Wheel[] wheels\nuint8 end\n", rows, order)
    if counts[0] != counts[1]:
        with pytest.raises(UnevenError):
            gather(definition, of_payloads(payloads), requests(definition))
    columns = decoder.columns(
        definition,
        of_payloads(payloads),
        [FieldRequest("t", "wheels.torque", "number", "w1"), FieldRequest("end", "end", "number")],
    )
    np.testing.assert_array_equal(columns[0][0], [np.nan if count == 1 else 1 for count in counts])
    assert columns[1][0].tolist() == [5, 5]


def test_both_byte_orders_in_one_topic():
    rows = [{"a": 1, "b": [2.5]}, {"a": 3, "b": [4.5]}]
    definition, little = pack("int32 a\nfloat64[] b\n", rows, "<")
    _, big = pack("int32 a\nfloat64[] b\n", rows, ">")
    columns = compare(definition, [little[0], big[1]], must_be_fast=False)
    assert columns["a"].tolist() == [1, 3]
    assert columns["b[0]"].tolist() == [2.5, 4.5]


TEXT = "string s\nfloat64[] a\nstring[] name\nWheel[] wheels\nuint16 end\n"
ROW = {"s": "abc", "a": [1.0, 2.0], "name": ["x", "yy"], "wheels": [{"name": "fl", "torque": 1.5}], "end": 9}


@cache
def whole_message(order):
    """Return the definition of a message, its payload, and what decodes it the plain way."""
    definition, (payload,) = pack(TEXT, [ROW], order)
    return definition, payload, plain_decoding.decoder(definition)


@orders
def test_a_message_cut_anywhere_is_never_read_as_something_else(order):
    definition, whole, _ = whole_message(order)
    asked = [request for _, request in requests(definition)]
    for size in range(len(whole)):
        with pytest.raises(UndecodableError) as caught:
            decoder.columns(definition, of_payloads([whole, whole[:size], whole]), asked)
        assert caught.value.row == 1


@orders
def test_bytes_left_over(order):
    definition, whole, _ = whole_message(order)
    asked = [FieldRequest("end", "end", "number")]
    if order != "ros1":  # CDR may be padded
        assert decoder.columns(definition, of_payloads([whole, whole + bytes(3)]), asked)[0][0].tolist() == [
            9,
            9,
        ]
    with pytest.raises(UndecodableError) as caught:
        decoder.columns(definition, of_payloads([whole, whole, whole + bytes(4)]), asked)
    assert caught.value.row == 2


@orders
def test_of_several_wrong_messages_the_first_is_told(order):
    definition, whole, _ = whole_message(order)
    payloads = [whole, whole + bytes(8), whole[:-3], whole]
    with pytest.raises(UndecodableError, match="longer than its members") as caught:
        decoder.columns(definition, of_payloads(payloads), [FieldRequest("end", "end", "number")])
    assert caught.value.row == 1


@examples(150)
@given(st.data(), st.sampled_from(["ros1", "<", ">"]))
def test_damaged_bytes_give_an_error_or_what_the_plain_way_gives(data, order):
    definition, whole, decoded = whole_message(order)
    broken = bytearray(whole)
    for _ in range(data.draw(st.integers(1, 3))):
        broken[data.draw(st.integers(0, len(whole) - 1))] = data.draw(st.integers(0, 255))
    wanted = requests(definition)
    try:
        messages = [decoded(whole), decoded(bytes(broken))]
    except SerdeError as error:
        assume("utf-8" not in str(error))  # only texts that are asked for are decoded the fast way
        with pytest.raises(UndecodableError):
            decoder.columns(
                definition, of_payloads([whole, bytes(broken)]), [request for _, request in wanted]
            )
    else:
        slow = [extract(messages, *pair) for pair in wanted]
        both = of_payloads([whole, bytes(broken)])
        same(decoder.columns(definition, both, [request for _, request in wanted]), slow, wanted)


@orders
def test_a_text_that_is_not_utf8_harms_only_who_asks_for_it(order):
    definition, (whole,) = pack("string s\nuint16 end\n", [{"s": "ab", "end": 9}], order)
    broken = whole.replace(b"ab", b"\xe4b")
    assert decoder.columns(definition, of_payloads([broken]), [FieldRequest("end", "end", "number")])[0][
        0
    ].tolist() == [9]
    with pytest.raises(UndecodableError):
        decoder.columns(definition, of_payloads([broken]), [FieldRequest("s", "s", "text")])


def test_an_encapsulation_that_is_not_plain_cdr():
    definition, (whole,) = pack("int32 a\n", [{"a": 1}], "<")
    with pytest.raises(UndecodableError, match="encapsulation"):
        decoder.columns(
            definition, of_payloads([b"\x00\x07" + whole[2:]]), [FieldRequest("a", "a", "number")]
        )
