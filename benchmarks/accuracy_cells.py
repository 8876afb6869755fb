"""One cell of the accuracy study: windows as they are measured, and how far estimates and bound are off."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import wheel_truth as truth
from simulator import paper

from terrain_cli.estimation import estimate_windows
from terrain_cli.estimation.wheel_fit import Noise, fit
from terrain_cli.mechanics.linear import line_coordinates
from terrain_cli.mechanics.wheel_model import Model, WheelGeometry

SLIPS = (0.1, 0.3, 0.5, 0.7, 0.9)
POINTS = (5, 10, 30)
NOISES = (0.0, 0.01, 0.03, 0.10)
LARGEST_SLIP = 0.99
NORMAL_95 = 1.959964
#: Pa, where the strength is compared if no bound says where.
MEAN_STRESS = 5e3


@dataclass(frozen=True)
class Windows:
    """One window of samples for each soil, shape (sets, points): the truth and what is measured."""

    soils: truth.Soils
    channels: dict
    measured: dict
    noise: float


@dataclass(frozen=True)
class Errors:
    """Errors of estimates, one entry a set: c in kPa, φ in degrees, strength in kPa, and what was said of them."""

    cohesion: np.ndarray
    phi: np.ndarray
    strength: np.ndarray | None = None
    covered: np.ndarray | None = None


@dataclass(frozen=True)
class Bound:
    """Cramér–Rao bound with the grid's priors, one entry a set: kPa and degrees."""

    cohesion: np.ndarray
    phi: np.ndarray
    strength: np.ndarray
    pivot: np.ndarray


def prior_columns(grid):
    """Return the parameters as they are sought: c, tan φ, log k, log keq, n."""
    return np.array(
        [
            grid.cohesion,
            grid.tan_phi,
            np.log(grid.shear_modulus),
            np.log(grid.stiffness),
            grid.sinkage_exponent,
        ]
    )


def drive(soils, slip, rng):
    """Return the true channels of windows of the most points: load and slip vary at random."""
    shape = (len(soils.cohesion), max(POINTS))
    load, slips = (
        mean * (1.0 + paper.VARIATION * rng.uniform(-1.0, 1.0, shape)) for mean in (paper.LOAD, slip)
    )
    slips = np.minimum(slips, LARGEST_SLIP)
    each = soils.take(np.repeat(np.arange(shape[0]), shape[1]))
    depth = truth.sinkage(each, load.ravel(), slips.ravel())
    torque = truth.forces(each, depth, slips.ravel())[1]
    slopes = truth.slopes(each, depth, slips.ravel()).reshape(7, 2, *shape)
    return {
        "load": load,
        "torque": torque.reshape(shape),
        "sinkage": depth.reshape(shape),
        "slip": slips,
    }, slopes


def measure(channels, soils, points, noise, rng, *, of_maximum=False):
    """Return the first points of every window with noise, a share of each W, T, z and i or of its window's maximum."""
    cut = {name: column[:, :points] for name, column in channels.items()}
    shown = {
        name: column
        + noise
        * (column.max(axis=1, keepdims=True) if of_maximum else column)
        * rng.standard_normal(column.shape)
        for name, column in cut.items()
    }
    return Windows(soils, cut, shown, noise)


def bound_of(windows, slopes, spread):
    """Return the bound: priors of the deviations `spread`, and per sample R + J Ru Jᵀ for W and T."""
    channels, noise, points = windows.channels, windows.noise, windows.channels["load"].shape[1]
    by, across = slopes[:5, :, :, :points], slopes[5:, :, :, :points]
    outputs = np.array([channels["load"], channels["torque"]])
    inputs = np.array([channels["sinkage"], channels["slip"]])
    covariance = np.einsum("uawn,ubwn,uwn->wnab", across, across, (noise * inputs) ** 2)
    for a in (0, 1):
        covariance[:, :, a, a] += (noise * outputs[a]) ** 2
    information = np.einsum("pawn,wnab,qbwn->wpq", by, np.linalg.inv(covariance), by)
    information += np.diag(1.0 / spread**2)
    posterior = np.linalg.inv(information)
    variance_c, between, variance_t = posterior[:, 0, 0], posterior[:, 0, 1], posterior[:, 1, 1]
    pivot = -between / variance_t
    tan_phi = windows.soils.tan_phi
    return Bound(
        np.sqrt(variance_c) / 1e3,
        np.degrees(np.sqrt(variance_t) / (1.0 + tan_phi**2)),
        np.sqrt(variance_c - between**2 / variance_t) / 1e3,
        pivot,
    )


def line_errors(windows, share, method):
    """Return the errors of the linearised estimator with k wrong by a share."""
    sets, points = windows.measured["load"].shape
    cohesion, phi = np.empty(sets), np.empty(sets)
    for k in np.unique(windows.soils.shear_modulus):
        here = np.flatnonzero(windows.soils.shear_modulus == k)
        channels = {name: column[here].ravel() for name, column in windows.measured.items()}
        geometry = {"radius": truth.RADIUS, "width": truth.WIDTH, "shear_modulus": k * share}
        with np.errstate(invalid="ignore"):
            x, y = line_coordinates(**channels, **geometry)
            found = estimate_windows(
                [x, y, *(channels[name] for name in ("load", "torque", "sinkage", "slip"))],
                np.arange(len(here) + 1) * points,
                geometry,
                method=method,
                correlated=False,
                min_samples=3,
            )
        cohesion[here], phi[here] = found.c, found.phi
    return Errors(
        (cohesion - windows.soils.cohesion) / 1e3, np.degrees(phi - np.arctan(windows.soils.tan_phi))
    )


def rms(values):
    known = np.asarray(values)[np.isfinite(values)]
    return float(np.sqrt(np.mean(known**2))) if len(known) else np.nan


def wheel_errors(windows, priors, pivot, *, learn):
    """Return the errors of wong-reece, which is told the noise or learns it, and what its intervals cover.

    The strength is that at `pivot`, the bound's σ*, but its intervals are judged at the estimate's own.
    """
    sets, points = windows.measured["load"].shape
    found = fit(
        Model(),
        WheelGeometry(truth.RADIUS, truth.WIDTH),
        {name: column.ravel() for name, column in windows.measured.items()},
        np.arange(sets + 1) * points,
        priors=priors,
        noise=None if learn else Noise.equal(windows.noise),
        correlated=False,
        min_samples=3,
    )
    soils = windows.soils
    cohesion = found.values["cohesion"] - soils.cohesion
    tan_phi = found.values["tan_phi"] - soils.tan_phi
    phi = found.phi - np.arctan(soils.tan_phi)
    strength = found.strength - (soils.cohesion + found.sigma_star * soils.tan_phi)
    off = np.abs([cohesion, phi, strength])
    said = np.array([found.errors["cohesion"], found.phi_se, found.strength_se])
    return Errors(
        cohesion / 1e3, np.degrees(phi), (cohesion + pivot * tan_phi) / 1e3, off <= NORMAL_95 * said
    )
