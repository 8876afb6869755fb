"""Stress along the rim: Figure 2 of Iagnemma et al. 2004, for windows that were fitted."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from terrain_cli.mechanics.stresses import stresses
from terrain_cli.views.chart_style import COLOURS, FAINT
from terrain_cli.views.figures.picture import Picture

if TYPE_CHECKING:
    from collections.abc import Sequence

    from matplotlib.figure import Figure

    from terrain_cli.views.soil_table import Moment


def rim_stress(moments: Sequence[Moment]) -> Figure:
    """Draw normal and shear stress along the rim, a panel for each moment.

    Parameters
    ----------
    moments : sequence of Moment
        From `soil_strength.moments`.
    """
    columns = min(2, len(moments))
    rows = -(-len(moments) // columns)
    figure = Picture(figsize=(3.8 * columns, 2.9 * rows + 0.3))
    grid = figure.subplots(rows, columns, squeeze=False)
    for axes in grid.flat[len(moments) :]:
        axes.remove()
    for axes, moment in zip(grid.flat, moments, strict=False):
        seen = stresses(moment.model, moment.wheel, moment.channels, moment.values)
        angle = np.degrees(seen.angle[:, 0])
        normal, shear = seen.normal[:, 0] / 1e3, seen.shear[:, 0] / 1e3
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
    handles, labels = grid[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=2)
    return figure
