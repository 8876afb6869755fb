"""Pictures for paper: each function returns one matplotlib figure."""

from __future__ import annotations

from terrain_cli.views.figures.drive_figures import convergence, convergence_of_all, measured
from terrain_cli.views.figures.model_figures import candidates, errors, predicted_measured, residuals
from terrain_cli.views.figures.soil_figures import rim_stress, strength, track, valleys

__all__ = [
    "candidates",
    "convergence",
    "convergence_of_all",
    "errors",
    "measured",
    "predicted_measured",
    "residuals",
    "rim_stress",
    "strength",
    "track",
    "valleys",
]
