"""A fast parser of plain message definitions in the language MSG; the rest goes to rosbags.

rosbags' parser tries every rule of the grammar at every place: 20 ms for the ten types of a rover's
bag, a third of what reading one minute takes; this 1 ms. It is given what is more than names, lists,
comments and whole-number constants, and everything that is wrong.
"""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, cast

from rosbags.interfaces import Nodetype
from rosbags.typesys.msg import normalize_msgtype

if TYPE_CHECKING:
    from rosbags.interfaces.typing import BaseDesc, Basename, FieldDesc, NameDesc, Typesdict

_BASE = r"(?:bool|byte|char|float(?:32|64)|u?int(?:8|16|32|64)|string)\b"
_NAMED = r"(?:[a-z][a-z0-9]*(?:_[a-z0-9]+)*/)*[A-Za-z][A-Za-z0-9]*(?:_[A-Za-z0-9]+)*"
_END = r"[ \t]*(?:#.*)?"
_FIELD = re.compile(
    rf"[ \t]*(?:string<=(?P<letters>[0-9]{{1,9}})|(?P<base>{_BASE})|(?!{_BASE})(?P<named>{_NAMED}))"
    rf"(?P<list>\[(?:(?P<most><=)?(?P<length>[0-9]{{1,9}}))?\])?[ \t]+(?P<name>[A-Za-z][A-Za-z0-9_]*){_END}"
)
_CONSTANT = re.compile(
    rf"[ \t]*{_BASE}[ \t]+[A-Z][A-Z0-9]*(?:_[A-Z0-9]+)*[ \t]*=[ \t]*-?(?:0|[1-9][0-9]*){_END}"
)
_BAR = "=" * 80
_HEAD = re.compile(r"MSG: ([A-Za-z0-9/_]+)[ \t]*")
_SHORT = {
    "time": "builtin_interfaces/msg/Time",
    "duration": "builtin_interfaces/msg/Duration",
    "Header": "std_msgs/msg/Header",
}


def plain_types(text: str, name: str) -> Typesdict | None:
    """Parse a definition from `msg_text`, the first type in it of this name.

    What `rosbags.typesys.get_types_from_msg` returns, without constants; None where it is for rosbags to
    parse.
    """
    types: Typesdict = {}
    lines = iter([f"MSG: {name}", *filter(None, text.split("\n"))])
    for line in lines:
        if line == _BAR or not types:
            if (head := _HEAD.fullmatch(next(lines, "") if types else line)) is None:
                return None
            owner = normalize_msgtype(head[1])
            types[owner] = [], []
        elif (field := _FIELD.fullmatch(line)) is not None:
            types[owner][1].append((field["name"], _type(field, owner)))
        elif _CONSTANT.fullmatch(line) is None:
            return None
    return types


def _type(field: re.Match[str], owner: str) -> FieldDesc:
    inner: BaseDesc | NameDesc
    if field["named"]:
        inner = Nodetype.NAME, _full_name(_SHORT.get(field["named"], field["named"]), owner)
    else:
        inner = Nodetype.BASE, (cast("Basename", field["base"] or "string"), int(field["letters"] or 0))
    if not field["list"]:
        return inner
    if field["length"] and not field["most"]:
        return Nodetype.ARRAY, (inner, int(field["length"]))
    return Nodetype.SEQUENCE, (inner, int(field["length"] or 0))


def _full_name(name: str, owner: str) -> str:
    """Return the name of a type with its package; without one it is in that of the type that has it."""
    package, _, last = name.rpartition("/")
    if not package:
        return f"{owner.rpartition('/')[0]}/{name}"
    return name if "/msg/" in name or "/action/" in name else f"{package}/msg/{last}"
