"""The checksum of a ROS 1 message definition, which each connection notes beside the definition.

As ``genmsg`` computes it: MD5 of the constants, then of the fields in their order, without comments
and spaces, each message type in place of which its own checksum stands.
"""

from __future__ import annotations

import re
from hashlib import md5

_BUILT_IN = frozenset(
    {"bool", "byte", "char", "string", "time", "duration", "float32", "float64"}
    | {f"{sign}int{bits}" for sign in ("", "u") for bits in (8, 16, 32, 64)}
)
_DEEPEST = 50


class _UnknownError(Exception):
    """Not all that the checksum covers can be told."""


def checksum(text: str, type_name: str) -> str | None:
    """Return the checksum of a definition, behind which are those of its parts, as bags hold it.

    None where it cannot be told: a type is missing, or a constant is a number with a fraction or a text,
    which tools write in more than one way.
    """
    main, *others = re.split(r"^=+\n", text, flags=re.MULTILINE)
    sections = {_short(type_name): main}
    for section in others:
        first, _, rest = section.partition("\n")
        sections[first.removeprefix("MSG:").strip()] = rest
    try:
        return _of(_short(type_name), sections, {}, 0)
    except _UnknownError:
        return None


def _short(name: str) -> str:
    return name.replace("/msg/", "/")


def _of(name: str, sections: dict[str, str], known: dict[str, str], depth: int) -> str:
    if name in known:
        return known[name]
    if name not in sections or depth > _DEEPEST:
        raise _UnknownError
    constants, fields = [], []
    for line in sections[name].split("\n"):
        kind, _, rest = line.partition("#")[0].strip().partition(" ")
        rest = rest.strip()
        if not kind:
            continue
        if "=" in rest:
            if kind in {"string", "float32", "float64"}:
                raise _UnknownError
            constant, _, value = rest.partition("=")
            constants.append(f"{kind} {constant.strip()}={value.strip()}")
            continue
        base = kind.partition("[")[0]
        if base in _BUILT_IN:
            fields.append(f"{kind} {rest}")
            continue
        package = name.partition("/")[0]
        full = "std_msgs/Header" if base == "Header" else base if "/" in base else f"{package}/{base}"
        fields.append(f"{_of(full, sections, known, depth + 1)} {rest}")
    known[name] = md5("\n".join([*constants, *fields]).encode(), usedforsecurity=False).hexdigest()
    return known[name]
