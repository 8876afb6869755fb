"""Texts of message definitions before rosbags sees them, whose parser and code generator trust them.

rosbags writes Python for each type and runs it, and its parser of IDL takes time that grows with 64 to the
power of nested brackets. So a text is measured before it is parsed, and of what was parsed only checked names
and numbers go on.
"""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, NamedTuple

from rosbags.interfaces import Nodetype
from rosbags.typesys.base import normalize_fieldname

from formats import limits
from formats.limits import LEAVES, TooMuchError

if TYPE_CHECKING:
    from rosbags.interfaces.typing import FieldDesc, Typesdict

_TYPE_NAME = re.compile(r"[A-Za-z][A-Za-z0-9_]*(/[A-Za-z][A-Za-z0-9_]*)+")
_FIELD_NAME = re.compile(r"[A-Za-z][A-Za-z0-9_]*")
#: What may hold anything: comments, texts, single characters.
_OPAQUE = re.compile(r"""//[^\n]*|/\*.*?\*/|"(?:\\.|[^"\\])*"|'(?:\\.|[^'\\])*'""", re.DOTALL)
#: Annotations have the only round brackets that the ROS tools write, none of them nested.
_ANNOTATION = re.compile(r"@[A-Za-z_][A-Za-z0-9_:]*\s*\([^()]*\)")
_LONGEST_NAME = 256
#: ``sequence<string<8>, 4>``
_ANGLES = 2
_CONSTANTS = 2_000


def msg_text(text: str) -> str:
    """Return a definition in the language MSG without blank lines and comments, if it is within bounds."""
    _check_length(text)
    lines = [line for line in text.split("\n") if line.strip() and not line.lstrip().startswith("#")]
    if len(lines) > limits.DEFINITION_LINES:
        raise TooMuchError(f"a message definition has more than {limits.DEFINITION_LINES:,} lines")
    return "\n".join(lines) + "\n"


def check_idl(text: str) -> None:
    """Refuse a definition in the language IDL that would take long to parse."""
    _check_length(text)
    bare = _ANNOTATION.sub(" ", _OPAQUE.sub(" ", text))
    if any(sign in bare for sign in ("(", "<<", "*", '"', "'")) or bare.count("const ") > _CONSTANTS:
        raise TooMuchError("a message definition calculates where it should name")
    depth = 0
    for sign in re.findall("[<>]", bare):
        depth += 1 if sign == "<" else -1
        if depth > _ANGLES:
            raise TooMuchError("a message definition has lists within lists within lists")


def checked(types: Typesdict) -> Typesdict:
    """Return parsed types as code may be written from them: no constants, and each name an identifier."""
    if len(types) > limits.DEFINITION_TYPES:
        raise TooMuchError(f"a message definition has more than {limits.DEFINITION_TYPES:,} types")
    elements = 0
    for name, (_, fields) in types.items():
        _check_name(name, _TYPE_NAME)
        if len(fields) > LEAVES:
            raise TooMuchError(f"a message has more than {LEAVES:,} fields")
        for field, desc in fields:
            _check_name(field, _FIELD_NAME)
            elements += _check_field(desc)
    if elements > LEAVES:
        raise TooMuchError(f"the lists of a message have more than {LEAVES:,} elements")
    known: dict[str, _Extent] = {}
    for name in types:
        _measure(name, types, known)
    for name, (_, fields) in types.items():
        if len({normalize_fieldname(field) for field, _ in fields}) < len(fields):
            raise ValueError(f"members of {name} have one name")
    return {name: ([], fields) for name, (_, fields) in types.items()}


def _check_length(text: str) -> None:
    if len(text) > limits.DEFINITION_CHARACTERS:
        raise TooMuchError(f"a message definition has more than {limits.DEFINITION_CHARACTERS:,} characters")


def _check_name(name: str, pattern: re.Pattern[str]) -> None:
    if len(name) > _LONGEST_NAME or not pattern.fullmatch(name):
        raise TooMuchError(f"{name[:60]!r} is no name")


def _check_field(desc: FieldDesc) -> int:
    """Return the elements of a list of texts or messages whose length is fixed."""
    if desc[0] not in {Nodetype.ARRAY, Nodetype.SEQUENCE}:
        if desc[0] == Nodetype.NAME:
            _check_name(desc[1], _TYPE_NAME)
        return 0
    element, length = desc[1]
    if not 0 <= length < 2**32:
        raise TooMuchError("the length of a list is no number that a message can have")
    if element[0] == Nodetype.NAME:
        _check_name(element[1], _TYPE_NAME)
    elif element[1][0] != "string":
        return 0
    if desc[0] == Nodetype.SEQUENCE:
        return 0
    if length > limits.FIXED_LIST:
        raise TooMuchError(f"a list has {length:,} elements by definition; {limits.FIXED_LIST:,} at most")
    return int(length)


class _Extent(NamedTuple):
    """Of one message type: fields down to the last member, fewest bytes, nesting."""

    leaves: int
    size: int
    depth: int


def _measure(name: str, types: Typesdict, known: dict[str, _Extent]) -> _Extent:
    """Measure a type once; refuse lists of what takes no byte, which nothing would end."""
    if name in known or name not in types:
        # What is missing or contains itself is told where the fields are listed.
        return known.get(name, _Extent(1, 1, 1))
    known[name] = _Extent(1, 1, 1)
    leaves = size = depth = 0
    for _, desc in types[name][1]:
        if desc[0] == Nodetype.BASE:
            leaves, size = leaves + 1, size + 1
            continue
        if desc[0] == Nodetype.NAME:
            part = _measure(desc[1], types, known)
            size += part.size
        else:
            element, length = desc[1]
            part = _measure(element[1], types, known) if element[0] == Nodetype.NAME else _Extent(1, 1, 0)
            if part.size == 0:
                raise TooMuchError(f"a list of {element[1]}, which has no fields")
            size += 4 if desc[0] == Nodetype.SEQUENCE else part.size * length
        leaves, depth = leaves + part.leaves, max(depth, part.depth)
        if leaves > LEAVES:
            raise TooMuchError(f"a message has more than {LEAVES:,} fields")
    if depth >= limits.DEPTH:
        raise TooMuchError(f"its members nest deeper than {limits.DEPTH}")
    known[name] = _Extent(leaves, size, depth + 1)
    return known[name]
