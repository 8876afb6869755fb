"""The soil: c and φ with their errors, alone and together, its strength, stresses at the rim, the track."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch, Polygon
from matplotlib.path import Path
from matplotlib.transforms import Bbox
from numpy.typing import ArrayLike

from terrain_cli.presentation.segment_table import GRID
from terrain_cli.views import shown_segments
from terrain_cli.views.chart_style import COLOURS, FAINT, INK, LINES, MARKERS, SCALE
from terrain_cli.views.figures.drive_figures import Picture, panels
from terrain_cli.views.shown_samples import limits as limits_of
from terrain_cli.views.shown_segments import Moment
from terrain_cli.vocabulary.arrays import Array, Index
from terrain_cli.vocabulary.choices import MOST_VALLEYS

Posterior = Mapping[str, Any]

MOST_ERRORS = 60  # With more segments than this, errors would hide the estimates
MOST_BANDS = 6  # With more than this, bands would hide the lines
#: Wheels in one picture: all follow nearly the same track, and would hide each other on one map.
MOST_WHEELS = 4
MOST_LABELS = 12  # With more segments than this their values are left to the colours
#: Probabilities of the regions that are drawn, and of the one that a panel shows.
_REGIONS, _SHOWN = (0.95, 0.68), 0.995
_OF_68 = 1.51  # Standard deviations to which 68 % of a normal distribution in the plane reach
_INFORMATIVE = 0.3  # A prior is drawn where an error is more than this share of its own


def strength(table: Mapping[str, Any]) -> Figure:
    """Draw c and φ of every segment with their ellipses, and beside it the strength line of each."""
    figure = Picture(figsize=(7.6, 3.9))
    left, right = figure.subplots(1, 2)
    groups = shown_segments.groups(table, len(COLOURS))
    kinds = list(dict.fromkeys(groups))
    styles = [kinds.index(kind) for kind in groups]
    _estimates(left, table, styles)
    _lines(right, table, styles)
    handles = [
        Line2D([], [], color=COLOURS[j], marker=MARKERS[j], linestyle=LINES[j], label=kind)
        for j, kind in enumerate(kinds)
        if len(kinds) > 1  # One name for all tells nothing apart.
    ]
    if any(status != "ok" for status in table["status"]):
        hollow: dict[str, Any] = {"marker": "o", "linestyle": "none", "markerfacecolor": "white"}
        handles.append(Line2D([], [], color="black", label="hollow, dotted: status not ok", **hollow))
    if handles:
        figure.legend(handles=handles, loc="outside lower center", ncols=min(len(handles), 4))
    return figure


def _estimates(axes: Axes, table: Mapping[str, Any], styles: list[int]) -> None:
    c, phi = shown_segments.estimate_limits(table)
    unseen = 0
    for row, style in enumerate(styles):
        colour, outline = COLOURS[style], shown_segments.ellipse(table, row)
        if len(styles) <= MOST_ERRORS and np.isfinite(outline).all():
            # One around the axes, or beyond them, does not show.
            unseen += not Path(outline).intersects_bbox(Bbox(np.transpose([c, phi])), filled=False)
            trusted = table["status"][row] == "ok"
            face, alpha, line = (colour, 0.25, "-") if trusted else ("none", 0.5, ":")
            look: dict[str, Any] = {"facecolor": face, "edgecolor": colour, "alpha": alpha}
            axes.add_patch(Polygon(outline, linewidth=0.8, linestyle=line, **look))
        _mark(axes, table, row, colour, marker=MARKERS[style], markersize=5.0, linestyle="none")
    x, y = (np.asarray(table[name], dtype=float) for name in ("c_kPa", "phi_deg"))
    outside = int(np.count_nonzero((x < c[0]) | (x > c[1]) | (y < phi[0]) | (y > phi[1])))
    title = "estimates, 95 % regions" if len(styles) <= MOST_ERRORS else "estimates"
    notes = [f"{outside} beyond the axes"] * bool(outside) + [f"{unseen} outside the picture"] * bool(unseen)
    axes.set(
        xlim=c,
        ylim=phi,
        xlabel="cohesion c (kPa)",
        ylabel="friction angle φ (°)",
        title=f"{title} ({', '.join(notes)})" if notes else title,
    )


def _mark(axes: Axes, table: Mapping[str, Any], row: int, colour: str, **style: Any) -> None:
    """Draw c and φ of a segment, hollow where its status is not ok."""
    face = colour if table["status"][row] == "ok" else "white"
    axes.plot(table["c_kPa"][row], table["phi_deg"][row], color=colour, markerfacecolor=face, **style)


def _lines(axes: Axes, table: Mapping[str, Any], styles: list[int]) -> None:
    pivots = np.asarray(table["sigma_star_kPa"], dtype=float)
    known = shown_segments.tested(table)
    axes.set(
        xlabel="normal stress σ (kPa)",
        ylabel="shear strength c + σ tan φ (kPa)",
        title="strength, marked at σ* with 95 % error",
    )
    if not len(known):
        return
    for row in known:
        colour, marker, line = COLOURS[styles[row]], MARKERS[styles[row]], LINES[styles[row]]
        # Far from σ* the drive has not tried the soil.
        stress = np.linspace(0.5 * pivots[row], 1.5 * pivots[row], 30)
        value, error = shown_segments.strength(table, row, stress)
        if np.isfinite(value).all():
            axes.plot(stress, value, color=colour, linestyle=line, linewidth=1.0)
        if len(known) <= MOST_BANDS and np.isfinite(error).all():
            axes.fill_between(
                stress, value - 1.96 * error, value + 1.96 * error, color=colour, alpha=0.15, linewidth=0.0
            )
        error = 1.96 * np.nan_to_num(table["strength_se_kPa"][row])
        style: dict[str, Any] = {"marker": marker, "markersize": 4.0, "capsize": 2.0, "elinewidth": 0.9}
        style |= {"color": colour, "yerr": error if len(styles) <= MOST_ERRORS else None}
        axes.errorbar(pivots[row], table["strength_kPa"][row], **style)
    across, up = shown_segments.strength_limits(table)
    axes.set(xlim=across, ylim=up)


def rim_stress(moments: Sequence[Moment]) -> Figure:
    """Draw normal and shear stress along the rim, a panel for each moment."""
    figure, grid = panels(len(moments), 2, (3.8, 0.0), (2.9, 0.3))
    for axes, moment in zip(grid.flat, moments, strict=False):
        angle, normal, shear = moment.stresses
        peak = int(np.argmax(normal))
        axes.axvline(angle[peak], color=FAINT, linewidth=0.7, linestyle=":")
        axes.text(
            angle[peak], 1.0, f"θm = {angle[peak]:.0f}°", transform=axes.get_xaxis_transform(), fontsize=7.5
        )
        axes.plot(angle, normal, color=COLOURS[0], label="normal stress σ")
        axes.plot(angle, shear, color=COLOURS[1], linestyle="--", label="shear stress τ")
        axes.axhline(0.0, color=FAINT, linewidth=0.6)
        axes.set(xlabel="angle from the vertical θ (°), forward positive", ylabel="stress (kPa)")
        axes.set_title(moment.title, pad=14.0, fontsize=8.0)
    figure.legend(*grid[0, 0].get_legend_handles_labels(), loc="outside lower center", ncols=2)
    return figure


def track(table: Mapping[str, Any], misfit: Mapping[str, ArrayLike]) -> Figure | None:
    """Draw the track of each wheel by strength and by each misfit; None where no segment has a place."""
    paths = shown_segments.paths(table)
    if not any(len(path) for path in paths):
        return None
    key = list(zip(table["source"], table["wheel"], strict=True))
    wheels = list(dict.fromkeys(key))[:MOST_WHEELS]
    shown = dict([shown_segments.mapped_strength(table)])
    shown |= {label: np.asarray(values, dtype=float) for label, values in misfit.items()}
    every = np.concatenate([path for path in paths if len(path)])
    across, up, stretch = shown_segments.frame(table, every)
    shape = (up[1] - up[0]) * stretch / (across[1] - across[0])
    panel = (3.4, 3.1 * shape + 0.3) if shape < 1.0 else (3.4 / shape + 0.9, 3.8)
    figure = Picture(figsize=(panel[0] * len(shown), panel[1] * len(wheels) + 1.1), layout="compressed")
    grid = figure.subplots(len(wheels), len(shown), squeeze=False, sharex=True, sharey=True)
    x, y = ("longitude (°)", "latitude (°)") if shown_segments.geographic(table) else ("x (m)", "y (m)")
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
            rise = float(np.prod(course[-1] - course[0]))
            # On the side from which the track falls away, so that no number lies on it.
            side = "right" if rise > 0.0 else "left" if rise < 0.0 else "center"
            look: dict[str, Any] = {"fontsize": 7.0, "ha": side, "color": INK}
            middle = course[len(course) // 2]
            axes.annotate(f"{value:.2g}", middle, (0, 6), textcoords="offset points", **look)
    axes.grid(visible=True, color=FAINT, alpha=0.3, linewidth=0.5)
    return lines


def valleys(posterior: Posterior, table: Mapping[str, Any]) -> Figure | None:
    """Draw the joint posterior of c and φ of the segments of one wheel; None where no segment has a grid."""
    kind, number = np.asarray(posterior["kind"]), np.asarray(posterior["segment"])
    there = np.unique(number[kind == GRID])
    if not len(there):
        return None
    if len(there) > MOST_VALLEYS:
        there = there[np.round(np.linspace(0, len(there) - 1, MOST_VALLEYS)).astype(int)]
    figure, grid = panels(len(there), 3, (2.9, 0.0 if len(there) > 1 else 1.7), (2.7, 0.8))
    drawn = [
        _panel(axes, posterior, np.flatnonzero(number == segment), table, int(segment))
        for axes, segment in zip(grid.flat, there, strict=False)
    ]
    handles = [
        Patch(color=COLOURS[0], alpha=0.65, label="68 %"),
        Patch(color=COLOURS[0], alpha=0.25, label="95 %"),
        Line2D(
            [], [], color=INK, marker="o", markersize=4.0, linestyle="none", label="estimate (hollow: not ok)"
        ),
        Line2D([], [], color=FAINT, linewidth=0.9, linestyle="--", label="95 % by its standard errors"),
        Line2D([], [], color=COLOURS[1], label="same strength at the pivot stress"),
    ]
    if any(drawn):
        handles.append(Line2D([], [], color=COLOURS[2], linestyle=":", label="68 % of the prior"))
    figure.legend(handles=handles, loc="outside lower center", ncols=3 if len(there) > 1 else 2)
    left = int(np.count_nonzero(np.isfinite(table["strength_kPa"]))) - len(there)
    wheel = " ".join([str(table["source"][0]), str(table["wheel"][0])]).strip()
    figure.suptitle(
        f"{wheel}: {len(there)} of {left + len(there)} segments" if left > 0 else wheel, fontsize=9.0
    )
    return figure


def _panel(axes: Axes, posterior: Posterior, rows: Index, table: Mapping[str, Any], segment: int) -> bool:
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
    limits = [limits_of(part[shown], margin=0.08) for part in (c, phi)]
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
    outline = shown_segments.ellipse(table, row)
    if np.isfinite(outline).all():
        axes.plot(*outline.T, color=FAINT, linewidth=0.9, linestyle="--")
    _mark(axes, table, row, INK, marker="o", markersize=4.0)
    terrain = f", {table['terrain'][row]}" if table["terrain"][row] else ""
    axes.set(xlim=limits[0], ylim=limits[1], xlabel="cohesion c (kPa)", ylabel="friction angle φ (°)")
    stress = f", pivot at {pivot:.3g} kPa" if pivot > 0.0 else ""
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
