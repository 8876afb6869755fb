"""The held-out error before and after each change of a model."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from terrain_cli.improvement.error_ladder import channels
from terrain_cli.views.chart_style import COLOURS, INK
from terrain_cli.views.figures.picture import Picture
from terrain_cli.views.ladder_table import measured, top
from terrain_cli.vocabulary import quantities

if TYPE_CHECKING:
    from collections.abc import Sequence

    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from terrain_cli.improvement.error_ladder import Rung
    from terrain_cli.improvement.improvement_outcome import Interval

#: Distance of before and after from the middle of their step.
_APART = 0.18


def errors(ladder: Sequence[Rung]) -> Figure | None:
    """Draw the held-out error of every channel, step by step, with its 95 % interval and the noise.

    Returns
    -------
    matplotlib.figure.Figure or None
        None where nothing was tried on data.
    """
    names = channels(ladder)
    if not names:
        return None
    tested = [rung for rung in ladder if rung.channels]
    wide = max(4.2, 1.6 + 0.95 * len(tested))
    figure = Picture(figsize=(min(wide, 14.0), 0.9 + 1.9 * len(names)))
    grid = figure.subplots(len(names), 1, squeeze=False, sharex=True)[:, 0]
    place = {rung.number: index for index, rung in enumerate(tested)}
    for axes, name in zip(grid, names, strict=True):
        _panel(axes, tested, name, place)
    grid[-1].set_xticks(
        range(len(tested)), [rung.label for rung in tested], rotation=25, ha="right", rotation_mode="anchor"
    )
    grid[-1].set_xlim(-0.6, len(tested) - 0.4)
    handles, labels = grid[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper left", ncols=len(labels))
    return figure


def _panel(axes: Axes, tested: Sequence[Rung], name: str, place: dict[int, int]) -> None:
    known = measured(tested, name)
    what = quantities.quantity(name, known[0][1].unit)
    at = np.array([place[rung.number] for rung, _ in known], dtype=float)
    for side, marker, face, label in (
        (-_APART, "o", "white", "before"),
        (_APART, "s", COLOURS[0], "after"),
    ):
        intervals = [one.before if side < 0.0 else one.after for _, one in known]
        value, spread = _spread(intervals, what.factor)
        axes.errorbar(
            at + side,
            value,
            spread,
            fmt=marker,
            color=COLOURS[0],
            markerfacecolor=face,
            markersize=5.0,
            capsize=2.5,
            linewidth=1.0,
            label=f"{label} (95 %)",
            zorder=3,
        )
    for x, (_, one) in zip(at, known, strict=True):
        ends = [one.before.value * what.factor, one.after.value * what.factor]
        axes.plot([x - _APART, x + _APART], ends, color=INK, linewidth=0.8, zorder=2)
    noise = np.array([one.noise * what.factor for _, one in known])
    axes.hlines(noise, at - 0.42, at + 0.42, color=COLOURS[1], linestyle=":", linewidth=1.4, label="noise")
    axes.set_ylim(0.0, top(known) * what.factor)
    axes.set_ylabel(f"{what.words}{what.in_unit}")
    axes.grid(axis="y", linewidth=0.4, alpha=0.5)
    if axes.get_subplotspec().is_first_row():  # type: ignore[union-attr]
        axes.set_title("rms error on data that were not fitted")


def _spread(intervals: Sequence[Interval], factor: float) -> tuple[np.ndarray, np.ndarray]:
    """Return values, and how far their intervals reach down and up, shape (2, n)."""
    table = np.array(intervals, dtype=float).reshape(-1, 3) * factor
    value = table[:, 0]
    reach = np.stack([value - table[:, 1], table[:, 2] - value])
    return value, np.maximum(np.nan_to_num(reach), 0.0)
