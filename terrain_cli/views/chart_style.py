"""What pictures share: colours that print and that colour-blind people tell apart, and their libraries."""

from __future__ import annotations

from importlib.util import find_spec
from typing import Any, Final

from terrain_cli import version
from terrain_cli.errors import ConfigurationError

#: Okabe & Ito 2008 without its yellow, which is too faint for lines on paper.
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000")
MARKERS = ("o", "s", "^", "D", "v", "P", "X")
LINES: tuple[Any, ...] = ("-", "--", "-.", ":", (0, (5, 1)), (0, (3, 1, 1, 1)), (0, (1, 1)))
#: From little to much: evenly graded in grey as well.
SCALE: Final = "cividis"
COUNTS: Final = "Greys"
INK, FAINT, MEDIAN = "#222222", "#8a8a8a", "#D55E00"

#: For matplotlib. Nothing from a log is taken for mathematics, and text stays text in an SVG.
SETTINGS: dict[str, Any] = {
    "text.parse_math": False,
    "svg.fonttype": "none",
    # The same data give the same file.
    "svg.hashsalt": "terrain-est",
    "font.size": 9.0,
    "font.family": "DejaVu Sans",
    "axes.titlesize": 9.0,
    "axes.titlelocation": "left",
    "axes.labelsize": 9.0,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.edgecolor": INK,
    "axes.linewidth": 0.7,
    "axes.formatter.useoffset": False,
    "axes.unicode_minus": True,
    "xtick.labelsize": 8.0,
    "ytick.labelsize": 8.0,
    "legend.fontsize": 8.0,
    "legend.frameon": False,
    "figure.constrained_layout.use": True,
    "figure.dpi": 100.0,
    "savefig.dpi": 160.0,
    "lines.linewidth": 1.2,
}
#: Extra of the package → what it brings.
LIBRARIES = {"plot": ("matplotlib",), "report": ("altair", "jinja2", "vl_convert")}


def need(extra: str) -> None:
    """Check, before the work, that what a picture ("plot") or a report needs is installed."""
    missing = [name for name in LIBRARIES[extra] if find_spec(name) is None]
    if missing:
        what = {"plot": "pictures need", "report": "a report needs"}[extra]
        raise ConfigurationError(
            f"{what} {' and '.join(missing)}, which {'is' if len(missing) == 1 else 'are'} not installed",
            hint=version.command_for(extra),
        )
