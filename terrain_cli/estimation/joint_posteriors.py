"""What is known of all parameters of a window together: grids of c and φ, and covariances."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from terrain_cli.estimation import joint_grid
from terrain_cli.estimation.joint_grid import Frame, JointPosterior
from terrain_cli.estimation.wheel_fit.unknowns import POSITIVE

if TYPE_CHECKING:
    from collections.abc import Sequence

    from terrain_cli.estimation import WindowEstimates
    from terrain_cli.estimation.wheel_fit import Fit
    from terrain_cli.models import ModelFile
    from terrain_cli.windows.cut_windows import Windows

_PAIR, _UNITS = ("cohesion", "tan_phi"), ("Pa", "1")


def chosen(windows: Windows, most: int) -> list[int]:
    """Return windows of several samples, evenly spread, `most` of them at the most."""
    there = np.flatnonzero(np.diff(windows.bounds) > 1)
    if len(there) > most:
        there = there[np.round(np.linspace(0, len(there) - 1, most)).astype(int)]
    return [int(j) for j in there]


def of_line(estimates: WindowEstimates, windows: Sequence[int]) -> list[JointPosterior]:
    """Return the normal distributions that the errors of a line stand for, where there is an estimate."""
    found = []
    for j in windows:
        tan_phi = float(np.tan(estimates.phi[j]))
        errors = np.array([estimates.c_se[j], estimates.phi_se[j] * (1.0 + tan_phi**2)])
        covariance = np.outer(errors, errors) * np.array([[1.0, estimates.corr[j]], [estimates.corr[j], 1.0]])
        if not joint_grid.possible(covariance):
            continue
        values = np.array([estimates.c[j], tan_phi])
        found.append(
            JointPosterior(
                window=j,
                names=_PAIR,
                units=_UNITS,
                values=values,
                covariance=covariance,
                prior=np.full((2, 2), np.nan),
                grid=joint_grid.grid(Frame(values, covariance)),
            )
        )
    return found


def of_fit(fit: Fit, file: ModelFile, windows: Sequence[int]) -> list[JointPosterior]:
    """Return what a fit knows of windows, in the units of the model file."""
    units = tuple(file.units[name] for name in fit.names)
    factor = np.array([file.factor(name) for name in fit.names])
    prior = np.array([_prior(fit, name) for name in fit.names]).reshape(-1, 2) / factor[:, None]
    found = []
    for j in windows:
        values = np.array([fit.values[n][j] if n in fit.values else fit.shared[n] for n in fit.names])
        if not np.isfinite(values).all():
            continue
        found.append(
            JointPosterior(
                window=j,
                names=fit.names,
                units=units,
                values=values / factor,
                covariance=fit.covariance[j] / np.outer(factor, factor),
                prior=prior,
                grid=fit.grids.get(j),
            )
        )
    return found


def _prior(fit: Fit, name: str) -> tuple[float, float]:
    """Return the prior of a window's own parameter; the median of one that is sought by its logarithm."""
    mean, sd = fit.priors.get(name, (np.nan, np.nan))
    if name not in POSITIVE:
        return mean, sd
    return float(np.exp(mean)), float(np.exp(mean)) * sd
