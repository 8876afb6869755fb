"""Strength of the soil at a normal stress, and the stresses that a wheel puts on it."""

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from terrain_cli.estimation.line.pooled import PooledEstimate
from terrain_cli.estimation.line.window_estimates import WindowEstimates
from terrain_cli.telemetry import Samples
from terrain_cli.vocabulary.arrays import Array, Index, ratio
from terrain_cli.vocabulary.quantities import the_wheel
from terrain_cli.windows.cut_windows import Windows

#: Steps of the typical stress, by decade: so that logs of one rover have one stress.
_STEPS = np.log10([1.0, 2.0, 5.0, 10.0])


def mean_stress(load: Array, sinkage: Array, radius: float, width: float) -> Array:
    """Return the load by the ground that carries it, W / (b r sin θ1), in Pa; NaN without sinkage."""
    share = np.clip(sinkage / radius, 0.0, 1.0)
    length = radius * np.sqrt(share * (2.0 - share))
    return ratio(load, width * length, np.nan)


def _stresses(samples: Samples, rows: Index) -> Array:
    # A comparison does without a channel that the model predicts.
    unknown = np.full(len(samples), np.nan)
    load, sinkage = (samples.channels.get(name, unknown)[rows] for name in ("load", "sinkage"))
    return mean_stress(load, sinkage, samples.geometry.radius, samples.geometry.width)


def typical_stress(stress: Array) -> float:
    """Return the median stress, rounded to 1, 2 or 5 times a power of ten; NaN if there is none."""
    known = stress[np.isfinite(stress) & (stress > 0.0)]
    if len(known) == 0:
        return np.nan
    decade, rest = divmod(float(np.log10(np.median(known))), 1.0)
    return float(np.round(10.0 ** _STEPS[np.argmin(np.abs(_STEPS - rest))]) * 10.0**decade)


def stress_of_all(estimates: WindowEstimates) -> float:
    """Return the stress, Pa, at which several logs are compared: that of the first, NaN without one."""
    known = estimates.stress[np.isfinite(estimates.stress)]
    return float(known[0]) if len(known) else np.nan


def with_strengths(
    estimates: WindowEstimates, windows: Windows, at_stress: float | None = None
) -> WindowEstimates:
    """Return estimates with σ* within each window's stresses, and strengths at one stress in Pa."""
    stress = _stresses(windows.samples, windows.rows)
    filled = np.diff(windows.bounds) > 0
    low, high = np.full((2, len(windows)), np.nan)
    if filled.any():
        first = windows.bounds[:-1][filled]
        low[filled], high[filled] = np.fmin.reduceat(stress, first), np.fmax.reduceat(stress, first)
    common = np.full(len(windows), typical_stress(stress) if at_stress is None else at_stress)
    pivot = np.where(np.isfinite(low), np.clip(estimates.sigma_star, low, high), estimates.sigma_star)
    strength, strength_se = strength_at(pivot, estimates)
    mapped, mapped_se = strength_at(common, estimates)
    return replace(
        estimates,
        sigma_star=pivot,
        strength=strength,
        strength_se=strength_se,
        stress=common,
        strength_at_stress=mapped,
        strength_at_stress_se=mapped_se,
    )


def at_one_stress(estimates: WindowEstimates, stress: float) -> WindowEstimates:
    """Return estimates of several logs with all strengths at one stress, Pa, instead of that of each log.

    c and φ may be empty where they are not told; what is known of both together still has its strength.
    """
    own = estimates
    error = np.hypot(
        _error(stress, own.data_c_se, own.data_tan_phi_se, own.data_corr),
        _error(stress, own.assumed_c_se, own.assumed_tan_phi_se, own.assumed_corr),
    )
    # As it stands where a log was compared there itself.
    other = np.isfinite(own.strength_at_stress) & (own.stress != stress)
    return replace(
        own,
        stress=np.where(other, stress, own.stress),
        strength_at_stress=np.where(other, own.data_c + stress * own.data_tan_phi, own.strength_at_stress),
        strength_at_stress_se=np.where(other, error, own.strength_at_stress_se),
    )


def stress_range(samples: Samples) -> tuple[float, float]:
    """Return the least and the greatest mean stress, Pa, of usable samples; NaN where none is known."""
    stress = _stresses(samples, samples.usable)
    known = stress[np.isfinite(stress)]
    return (float(known.min()), float(known.max())) if len(known) else (np.nan, np.nan)


def extrapolation_notes(
    wheel: str, ranges: Sequence[tuple[float, float]], at_stress: float | None
) -> Iterator[str]:
    """Say that strengths at a stress, Pa, are extrapolated, if no part of a drive was near it."""
    known = np.array([ends for ends in ranges if np.isfinite(ends).all()])
    if at_stress is None or not len(known):
        return
    low, high = known.min(), known.max()
    # A round stress, as one gets without asking, is near enough.
    lowest, highest = (typical_stress(np.array([end])) for end in (low, high))
    if not min(low, lowest) <= at_stress <= max(high, highest):
        yield (
            f"strengths at {at_stress / 1e3:.4g} kPa are extrapolated: {the_wheel(wheel)} put "
            f"{low / 1e3:.3g} to {high / 1e3:.3g} kPa on the soil, on average over the contact"
        )


def strength_at(stress: Array | float, of: WindowEstimates | PooledEstimate) -> tuple[Array, Array]:
    """Return c + σ tan φ and its standard error, Pa."""
    tan_phi = np.tan(of.phi)
    return of.c + stress * tan_phi, _error(stress, of.c_se, of.phi_se * (1.0 + tan_phi**2), of.corr)


def _error(stress: Array | float, c_se: Array | float, tan_se: Array | float, corr: Array | float) -> Array:
    # An estimate without error has no correlation.
    mixed = np.where(c_se * tan_se > 0.0, corr * c_se * tan_se, 0.0)
    variance = c_se**2 + 2.0 * stress * mixed + (stress * tan_se) ** 2
    error: Array = np.sqrt(np.maximum(variance, 0.0))
    return error
