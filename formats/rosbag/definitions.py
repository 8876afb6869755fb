"""Message definitions: from the text in the bag to the fields a person can name.

rosbags trusts the texts: its parser of IDL takes time that grows with 64 to the power of nested brackets. So
a text is measured before it is parsed, and of what was parsed only checked names and numbers go on.
"""

import re
from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, NamedTuple, TypeAlias, cast

import numpy as np
from numpy.typing import NDArray
from rosbags.interfaces import Connection, MessageDefinitionFormat, Nodetype
from rosbags.interfaces.typing import FieldDesc, Typesdict
from rosbags.typesys import Stores, get_types_from_idl, get_types_from_msg, get_typestore

from formats import limits
from formats.limits import LEAVES, TooMuchError
from formats.table import Kind

TIME, DURATION = "builtin_interfaces/msg/Time", "builtin_interfaces/msg/Duration"
HEADER = "std_msgs/msg/Header"
STAMP = "header.stamp"

#: NumPy's code of each base type, without the byte order.
CODES = {
    "bool": "u1", "byte": "i1", "char": "u1",
    "int8": "i1", "int16": "i2", "int32": "i4", "int64": "i8",
    "uint8": "u1", "uint16": "u2", "uint32": "u4", "uint64": "u8",
    "float32": "f4", "float64": "f8",
}  # fmt: skip
#: Lists of these are images, point clouds and the like: never columns.
BLOBS = {"byte", "char", "int8", "uint8"}
MD5_OF_NOTHING = "d41d8cd98f00b204e9800998ecf8427e"
BUILT_IN = get_typestore(Stores.EMPTY).fielddefs  # What rosbags knows of itself, whatever a file says of them
#: rosbags takes longer to parse the definitions of a bag than it takes to read a minute of its messages, and
#: those of the next bag are the same.
_types_of_msg = lru_cache(256)(get_types_from_msg)
_STANDARD = {True: Stores.ROS1_NOETIC, False: Stores.ROS2_HUMBLE}
#: What a message without fields is given by the ROS 2 tools: one byte that means nothing.
FILLER = "structure_needs_at_least_one_member"
_FILLED: tuple[str, FieldDesc] = FILLER, (Nodetype.BASE, ("uint8", 0))
_BAR = "=" * 80 + "\n"  # Between the parts of a definition

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

Path: TypeAlias = tuple[str, ...]
#: float64, datetime64[ns], or object (str, or None where there is none).
Values: TypeAlias = "NDArray[Any]"
NAT = np.datetime64("NaT", "ns")


class UnusableError(Exception):
    """Messages of a connection cannot be decoded; the text says why."""


@dataclass(frozen=True, slots=True)
class Leaf:
    """One field of a message, or one list of numbers or texts."""

    kind: Kind
    base: str  # The base type, or `TIME` or `DURATION`
    path: Path  # The members that lead to the value or to the list
    inner: Path = ()  # The members that lead on from each element, where the elements are messages
    #: What names the elements: the path of the list ``name`` beside them, or ("name",) within each of them.
    names: Path | None = None

    @property
    def name(self) -> str:
        """The dotted path by which a person asks for it."""
        return ".".join(self.path + self.inner)


@dataclass(frozen=True, slots=True)
class FieldRequest:
    asked: str  # As the caller wrote it
    field: str  # Name of the leaf
    kind: Kind  # What comes out, one per message
    #: Which element of a list: its place or its name; None where the field is no list.
    key: int | str | None = None

    def blank(self, rows: int) -> Values:
        if self.kind == "text":
            return np.full(rows, None, dtype=object)
        return np.full(rows, np.nan) if self.kind == "number" else np.full(rows, NAT)


@dataclass(frozen=True, kw_only=True)
class Definition:
    """How the messages of one connection are laid out."""

    type: str  # Name of the message type, as ``sensor_msgs/msg/JointState``
    ros1: bool  # Serialised as ROS 1 does; as CDR if not
    #: This type and those it is made of, as rosbags parses them.
    types: Typesdict
    leaves: dict[str, Leaf]
    origin: str = ""  # Where the definition is from, if not from the file

    @property
    def stamped(self) -> bool:
        """The message begins with a standard header."""
        begins = members(self.types, self.type)[:1] == [("header", (Nodetype.NAME, HEADER))]
        return begins and STAMP in self.leaves


def members(types: Typesdict, type_name: str) -> list[tuple[str, FieldDesc]]:
    if type_name not in types:
        raise UnusableError(f"the definition of {type_name} is missing")
    return types[type_name][1]


def define(connection: Connection, *, ros1: bool) -> Definition:
    """Find the definition of a connection's messages: in the file, or a standard type; UnusableError."""
    reasons = []
    for find, origin in ((_from_file, ""), (_from_standard, "ROS 1 Noetic" if ros1 else "ROS 2 Humble")):
        try:
            types = find(connection, ros1=ros1)
            leaves = find_leaves(types, connection.msgtype)
        except UnusableError as error:
            reasons.append(str(error))
        else:
            name = connection.msgtype
            return Definition(type=name, ros1=ros1, types=types, leaves=leaves, origin=origin)
    raise UnusableError(reasons[0])


def _from_file(connection: Connection, *, ros1: bool) -> Typesdict:
    text = connection.msgdef.data
    blank_on_purpose = ros1 and connection.digest == MD5_OF_NOTHING
    if connection.msgdef.format == MessageDefinitionFormat.NONE or not (text.strip() or blank_on_purpose):
        raise UnusableError("the file has no definition of it")
    try:
        if connection.msgdef.format == MessageDefinitionFormat.MSG:
            types = _checked(_types_of_msg(msg_text(text), connection.msgtype))
        else:
            _check_idl(text)
            parts = (p.partition("\n")[2] if p.startswith("IDL: ") else p for p in text.split(_BAR))
            several = [get_types_from_idl(part) for part in parts if part.strip()]
            types = _checked({name: desc for found in several for name, desc in found.items()})
    except TooMuchError as error:
        raise UnusableError(str(error)) from error
    except Exception as error:  # a damaged text makes rosbags' parser fail in any way
        raise UnusableError("its definition in the file cannot be parsed") from error
    return {name: ([], fields or [_FILLED]) for name, (_, fields) in types.items()} | BUILT_IN


def _from_standard(connection: Connection, *, ros1: bool) -> Typesdict:
    """Take a standard type, if its hash is the one the recorder noted (ROS 2 did not always)."""
    store = get_typestore(_STANDARD[ros1])
    known = connection.msgtype in store.fielddefs
    if known and ros1:
        known = connection.digest == store.generate_msgdef(connection.msgtype)[1]
    elif known and connection.digest:
        known = connection.digest == store.hash_rihs01(connection.msgtype)
    if not known:
        raise UnusableError("it is not a standard type")
    return store.fielddefs


def find_leaves(types: Typesdict, type_name: str) -> dict[str, Leaf]:
    """Return the fields of a message by name, in the order of its definition."""
    return {leaf.name: leaf for leaf in _leaves(types, type_name)}


def _leaves(types: Typesdict, type_name: str, path: Path = (), within: Path = ()) -> Iterator[Leaf]:
    if type_name in within:
        raise UnusableError(f"the definition of {type_name} contains itself")
    within = (*within, type_name)
    own = members(types, type_name)
    lists = {name: desc[1][0] for name, desc in own if desc[0] in {Nodetype.ARRAY, Nodetype.SEQUENCE}}
    texts = {name for name, (node, base) in lists.items() if node == Nodetype.BASE and base[0] == "string"}
    for name, desc in own:
        here = (*path, name)
        if name == FILLER:
            continue
        if desc[0] == Nodetype.BASE or desc[0] == Nodetype.NAME:
            if (leaf := _scalar(desc, here)) is not None:
                yield leaf
            else:
                yield from _leaves(types, cast("str", desc[1]), here, within)
            continue
        element = desc[1][0]
        if element[0] == Nodetype.NAME and element[1] not in {TIME, DURATION}:
            yield from _inner_leaves(types, element[1], here, within)
        elif (leaf := _scalar(element, here)) is not None and leaf.base not in BLOBS and leaf.kind != "time":
            beside = (*path, "name") if "name" in texts and name != "name" else None
            yield Leaf("texts" if leaf.kind == "text" else "numbers", leaf.base, here, names=beside)


def _inner_leaves(types: Typesdict, type_name: str, path: Path, within: Path) -> Iterator[Leaf]:
    """Fields of messages in a list: one list each. Lists within lists are left out."""
    inner = list(_leaves(types, type_name, within=within))
    named = any(leaf.path == ("name",) and leaf.kind == "text" for leaf in inner)
    for leaf in inner:
        if leaf.kind in {"number", "text"}:
            beside = ("name",) if named and leaf.path != ("name",) else None
            yield Leaf("numbers" if leaf.kind == "number" else "texts", leaf.base, path, leaf.path, beside)


def _scalar(desc: FieldDesc, path: Path) -> Leaf | None:
    if desc[0] == Nodetype.NAME:
        kinds: dict[str, Kind] = {TIME: "time", DURATION: "number"}
        return Leaf(kinds[desc[1]], desc[1], path) if desc[1] in kinds else None
    base = cast("str", desc[1][0])
    if base != "string" and base not in CODES:
        raise UnusableError(f"the type {base} of its member {'.'.join(path)} is not supported")
    return Leaf("text" if base == "string" else "number", base, path)


def msg_text(text: str) -> str:
    """Return a definition in the language MSG without blank lines and comments, if it is within bounds."""
    _check_length(text)
    lines = [line for line in text.split("\n") if line.strip() and not line.lstrip().startswith("#")]
    if len(lines) > limits.DEFINITION_LINES:
        raise TooMuchError(f"a message definition has more than {limits.DEFINITION_LINES:,} lines")
    return "\n".join(lines) + "\n"


def _check_idl(text: str) -> None:
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


def _checked(types: Typesdict) -> Typesdict:
    """Return parsed types without their constants, if they are within bounds and each name is one."""
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
        if len({field for field, _ in fields}) < len(fields):
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
