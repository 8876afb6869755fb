"""Parameters and their covariance from a least-squares solution, in the form of `Fit`."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from terrain_cli.comparison import smoothed_fit
from terrain_cli.estimation.wheel_fit import normal_equations

if TYPE_CHECKING:
    from terrain_cli.comparison.smoothed_fit import Solution
    from terrain_cli.comparison.smoothed_model import SmoothedData
    from terrain_cli.estimation.wheel_fit import Fit
    from terrain_cli.vocabulary.arrays import Array


def covariance(data: SmoothedData, solution: Solution) -> tuple[Array, Array]:
    """Return the covariance of each window's parameters, and of the common ones alone.

    In their own units: of the window's own and the common ones, (w, q + m, q + m), and (m, m).
    """
    w, q = solution.t.shape
    m = len(solution.common)
    information, _ = smoothed_fit.moments(solution.design, solution.residual, data.window, data.windows)
    found, shared = normal_equations.arrow(information / solution.spread, q, np.eye(q + m))
    held = normal_equations.inverse(shared - found.taken())
    whole = normal_equations.covariance(found.own, found.gain, held)
    sought = solution.unknowns
    slope = [np.abs(u.slope(solution.t[:, j])) for j, u in enumerate(sought.local)]
    slope += [np.full(w, abs(float(u.slope(solution.common[j])))) for j, u in enumerate(sought.shared)]
    scale = np.stack(slope, axis=1) if slope else np.zeros((w, 0))
    outside = scale[0, q:] if w else np.zeros(m)
    return whole * scale[:, :, None] * scale[:, None, :], held * np.outer(outside, outside)


def parameters(solution: Solution) -> dict[str, Array]:
    """Return the parameters sought, in their own units, (w,): what is common stands in every window."""
    windows, sought = len(solution.t), solution.unknowns
    found = {u.name: u.value(solution.t[:, j]) for j, u in enumerate(sought.local)}
    common = {u.name: u.value(np.asarray(solution.common[j])) for j, u in enumerate(sought.shared)}
    return found | {name: np.full(windows, float(value)) for name, value in common.items()}


def as_fit(data: SmoothedData, solution: Solution, fit: Fit) -> Fit:
    """Put a solution in the place of what another fit of the same windows found; empty windows stay NaN."""
    own, common = covariance(data, solution)
    found = parameters(solution)
    names, empty = tuple(found), fit.n == 0
    outside = [u.name for u in solution.unknowns.shared]
    error = {name: np.sqrt(own[:, j, j]) for j, name in enumerate(names)}
    values = {name: np.where(empty, np.nan, found[name]) for name in names if name in fit.values}
    errors = {name: np.where(empty, np.nan, error[name]) for name in values}
    changed: dict[str, Any] = {}
    if {"cohesion", "tan_phi"} <= values.keys():
        c, tan = names.index("cohesion"), names.index("tan_phi")
        sigma = np.maximum(-own[:, c, tan] / own[:, tan, tan], 0.0)
        variance = own[:, c, c] + 2.0 * sigma * own[:, c, tan] + sigma**2 * own[:, tan, tan]
        changed = {
            "sigma_star": np.where(empty, np.nan, sigma),
            "strength": values["cohesion"] + sigma * values["tan_phi"],
            "strength_se": np.where(empty, np.nan, np.sqrt(np.maximum(variance, 0.0))),
        }
    return replace(
        fit,
        values=fit.values | values,
        errors=fit.errors | errors,
        shared=dict(fit.shared) | {name: float(found[name][0]) for name in outside},
        shared_errors=dict(fit.shared_errors)
        | {name: float(np.sqrt(common[j, j])) for j, name in enumerate(outside)},
        names=names,
        covariance=own,
        shared_covariance=common,
        **changed,
    )
