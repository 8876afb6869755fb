"""HTML elements of the page."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence


@dataclass(frozen=True)
class Table:
    """Rows under a caption; all text is taken as it is, none as HTML."""

    caption: str
    head: Sequence[str]  # Headings of the columns
    rows: Sequence[Sequence[str]]  # The first cell names the row
    figures: frozenset[int] = frozenset()  # Columns of numbers, which are set flush right
    note: str = ""  # What was left out, or how to read it


@dataclass(frozen=True)
class Chart:
    """A picture."""

    title: str
    alt: str  # What it shows, for those who do not see it
    spec: Mapping[str, Any]  # Of Vega-Lite
    wide: bool = False  # Two in a row on a wide screen, instead of three


@dataclass(frozen=True, kw_only=True)
class Section:
    """A part of the page with a heading, left out where it has neither text nor parts."""

    id: str  # For links; letters and hyphens
    title: str
    text: Sequence[str] = ()  # Paragraphs
    points: Sequence[str] = ()  # Items of a list, after the paragraphs
    # Charts that follow one another share a row where there is room
    parts: Sequence[Table | Chart] = field(default_factory=tuple)
    lead: str = ""  # What is to be known first, before the paragraphs
    command: str = ""  # What to run next

    @property
    def blocks(self) -> list[list[Table | Chart]]:
        """The parts, with the charts that follow one another put together."""
        result: list[list[Table | Chart]] = []
        for part in self.parts:
            if result and isinstance(part, Chart) and isinstance(result[-1][-1], Chart):
                result[-1].append(part)
            else:
                result.append([part])
        return result

    def __bool__(self) -> bool:
        return bool(self.text or self.points or self.parts)
