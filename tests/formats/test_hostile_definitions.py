"""Message definitions made to do harm: without end, and with code in their names and constants."""

from __future__ import annotations

import struct

import pytest
from rosbags.interfaces import Connection, ConnectionExtRosbag2, MessageDefinition, MessageDefinitionFormat

from formats.rosbag.decoder import UndecodableError, columns
from formats.rosbag.definitions import FILLER, UnusableError, define
from formats.rosbag.storage.raw_messages import of_payloads

pytestmark = pytest.mark.usefixtures("soon")


def connection(text, *, idl=False, name="a/msg/B"):
    kind = MessageDefinitionFormat.IDL if idl else MessageDefinitionFormat.MSG
    return Connection(
        1, "/a", name, MessageDefinition(kind, text), "", 1, ConnectionExtRosbag2("cdr", []), None
    )


BAR = "=" * 80 + "\n"
LAUGHS = (
    "B0[] x\n"
    + "".join(f"{BAR}MSG: a/B{i}\n" + f"B{i + 1} a\nB{i + 1} b\n" * 5 for i in range(30))
    + f"{BAR}MSG: a/B30\nint8 x\n"
)
DEEP = (
    "B0 x\n" + "".join(f"{BAR}MSG: a/B{i}\nB{i + 1} a\n" for i in range(200)) + f"{BAR}MSG: a/B200\nint8 x\n"
)


@pytest.mark.parametrize("ros1", [False, True])
@pytest.mark.parametrize(
    ("text", "says"),
    [
        (LAUGHS, "more than 20,000 fields"),
        (DEEP, "nest deeper|cannot be parsed"),
        ("string[100000000] x\n", "100,000,000 elements by definition"),
        (f"C[100000000] x\n{BAR}MSG: a/C\nint8 y\n", "100,000,000 elements by definition"),
        ("".join(f"string[4000] x{i}\n" for i in range(9)), "more than 20,000 elements"),
        (f"C[] x\n{BAR}MSG: a/C\n", "a list of a/msg/C, which has no fields"),
        (f"C[5] x\n{BAR}MSG: a/C\nuint8[0] y\n", "a list of a/msg/C, which has no fields"),
        ("float64 x\n" * 30_000, "more than 20,000 lines"),
        ("# " + "x" * 600_000, "more than 524,288 characters"),
        ("float64[99999999999999999999] x\n", "no number that a message can have"),
        (f"float64 {'x' * 300}\n", "is no name"),
        (f"B x\n{BAR}MSG: a/B\nB x\n", "contains itself|cannot be parsed|conflicting"),
    ],
    ids=lambda value: value[:12] if isinstance(value, str) else value,
)  # fmt: skip
def test_definitions_without_end(text, says, ros1):
    with pytest.raises(UnusableError, match=says):
        define(connection(text), ros1=ros1)


@pytest.mark.parametrize(
    "body",
    [
        "const long A = " + "(" * 4 + "1" + ")" * 4 + "; struct B { long x; };",
        "const long A = 1 << 99999999999; struct B { long x; };",
        "const long A = 9 * 9; struct B { long x; };",
        "const char c = '\"'; const long A = ((((1)))); const char d = '\"'; struct B { long x; };",
        "struct B { " + "sequence<" * 20 + "long" + ">" * 20 + " x; };",
        "struct B { long x[((((2))))]; };",
        "".join(f"const long A{i} = 1; " for i in range(5_000)) + "struct B { long x; };",
    ],
    ids=range(7),
)
def test_idl_that_takes_for_ever(body):
    with pytest.raises(UnusableError, match="a message definition"):
        define(connection(f"module a {{ module msg {{ {body} }}; }};", idl=True), ros1=False)


def test_idl_as_the_tools_write_it():
    text = """// generated from rosidl_adapter/resource/msg.idl.em
#include "std_msgs/msg/Header.idl"
module a { module msg {
  module B_Constants { @verbatim (language="comment", text= "it's (not) 1 << 2 * 3") const uint8 X = 1; };
  typedef double double__3[3];
  @verbatim (language="comment", text= "one" "\\n" "two")
  struct B { /* a (comment) */ double x; sequence<string<8>, 4> y; double__3 z; };
}; };"""
    assert list(define(connection(text.replace("#include", "//"), idl=True), ros1=False).leaves) == [
        "x",
        "y",
        "z",
    ]


@pytest.mark.parametrize(
    "name",
    [
        "a/msg/B:\n    import os",
        "a/msg/B\nint8 x",
        "a/msg/__import__('os')",
        'a/msg/B"""',
        "msg/\x00",
        "/",
        "",
    ],
)
@pytest.mark.parametrize("idl", [False, True])
def test_names_do_not_become_code(name, idl):
    text = "module a { module msg { struct B { long x; }; }; };" if idl else "int8 x\n"
    with pytest.raises(UnusableError):
        define(connection(text, idl=idl, name=name), ros1=False)


@pytest.mark.parametrize("value", ["__import__('os').system('false')", "1e999", "'", "\\"])
def test_constants_do_not_become_code(value):
    """A constant is no part of a message."""
    found = define(connection(f"string A={value}\nfloat32 C=1e999\nint8 x\n"), ros1=False)
    assert list(found.leaves) == ["x"]
    assert found.types["a/msg/B"][0] == []


def test_a_member_called_as_what_the_tools_add():
    definition = define(connection(f"uint8 {FILLER}\nstring[] x\n"), ros1=True)
    with pytest.raises(UndecodableError):
        columns(definition, of_payloads([bytes(5)]), [])


def test_a_list_that_claims_more_than_there_is():
    definition = define(connection(f"C[] x\n{BAR}MSG: a/C\nstring[] y\n"), ros1=True)
    with pytest.raises(UndecodableError):
        columns(definition, of_payloads([struct.pack("<I", 2**32 - 1) + bytes(100)]), [])


def test_more_texts_than_are_walked():
    definition = define(connection("string[] x\n"), ros1=True)
    with pytest.raises(UndecodableError, match="more than 1,000,000 texts"):
        columns(definition, of_payloads([struct.pack("<I", 1_000_001) + bytes(4 * 1_000_001)]), [])
