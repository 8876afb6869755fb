"""Fits in the form that the table of windows is made of."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from terrain_cli.estimation.line.window_estimates import WindowEstimates
    from terrain_cli.estimation.wheel_fit.fit_result import Fit


def as_window_estimates(fit: Fit, linear: WindowEstimates) -> WindowEstimates:
    """Put a fit in the place of the linear estimates of the same windows.

    Parameters
    ----------
    linear : WindowEstimates
        Keeps its columns of least squares and ridge, and the bounds of φ.

    Returns
    -------
    WindowEstimates
        With the method "wong-reece" (the base of the fit's model); k is in ``fit.values``.

    Raises
    ------
    ValueError
        Different numbers of windows.
    """
    if len(fit) != len(linear):
        raise ValueError(f"a fit of {len(fit)} windows and estimates of {len(linear)}")
    nothing = np.full(len(fit), np.nan)
    return replace(
        linear,
        method=np.full(len(fit), fit.model.base),
        status=fit.status,
        c=fit.values["cohesion"],
        c_se=fit.errors["cohesion"],
        phi=fit.phi,
        phi_se=fit.phi_se,
        corr=fit.correlation("cohesion", "tan_phi"),
        sigma_star=fit.sigma_star,
        strength=fit.strength,
        strength_se=fit.strength_se,
        torque_rmse=fit.rmse.get("torque", nothing),
        # Errors of the channels are in `phi_se`, and average out over windows.
        phi_bias=np.zeros(len(fit)),
    )
