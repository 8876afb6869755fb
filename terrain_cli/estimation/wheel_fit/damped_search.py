"""A damped search whose cost never rises, for windows in which `gauss_newton` does not converge.

Levenberg–Marquardt: every step is shortened until the sum of squares falls, with the true values
of the inputs brought along before it is judged (Boggs & Rogers 1990). It takes several times as
long as Gauss–Newton, and ends in the valley in which it began however wrong the model is.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from terrain_cli.estimation.wheel_fit.gauss_newton import Normal, State, accumulate, initial, newton

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from terrain_cli.estimation.wheel_fit.fit_data import FitData
    from terrain_cli.estimation.wheel_fit.linearised import Problem

    Array = NDArray[np.float64]

ITERATIONS = 60
#: Damping at first, its least and most, and what a step that falls or does not makes of it.
_DAMPING, _LEAST, _MOST, _EASED, _RAISED = 1e-2, 1e-9, 1e8, 0.2, 5.0
#: Steps that win less of the sum of squares than this, and than this share of it, are the last.
_FALL, _SHARE = 0.01, 1e-3


def descend(
    problem: Problem,
    data: FitData,
    t: Array,
    common: Array,
    *,
    order: int | None,
    iterations: int = ITERATIONS,
) -> State:
    """Go downhill from a beginning within the bounds, t of shape (w, p) and common of shape (q,).

    Windows that share something go together: all their steps fall, or none is taken.
    """
    sought = problem.unknowns
    together = len(sought.shared) > 0
    state = initial(data, t, common)
    state.converged[:] = data.count == 0
    damping = np.full(len(t), _DAMPING)
    normal, state.merit[:], state.latent = _cost(problem, data, state.t, common, state.latent, order)
    for _ in range(iterations):
        active = np.arange(len(t)) if together else np.flatnonzero(~state.converged)
        if len(active) == 0 or state.converged.all():
            break
        part, rows = data.only(active), data.rows_of(active)
        here = _damped(_some(normal, active), damping[active])
        step, shift, _ = newton(here, sought, state.t[active], state.common)
        moved, moved_common = state.t[active] + step, state.common + shift
        tried, merit, latent = _cost(problem, part, moved, moved_common, state.latent[:, rows], order)
        fall = state.merit[active] - merit
        if together:
            whole = float(fall.sum() + np.sum(state.common**2) - np.sum(moved_common**2))
            fall = np.full(len(active), whole)
        better = fall > 0.0
        least = np.maximum(_FALL, _SHARE * (state.merit[active].sum() if together else state.merit[active]))
        at = active[better]
        state.t[at], state.merit[at] = moved[better], merit[better]
        inside = np.repeat(better, part.count)
        state.latent[:, rows[inside]] = latent[:, inside]
        for old, new in (
            (normal.information, tried.information),
            (normal.score, tried.score),
            (normal.misfit, tried.misfit),
        ):
            old[at] = new[better]
        if together and better.all():
            state.common = moved_common
        # A short step wins little too: that one may not be the last.
        done = (better & (fall < least) & (damping[active] <= _DAMPING)) | (damping[active] >= _MOST)
        state.converged[active] = done
        damping[active] = np.clip(damping[active] * np.where(better, _EASED, _RAISED), _LEAST, _MOST)
    return state


def _cost(
    problem: Problem, data: FitData, t: Array, common: Array, latent: Array, order: int | None
) -> tuple[Normal, Array, Array]:
    """Return equations and sum of squares with the true values of the inputs that go with the unknowns."""
    latent = latent.copy()
    # A step too far may lead beyond all numbers, and is not taken.
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        accumulate(problem, data, t, common, latent, order=order)
        normal = accumulate(problem, data, t, common, latent, order=order)
        merit = normal.misfit + np.sum(t**2, axis=1)
    # Where the model gives no number nothing is missed, and nothing learnt but what is known beforehand.
    sum_of = np.einsum("wab->w", np.abs(normal.information)) + np.abs(normal.score).sum(axis=1)
    dumb = (sum_of <= 0.0) & (normal.score.shape[1] > 0)
    wild = ~np.isfinite(sum_of + merit)
    normal.information[wild], normal.score[wild] = 0.0, 0.0
    return normal, np.where(dumb | wild, np.inf, merit), latent


def _some(normal: Normal, windows: NDArray[np.intp]) -> Normal:
    return Normal(normal.information[windows], normal.score[windows], normal.misfit[windows])


def _damped(normal: Normal, damping: Array) -> Normal:
    diagonal = 1.0 + np.einsum("waa->wa", normal.information)
    extra = (damping[:, None] * diagonal)[:, :, None] * np.eye(diagonal.shape[1])
    return replace(normal, information=normal.information + extra)
