"""Whether effects that a model lacks show in its residuals, and how far each would move what was fitted.

Each parameter of an effect is tested at its null (Rao 1948). With the whitened residuals r, their derivatives
g by the parameter and J by what was fitted, u = gᵀr + Gᵀ (Jᵀr − t) is its score when all else is fitted anew,
priors counted in, and the information S left of it the variance of u (`normal_equations`). To first order
the parameter is u / S, and moves the others by G u / S. Where noise lasts, the variance of u is as many times
S as samples make an independent one.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from terrain_cli.estimation.line.window_estimates import STRENGTH_HOLDS
from terrain_cli.estimation.wheel_fit.excess_scatter import memory
from terrain_cli.estimation.wheel_fit.gauss_newton import accumulate, eliminate
from terrain_cli.estimation.wheel_fit.unknowns import unknown
from terrain_cli.mechanics.effect import mean_load

if TYPE_CHECKING:
    from collections.abc import Sequence

    from terrain_cli.estimation.wheel_fit.fit_data import FitData
    from terrain_cli.estimation.wheel_fit.fit_result import Fit, Parameters
    from terrain_cli.estimation.wheel_fit.linearised import Equations, Problem
    from terrain_cli.estimation.wheel_fit.unknowns import Unknown
    from terrain_cli.mechanics.effect import Effect
    from terrain_cli.vocabulary.arrays import Array, Mask


#: Standard deviations beyond chance at which an effect shows, and errors by which it moves c, φ or strength.
_SHOWS, _FAR = 4.0, 1.0
#: Samples of all windows together that are tested, and of each window at the least; nodes on each arc.
_SAMPLES, _EACH, _ORDER = 2_000, 6, 6
#: Steps in which the true values of the inputs come to rest.
_STEPS = 3


def moved(
    problem: Problem, data: FitData, t: Array, common: Array, found: Fit, effects: Sequence[Effect]
) -> Mask:
    """Tell in which windows an effect shows that would move c, φ or strength by more than its error.

    Fitted were `t`, shape (w, p), and `common`, shape (q,), which `found` has in their own units. Shape (w,).
    """
    if not effects or not np.isin(found.status, STRENGTH_HOLDS).any():
        return np.zeros(len(t), dtype=bool)
    few = data.thinned(max(_SAMPLES // max(len(t), 1), _EACH))
    score, moves = scores(problem, few, t, common, effects)
    ways = _in_errors(found, problem.unknowns.local)
    far = np.abs(np.einsum("kwp,wpm->kwm", ways, moves)) > _FAR
    return np.asarray((far & (np.abs(score) > _SHOWS)).any(axis=(0, 2)))


def _in_errors(found: Parameters, local: Sequence[Unknown]) -> Array:
    """Return c, tan φ and strength in their errors, by the windows' own unknowns, shape (3, w, p)."""
    ways = np.zeros((3, len(found.strength), len(local)))
    for place, one in enumerate(local):
        if one.name == "cohesion":
            ways[0, :, place], ways[2, :, place] = one.sd / found.errors[one.name], one.sd / found.strength_se
        elif one.name == "tan_phi":
            ways[1, :, place] = one.sd / found.errors[one.name]
            ways[2, :, place] = one.sd * found.sigma_star / found.strength_se
    return np.where(np.isfinite(ways), ways, 0.0)


def scores(
    problem: Problem, data: FitData, t: Array, common: Array, effects: Sequence[Effect]
) -> tuple[Array, Array]:
    """Return how many standard deviations the score of each parameter of some effects is, shape (m,).

    Also by how much each would move the windows' own unknowns, shape (w, p, m).
    """
    model = replace(problem.model, effects=(*problem.model.effects, *effects))
    under = mean_load(data.channels), problem.wheel.radius
    added = [
        unknown(model, effect.qualified(one), under=under) for effect in effects for one in effect.parameters
    ]
    latent = data.given.copy()
    for _ in range(_STEPS):
        accumulate(problem, data, t, common, latent, order=_ORDER)
    sought = replace(problem.unknowns, shared=(*problem.unknowns.shared, *added))
    larger = replace(problem, model=model, unknowns=sought)
    parts: list[Equations] = []
    common = np.concatenate([common, np.zeros(len(added))])
    normal = accumulate(
        larger, data, t, common, latent, order=_ORDER, each=lambda _, __, one: parts.append(one)
    )

    local, before = t.shape[1], len(common) - len(added)
    _, gain, left = eliminate(normal, local)
    score = normal.score[:, local:].sum(axis=0) - common
    score += np.einsum("wpm,wp->m", gain, normal.score[:, :local] - t)
    # What all windows share is eliminated as well.
    along = -np.linalg.solve(left[:before, :before], left[:before, before:])
    score = score[before:] + along.T @ score[:before]
    # That of their priors at the least, but for rounding.
    information = np.maximum(np.diag(left[before:, before:] + left[before:, :before] @ along), 1.0)
    gain = gain[:, :, before:] + gain[:, :, :before] @ along
    size = score / information

    design = np.concatenate([one.design for one in parts], axis=2)
    residual = np.concatenate([one.residual * one.weight for one in parts], axis=1)
    shown = design[:, local + before :] + np.einsum("apn,pm->amn", design[:, local : local + before], along)
    shown += np.einsum("apn,npm->amn", design[:, :local], np.repeat(gain, data.count, axis=0))
    # Chance is in what the effect leaves of its score.
    rest = np.einsum("amn,amn->mn", shown, residual[:, None] - size[:, None] * shown)
    lasting = memory(rest, data.bounds, together=True)[:, 0]
    return score / np.sqrt(information * lasting), gain * size
