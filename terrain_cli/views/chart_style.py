"""What pictures share: colours that print and that the colour-blind tell apart, libraries, axes of errors."""

from __future__ import annotations

import math
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from terrain_cli import version
from terrain_cli.errors import ConfigurationError
from terrain_cli.vocabulary.quantities import listed

if TYPE_CHECKING:
    from collections.abc import Sequence

    from terrain_cli.improvement.improvement_outcome import ChannelChange
    from terrain_cli.improvement.model_history import Rung

#: Okabe & Ito 2008 without its yellow, which is too faint for lines on paper.
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000")
MARKERS = ("o", "s", "^", "D", "v", "P", "X")
LINES: tuple[Any, ...] = ("-", "--", "-.", ":", (0, (5, 1)), (0, (3, 1, 1, 1)), (0, (1, 1)))
#: From little to much: evenly graded in grey as well.
SCALE: Final = "cividis"
COUNTS: Final = "Greys"
INK, FAINT, MEDIAN = "#222222", "#8a8a8a", "#D55E00"

STYLE = Path(__file__).with_name("paper.mplstyle")  # For matplotlib
#: Extra of the package → what it brings.
LIBRARIES = {"plot": ("matplotlib",), "report": ("jinja2", "platformdirs", "vl_convert")}


def need(extra: str) -> None:
    """Check, before the work, that what a picture ("plot") or a report needs is installed."""
    missing = [name for name in LIBRARIES[extra] if find_spec(name) is None]
    if missing:
        what = {"plot": "pictures need", "report": "a report needs"}[extra]
        raise ConfigurationError(
            f"{what} {listed(missing)}, which {'is' if len(missing) == 1 else 'are'} not installed",
            hint=version.command_for(extra),
        )


def measured(ladder: Sequence[Rung], name: str) -> list[tuple[Rung, ChannelChange]]:
    """Return the changes in which the error of a channel is known, with what it was."""
    return [(rung, one) for rung in ladder for one in rung.channels if one.name == name]


def top(known: Sequence[tuple[Rung, ChannelChange]]) -> float:
    """Return where the axis of a channel's errors ends: a very wide interval would hide the values."""
    intervals = [interval for _, one in known for interval in (one.before, one.after)]
    values = [*(v.value for v in intervals), *(one.noise for _, one in known)]
    highest = max(filter(math.isfinite, values), default=1.0)
    ends = [v.high for v in intervals if math.isfinite(v.high)]
    return 1.08 * min(max([highest, *ends]), 2.0 * highest)
