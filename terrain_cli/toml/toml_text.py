"""Keys and values as TOML writes them."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from datetime import date, time
from numbers import Integral, Real
from typing import Any


def key(name: str) -> str:
    """Write a name as a key."""
    bare = name.isascii() and name.replace("-", "").replace("_", "").isalnum()
    return name if bare else value(name)


def value(content: Any) -> str:
    """Write a value, of NumPy too, on one line; entries of a mapping that are None are left out."""
    for kind, write in _WRITERS:
        if isinstance(content, kind):
            return write(content)
    raise TypeError(f"TOML has no {type(content).__name__}")


def _text(content: str) -> str:
    # As JSON, which leaves alone one control character that TOML does not.
    return json.dumps(content, ensure_ascii=False).replace("\x7f", "\\u007f")


def _list(content: Sequence[Any]) -> str:
    return f"[{', '.join(map(value, content))}]"


def _table(content: Mapping[str, Any]) -> str:
    pairs = (f"{key(name)} = {value(inner)}" for name, inner in content.items() if inner is not None)
    return f"{{ {', '.join(pairs)} }}"


#: The first kind that fits: a bool is an integer to Python.
_WRITERS: tuple[tuple[type, Callable[[Any], str]], ...] = (
    (str, _text),
    (bool, lambda content: str(content).lower()),
    (Integral, lambda content: str(int(content))),
    (Real, lambda content: repr(float(content))),
    # With its time, where it has one.
    (date, lambda content: content.isoformat()),
    (time, time.isoformat),
    (Mapping, _table),
    (list, _list),
    (tuple, _list),
)
