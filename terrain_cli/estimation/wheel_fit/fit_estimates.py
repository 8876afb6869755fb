"""Fits in the form that the table of windows is made of."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from terrain_cli.estimation.line.window_estimates import WindowEstimates
    from terrain_cli.estimation.wheel_fit.fit_result import Fit

    Array = NDArray[np.float64]


#: Least share of the prior's variance that the data take away along an axis: they never say nothing at all.
_LEAST = 1e-6


def _without_priors(fit: Fit) -> dict[str, Any]:
    """Return what the data alone say of c and tan φ: their posterior by its priors (Bayes).

    Along an axis of variance v and mean m, in terms of the priors, the data alone have the variance
    v / (1 − v) and the mean m / (1 − v).
    """
    names = ("cohesion", "tan_phi")
    value = np.array([fit.values[name] for name in names]).T
    error = np.array([fit.errors[name] for name in names]).T
    prior = np.array([fit.priors.get(name, (0.0, np.inf)) for name in names])
    mean, sd = prior[:, 0], np.where(np.isfinite(prior[:, 1]), prior[:, 1], 1.0)
    free = np.isfinite(prior[:, 1])
    scaled = error / sd
    covariance = scaled[:, :, None] * scaled[:, None, :]
    covariance[:, 0, 1] *= np.nan_to_num(fit.correlation(*names))
    covariance[:, 1, 0] = covariance[:, 0, 1]
    known = np.isfinite(covariance).all(axis=(1, 2)) & free.all()
    variance, axes = np.linalg.eigh(np.where(known[:, None, None], covariance, 0.5 * np.eye(2)))
    left = np.maximum(1.0 - variance, _LEAST)
    along = np.einsum("wab,wa->wb", axes, np.where(known[:, None], (value - mean) / sd, 0.0))
    alone = mean + sd * np.einsum("wab,wb->wa", axes, along / left)
    wide = np.einsum("wab,wb,wcb->wac", axes, variance / left, axes)
    wide_se = np.sqrt(np.einsum("waa->wa", wide))
    value = np.where(known[:, None], alone, value)
    corr = np.where(known, wide[:, 0, 1] / (wide_se[:, 0] * wide_se[:, 1]), fit.correlation(*names))
    error = np.where(known[:, None], sd * wide_se, error)
    return {
        "data_c": value[:, 0],
        "data_c_se": error[:, 0],
        "data_tan_phi": value[:, 1],
        "data_tan_phi_se": error[:, 1],
        "data_corr": corr,
    }


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
        separable=fit.separable,
        **_without_priors(fit),
        c=fit.values["cohesion"],
        c_se=fit.errors["cohesion"],
        phi=fit.phi,
        phi_se=fit.phi_se,
        corr=fit.correlation("cohesion", "tan_phi"),
        sigma_star=fit.sigma_star,
        strength=fit.strength,
        strength_se=fit.strength_se,
        torque_rmse=fit.rmse.get("torque", nothing),
        assumed_c=np.zeros(len(fit)),
        assumed_tan_phi=np.zeros(len(fit)),
        assumed_corr=np.zeros(len(fit)),
        # Errors of the channels are in `phi_se`, and average out over windows.
        phi_bias=np.zeros(len(fit)),
    )
