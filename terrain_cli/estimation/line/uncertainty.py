"""Standard errors of c, φ and the strength: from samples, correlated in time, and from the noise of sensors.

x and y are computed from load, torque, sinkage and slip, all of them noisy, so that least
squares is biased however long the window: noise in the load or the slip flattens the line,
noise in the sinkage turns it towards the origin. Two channels come from different sensors,
though, and share no noise. With g = y − c − x tan φ taken at the true soil, a channel q is
correlated with g only through its own noise, cov(q, g) = (∂g/∂q) var(noise of q), and the sign
of ∂g/∂q is known: positive for the torque, negative for load, sinkage and slip (for a soil
with c ≥ 0 and φ ≥ 0). Each channel therefore bounds tan φ from one side by the slope
cov(q, y)/cov(q, x) that it gives as an instrument. Load bounds it from below and torque from
above (Frisch 1934; Klepper & Leamer 1984).

Where nothing but noise varies, the bounds are those of any soil.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from terrain_cli.estimation.line.moments import (
    CHANNELS,
    LOAD,
    SINKAGE,
    SLIP,
    TORQUE,
    Line,
    WindowMoments,
    X,
    Y,
)
from terrain_cli.vocabulary.arrays import Array, Mask
from terrain_cli.vocabulary.choices import LARGEST_PHI

_SIGN = {LOAD: -1.0, TORQUE: 1.0, SINKAGE: -1.0, SLIP: -1.0}  # Sign of ∂g/∂q

_SIGNIFICANT = 3.0  # Standard errors by which cov(q, x) must differ from zero for the channel to be heard

#: A channel that varies by more than this share of its mean, and takes x along with this
#: correlation, varies in truth: no sensor in use drifts so far. A smooth undulation has few
#: independent samples, and the less noise lies on it the fewer they look.
_PLAIN_VARIATION = 0.05
_PLAIN_CORRELATION = 0.8
_ITERATIONS = 6

#: Standard deviations of the residuals by which a line, or its slope over the spread of x, may be
#: off at the most. A few correlated residuals cannot tell their own correlation, and would
#: otherwise make a large error of a small misfit.
_LARGEST_ERROR = 2.0

_SMOOTH = 0.9  # Lag-1 autocorrelation of residuals that may be called smooth
#: Share of the strength by which equations [20] to [25] are off for dropping κ3: 0.07 to 1.0 %, root mean
#: square 0.42 %, on soils of Wong's Theory of Ground Vehicles, at 60 to 100 N and slips of 0.1 to 0.8.
DROPPED_KAPPA3 = 0.005


def phi_bounds(moments: WindowMoments, *, correlated: bool) -> tuple[Array, Array]:
    """Bounds of φ, in rad between 0 and 60°, that hold for any amount of noise in any of the four sensors."""
    low, high = np.zeros_like(moments.count), np.full_like(moments.count, LARGEST_PHI)
    for channel in CHANNELS:
        with np.errstate(divide="ignore", invalid="ignore"):
            phi = np.arctan(moments[0, channel, Y] / moments[0, channel, X])
        heard = moments.varies(X) & moments.varies(channel)
        heard &= _significant(moments, channel, correlated=correlated)
        above = _SIGN[channel] * moments[0, channel, X] > 0.0
        high = np.where(heard & above, np.minimum(high, phi), high)
        low = np.where(heard & ~above, np.maximum(low, phi), low)
    # Two bounds that have crossed differ by sampling error only.
    low, high = np.minimum(low, high), np.maximum(low, high)
    return np.clip(low, 0.0, LARGEST_PHI), np.clip(high, 0.0, LARGEST_PHI)


def distance_to_bounds(phi: Array, low: Array, high: Array) -> Array:
    """Root mean square distance of φ to a truth that lies anywhere between its bounds, in rad."""
    return np.asarray(np.sqrt((high - low) ** 2 / 12.0 + (0.5 * (low + high) - phi) ** 2))


def _significant(moments: WindowMoments, channel: int, *, correlated: bool) -> Mask:
    """Whether x follows a channel by more than chance (Fisher's z of their correlation).

    The samples are worth as many as are independent in what the channel leaves of x, so that
    one clear step of the load counts for more than a slow drift of two sensors.
    """
    own, shared, x = moments[0, channel, channel], moments[0, channel, X], moments[0, X, X]
    with np.errstate(divide="ignore", invalid="ignore"):
        correlation = np.clip(shared / np.sqrt(own * x), -1.0, 1.0)
        independent = moments.count
        if correlated:
            slope = shared / own
            rest = x - slope * shared
            late = moments[1, channel, channel]
            rest1 = moments[1, X, X] - 2.0 * slope * moments[1, channel, X] + slope**2 * late
            common = _unbiased(rest1 / rest, moments.count) * _unbiased(late / own, moments.count)
            independent = independent * (1.0 - common) / (1.0 + common)
        z = np.arctanh(np.abs(correlation)) * np.sqrt(np.maximum(independent - 3.0, 1.0))
        varies = np.sqrt(own / moments.count) > _PLAIN_VARIATION * np.abs(moments.mean[channel])
    plain = varies & (np.abs(correlation) > _PLAIN_CORRELATION)
    return np.asarray((z > _SIGNIFICANT) | plain)


def _unbiased(correlation: Array, count: Array) -> Array:
    """Lag-1 autocorrelation without its bias −(1 + 3ρ)/n (Marriott & Pope 1954); 0 where x is explained."""
    unbiased = (count * correlation + 1.0) / np.maximum(count - 3.0, 1.0)
    return np.nan_to_num(np.clip(unbiased, 0.0, 1.0))


@dataclass(frozen=True)
class Errors:
    """Sampling errors of the two parameters that are uncorrelated: the mean stress and the slope."""

    variance: Array  # Shape (w,): of one residual, Pa²
    mean: Array  # Shape (w,): variance of the mean of `count` residuals over that of one
    tan_phi: Array  # Shape (w,): variance of tan φ; NaN where x does not vary


def sampling_errors(moments: WindowMoments, line: Line, *, correlated: bool) -> Errors:
    """Variances of a line's mean stress and slope; NaN where n < 3.

    The residuals' autocorrelation is taken as a ρᵏ at lag k: white noise (a = 0), a first-order process (a =
    1) or the sum of the two, which is what a slow misfit under sensor noise looks like. a and ρ come from
    lags 1 and 2; what least squares takes up of them is put back. The effective numbers of samples follow as
    n/τ with τ = 1 + 2 Σ (1 − k/n) a ρᵏ for the mean and a (ρ ρx)ᵏ for the slope, where ρx is the lag-1
    autocorrelation of x (Bartlett 1935). Negative correlation is not used to shrink an error.

    Residuals that turn more smoothly than a first-order process are no noise but the misfit of the model,
    which no number of samples averages out: the error is then that of two samples. Otherwise variances are
    widened by Student's t, so that ± 1.96 se holds its 95 % where few samples are independent. Of steady test
    points, which are not `correlated`, they are the textbook ones.
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


def _effective(moments: WindowMoments, line: Line) -> tuple[Array, Array, Array, Mask]:
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
    """Return samples per independent one, 1 to n/2: 1 + 2 Σ (1 − k/n) a ρᵏ over lags k = 1 … n − 1."""
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


class Uncertainty(NamedTuple):
    """What is known of estimates, one entry per window, as `WindowEstimates` has it."""

    c_se: Array
    phi_se: Array
    corr: Array
    sigma_star: Array
    strength: Array
    strength_se: Array
    phi_bias: Array


def uncertainty(
    moments: WindowMoments, line: Line, cohesion: Array, tan_phi: Array, gain: Array, *, correlated: bool
) -> tuple[Uncertainty, Array]:
    """Errors of estimates (c in Pa, tan φ) made from least-squares lines; NaN where n < 3.

    And the standard deviation of φ, rad, that samples and bounds leave open, wherever the estimate lies.

    A line turns about the mean point of its window. The stress there, s, is uncorrelated with the slope of
    least squares; a linear estimator maps the sampling errors of both by `gain`, shape (2, 2, w), its
    derivatives. To them is added what sampling does not see, as mean squares: to tan φ the distance to any
    truth within the bounds that the channels put on φ, to s the pull of a penalty away from the mean of y,
    and to both the share of dropping κ3. The error of s allows for residuals about the true line, too.
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
        var_s = var_s + pull**2 + (DROPPED_KAPPA3 * mean_y) ** 2
        var_t = var_t + bias**2 * (1.0 + tan_phi**2) ** 2 + (DROPPED_KAPPA3 * tan_phi) ** 2
        var_t = np.where(np.isfinite(tan_phi), var_t, np.nan)
        offset = np.where(var_t > 0.0, -cov / var_t, 0.0)
        # Near zero the differences may come out negative by rounding.
        var_c = np.maximum(var_s - 2.0 * mean_x * cov + mean_x**2 * var_t, 0.0)
        found = Uncertainty(
            np.sqrt(var_c),
            np.sqrt(var_t) / (1.0 + tan_phi**2),
            np.clip((cov - mean_x * var_t) / np.sqrt(var_c * var_t), -1.0, 1.0),
            mean_x + offset,
            mean_y + pull + offset * np.nan_to_num(tan_phi),
            np.sqrt(np.maximum(var_s + np.nan_to_num(offset * cov), 0.0)),
            bias,
        )
        return found, np.sqrt(sampling.tan_phi / (1.0 + line.tan_phi**2) ** 2 + (high - low) ** 2 / 12.0)
