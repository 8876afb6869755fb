"""Names of wheels: ``front-left``, ``/front_left/load`` and ``FrontLeftWheelJoint`` are one."""

from __future__ import annotations

import re
from functools import cache
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

#: Said of every wheel, so that they tell none apart.
_GENERIC = re.compile(r"wheel|joint|motor|drive", re.IGNORECASE)
#: Shorter texts occur inside others by chance.
_LONG_ENOUGH = 4


@cache
def words(name: str) -> frozenset[str]:
    """Split a name such as "wheel_fl" or "RearLeftJoint" into the words that tell it from others."""
    parted = re.sub(r"(?<=[a-z0-9])(?=[A-Z])", "_", name)
    special = re.findall(r"[^\W_]+", _GENERIC.sub("_", parted).casefold())
    # A number belongs to what stands before it: rover1 is not wheel 1.
    return frozenset(special or re.findall(r"[^\W_]+", parted.casefold()))


@cache
def _plain(name: str) -> str:
    return re.sub(r"[\W_]+", "", name).casefold()


def _contains(a: str, b: str) -> bool:
    short, long = sorted((_plain(_GENERIC.sub("", name)) for name in (a, b)), key=len)
    # "wheel1" is not in "wheel10".
    return len(short) >= _LONG_ENOUGH and re.search(rf"{short}(?!\d)", long) is not None


def _initials(a: str, b: str) -> bool:
    long, short = sorted((words(a), words(b)), key=len, reverse=True)
    return len(short) == 1 < len(long) and sorted(*short) == sorted(word[0] for word in long)


_SAME: tuple[Callable[[str, str], bool], ...] = (
    lambda a, b: _plain(a) == _plain(b),
    lambda a, b: words(a) == words(b),
    lambda a, b: words(a) < words(b),
    lambda a, b: words(a) > words(b) > frozenset(),
    _contains,
    _initials,
)


def match_name(wanted: str, names: Iterable[str]) -> str | None:
    """Find the one name that means the same wheel.

    The one that is equal but for punctuation, else has the same words, more, fewer, is written within the
    other, or has its initials: the first of these that fits any. None if it fits several, or nothing does.
    """
    names = [name for name in dict.fromkeys(names) if _plain(name)]
    if not _plain(wanted):
        return None
    for same in _SAME:
        found = [name for name in names if same(wanted, name)]
        if found:
            return found[0] if len(found) == 1 else None
    return None
