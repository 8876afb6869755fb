"""Standard errors of c, φ and the strength, from the scatter of samples and the noise of the sensors."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from terrain_cli.estimation.line.correlation import sampling_errors
from terrain_cli.estimation.line.moments import X, Y
from terrain_cli.estimation.line.separability import distance_to_bounds, phi_bounds

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from terrain_cli.estimation.line.least_squares import Line
    from terrain_cli.estimation.line.moments import WindowMoments

    Array = NDArray[np.float64]


#: Share of the strength by which equations [20] to [25] are off for dropping κ3: 0.07 to 1.0 %, root mean
#: square 0.42 %, on soils of Wong's Theory of Ground Vehicles, at 60 to 100 N and slips of 0.1 to 0.8.
DROPPED_KAPPA3 = 0.005


@dataclass(frozen=True, kw_only=True)
class Uncertainty:
    """What is known of estimates, one entry per window."""

    # phi_low, phi_high: shape (w,): bounds of φ in rad for any noise in the four sensors (see `separability`)
    phi_low: Array
    phi_high: Array
    phi_bias: Array  # Shape (w,): root mean square distance of φ to a truth between the bounds, rad
    # Shape (w,): standard deviation of φ that the samples and the bounds leave open, wherever the estimate
    # lies, rad
    phi_open: Array
    cohesion: Array  # cohesion, phi: shape (w,): standard errors in Pa and rad
    phi: Array
    correlation: Array  # Shape (w,): of c and φ
    pivot: Array  # Shape (w,): stress σ* at which the strength c + σ* tan φ is not correlated with φ, Pa
    strength: Array  # strength, strength_se: shape (w,): strength at σ* and its standard error, Pa
    strength_se: Array


def uncertainty(
    moments: WindowMoments, line: Line, cohesion: Array, tan_phi: Array, gain: Array, *, correlated: bool
) -> Uncertainty:
    """Errors of estimates made from least-squares lines.

    A line turns about the mean point of its window. The stress there, s, is uncorrelated with
    the slope of least squares; a linear estimator maps the sampling errors of both by `gain`.
    To them is added what sampling does not see, as mean squares: to tan φ the distance to a
    truth anywhere within the bounds that the channels put on φ, and to s the pull of a penalty
    away from the mean of y, and to both the share that dropping κ3 makes of them.
    Residuals about the true line are larger than about the line fitted
    to noise, by as much as the two may differ in slope; the error of s allows for that too.

    Parameters
    ----------
    line : Line
        Least squares of the same windows.
    cohesion, tan_phi : ndarray, shape (w,)
        The estimates, c in Pa.
    gain : ndarray, shape (2, 2, w)
        Derivatives of the estimates of (s, tan φ) by those of least squares.
    correlated : bool
        Whether samples follow each other in time.

    Returns
    -------
    Uncertainty
        NaN where n < 3.
    """
    mean_x, mean_y = moments.mean[X], moments.mean[Y]
    sampling = sampling_errors(moments, line, correlated=correlated)
    low, high = phi_bounds(moments, correlated=correlated)
    phi = np.arctan(tan_phi)
    bias = distance_to_bounds(phi, low, high)
    slope_bias = np.nan_to_num(bias) * (1.0 + np.nan_to_num(tan_phi) ** 2)
    with np.errstate(divide="ignore", invalid="ignore"):
        about_truth = sampling.variance + moments[0, X, X] / moments.count * slope_bias**2
        stress = np.array([about_truth * sampling.mean, np.nan_to_num(sampling.tan_phi)])
        var_s, cov, var_t = (np.sum(gain[a] * gain[b] * stress, axis=0) for a, b in ((0, 0), (0, 1), (1, 1)))
        # Least squares has no slope where x does not vary, but its mean stands.
        pull = np.nan_to_num(cohesion + mean_x * tan_phi - mean_y)
        var_s, var_t = (
            var_s + pull**2 + (DROPPED_KAPPA3 * mean_y) ** 2,
            np.where(
                np.isfinite(tan_phi),
                var_t + bias**2 * (1.0 + tan_phi**2) ** 2 + (DROPPED_KAPPA3 * tan_phi) ** 2,
                np.nan,
            ),
        )
        offset = np.where(var_t > 0.0, -cov / var_t, 0.0)
        # Near zero the differences may come out negative by rounding.
        var_c = np.maximum(var_s - 2.0 * mean_x * cov + mean_x**2 * var_t, 0.0)
        return Uncertainty(
            phi_low=low,
            phi_high=high,
            phi_bias=bias,
            phi_open=np.sqrt(sampling.tan_phi / (1.0 + line.tan_phi**2) ** 2 + (high - low) ** 2 / 12.0),
            cohesion=np.sqrt(var_c),
            phi=np.sqrt(var_t) / (1.0 + tan_phi**2),
            correlation=np.clip((cov - mean_x * var_t) / np.sqrt(var_c * var_t), -1.0, 1.0),
            pivot=mean_x + offset,
            strength=mean_y + pull + offset * np.nan_to_num(tan_phi),
            strength_se=np.sqrt(np.maximum(var_s + np.nan_to_num(offset * cov), 0.0)),
        )
