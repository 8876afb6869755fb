"""What was saved of a damaged file, and what was lost: in words, and for machines."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import Any, TypeAlias

#: What to do about a damaged file.
HINT = "add --salvage to read what is left of it"
NS = 1e-9
Span: TypeAlias = tuple[int, int]  # Of log time, in ns
_TOLD = 3  # Damage of one kind is told so many times
_BEGINNINGS = ("damaged: ", "salvaged: ", "lost: ")  # How the sentences begin that tell of it


class Notice(str):
    """A remark that every command says, in what it writes or on stderr, whatever else it shows."""

    __slots__ = ()


def told(remarks: Iterable[str]) -> list[str]:
    """Return the remarks that tell what was saved and what was lost."""
    return [remark for remark in remarks if remark.startswith(_BEGINNINGS)]


def set_aside(number: int, what: str) -> str:
    """Say how many of what is counted, in the plural, contradict themselves."""
    if number == 1:
        return f"1 {what.removesuffix('s')} set aside, which contradicts itself"
    return f"{number:,} {what} set aside, which contradict themselves"


@dataclass(kw_only=True)
class Recovery:
    """What was found in a file that was read with salvage."""

    what: str = "messages"  # What is counted: "messages", "rows" or "parts"
    #: What is wrong with the file, in the order of its bytes; nothing for a whole file.
    damage: list[str] = field(default_factory=list)
    read: int = 0
    expected: int | None = None  # How many there were, where something tells it
    aside: int = 0  # Messages that are there, but cannot be trusted or decoded
    #: Bytes that made sense, and those of the file when it was whole, or of what is there if nothing tells.
    bytes_read: int = 0
    bytes_expected: int | None = None
    whole_known: bool = False  # `bytes_expected` is the size of the whole file
    #: Stretches of log time without what was lost, in ns; None where an end is not known.
    lost: list[tuple[int | None, int | None]] = field(default_factory=list)
    first: int | None = None  # The least log time that can be read, in ns
    goes_on: int | None = None  # A log time that was reached at least, where the end is not known, in ns
    #: Checksums in the file vouch for each value. Otherwise a changed byte inside a value cannot be seen.
    checked: bool = False

    @property
    def damaged(self) -> bool:
        return bool(self.damage or self.aside)

    @property
    def fraction(self) -> float | None:
        """Share of the messages or rows that was saved, of the bytes where their number is not known."""
        if not self.damaged:
            return 1.0
        if self.expected:
            return min(1.0, self.read / self.expected)
        if self.bytes_expected:
            return min(1.0, self.bytes_read / self.bytes_expected)
        return None

    @property
    def lost_s(self) -> float | None:
        """Seconds without what was lost; None where that cannot be known."""
        if any(start is None or end is None for start, end in self.lost):
            return None
        return sum((end - start) * NS for start, end in self.lost if start is not None and end is not None)

    @property
    def lost_at_least_s(self) -> float:
        """Seconds that are known to be without what was lost."""
        ends = [(start, self.goes_on if end is None else end) for start, end in self.lost]
        return sum((end - start) * NS for start, end in ends if start is not None and end is not None)

    def add(self, other: Recovery) -> None:
        """Take in what was found in another file of the same log."""
        self.damage += other.damage
        self.checked = self.checked and other.checked
        known = self.expected is not None and other.expected is not None
        self.expected = (self.expected or 0) + (other.expected or 0) if known else None
        for name in ("read", "aside", "bytes_read"):
            setattr(self, name, getattr(self, name) + getattr(other, name))
        if other.bytes_expected is not None:
            self.bytes_expected = (self.bytes_expected or 0) + other.bytes_expected
        self.whole_known = self.whole_known and other.whole_known
        if self.lost and other.first is not None:
            # What is missing at the end of a file is missing until the next begins.
            start, end = self.lost[-1]
            self.lost[-1] = start, max(other.first, start or 0) if end is None else end
        self.lost += other.lost
        self.goes_on = other.goes_on

    def sentences(self) -> list[str]:
        """Tell a person; nothing of a whole file."""
        if not self.damaged:
            return []
        more = len(self.damage) - _TOLD
        lines = [f"damaged: {text}" for text in self.damage[:_TOLD]]
        if more > 0:
            lines.append(f"damaged: and {more} more places")
        lines.append(f"salvaged: {self.read:,} {self.what}{self._share()}")
        if self.aside:
            lines.append(f"salvaged: {set_aside(self.aside, self.what)}")
        if self.lost:
            lines.append(f"lost: {self._time_lost()}")
        if not self.checked:
            lines.append("no checksum protects the values: a changed byte in a value cannot be seen")
        return lines

    def _share(self) -> str:
        share = self.fraction
        if share is None:
            return ""
        # Never 100 % of what is not whole.
        percent = f"{min(100 * share, 99.9):.1f} %"
        if self.expected:
            return f" of {self.expected:,} ({percent})"
        if self.whole_known:
            return f", from {percent} of the bytes of the whole file"
        return f", from {percent} of the bytes that are there; how many there were is not known"

    def _time_lost(self) -> str:
        if self.lost_s is not None:
            stretches = len(self.lost)
            return f"{self.lost_s:.3f} s in {stretches} stretch{'es' * (stretches != 1)} of the log"
        least = self.lost_at_least_s
        told = f"at least {least:.3f} s, and " if least else ""
        beginning = any(start is None for start, _ in self.lost)
        where = "what is missing" if beginning else "what came after the last"
        return f"{told}{where}; how much that was cannot be known"

    def document(self) -> dict[str, Any]:
        """Tell a machine, ready for JSON; null where not known."""
        of_bytes = "bytes" if self.whole_known else "bytes that are there"
        return {
            "damage": list(self.damage),
            "what": self.what,
            "read": self.read,
            "expected": self.expected,
            "set_aside": self.aside,
            "fraction": self.fraction,
            "fraction_of": self.what if self.expected or not self.damaged else of_bytes,
            "lost_s": self.lost_s if self.lost or not self.damaged else None,
            "lost_at_least_s": self.lost_at_least_s,
            "lost": [[None if end is None else end * NS for end in stretch] for stretch in self.lost],
            "checked": self.checked,
        }


def lost_between(spans: Sequence[Span | None], end: int | None) -> list[tuple[int | None, int | None]]:
    """Return log times (ns) between which something, None in `spans`, was lost, up to the `end` if known."""
    lost: list[tuple[int | None, int | None]] = []
    before: int | None = None
    waiting = False
    for span in spans:
        if span is None:
            waiting = True
            continue
        first, last = span
        if waiting:
            after = first if before is None else max(first, before)
            if lost and lost[-1][1] == before is not None:
                lost[-1] = lost[-1][0], after
            else:
                lost.append((before, after))
            waiting = False
        before = last if before is None else max(before, last)
    if waiting:
        lost.append((before, max(end, before) if end is not None and before is not None else end))
    return lost
