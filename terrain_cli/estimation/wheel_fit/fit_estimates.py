"""Fits in the form that the table of windows is made of."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from terrain_cli.estimation.wheel_fit.fit_result import between

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from terrain_cli.estimation.line.window_estimates import WindowEstimates
    from terrain_cli.estimation.wheel_fit.fit_result import Fit

    Array = NDArray[np.float64]


def _parted(fit: Fit) -> dict[str, Any]:
    """Return c and tan φ with the errors from noise, and those from priors."""
    found: dict[str, Any] = {"data_c": fit.values["cohesion"], "data_tan_phi": fit.values["tan_phi"]}
    for part, covariance in (("data", fit.covariance - fit.by_priors), ("assumed", fit.by_priors)):
        var_c, cov, var_t = (
            between(fit.names, covariance, a, b)
            for a, b in (("cohesion", "cohesion"), ("cohesion", "tan_phi"), ("tan_phi", "tan_phi"))
        )
        c, t = (np.sqrt(np.maximum(variance, 0.0)) for variance in (var_c, var_t))
        both = c * t
        corr = np.clip(np.divide(cov, both, out=np.zeros_like(both), where=both > 0.0), -1.0, 1.0)
        found |= {f"{part}_c_se": c, f"{part}_tan_phi_se": t, f"{part}_corr": corr}
    return found


def as_window_estimates(fit: Fit, linear: WindowEstimates) -> WindowEstimates:
    """Put a fit in the place of the linear estimates of the same windows.

    Those keep their columns of least squares and ridge, and the bounds of φ.
    """
    if len(fit) != len(linear):
        raise ValueError(f"a fit of {len(fit)} windows and estimates of {len(linear)}")
    nothing = np.full(len(fit), np.nan)
    return replace(
        linear,
        method=np.full(len(fit), fit.model.base),
        status=fit.status,
        separable=fit.separable,
        **_parted(fit),
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
