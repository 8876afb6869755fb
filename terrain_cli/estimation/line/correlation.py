"""Standard errors of a fitted line whose residuals may be correlated in time."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from terrain_cli.estimation.line.moments import X, Y

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from terrain_cli.estimation.line.least_squares import Line
    from terrain_cli.estimation.line.moments import WindowMoments

    Array = NDArray[np.float64]

_ITERATIONS = 6

#: Standard deviations of the residuals by which a line, or its slope over the spread of x, may be
#: off at the most. A few correlated residuals cannot tell their own correlation, and would
#: otherwise make a large error of a small misfit.
_LARGEST_ERROR = 2.0

#: Lag-1 autocorrelation of residuals that may be called smooth.
_SMOOTH = 0.9


@dataclass(frozen=True)
class Errors:
    """Sampling errors of the two parameters that are uncorrelated: the mean stress and the slope."""

    variance: Array  # Shape (w,): of one residual, Pa²
    mean: Array  # Shape (w,): variance of the mean of `count` residuals over that of one
    tan_phi: Array  # Shape (w,): variance of tan φ; NaN where x does not vary


def sampling_errors(moments: WindowMoments, line: Line, *, correlated: bool) -> Errors:
    """Variances of a line's mean stress and slope.

    The residuals' autocorrelation is taken as a ρᵏ at lag k: white noise (a = 0), a
    first-order process (a = 1) or the sum of the two, which is what a slow misfit under sensor
    noise looks like. a and ρ come from lags 1 and 2. Least squares makes residuals look less
    correlated and smaller than the noise; the share of both that the line takes up is put
    back (to first order, by iteration). The effective numbers of samples follow as n/τ with
    τ = 1 + 2 Σ (1 − k/n) a ρᵏ for the mean and a (ρ ρx)ᵏ for the slope, where ρx is the lag-1
    autocorrelation of x (Bartlett 1935). Negative correlation is not used to shrink an error.

    Residuals that turn more smoothly than a first-order process are no noise but the misfit of
    the model, which no number of samples averages out: the error is then that of two samples.

    Variances of correlated residuals are widened by Student's t for the effective number of
    samples over that for n, so that ± 1.96 se holds its 95 % where a window has few
    independent samples. With uncorrelated residuals the variances are the textbook ones.

    Parameters
    ----------
    correlated : bool
        False for steady test points, which have no order in time.

    Returns
    -------
    Errors
        NaN where n < 3.
    """
    count, spread = moments.count, np.where(moments.varies(X), moments[0, X, X], np.nan)
    with np.errstate(divide="ignore", invalid="ignore"):
        plain = np.where(count > 2, line.residual / (count - 2.0), np.nan)
        if not correlated:
            return Errors(plain, 1.0 / count, plain / spread)
        tau_mean, tau_slope, dof, smooth = _effective(moments, line)
        variance = np.where(smooth, plain, np.where(count > 2, line.residual / dof, np.nan))
        mean, tan_phi = (
            np.where(
                smooth,
                plain / 2.0,
                np.minimum(
                    variance * tau / count * (student(count / tau - 2.0) / student(count - 2.0)) ** 2,
                    _LARGEST_ERROR**2 * plain,
                ),
            )
            for tau in (tau_mean, tau_slope)
        )
        return Errors(variance, np.nan_to_num(mean / variance), tan_phi * count / spread)


def _effective(moments: WindowMoments, line: Line) -> tuple[Array, Array, Array, NDArray[np.bool_]]:
    """Return the samples per independent one, for mean and slope, and the degrees of freedom left.

    And whether the residuals are smooth: their second partial autocorrelation is negative by more
    than chance. A first-order process has none, and noise above it has a positive one.
    """
    count, spread, slope = moments.count, moments[0, X, X], np.nan_to_num(line.tan_phi)
    seen1, seen2 = (
        (moments[lag, Y, Y] - 2.0 * slope * moments[lag, X, Y] + slope**2 * moments[lag, X, X])
        / line.residual
        for lag in (1, 2)
    )
    x1, x2 = (np.nan_to_num(np.clip(moments[lag, X, X] / spread, -1.0, 1.0)) for lag in (1, 2))
    seen1, seen2 = (np.nan_to_num(np.clip(seen, -1.0, 1.0)) for seen in (seen1, seen2))
    partial = (seen2 - seen1**2) / np.maximum(1.0 - seen1**2, np.finfo(float).eps)
    smooth = (seen1 > _SMOOTH) & (partial < -3.0 / np.sqrt(count))
    # At least two independent samples: fewer cannot be told from a drift.
    largest = np.maximum(1.0 - 2.0 / count, 0.0)
    rho, share = np.clip(seen1, 0.0, largest), np.ones_like(count)
    for iteration in range(_ITERATIONS + 1):
        tau_mean = samples_per_independent(rho, share, count)
        tau_slope = samples_per_independent(rho * x1, share, count)
        dof = np.maximum(count - tau_mean - tau_slope, 1.0)
        if iteration == _ITERATIONS:
            break
        at1 = np.clip((seen1 * dof + tau_mean + tau_slope * x1) / (count - 1.0), 0.0, largest)
        at2 = (seen2 * dof + tau_mean + tau_slope * x2) / (count - 2.0)
        # Below the noise of a correlation, the ratio of two of them says nothing.
        clear = at1 > 1.0 / np.sqrt(count)
        rho = np.where(clear, np.clip(at2 / np.where(clear, at1, 1.0), at1, largest), at1)
        share = np.where(clear, at1 / np.where(clear, rho, 1.0), 1.0)
    return tau_mean, tau_slope, dof, smooth


def samples_per_independent(rho: Array, share: Array, count: Array) -> Array:
    """Return how many samples make one independent one: 1 + 2 Σ (1 − k/n) a ρᵏ over lags k = 1 … n − 1.

    ρ < 1 and the share a are of the autocorrelation a ρᵏ, all of shape (w,); between 1 and n/2.
    """
    total = rho / (1.0 - rho) - rho * (1.0 - rho**count) / (count * (1.0 - rho) ** 2)
    return np.asarray(np.clip(1.0 + 2.0 * share * total, 1.0, np.maximum(count / 2.0, 1.0)))


def student(dof: Array) -> Array:
    """Quantile 0.975 of Student's t, by expansion in 1/dof, 1 at least (Abramowitz & Stegun 26.7.5)."""
    z, dof = 1.959964, np.maximum(dof, 1.0)
    return np.asarray(
        z
        + (z**3 + z) / (4.0 * dof)
        + (5.0 * z**5 + 16.0 * z**3 + 3.0 * z) / (96.0 * dof**2)
        + (3.0 * z**7 + 19.0 * z**5 + 17.0 * z**3 - 15.0 * z) / (384.0 * dof**3)
    )
