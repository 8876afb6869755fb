"""The search for the unknowns of windows, and what is done where it ends at an impossible soil.

Such windows are sought again, downhill from several beginnings. Where the model misses one by so much that
it ends at a soil that nobody knows (or, if asked for, that its errors would be larger than those of the
priors alone), the noise of that window is taken to be as large as its residuals in the long run: the
priors then weigh as much as they know more, and what the data cannot tell stays within what soils are.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from terrain_cli.estimation.line.moments import segment_sum
from terrain_cli.estimation.wheel_fit import damped_search
from terrain_cli.estimation.wheel_fit.damped_search import descend
from terrain_cli.estimation.wheel_fit.excess_scatter import MISSED
from terrain_cli.estimation.wheel_fit.fit_data import BALANCE, FitData, Noise
from terrain_cli.estimation.wheel_fit.gauss_newton import (
    ITERATIONS,
    State,
    accumulate,
    eliminate,
    initial,
    inside,
    solve,
)
from terrain_cli.estimation.wheel_fit.linearised import Problem
from terrain_cli.estimation.wheel_fit.normal_equations import covariance
from terrain_cli.estimation.wheel_fit.posterior import Posterior, posterior
from terrain_cli.estimation.wheel_fit.unknowns import FAR, Unknowns
from terrain_cli.vocabulary.arrays import Array, Index, Mask

#: Samples of each window, and steps, that tell which beginning is best.
_TRIED, _ROUGHLY = 12, 6
#: Mean square of the residuals, in terms of the noise, from which on another beginning may lead lower.
_HOPELESS = 100.0
_USELESS = 1.01  # Standard deviation, in that of the prior, from which on the prior alone knows more
#: Times that the noise of a window is raised, the first ones together with all that shares something
#: with it, and by how much at least: in the end no more is known than beforehand.
_ROUNDS, _TOGETHER, _RAISED = 10, 2, 5.0
#: Nodes on each arc that are enough where the noise is above `_FINE`: forces right to 1e-4.
_COARSE, _FINE = 6, 1e-3
#: Samples of each window, and iterations, that bring the search near.
_SOME, _ROUGH = 5, 3
#: Samples of a window that tell where its search ends, and what leads it astray; and steps with all of them
#: that take it there: with so many the way is a few standard errors.
ENOUGH, _LAST = 200, 8
#: Steps from elsewhere, and downhill in one round of many.
_ELSEWHERE, _A_ROUND = 15, 10
_LOWER = 0.1  # A sum of squares that is less by this is that of another valley
#: Standard deviations of χ² beyond which a window is sought again from elsewhere, and the share of
#: windows above which it is the model, not the search, that fails.
_BAD, _FEW_BAD = 6.0, 0.2


def mend(
    problem: Problem,
    data: FitData,
    state: State,
    found: Posterior,
    *,
    order: int | None,
    correlated: bool,
    tempered: bool,
) -> Posterior:
    """Fit those windows anew in which the search went astray; of windows that share something all, or none.

    `state` is changed in place. The noise of windows is raised until their errors are no larger than those of
    the priors; if `tempered`, of all windows of which the priors alone would know more.
    """
    unknowns = problem.unknowns
    missed = found.misfit > _HOPELESS * np.maximum(found.dof, 1.0)
    far = np.linalg.norm(found.t, axis=1) > FAR
    lost = (data.count > 0) & (~state.converged | found.at_bound.any(axis=1) | missed | far)
    if lost.any():
        at = np.flatnonzero(lost | bool(unknowns.shared))
        part = data.only(at)
        # Of samples of which few are independent some know as much as all.
        enough = bool(np.all(found.inflation[at] > np.maximum(part.count / ENOUGH, MISSED)))
        ends = _best(problem, part.thinned(ENOUGH) if enough else part, state.only(at), order)
        ends = _with_all(problem, part, ends, order)
        put(state, ends, at, data.rows_of(at))
        found = _put(found, posterior(problem, part, ends, order=order, correlated=correlated), at)
    # What is shared follows from all windows, and few times suffice for that.
    for _ in range(_TOGETHER if unknowns.shared else 0):
        wide = _useless(found, tempered=tempered)
        if not wide.any():
            break
        _raise(data, found, wide)
        ends = _downhill(problem, data, state, order)
        put(state, ends, np.arange(len(lost)), np.arange(state.latent.shape[1]))
        found = posterior(problem, data, state, order=order, correlated=correlated)
    alone = replace(problem, unknowns=_held(unknowns, state))
    for _ in range(_ROUNDS):
        wide = _useless(found, tempered=tempered)
        if not wide.any():
            break
        _raise(data, found, wide)
        # One by one, as their noise has changed, which is that of their long run already.
        at = np.flatnonzero(wide)
        part, rows = data.only(at), data.rows_of(at)
        few = part.thinned(ENOUGH)
        few = replace(few, excess=few.excess * few.count / part.count)
        ends = _with_all(alone, part, _downhill(alone, few, state.only(at), order), order)
        put(state, ends, at, rows)
        _put(found, posterior(alone, part, ends, order=order, correlated=False), at)
        if len(state.common):
            normal = accumulate(problem, part, ends.t, state.common, ends.latent.copy(), order=order)
            gain = eliminate(normal, state.t.shape[1])[1]
            found.gain[at] = np.where(found.at_bound[at, :, None], 0.0, gain)
    return found


def _raise(data: FitData, found: Posterior, wide: Mask) -> None:
    data.excess[wide] = np.maximum(found.inflation, _RAISED * data.excess)[wide]


def _useless(found: Posterior, *, tempered: bool) -> Mask:
    """Tell where the model misses, and ends at no known soil or, if asked for, knows less than the priors."""
    missed = found.inflation > MISSED
    if not tempered:
        return np.asarray(np.any(np.abs(found.t) > FAR, axis=1) & missed)
    whole = covariance(found.own, found.gain, found.shared)
    variance = np.einsum("waa->wa", whole)[:, : found.t.shape[1]]
    return np.asarray(np.any(~(variance <= _USELESS**2), axis=1) & missed)


def _held(unknowns: Unknowns, state: State) -> Unknowns:
    """Return the windows' own unknowns alone, with what they share held where it is."""
    shared = zip(unknowns.shared, state.common, strict=True)
    held = {u.name: np.asarray(u.value(np.asarray(number)), dtype=float) for u, number in shared}
    return Unknowns(unknowns.local, (), {**unknowns.fixed, **held})


def _best(problem: Problem, data: FitData, ended: State, order: int | None) -> State:
    """Go down from where the search ended and from the best of other beginnings, and take the lower end.

    A dozen samples tell which of the others is best, but not whether it leads lower than the search did.
    """
    some = data.thinned(_TRIED)
    centre, nothing = damped_search.centre(problem, some)
    begun = [centre, *damped_search.others(problem, some, nothing)]
    if problem.unknowns.shared:
        rough = [descend(problem, some, t, nothing, order=order, iterations=_ROUGHLY) for t in begun]
        best = _lowest(rough, some, problem)
        return _descended(problem, data, [(ended.t, ended.common), (best.t, best.common)], order)
    copies, every = _copies(some, len(begun)), np.concatenate(begun)
    ends = descend(problem, copies, every, nothing, order=order, iterations=_ROUGHLY)
    lowest = ends.merit.reshape(len(begun), -1).argmin(axis=0)
    t = ends.t.reshape(len(begun), *centre.shape)[lowest, np.arange(len(lowest))]
    return _descended(problem, data, [(ended.t, ended.common), (t, nothing)], order)


def _with_all(problem: Problem, data: FitData, ends: State, order: int | None) -> State:
    """Return ends of a search with some of the samples, with the true values of all."""
    if ends.latent.shape[1] == data.measured.shape[1]:
        return ends
    state = replace(initial(data, ends.t, ends.common), converged=ends.converged)
    normal = accumulate(problem, data, state.t, state.common, state.latent, order=order)
    state.merit[:] = normal.misfit + np.sum(state.t**2, axis=1)
    return state


def _lowest(ends: Sequence[State], data: FitData, problem: Problem) -> State:
    """Return the lowest of several ends: of each window, or of all where they share something."""
    if problem.unknowns.shared:
        return min(ends, key=lambda end: float(end.merit.sum() + np.sum(end.common**2)))
    best = ends[0]
    for end in ends[1:]:
        at = np.flatnonzero(end.merit < best.merit)
        rows = data.rows_of(at)
        put(best, end.only(at, rows), at, rows)
    return best


def _copies(data: FitData, number: int) -> FitData:
    """Return windows that share nothing so many times: many searches at once take the time of one."""
    return data.only(np.tile(np.arange(len(data.windows)), number))


def _downhill(problem: Problem, data: FitData, state: State, order: int | None) -> State:
    """Go down anew from where the search ended, and from the prior means."""
    common = state.common if problem.unknowns.shared else np.zeros(0)
    begun = [(inside(problem.unknowns.local, state.t), common), damped_search.centre(problem, data)]
    return _descended(problem, data, begun, order)


def _descended(
    problem: Problem, data: FitData, begun: Sequence[tuple[Array, Array]], order: int | None
) -> State:
    """Go down from several beginnings with some of the samples, and from the lowest end with all of them."""
    some = data.thinned(ENOUGH)
    best = _lowest([descend(problem, some, *one, order=order) for one in begun], some, problem)
    if len(some.measured[0]) == len(data.measured[0]):
        return best
    ends = descend(problem, data, best.t, best.common, order=order, iterations=_LAST)
    return replace(ends, converged=ends.converged | best.converged)


def put(state: State, other: State, at: Index, rows: Index) -> None:
    """Put some windows, and their rows, in the place of the same ones of another search, in place."""
    state.t[at], state.merit[at], state.converged[at] = other.t, other.merit, other.converged
    state.latent[:, rows] = other.latent
    if len(other.common):
        state.common[:] = other.common


def _put(found: Posterior, other: Posterior, at: Index) -> Posterior:
    """Put some windows in the place of the same ones of another posterior."""
    for name in ("t", "own", "misfit", "dof", "inflation", "excess", "at_bound"):
        getattr(found, name)[at] = getattr(other, name)
    local = found.t.shape[1]
    for name in ("sure", "wide"):
        getattr(found, name)[at, :local] = getattr(other, name)[:, :local]
    if not len(other.common):
        return found
    for name in ("sure", "wide"):
        getattr(found, name)[at, local:] = getattr(other, name)[:, local:]
    found.gain[at] = other.gain
    return replace(found, common=other.common, shared=other.shared)


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


def search(problem: Problem, data: FitData, order: int | None, begun: State | None = None) -> State:
    """Find the most probable unknowns, from several beginnings where one does not suffice.

    Or only from where a search with nearly the same noise ended (`begun`): windows in which that one got lost
    are left to `mend`.
    """
    if begun is not None and begun.converged.all():
        return _again(problem, data, begun, order, iterations=_LAST)
    some = data.thinned(ENOUGH)
    state = _searched(problem, some, order) if begun is None else _again(problem, some, begun, order)
    if len(some.measured[0]) == len(data.measured[0]):
        return state
    return _again(problem, data, state, order, iterations=_LAST)


def lower_elsewhere(problem: Problem, data: FitData, ended: State) -> State | None:
    """Return the end of a search from all beginnings with effects, if it is lower than where one has ended.

    What noise usually is may have led that one to another valley, of which the noise was then learnt.
    """
    if next(damped_search.with_effects(problem, data, ended.t, ended.common), None) is None:
        return None
    some, order = data.thinned(ENOUGH), enough_nodes(problem.noise, data)
    ends = [search(problem, some, order, ended), search(problem, some, order)]
    here, there = (float(end.merit.sum() + np.sum(end.common**2)) for end in ends)
    return ends[1] if ends[1].converged.all() and there < here - _LOWER else None


def _again(
    problem: Problem, data: FitData, begun: State, order: int | None, *, iterations: int = ITERATIONS
) -> State:
    """Search from where another one ended, in the windows in which it did not get lost."""
    state = initial(data, begun.t, begun.common)
    # A step from true values that go with other unknowns leads away, and further than quick steps return.
    accumulate(problem, data, state.t, state.common, state.latent, order=order)
    lost = ~begun.converged
    if problem.unknowns.shared:
        lost[:] = lost.any()
    state.converged[:], state.lost[:] = ~lost, lost
    state = solve(problem, data, state, order=order, iterations=iterations)
    state.converged &= ~lost
    state.lost[:] = False
    return state


def _searched(problem: Problem, data: FitData, order: int | None) -> State:
    t, common = damped_search.centre(problem, data)
    state = _towards(problem, data, t, common, order)
    if not problem.unknowns.shared:
        return _elsewhere(problem, data, state, common, order)
    present = damped_search.with_effects(problem, data, t, common)
    return _lowest([state, *(_with_effects(problem, data, *one, order) for one in present)], data, problem)


def _with_effects(problem: Problem, data: FitData, t: Array, common: Array, order: int | None) -> State:
    """Search from where effects are there: downhill at first, for quick steps may lead back to their null."""
    near = descend(problem, data, t, common, order=_COARSE, iterations=_A_ROUND)
    return solve(problem, data, initial(data, near.t, near.common), order=order)


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
    again, rows = data.only(bad), data.rows_of(bad)
    begun = list(damped_search.others(problem, again, common))
    copies = _copies(again, len(begun))
    ends = solve(
        problem, copies, initial(copies, np.concatenate(begun), common), order=order, iterations=_ELSEWHERE
    )
    for own in np.split(np.arange(len(ends.t)), len(begun)):
        tried = ends.only(own, copies.rows_of(own))
        better = tried.converged & ((tried.merit < state.merit[bad] - _LOWER) | ~state.converged[bad])
        inside = np.flatnonzero(np.repeat(better, again.count))
        put(state, tried.only(np.flatnonzero(better), inside), bad[better], rows[inside])
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
        ends = descend(problem, data, begun.t, begun.common, order=order, iterations=_A_ROUND)
        return replace(ends, lost=state.lost)
    ends = descend(problem, data.only(lost), begun.t[lost], begun.common, order=order, iterations=_A_ROUND)
    put(state, ends, lost, data.rows_of(lost))
    return state
