"""English for messages: counted nouns, and lists of names."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Sequence


def counted(number: int, noun: str, ending: str = "s") -> str:
    """Write how many there are: "1 segment", "2,250 samples".

    Parameters
    ----------
    noun : str
        Of one.
    ending : str
        Of several.
    """
    return f"{number:,} {noun}{'' if number == 1 else ending}"


def listed(names: Sequence[str], last: str = "and") -> str:
    """Join names: "a, b and c".

    Parameters
    ----------
    names : sequence of str
        At least one.
    last : str
        Between the last two.
    """
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} {last} {names[-1]}"
