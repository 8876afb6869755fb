"""Cohesion and friction angle with their errors, and the strength they stand for."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.lines import Line2D
from matplotlib.patches import Polygon
from matplotlib.path import Path
from matplotlib.transforms import Bbox

from terrain_cli.views import segment_groups
from terrain_cli.views.chart_style import COLOURS, LINES, MARKERS
from terrain_cli.views.figures.picture import Picture

if TYPE_CHECKING:
    from collections.abc import Mapping

    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

#: With more segments than this, errors would hide the estimates.
MOST_ERRORS = 60
#: With more than this, bands would hide the lines.
MOST_BANDS = 6


def strength(table: Mapping[str, Any]) -> Figure:
    """Draw c and φ of every segment with their ellipses, and beside it the strength line of each.

    Parameters
    ----------
    table : mapping of str to sequence
        Columns of `results.COLUMNS`.
    """
    figure = Picture(figsize=(7.6, 3.9))
    left, right = figure.subplots(1, 2)
    kinds = segment_groups.groups(table, len(COLOURS))
    _estimates(left, table, kinds)
    _lines(right, table, kinds)
    handles = [
        Line2D([], [], color=COLOURS[j], marker=MARKERS[j], linestyle=LINES[j], label=kind)
        for j, kind in enumerate(dict.fromkeys(kinds))
    ]
    if any(status != "ok" for status in table["status"]):
        hollow: dict[str, Any] = {"marker": "o", "linestyle": "none", "markerfacecolor": "white"}
        handles.append(Line2D([], [], color="black", label="hollow, dotted: status not ok", **hollow))
    figure.legend(handles=handles, loc="outside lower center", ncols=min(len(handles), 4))
    return figure


def _estimates(axes: Axes, table: Mapping[str, Any], kinds: list[str]) -> None:
    styles = {kind: j for j, kind in enumerate(dict.fromkeys(kinds))}
    c, phi = segment_groups.estimate_limits(table)
    unseen = 0
    for row, kind in enumerate(kinds):
        style = styles[kind]
        trusted = table["status"][row] == "ok"
        outline = segment_groups.ellipse(table, row)
        if len(kinds) <= MOST_ERRORS and np.isfinite(outline).all():
            # One around the axes, or beyond them, does not show.
            unseen += not Path(outline).intersects_bbox(Bbox(np.transpose([c, phi])), filled=False)
            axes.add_patch(
                Polygon(
                    outline,
                    facecolor=COLOURS[style] if trusted else "none",
                    edgecolor=COLOURS[style],
                    alpha=0.25 if trusted else 0.5,
                    linewidth=0.8,
                    linestyle="-" if trusted else ":",
                )
            )
        axes.plot(
            table["c_kPa"][row],
            table["phi_deg"][row],
            marker=MARKERS[style],
            linestyle="none",
            markersize=5.0,
            color=COLOURS[style],
            markerfacecolor=COLOURS[style] if trusted else "white",
        )
    x, y = (np.asarray(table[name], dtype=float) for name in ("c_kPa", "phi_deg"))
    outside = int(np.count_nonzero((x < c[0]) | (x > c[1]) | (y < phi[0]) | (y > phi[1])))
    title = "estimates, 95 % regions" if len(kinds) <= MOST_ERRORS else "estimates"
    notes = [f"{outside} beyond the axes"] * bool(outside) + [f"{unseen} not in sight"] * bool(unseen)
    axes.set(
        xlim=c,
        ylim=phi,
        xlabel="cohesion c (kPa)",
        ylabel="friction angle φ (°)",
        title=f"{title} ({', '.join(notes)})" if notes else title,
    )


def _lines(axes: Axes, table: Mapping[str, Any], kinds: list[str]) -> None:
    styles = {kind: j for j, kind in enumerate(dict.fromkeys(kinds))}
    pivots = np.asarray(table["sigma_star_kPa"], dtype=float)
    known = segment_groups.tested(table)
    axes.set(
        xlabel="normal stress σ (kPa)",
        ylabel="shear strength c + σ tan φ (kPa)",
        title="strength, marked at σ* with 95 % error",
    )
    if not len(known):
        return
    for row in known:
        style = styles[kinds[row]]
        colour, marker, line = COLOURS[style], MARKERS[style], LINES[style]
        # Far from σ* the drive has not tried the soil.
        stress = np.linspace(0.5 * pivots[row], 1.5 * pivots[row], 30)
        value, error = segment_groups.strength(table, row, stress)
        if np.isfinite(value).all():
            axes.plot(stress, value, color=colour, linestyle=line, linewidth=1.0)
        if len(known) <= MOST_BANDS and np.isfinite(error).all():
            axes.fill_between(
                stress, value - 1.96 * error, value + 1.96 * error, color=colour, alpha=0.15, linewidth=0.0
            )
        axes.errorbar(
            pivots[row],
            table["strength_kPa"][row],
            yerr=1.96 * np.nan_to_num(table["strength_se_kPa"][row]) if len(kinds) <= MOST_ERRORS else None,
            color=colour,
            marker=marker,
            markersize=4.0,
            capsize=2.0,
            elinewidth=0.9,
        )
    across, up = segment_groups.strength_limits(table)
    axes.set(xlim=across, ylim=up)
