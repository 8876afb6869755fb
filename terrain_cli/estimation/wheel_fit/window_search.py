"""The search for the unknowns of windows: where it begins, and what is done where it gets lost."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from terrain_cli.estimation.line.moments import segment_sum
from terrain_cli.estimation.wheel_fit import starts
from terrain_cli.estimation.wheel_fit.damped_search import descend
from terrain_cli.estimation.wheel_fit.fit_data import BALANCE
from terrain_cli.estimation.wheel_fit.gauss_newton import initial, solve
from terrain_cli.estimation.wheel_fit.strayed_windows import put

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from terrain_cli.estimation.wheel_fit.channel_noise import Noise
    from terrain_cli.estimation.wheel_fit.fit_data import FitData
    from terrain_cli.estimation.wheel_fit.gauss_newton import State
    from terrain_cli.estimation.wheel_fit.linearised import Problem

    Array = NDArray[np.float64]

#: Nodes on each arc that are enough where the noise is above `_FINE`: forces right to 1e-4.
_COARSE, _FINE = 6, 1e-3
#: Samples of each window, and iterations, that bring the search near.
_SOME, _ROUGH = 5, 3
#: Standard deviations of χ² beyond which a window is sought again from elsewhere, and the share of
#: windows above which it is the model, not the search, that fails.
_BAD, _FEW_BAD = 6.0, 0.2


def enough_nodes(noise: Noise, data: FitData) -> int | None:
    """Return how many nodes the noise of what is predicted is worth."""
    for output in data.outputs:
        name = "load" if output == BALANCE else output
        if name in data.channels:
            size = float(np.sqrt(np.mean(data.channels[name] ** 2))) if len(data.channels[name]) else 1.0
            deviation = float(np.sqrt(noise.variance(name, np.array([size]))[0]))
            if deviation < _FINE * size:
                return None
    return _COARSE


def search(problem: Problem, data: FitData, order: int | None) -> State:
    """Find the most probable unknowns, from several beginnings where one does not suffice."""
    t, common = starts.centre(problem, data)
    begun = [common, *starts.of_shapes(problem, common)]
    if len(begun) > 1:
        ends = [_towards(problem, data, t, one, order) for one in begun]
        return min(ends, key=lambda end: float(end.merit.sum() + np.sum(end.common**2)))
    state = _towards(problem, data, t, common, order)
    if problem.unknowns.shared:
        return state
    return _elsewhere(problem, data, state, common, order)


def _towards(problem: Problem, data: FitData, t: Array, common: Array, order: int | None) -> State:
    """Search from one beginning: with few samples and nodes, then with all."""
    some = data.thinned(_SOME)
    rough = solve(problem, some, initial(some, t, common), order=_COARSE, iterations=_ROUGH)
    state = solve(problem, data, initial(data, rough.t, rough.common), order=_COARSE)
    if order != _COARSE:
        state = solve(problem, data, state, order=order)
    return state


def _elsewhere(problem: Problem, data: FitData, state: State, common: Array, order: int | None) -> State:
    """Search again, from elsewhere, in the windows that fit badly."""
    t = state.t
    usual = segment_sum(data.seen.sum(axis=0).astype(float), data.bounds) + t.shape[1]
    bad = np.flatnonzero(~state.converged | (state.merit > usual + _BAD * np.sqrt(2.0 * usual)))
    if len(bad) == 0 or len(bad) > max(_FEW_BAD * len(t), 5):
        return state
    again = data.only(bad)
    rows = data.rows_of(bad)
    for other in starts.others(problem, again, common):
        tried = solve(problem, again, initial(again, other, common), order=order)
        better = tried.converged & ((tried.merit < state.merit[bad] - 0.1) | ~state.converged[bad])
        at = bad[better]
        state.t[at], state.merit[at], state.converged[at] = tried.t[better], tried.merit[better], True
        inside = np.repeat(better, again.count)
        state.latent[:, rows[inside]] = tried.latent[:, inside]
    return state


def settled_search(problem: Problem, data: FitData, begun: State, order: int | None) -> State:
    """Search from where the last one ended, by steps that never go uphill where the quick ones get lost.

    Residuals of a search that is lost say nothing of the noise, and differ with the last digit.
    """
    state = replace(begun, t=begun.t.copy(), common=begun.common.copy(), latent=begun.latent.copy())
    together = len(problem.unknowns.shared) > 0
    if not (together and begun.lost.any()):
        state = solve(problem, data, state, order=order)
        state.lost = begun.lost | ~state.converged
    lost = np.flatnonzero(state.lost)
    if len(lost) == 0:
        return state
    if together:
        return replace(descend(problem, data, begun.t, begun.common, order=order), lost=state.lost)
    ends = descend(problem, data.only(lost), begun.t[lost], begun.common, order=order)
    put(state, ends, lost, data.rows_of(lost))
    return state
