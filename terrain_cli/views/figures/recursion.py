"""How the recursive estimate converges: Figures 3, 4 and 7 of Iagnemma et al. 2004."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.figure import Figure

from terrain_cli.views import binning, segment_groups
from terrain_cli.views.chart_style import COLOURS, FAINT, INK

if TYPE_CHECKING:
    from collections.abc import Mapping

    from matplotlib.axes import Axes
    from numpy.typing import NDArray

    Array = NDArray[np.float64]

#: More samples than this are thinned: a line of them is as wide as a page has dots.
MOST_SAMPLES = 3_000
#: With more segments than this their limits would hide the lines.
MOST_LIMITS = 40


def convergence(trace: Mapping[str, Any]) -> Figure:
    """Draw c and φ of one wheel after every sample, each with ± 1.96 standard errors.

    Parameters
    ----------
    trace : mapping of str to sequence
        Columns of `results.trace`, of one wheel.
    """
    figure = Figure(figsize=(7.2, 4.8))
    upper, lower = figure.subplots(2, 1, sharex=True)
    number = np.asarray(trace["segment"])
    starts = np.flatnonzero(np.diff(number, prepend=number[0] - 1)) if len(number) else np.empty(0, int)
    shown = binning.some(len(number), MOST_SAMPLES)
    # A thinned line would else bridge two segments.
    shown = np.union1d(shown, starts)
    for axes, name, label, colour, widest in (
        (upper, "c", "cohesion c (kPa)", COLOURS[0], (-np.inf, np.inf)),
        (lower, "phi", "friction angle φ (°)", COLOURS[1], (-90.0, 90.0)),
    ):
        unit = "kPa" if name == "c" else "deg"
        value, error = (np.asarray(trace[f"{name}{part}_{unit}"], float) for part in ("", "_se"))
        low, high = value - 1.96 * error, value + 1.96 * error
        axes.fill_between(
            shown + 1, low[shown], high[shown], color=colour, alpha=0.25, linewidth=0.0, label="± 1.96 s.e."
        )
        axes.plot(shown + 1, value[shown], color=colour, label="estimate")
        if len(starts) <= MOST_LIMITS:
            _limits(axes, number, starts, name_them=axes is upper)
        _focus(axes, value, error, starts, widest)
        axes.set_ylabel(label)
        axes.legend(loc="lower right", ncols=2)
    lower.set_xlabel("sample")
    lower.set_xlim(1, max(len(number), 2))
    where = ", ".join(f"{key} {trace[key][0]}" for key in ("source", "wheel") if len(number))
    figure.suptitle(where, fontsize=9.0, x=0.01, ha="left")
    return figure


def _limits(axes: Axes, number: Any, starts: NDArray[np.intp], *, name_them: bool) -> None:
    ends = np.append(starts[1:], len(number))
    for start, end in zip(starts, ends, strict=True):
        if start:
            axes.axvline(start + 0.5, color=FAINT, linewidth=0.8, linestyle="--")
        if name_them and end - start > 0.02 * len(number):
            axes.text(
                start + 1 + 0.005 * len(number),
                1.02,
                f"segment {number[start]}" if len(starts) <= 8 else f"{number[start]}",
                transform=axes.get_xaxis_transform(),
                fontsize=7.5,
                color=INK,
            )


def _focus(
    axes: Axes, value: Array, error: Array, starts: NDArray[np.intp], widest: tuple[float, float]
) -> None:
    """Show where the segments end up; what their first samples say lies far beyond."""
    ends = np.append(starts[1:], len(value)) - 1
    last, spread = value[ends], np.nan_to_num(error[ends])
    known = np.isfinite(last)
    if not known.any():
        return
    last, spread = last[known], spread[known]
    room = 2.5 * spread + 0.25 * np.abs(np.median(last))
    reach = np.minimum(room, 3.0 * np.median(room))
    low, high = segment_groups.usual(np.concatenate([last - reach, last + reach]))
    axes.set_ylim(max(low, widest[0]), min(high, widest[1]))
