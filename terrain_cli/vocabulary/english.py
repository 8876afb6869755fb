"""English for messages: counted nouns, and lists of names."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Sequence


def counted(number: int, noun: str, ending: str = "s") -> str:
    """Write how many there are: "1 segment", "2,250 samples"."""
    return f"{number:,} {noun}{'' if number == 1 else ending}"


def listed(names: Sequence[str], last: str = "and") -> str:
    """Join names: "a, b and c"."""
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} {last} {names[-1]}"
