"""A log as it was measured."""

from __future__ import annotations

from typing import TYPE_CHECKING

from terrain_cli.simulation.simulated_log import channels
from terrain_cli.views.chart_style import COLOURS, FAINT
from terrain_cli.views.figures.picture import Picture
from terrain_cli.views.shown_samples import some
from terrain_cli.vocabulary import quantities
from terrain_cli.vocabulary.channels import CHANNELS

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from terrain_cli.simulation.simulated_log import SimulatedLog


def measured(log: SimulatedLog) -> Figure:
    """Draw each channel of a simulated log against time, wheel by wheel, and where the soil changes."""
    names = channels(log.scenario)
    rows = -(-len(names) // 2)
    figure = Picture(figsize=(8.6, 0.8 + 1.35 * rows))
    grid = figure.subplots(rows, 2, squeeze=False, sharex=True)
    for axes in grid.flat[len(names) :]:
        axes.remove()
    for axes, name in zip(grid.flat, names, strict=False):
        unit = CHANNELS[name].unit
        what = quantities.quantity(name, unit.symbol if unit else "")
        of = {"": log.body} if name in log.body else log.wheels
        for ink, (wheel, series) in zip(COLOURS, of.items(), strict=False):
            shown = some(len(series[name].time))
            values = series[name].values[shown] * what.factor
            axes.plot(series[name].time[shown], values, color=ink, linewidth=0.7, label=wheel)
        for stretches in log.stretches.values():
            for stretch in stretches[1:]:
                axes.axvline(stretch.start, color=FAINT, linewidth=0.7, linestyle=":")
        axes.set_title(what.label)
    for axes in grid.flat[len(names) - 2 : len(names)]:
        axes.set_xlabel("time (s)")
        axes.tick_params(labelbottom=True)
    if len(log.wheels) > 1:
        handles, labels = grid[0, 0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside upper left", ncols=len(labels))
    return figure
