"""Pictures for paper: each function returns one matplotlib figure."""

from __future__ import annotations

from terrain_cli.views.figures.agreement import predicted_measured, residuals
from terrain_cli.views.figures.ladder_figure import errors
from terrain_cli.views.figures.recursion import convergence, convergence_of_all
from terrain_cli.views.figures.soil_strength import rim_stress, strength
from terrain_cli.views.figures.track import track
from terrain_cli.views.figures.valleys import valleys

__all__ = [
    "convergence",
    "convergence_of_all",
    "errors",
    "predicted_measured",
    "residuals",
    "rim_stress",
    "strength",
    "track",
    "valleys",
]
