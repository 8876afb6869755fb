"""TOML read strictly, and written: every key must be known, and every value possible.

A rule takes a value and its place in the file, and returns the value as the program wants it.
"""

import errno
import io
import json
import math
import re
import tomllib
from collections.abc import Callable, Iterator, Mapping
from datetime import date, time
from numbers import Integral, Real
from pathlib import Path
from types import MappingProxyType
from typing import Any

from terrain_cli.errors import ConfigurationError, nearest

Rule = Callable[[Any, str], Any]

ABOVE_ZERO = math.ulp(0.0)
_SHOWN = 80  # Characters of a value that an error shows
#: Characters of a file, and parts of a dotted key: tomllib takes time with the square of the latter.
_LONGEST = 4 << 20
_PARTS = 40
_PART = r"""(?:[A-Za-z0-9_-]++|"[^"\n]*+"|'[^'\n]*+')[ \t]*+"""
_DOTTED = re.compile(rf"(?<![A-Za-z0-9_-])(?:{_PART}\.[ \t]*+){{{_PARTS}}}{_PART}")


def read_text(path: str | Path) -> str:
    """Read a file of a person's own, of one that is too long so much that `parse` refuses it."""
    from formats.byte_sources import read_short
    from formats.errors import FormatError

    try:
        # A character of UTF-8 has four bytes at the most.
        data = read_short(str(path), 4 * (_LONGEST + 1))
        text = io.TextIOWrapper(io.BytesIO(data), encoding="utf-8-sig").read(_LONGEST + 1)
    except FormatError as error:
        raise ConfigurationError(str(error)) from error
    except OSError as error:
        what = (error.strerror or str(error)).lower()
        what = {errno.ENOENT: "no such file", errno.EISDIR: "is a folder"}.get(error.errno or 0, what)
        raise ConfigurationError(f"{path}: {what}") from error
    except UnicodeDecodeError as error:
        raise ConfigurationError(f"{path}: not text in UTF-8", hint="save it as UTF-8") from error
    return text


def parse(content: str, path: str | Path) -> dict[str, Any]:
    """Parse TOML; nothing in it is checked."""
    if len(content) > _LONGEST:
        raise ConfigurationError(f"{path}: longer than {_LONGEST:,} characters")
    if _DOTTED.search(content):
        raise ConfigurationError(f"{path}: not TOML: a key has more than {_PARTS} parts")
    try:
        return tomllib.loads(content)
    except RecursionError:
        raise ConfigurationError(f"{path}: not TOML: nested too deep") from None
    except ValueError as error:
        # Not only a TOMLDecodeError: a number of thousands of digits, the 31st of February.
        raise ConfigurationError(f"{path}: not TOML: {error}") from error


def shown(value: object) -> str:
    """Return a value as an error shows it, cut to a length that a line holds."""
    try:
        text = repr(value)
    except (ValueError, RecursionError):
        # Python writes no number of thousands of digits, and nothing nested as deep.
        text = "something beyond all bounds"
    return text if len(text) <= _SHOWN else text[: _SHOWN - 1] + "…"


def require(values: Mapping[str, object], place: str, *keys: str) -> None:
    for key in keys:
        if key not in values:
            raise ConfigurationError(f"{place}: {key} is missing")


def number(what: str, low: float = -math.inf, high: float = math.inf, *, whole: bool = False) -> Rule:
    """Return the rule for a number within bounds; `what` it must be is said in words."""
    kinds = int if whole else (int, float)

    def rule(value: Any, place: str) -> Any:
        try:
            number = float(value) if isinstance(value, kinds) and not isinstance(value, bool) else math.nan
        except OverflowError:
            number = math.inf
        if not (math.isfinite(number) and low <= number <= high):
            raise ConfigurationError(f"{place}: must be {what}, not {shown(value)}")
        return value if whole else number

    return rule


def vector(size: int, axes: str, reach: float) -> Rule:
    """Return the rule for a list of metres up to some reach; a person writes its axes as [x, y, z]."""
    metres = number(f"a number of metres from {-reach:g} to {reach:g}", -reach, reach)

    def rule(value: Any, place: str) -> Any:
        if not isinstance(value, list) or len(value) != size:
            raise ConfigurationError(f"{place}: must be {axes} in m, not {shown(value)}")
        return tuple(metres(element, f"{place}[{index}]") for index, element in enumerate(value))

    return rule


def text(value: Any, place: str) -> Any:
    """Accept a text that is not empty, and has no NUL: no name of a file has one."""
    if not isinstance(value, str) or not value.strip() or "\0" in value:
        raise ConfigurationError(f"{place}: must be text, not {shown(value)}")
    return value


def flag(value: Any, place: str) -> Any:
    if not isinstance(value, bool):
        raise ConfigurationError(f"{place}: must be true or false, not {shown(value)}")
    return value


def choice(*choices: str) -> Rule:
    """Return the rule for one of some texts."""

    def rule(value: Any, place: str) -> Any:
        if value not in choices:
            near = nearest(value, choices) if isinstance(value, str) else ""
            raise ConfigurationError(
                f"{place}: must be one of {', '.join(choices)}, not {shown(value)}{near}"
            )
        return value

    return rule


def several(rule_of_each: Rule) -> Rule:
    def rule(value: Any, place: str) -> Any:
        if not isinstance(value, list):
            raise ConfigurationError(f"{place}: must be a list, not {shown(value)}")
        return [rule_of_each(element, f"{place}[{index}]") for index, element in enumerate(value)]

    return rule


def each(value: Any, place: str) -> Iterator[tuple[str, Any, str]]:
    """Yield key, value and place of all in a table."""
    if not isinstance(value, dict):
        raise ConfigurationError(f"{place}: must be a table, not {shown(value)}")
    for key, inner in value.items():
        yield key, inner, f"{place}{key}" if place.endswith(": ") else f"{place}.{key}"


def table(rules: Mapping[str, Rule]) -> Rule:
    """Return the rule for a table whose keys are known."""

    def rule(value: Any, place: str) -> Any:
        checked = {}
        for key, inner, where in each(value, place):
            if key not in rules:
                hint = f"known here: {', '.join(rules)}"
                raise ConfigurationError(f"{where}: unknown key{nearest(key, rules)}", hint=hint)
            checked[key] = rules[key](inner, where)
        return checked

    return rule


def tables(rule_of_each: Rule) -> Rule:
    """Return the rule for a table whose keys are names that the user chooses."""

    def rule(value: Any, place: str) -> Any:
        return {key: rule_of_each(inner, where) for key, inner, where in each(value, place)}

    return rule


def rules(keys: Mapping[str, Any], known: Mapping[str, Rule] = MappingProxyType({})) -> Rule:
    """Return the rule for a table from what a file of keys says of each, as `rule_of_each`."""
    return table(rule_of_each(keys, known))


def rule_of_each(
    keys: Mapping[str, Any], known: Mapping[str, Rule] = MappingProxyType({})
) -> dict[str, Rule]:
    """Return the rule of each key from what a file of keys says of it, the `known` rules by their names."""
    by_name = {"text": text, "flag": flag, **known}

    def of(entry: Any) -> Rule:
        match entry:
            case str():
                return by_name[entry]
            case {"what": _}:
                return number(**entry)
            case {"choice": [*choices]}:
                return choice(*choices)
            case {"axes": axes, "reach": reach}:
                return vector(1 + axes.count(","), axes, reach)
        return rules(entry, known)

    return {key: of(entry) for key, entry in keys.items()}


def key(name: str) -> str:
    bare = name.isascii() and name.replace("-", "").replace("_", "").isalnum()
    return name if bare else value(name)


def lines(content: Mapping[str, Any], before: str = "") -> list[str]:
    """Write each entry of a mapping, with what comes before its name; those that are None are left out."""
    return [f"{before}{key(name)} = {value(own)}" for name, own in content.items() if own is not None]


def value(content: Any) -> str:  # noqa: PLR0911 - one for each kind
    """Write a value, of NumPy too, on one line; entries of a mapping that are None are left out."""
    match content:
        case str():
            # As JSON, which leaves alone one control character that TOML does not.
            return json.dumps(content, ensure_ascii=False).replace("\x7f", "\\u007f")
        case bool():
            return str(content).lower()
        case Integral():
            return str(int(content))
        case Real():
            return repr(float(content))
        case date() | time():
            # With its time, where it has one.
            return content.isoformat()
        case Mapping():
            return f"{{ {', '.join(lines(content))} }}"
        case list() | tuple():
            return f"[{', '.join(map(value, content))}]"
    raise TypeError(f"TOML has no {type(content).__name__}")
