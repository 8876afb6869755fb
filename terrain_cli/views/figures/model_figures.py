"""How well a model predicts: against measurements, along its drivers, and change by change."""

import math
from collections.abc import Sequence
from textwrap import fill
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import QuadMesh
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from terrain_cli.comparison.blocks import Interval
from terrain_cli.comparison.comparison_outcome import Comparison
from terrain_cli.diagnosis.diagnosis_outcome import Diagnosis
from terrain_cli.diagnosis.verdict import sizes_text
from terrain_cli.improvement.model_history import Rung, channels
from terrain_cli.views import shown_samples
from terrain_cli.views.chart_style import COLOURS, COUNTS, FAINT, INK, MARKERS, MEDIAN, measured, top
from terrain_cli.views.figures.drive_figures import Picture, panels
from terrain_cli.vocabulary import quantities
from terrain_cli.vocabulary.arrays import Array

MOST_DRAWN = 500  # Points that an SVG holds one by one; more are an image in it
MOST_DRIVERS = 9  # Drivers in one picture
_LINE = 56  # Characters in a line of the parameters of a candidate
MOST_CANDIDATES = 12  # Candidates of a diagnosis, the best first
_WHEELS = tuple(colour for colour in COLOURS if colour != MEDIAN)  # Of wheels, under a median
_APART = 0.18  # Distance of before and after from the middle of their step


def predicted_measured(comparison: Comparison) -> Figure:
    """Draw residuals over the prediction: noise of what was measured, in both, would look like a failure."""
    shown = shown_samples.channels(comparison)
    wheels = [wheel.wheel for wheel in comparison.wheels]
    figure = Picture(figsize=(3.4 * len(shown), 3.9))
    grid = figure.subplots(1, len(shown), squeeze=False)[0]
    for axes, (name, what) in zip(grid, shown.items(), strict=True):
        errors = comparison.channels[name]
        pooled = shown_samples.pairs(comparison, name)
        along = shown_samples.Along(what, pooled.predicted, ())
        names = wheels if 1 < len(wheels) <= len(_WHEELS) else ()
        mesh = _along(axes, along, pooled, errors.noise * what.factor, names)
        if mesh is not None:
            figure.colorbar(
                mesh, ax=axes, label="samples", format="%d", location="bottom", shrink=0.8, aspect=30
            )
        axes.set(
            ylim=_usual(pooled.residual),
            xlabel=f"predicted {what.label}",
            ylabel=f"measured − predicted {what.label}",
            title=f"rms error {quantities.number(errors.rmse * what.factor)}, "
            f"held out {quantities.number(errors.heldout_rmse * what.factor)} {what.unit}\n"
            f"noise {quantities.number(errors.noise * what.factor)} {what.unit}, "
            f"{len(pooled.measured):,} samples",
        )
    _legend(figure, grid[0], 3 * len(shown))
    return figure


def _usual(residual: Array) -> tuple[float, float]:
    """Return the range of a residual and of zero, without its rarest values."""
    ends = np.percentile(residual, [0.2, 99.8]) if len(residual) else np.empty(0)
    return shown_samples.limits(np.append(ends, 0.0), margin=0.1)


def _legend(figure: Figure, axes: Axes, most: int) -> None:
    handles, labels = axes.get_legend_handles_labels()
    if handles:
        figure.legend(handles, labels, loc="outside upper left", ncols=min(len(labels), most))


def residuals(comparison: Comparison, channel: str) -> Figure:
    """Draw the residual of a channel against its drivers, with the band of 5 to 95 % about its median."""
    errors, what = comparison.channels[channel], shown_samples.channels(comparison)[channel]
    pooled = shown_samples.pairs(comparison, channel)
    shown = shown_samples.drivers(comparison, channel, pooled, MOST_DRIVERS)
    figure, grid = panels(len(shown), 3, (3.2, 0.3), (2.4, 0.7), sharey=True)
    for axes, driver in zip(grid.flat, shown, strict=False):
        along = shown_samples.driver(comparison, driver, pooled)
        _along(axes, along, pooled, errors.noise * what.factor)
        axes.set_xlabel(along.quantity.label)
    grid[0, 0].set_ylim(*_usual(pooled.residual))
    figure.supylabel(f"measured − predicted {what.label}", fontsize=9.0)
    _legend(figure, grid[0, 0], 3)
    return figure


def _along(
    axes: Axes,
    along: shown_samples.Along,
    pooled: shown_samples.Pairs,
    noise: float,
    wheels: Sequence[str] = (),
) -> QuadMesh | None:
    """Draw residuals, their median on top; points of `wheels` apart, or counts, which are returned."""
    driver, residual = along.values, pooled.residual
    known = np.flatnonzero(np.isfinite(driver))
    mesh = None
    if len(known) > shown_samples.MOST_POINTS:
        low, high = np.percentile(residual[known], [0.1, 99.9])
        near = known[(residual[known] >= low) & (residual[known] <= high)]
        edges = [np.linspace(*shown_samples.limits(column[near]), 51) for column in (driver, residual)]
        look: dict[str, Any] = {"cmap": COUNTS, "norm": LogNorm(1.0), "cmin": 1, "rasterized": True}
        *_, mesh = axes.hist2d(driver[near], residual[near], edges, **look)
    else:
        for index, label in enumerate(wheels or [None]):
            here = known[pooled.wheel[known] == index] if wheels else known
            marker, ink = (MARKERS[index], _WHEELS[index]) if wheels else (".", FAINT)
            style: dict[str, Any] = {"linestyle": "none", "marker": marker, "color": ink, "label": label}
            style |= {"markersize": 2.5, "markeredgewidth": 0.0, "alpha": 0.6}
            axes.plot(driver[here], residual[here], rasterized=len(here) > MOST_DRAWN, **style)
    if math.isfinite(noise):
        for sign, label in ((-1.0, None), (1.0, "± 1.96 × noise")):
            axes.axhline(sign * 1.96 * noise, color=COLOURS[0], linewidth=0.9, linestyle=":", label=label)
    axes.axhline(0.0, color=INK, linewidth=0.7)
    band = shown_samples.band(driver, residual)
    if along.labels:
        longest = max(map(len, along.labels))
        turned: dict[str, Any] = {"rotation": 25, "ha": "right", "rotation_mode": "anchor"}
        axes.set_xticks(
            range(len(along.labels)), along.labels, **(turned if longest * len(along.labels) > 30 else {})
        )
        axes.set_xlim(-0.5, len(along.labels) - 0.5)
        axes.bar(
            band.centre, band.high - band.low, 0.4, band.low, color=MEDIAN, alpha=0.22, label="5 to 95 %"
        )
        axes.plot(band.centre, band.median, "o", color=MEDIAN, markersize=4.0, label="median")
    elif len(band.centre):
        axes.fill_between(
            band.centre, band.low, band.high, color=MEDIAN, alpha=0.22, linewidth=0.0, label="5 to 95 %"
        )
        axes.plot(
            band.centre, band.median, color=MEDIAN, marker="o", markersize=2.5, linewidth=1.4, label="median"
        )
    return mesh


def candidates(found: Diagnosis) -> Figure | None:
    """Draw what each fitted candidate, if any, explains of the misfit, and its held-out loss with 95 %."""
    fitted = [one for one in found.candidates if one.refitted][:MOST_CANDIDATES]
    if not fitted:
        return None
    # A line ends between two parameters, never within one.
    whole = [sizes_text(one).replace(" ", "\N{NO-BREAK SPACE}") for one in fitted]
    sizes = [fill(one.replace(",\N{NO-BREAK SPACE}", ", "), _LINE) for one in whole]
    lines = 2 + max(size.count("\n") for size in sizes)
    figure = Picture(figsize=(8.6, 1.5 + (0.12 + 0.15 * lines) * len(fitted)))
    explained, loss = figure.subplots(1, 2, sharey=True)
    place = np.arange(len(fitted))
    inks = [COLOURS[0] if one.in_family else FAINT for one in fitted]
    shares = [100.0 * max(one.explained, 0.0) for one in fitted]
    explained.barh(place, np.nan_to_num(shares), height=0.6, color=inks)
    explained.set(xlim=(0.0, 100.0), xlabel="share of the misfit explained (%)")
    for at, one, ink in zip(place, fitted, inks, strict=True):
        loss.errorbar(one.loss, at, xerr=1.96 * one.loss_se, fmt="o", color=ink, capsize=2.5, markersize=5.0)
    loss.axvline(0.0, color=INK, linewidth=0.8)
    loss.set_xlabel("change of the held-out loss, 95 %\n(noise variances per sample)")
    doubts = [f" ({one.doubt})" if one.doubt else "" for one in fitted]
    names = [f"{one.effect}{doubt}\n{size}" for one, doubt, size in zip(fitted, doubts, sizes, strict=True)]
    explained.set_yticks(place, names)
    explained.invert_yaxis()
    for axes in (explained, loss):
        axes.grid(axis="x", linewidth=0.4, alpha=0.5)
    handles = [
        Patch(color=ink, label=label)
        for ink, label in (
            (COLOURS[0], "the best effect, and those that cannot be told from it"),
            (FAINT, "others"),
        )
        if ink in inks
    ]
    figure.legend(handles=handles, loc="outside upper left", ncols=2)
    return figure


def errors(ladder: Sequence[Rung]) -> Figure | None:
    """Draw the held-out error of each channel, step by step, with its 95 % interval and noise, if any."""
    names = channels(ladder)
    if not names:
        return None
    tested = [rung for rung in ladder if rung.channels]
    wide = max(4.2, 1.6 + 0.95 * len(tested))
    figure = Picture(figsize=(min(wide, 14.0), 0.9 + 1.9 * len(names)))
    grid = figure.subplots(len(names), 1, squeeze=False, sharex=True)[:, 0]
    place = {rung.number: index for index, rung in enumerate(tested)}
    for axes, name in zip(grid, names, strict=True):
        _rungs(axes, tested, name, place)
    grid[-1].set_xticks(
        range(len(tested)), [rung.label for rung in tested], rotation=25, ha="right", rotation_mode="anchor"
    )
    grid[-1].set_xlim(-0.6, len(tested) - 0.4)
    handles, labels = grid[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper left", ncols=len(labels))
    return figure


def _rungs(axes: Axes, tested: Sequence[Rung], name: str, place: dict[int, int]) -> None:
    known = measured(tested, name)
    what = quantities.quantity(name, known[0][1].unit)
    at = np.array([place[rung.number] for rung, _ in known], dtype=float)
    for side, marker, face, label in ((-_APART, "o", "white", "before"), (_APART, "s", COLOURS[0], "after")):
        intervals = [one.before if side < 0.0 else one.after for _, one in known]
        value, spread = _spread(intervals, what.factor)
        style: dict[str, Any] = {"color": COLOURS[0], "markersize": 5.0, "capsize": 2.5, "linewidth": 1.0}
        style |= {"fmt": marker, "markerfacecolor": face, "label": f"{label} (95 %)"}
        axes.errorbar(at + side, value, spread, zorder=3, **style)
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
