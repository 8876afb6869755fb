"""Where the wheels drove, coloured by the soil they met and by how well it is described."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.collections import LineCollection

from terrain_cli.views import segment_groups
from terrain_cli.views.chart_style import FAINT, INK, SCALE
from terrain_cli.views.figures.picture import Picture

if TYPE_CHECKING:
    from collections.abc import Mapping

    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from numpy.typing import ArrayLike, NDArray

    Array = NDArray[np.float64]

#: Wheels in one picture: all follow nearly the same track, and would hide each other on one map.
MOST_WHEELS = 4
#: With more segments than this their values are left to the colours.
MOST_LABELS = 12


def track(table: Mapping[str, Any], misfit: Mapping[str, ArrayLike]) -> Figure | None:
    """Draw the track of each wheel twice: coloured by the soil's strength, and by the misfit.

    Parameters
    ----------
    table : mapping of str to sequence
        Columns of `results.COLUMNS`.
    misfit : mapping of str to array_like, shape (segments,)
        What to colour the other maps by, by its label with the unit.

    Returns
    -------
    matplotlib.figure.Figure or None
        None where no segment has a place.
    """
    paths = segment_groups.paths(table)
    if not any(len(path) for path in paths):
        return None
    key = list(zip(table["source"], table["wheel"], strict=True))
    wheels = list(dict.fromkeys(key))[:MOST_WHEELS]
    shown = dict([segment_groups.mapped_strength(table)])
    shown |= {label: np.asarray(values, dtype=float) for label, values in misfit.items()}
    every = np.concatenate([path for path in paths if len(path)])
    across, up, stretch = segment_groups.frame(table, every)
    shape = (up[1] - up[0]) * stretch / (across[1] - across[0])
    panel = (3.4, 3.1 * shape + 0.3) if shape < 1.0 else (3.4 / shape + 0.9, 3.8)
    figure = Picture(figsize=(panel[0] * len(shown), panel[1] * len(wheels) + 1.1), layout="compressed")
    grid = figure.subplots(len(wheels), len(shown), squeeze=False, sharex=True, sharey=True)
    x, y = ("longitude (°)", "latitude (°)") if segment_groups.geographic(table) else ("x (m)", "y (m)")
    for column, (label, values) in enumerate(shown.items()):
        known = values[np.isfinite(values)]
        ends = (known.min(), known.max()) if len(known) else (0.0, 1.0)
        for line, wheel in enumerate(wheels):
            axes = grid[line, column]
            rows = [j for j, one in enumerate(key) if one == wheel]
            lines = _draw(axes, [paths[j] for j in rows], values[rows], ends)
            axes.set(xlim=across, ylim=up, aspect=stretch)
            axes.set_title(" ".join(dict.fromkeys(map(str, wheel))) if column == 0 else "", fontsize=8.0)
            axes.set_xlabel(x if line == len(wheels) - 1 else "")
            axes.set_ylabel(y if column == 0 else "")
        figure.colorbar(lines, ax=grid[:, column], label=label, location="bottom", aspect=30, shrink=0.9)
    return figure


def _draw(axes: Axes, paths: list[Array], values: Array, ends: tuple[float, float]) -> LineCollection:
    """Draw segments, with a tick where one ends and, where there are few, its value in figures."""
    drawn = [j for j, path in enumerate(paths) if len(path)]
    # A place that does not move is drawn as a dot: a line of no length with a round end.
    courses = [np.repeat(paths[j], 2, axis=0) if len(paths[j]) == 1 else paths[j] for j in drawn]
    lines = LineCollection(courses, cmap=SCALE, linewidths=5.0, capstyle="butt", zorder=2)
    lines.set_array(np.ma.masked_invalid(values[drawn]))
    lines.set_clim(*ends)
    axes.add_collection(lines)
    for course in courses:
        axes.plot(*course[0], marker="o", markersize=3.0, color="white", markeredgecolor=INK, zorder=3)
    for course, value in zip(courses, values[drawn], strict=True):
        if len(drawn) <= MOST_LABELS and np.isfinite(value):
            middle = course[len(course) // 2]
            axes.annotate(
                f"{value:.2g}",
                middle,
                (0, 6),
                textcoords="offset points",
                fontsize=7.0,
                ha="center",
                color=INK,
            )
    axes.grid(visible=True, color=FAINT, alpha=0.3, linewidth=0.5)
    return lines
