"""Predicted against measured, and the residual against what may drive it."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from terrain_cli.views import binning, sample_pairs
from terrain_cli.views.chart_style import COLOURS, COUNTS, FAINT, INK, MARKERS, MEDIAN
from terrain_cli.views.figures.picture import Picture
from terrain_cli.vocabulary import quantities

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.collections import QuadMesh
    from matplotlib.figure import Figure
    from numpy.typing import NDArray

    from terrain_cli.comparison.comparison_outcome import Comparison

    Array = NDArray[np.float64]

#: Points that an SVG holds one by one; more are an image in it.
MOST_DRAWN = 500
#: Drivers in one picture.
MOST_DRIVERS = 9


def predicted_measured(comparison: Comparison) -> Figure:
    """Draw what was predicted against what was measured, a panel for each channel."""
    shown = sample_pairs.channels(comparison)
    figure = Picture(figsize=(3.4 * len(shown), 3.9))
    for axes, name in zip(np.ravel(figure.subplots(1, len(shown))), shown, strict=True):
        errors = comparison.channels[name]
        what = quantities.quantity(name, errors.unit)
        pooled = sample_pairs.pairs(comparison, name)
        if len(pooled.measured) > binning.MOST_POINTS:
            mesh = _counts(axes, binning.grid(pooled.measured, pooled.predicted, square=True))
            figure.colorbar(mesh, ax=axes, label="samples", location="bottom", shrink=0.8, aspect=30)
        else:
            _points(axes, comparison, pooled)
        ends = binning.limits(pooled.measured, pooled.predicted)
        axes.plot(ends, ends, color=INK, linewidth=0.8, label="predicted = measured")
        axes.set(
            xlim=ends,
            ylim=ends,
            aspect="equal",
            xlabel=f"measured {what.label}",
            ylabel=f"predicted {what.label}",
            title=f"rms error {quantities.number(errors.rmse * what.factor)}, "
            f"held out {quantities.number(errors.heldout_rmse * what.factor)} {what.unit}\n"
            f"noise {quantities.number(errors.noise * what.factor)} {what.unit}, "
            f"{len(pooled.measured):,} samples",
        )
        axes.legend(loc="upper left", handletextpad=0.4)
    return figure


def _points(axes: Axes, comparison: Comparison, pooled: sample_pairs.Pairs) -> None:
    for index, wheel in enumerate(comparison.wheels):
        here = pooled.wheel == index
        label = wheel.wheel if 1 < len(comparison.wheels) <= len(COLOURS) else None
        style = index if label else 0
        axes.plot(
            pooled.measured[here],
            pooled.predicted[here],
            linestyle="none",
            marker=MARKERS[style],
            markersize=3.0,
            markerfacecolor="none",
            markeredgewidth=0.6,
            color=COLOURS[style],
            alpha=0.7,
            label=label,
            rasterized=bool(here.sum() > MOST_DRAWN),
        )


def _counts(axes: Axes, grid: binning.Grid) -> QuadMesh:
    from matplotlib.colors import LogNorm

    counts = np.ma.masked_equal(grid.counts, 0.0)
    norm = LogNorm(1.0, max(float(grid.counts.max()), 2.0))
    return axes.pcolormesh(grid.x, grid.y, counts, cmap=COUNTS, norm=norm, rasterized=True)


def residuals(comparison: Comparison, channel: str) -> Figure:
    """Draw the residual of a channel against its drivers, with the band of 5 to 95 % about its median.

    Parameters
    ----------
    channel : str
        "torque", "drawbar_pull" or "sinkage".
    """
    errors = comparison.channels[channel]
    what = quantities.quantity(channel, errors.unit)
    pooled = sample_pairs.pairs(comparison, channel)
    shown = sample_pairs.drivers(comparison, channel, pooled, MOST_DRIVERS)
    columns = min(3, max(len(shown), 1))
    rows = math.ceil(len(shown) / columns) or 1
    figure = Picture(figsize=(3.2 * columns + 0.3, 2.4 * rows + 0.7))
    grid = figure.subplots(rows, columns, squeeze=False, sharey=True)
    residual = pooled.residual
    for axes in grid.flat[len(shown) :]:
        axes.remove()
    for axes, driver in zip(grid.flat, shown, strict=False):
        along = sample_pairs.driver(comparison, driver, pooled)
        _along(axes, along, residual, errors.noise * what.factor)
        axes.set_xlabel(along.quantity.label)
    if len(residual):
        low, high = np.percentile(residual, [0.2, 99.8])
        grid[0, 0].set_ylim(*binning.limits(np.array([low, high, 0.0]), margin=0.1))
    figure.supylabel(f"measured − predicted {what.label}", fontsize=9.0)
    handles, labels = grid[0, 0].get_legend_handles_labels()
    if handles:
        figure.legend(handles, labels, loc="outside upper left", ncols=len(labels))
    return figure


def _along(axes: Axes, along: sample_pairs.Along, residual: Array, noise: float) -> None:
    driver = along.values
    known = np.flatnonzero(np.isfinite(driver))
    if len(known) > binning.MOST_POINTS:
        low, high = np.percentile(residual[known], [0.1, 99.9])
        near = known[(residual[known] >= low) & (residual[known] <= high)]
        _counts(axes, binning.grid(driver[near], residual[near], 50))
    else:
        axes.plot(
            driver[known],
            residual[known],
            ".",
            color=FAINT,
            markersize=2.5,
            alpha=0.6,
            rasterized=len(known) > MOST_DRAWN,
        )
    if math.isfinite(noise):
        for sign in (-1.0, 1.0):
            axes.axhline(
                sign * 1.96 * noise,
                color=COLOURS[0],
                linewidth=0.9,
                linestyle=":",
                label="± 1.96 × noise" if sign > 0.0 else None,
            )
    axes.axhline(0.0, color=INK, linewidth=0.7)
    band = binning.band(driver, residual)
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
