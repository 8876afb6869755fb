"""What is known of c and φ together: the valley in which they trade for each other, segment by segment."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from terrain_cli.presentation.posterior_table import GRID
from terrain_cli.views import segment_groups
from terrain_cli.views.chart_style import COLOURS, FAINT, INK
from terrain_cli.vocabulary.choices import MOST_VALLEYS

if TYPE_CHECKING:
    from collections.abc import Mapping

    from matplotlib.axes import Axes
    from numpy.typing import NDArray

    Array = NDArray[np.float64]
    Posterior = Mapping[str, Any]

#: Probabilities of the regions that are drawn, and of the one that a panel shows.
_REGIONS, _SHOWN = (0.95, 0.68), 0.995
#: Standard deviations to which 68 % of a normal distribution in the plane reach.
_OF_68 = 1.51
#: A prior is drawn where an error is more than this share of its own.
_INFORMATIVE = 0.3


def valleys(posterior: Posterior, table: Mapping[str, Any]) -> Figure | None:
    """Draw the joint posterior of c and φ of the segments of one wheel; None where no segment has a grid."""
    kind, number = np.asarray(posterior["kind"]), np.asarray(posterior["segment"])
    there = np.unique(number[kind == GRID])
    if not len(there):
        return None
    if len(there) > MOST_VALLEYS:
        there = there[np.round(np.linspace(0, len(there) - 1, MOST_VALLEYS)).astype(int)]
    columns = min(3, len(there))
    rows = math.ceil(len(there) / columns)
    figure = Figure(figsize=(max(2.9 * columns, 4.2), 2.7 * rows + 0.8))
    panels = figure.subplots(rows, columns, squeeze=False)
    for axes in panels.flat[len(there) :]:
        axes.remove()
    drawn = [
        _panel(axes, posterior, np.flatnonzero(number == segment), table, int(segment))
        for axes, segment in zip(panels.flat, there, strict=False)
    ]
    handles = [
        Patch(color=COLOURS[0], alpha=0.65, label="68 %"),
        Patch(color=COLOURS[0], alpha=0.25, label="95 %"),
        Line2D(
            [], [], color=INK, marker="o", markersize=4.0, linestyle="none", label="estimate (hollow: not ok)"
        ),
        Line2D([], [], color=FAINT, linewidth=0.9, linestyle="--", label="95 % by its standard errors"),
        Line2D([], [], color=COLOURS[1], label="same strength at the pivot stress σ*"),
    ]
    if any(drawn):
        handles.append(
            Line2D([], [], color=COLOURS[2], linestyle=":", label="68 % of what is known beforehand")
        )
    figure.legend(handles=handles, loc="outside lower center", ncols=3 if columns > 1 else 2)
    left = int(np.count_nonzero(np.isfinite(table["strength_kPa"]))) - len(there)
    wheel = " ".join([str(table["source"][0]), str(table["wheel"][0])]).strip()
    figure.suptitle(
        f"{wheel}: {len(there)} of {left + len(there)} segments" if left > 0 else wheel, fontsize=9.0
    )
    return figure


def _panel(
    axes: Axes, posterior: Posterior, rows: NDArray[np.intp], table: Mapping[str, Any], segment: int
) -> bool:
    """Draw one segment; return whether its prior was drawn."""
    column = {name: np.asarray(posterior[name])[rows] for name in posterior}
    grid = column["kind"] == GRID
    side = int(np.count_nonzero(column["phi_deg"][grid] == column["phi_deg"][grid][0]))
    c, phi, probability = (
        column[name][grid].astype(float).reshape(-1, side) for name in ("c_kPa", "phi_deg", "probability")
    )
    share = _share(probability)
    ends = [1.0 - inside for inside in _REGIONS]
    for level, shade in zip(ends, (0.25, 0.5), strict=True):
        axes.contourf(c, phi, share, levels=[level, 1.0], colors=[COLOURS[0]], alpha=shade)
    axes.contour(c, phi, share, levels=ends, colors=[COLOURS[0]], linewidths=0.8)
    shown = share >= 1.0 - _SHOWN
    limits = [_spread(part[shown]) for part in (c, phi)]
    here = (column["kind"] != GRID) & (column["other"] == column["parameter"])
    known = {
        name: {key: float(column[key][k]) for key in ("value", "se", "prior", "prior_sd")}
        for k, name in zip(np.flatnonzero(here), column["parameter"][here], strict=True)
    }
    pivot = float(column["pivot_kPa"][grid][0])
    if pivot > 0.0:
        strength = known["cohesion"]["value"] / 1e3 + pivot * known["tan_phi"]["value"]
        slope = np.tan(np.radians(np.linspace(*limits[1], 50)))
        axes.plot(strength - pivot * slope, np.degrees(np.arctan(slope)), color=COLOURS[1], linewidth=1.0)
    with_prior = _prior(axes, known)
    row = int(np.flatnonzero(np.asarray(table["segment"]) == segment)[0])
    outline = segment_groups.ellipse(table, row)
    if np.isfinite(outline).all():
        axes.plot(*outline.T, color=FAINT, linewidth=0.9, linestyle="--")
    axes.plot(
        table["c_kPa"][row],
        table["phi_deg"][row],
        marker="o",
        markersize=4.0,
        color=INK,
        markerfacecolor=INK if table["status"][row] == "ok" else "white",
    )
    terrain = f", {table['terrain'][row]}" if table["terrain"][row] else ""
    axes.set(xlim=limits[0], ylim=limits[1], xlabel="cohesion c (kPa)", ylabel="friction angle φ (°)")
    stress = f", σ* = {pivot:.3g} kPa" if pivot > 0.0 else ""
    axes.set_title(f"segment {segment}{terrain}\n{table['status'][row]}{stress}", fontsize=8.0)
    return with_prior


def _prior(axes: Axes, known: Mapping[str, Mapping[str, float]]) -> bool:
    """Draw what is known of c and φ beforehand, where that matters."""
    c, tan_phi = known["cohesion"], known["tan_phi"]
    if not any(one["se"] > _INFORMATIVE * one["prior_sd"] for one in (c, tan_phi)):
        return False
    turn = np.linspace(0.0, 2.0 * np.pi, 90)
    axes.plot(
        (c["prior"] + _OF_68 * c["prior_sd"] * np.cos(turn)) / 1e3,
        np.degrees(np.arctan(tan_phi["prior"] + _OF_68 * tan_phi["prior_sd"] * np.sin(turn))),
        color=COLOURS[2],
        linestyle=":",
    )
    return True


def _share(probability: Array) -> Array:
    """Return for each point the probability of all points that are less likely."""
    order = np.argsort(probability, axis=None)
    share = np.empty(probability.size)
    share[order] = np.cumsum(probability.ravel()[order])
    return share.reshape(probability.shape)


def _spread(values: Array) -> tuple[float, float]:
    low, high = float(values.min()), float(values.max())
    room = 0.08 * (high - low)
    return low - room, high + room
