"""The most probable unknowns: Gauss–Newton steps of all windows at once; and what lies beyond bounds.

Unknowns of a window meet those of another only through the shared ones, so that no matrix ever spans
two windows (`normal_equations`).

About a bound the posterior is taken as normal, with its peak as far outside as the next step of
the search would lead, and cut off: the mean and the deviation of what remains stand for the
unknown, and the others move along as they are correlated with it (Johnson, Kotz & Balakrishnan
1994, section 13.10.1).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from terrain_cli.estimation.wheel_fit.fit_data import FitData
from terrain_cli.estimation.wheel_fit.linearised import Equations, Problem, equations
from terrain_cli.estimation.wheel_fit.normal_equations import Eliminated, arrow, posterior_covariance
from terrain_cli.estimation.wheel_fit.unknowns import Unknown, Unknowns
from terrain_cli.vocabulary.arrays import Array, Index, Mask

ITERATIONS = 40
TOLERANCE = 0.1  # A step this small, in posterior standard deviations, is the last one
#: Iterations after which steps that turn back without shrinking to half are shortened, and how far.
_PATIENCE, _SHORTEST = 5, 0.1
_NEAR = 1e-9  # At its bound is what is no further from it, in prior standard deviations
#: Deviations by which a peak is taken to be outside at the most: the model is not normal that far.
_FARTHEST = 5.0


@dataclass(kw_only=True)
class State:
    """Where the search stands."""

    t: Array  # t, common: shape (w, p) and (q,): unknowns of each window, and shared ones
    common: Array
    latent: Array  # Shape (inputs, n): true values of the inputs
    converged: Mask  # Shape (w,)
    merit: Array  # Shape (w,): sum of squares of residuals and of local unknowns
    lost: Mask  # Shape (w,): where quick steps got lost, so that they are not tried again

    def only(self, at: Index, rows: Index | None = None) -> State:
        """Return where some windows stand, with their rows or with no true values."""
        return State(
            t=self.t[at],
            common=self.common,
            latent=self.latent[:, [] if rows is None else rows],
            converged=self.converged[at],
            merit=self.merit[at],
            lost=self.lost[at],
        )


@dataclass(frozen=True)
class Normal:
    """Normal equations of windows, without the priors."""

    information: Array  # Shape (w, p + q, p + q)
    score: Array  # Shape (w, p + q)
    misfit: Array  # Shape (w,)


def initial(data: FitData, t: Array, common: Array) -> State:
    """Begin at t, shape (w, p), and common, shape (q,), with the measured values for the true ones."""
    converged, lost = np.zeros((2, len(t)), dtype=bool)
    return State(
        t=t.copy(),
        common=common.copy(),
        latent=data.given.copy(),
        converged=converged,
        merit=np.full(len(t), np.inf),
        lost=lost,
    )


def solve(
    problem: Problem, data: FitData, start: State, *, order: int | None, iterations: int = ITERATIONS
) -> State:
    """Find the most probable unknowns; `start` is changed in place, `order` is nodes on each arc."""
    sought, state = problem.unknowns, start
    windows, shared = len(data.windows), len(sought.shared) > 0
    # Where a search with fewer nodes has ended one short step is enough to tell.
    settled = state.converged.copy()
    state.converged[:] = (data.count == 0) | state.lost
    state.merit[:] = np.inf
    share, before, last = np.ones(windows), np.full(windows, np.inf), np.zeros_like(state.t)
    active, part = np.flatnonzero(~state.converged), data
    if len(active) < windows:
        part = data.only(active)
    for iteration in range(iterations):
        if len(active) == 0:
            break
        rows = slice(None) if part is data else data.rows_of(active)
        latent, ways = state.latent[:, rows], Ways(part, sought)
        # A step too far may lead beyond all numbers.
        with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
            normal = accumulate(
                problem, part, state.t[active], state.common, latent, order=order, each=ways.keep
            )
        state.merit[active] = normal.misfit + np.sum(state.t[active] ** 2, axis=1)
        without_wild(normal)
        step, shift, length = newton(normal, sought, state.t[active], state.common)
        # The weights move along with the unknowns, so that no sum of squares tells whether a step
        # was too long; steps that swing to and fro do.
        back = np.sum(step * last[active], axis=1) < 0.0
        swings = (iteration >= _PATIENCE) & back & (length > 0.25 * before[active])
        share[active] = np.clip(np.where(swings, 0.5, 2.0) * share[active], _SHORTEST, 1.0)
        before[active], last[active] = length, step
        step = share[active, None] * step
        state.t[active] += step
        state.common += shift
        state.latent[:, rows] = ways.moved(latent, step, shift)
        done = (length <= TOLERANCE**2) & ((iteration > 0) | settled[active])
        # A guess at which the model gives no number tells nothing.
        done &= np.einsum("waa->w", normal.information) > (0.0 if normal.score.shape[1] else -1.0)
        state.converged[active] = done
        if shared:
            if done.all() and shift @ eliminate(normal, len(sought.local))[2] @ shift <= TOLERANCE**2:
                break
        elif done.any():
            active = active[~done]
            part = data.only(active)
    return state


def accumulate(
    problem: Problem,
    data: FitData,
    t: Array,
    common: Array,
    latent: Array,
    *,
    order: int | None,
    each: Callable[[Index, FitData, Equations], None] | None = None,
) -> Normal:
    """Linearise all windows, block by block, and move the true values of the inputs along, in place.

    `each` is called with the windows of each block, their data and equations.
    """
    size = t.shape[1] + len(common)
    windows = len(t)
    total = Normal(np.zeros((windows, size, size)), np.zeros((windows, size)), np.zeros(windows))
    for block in data.blocks():
        part = data if len(block) == windows else data.only(block)
        rows = slice(data.bounds[block[0]], data.bounds[block[-1] + 1])
        found = equations(problem, part, t[block], common, latent[:, rows], order=order)
        total.information[block], total.score[block], total.misfit[block] = found.normal(part.bounds)
        latent[:, rows] = found.latent(part)
        if each is not None:
            each(block, part, found)
    return total


def without_wild(normal: Normal) -> Mask:
    """Let windows whose sums are beyond all numbers tell nothing, in place; return which these are, (w,)."""
    sums = np.einsum("wab->w", np.abs(normal.information)) + np.abs(normal.score).sum(axis=1)
    wild = ~np.isfinite(sums + normal.misfit)
    normal.information[wild], normal.score[wild] = 0.0, 0.0
    return np.asarray(wild)


class Ways:
    """How the true values of the inputs move with the unknowns, so that both are stepped together.

    `by` has the shape (inputs, p + q, n).
    """

    def __init__(self, data: FitData, sought: Unknowns, by: Array | None = None) -> None:
        self._data = data
        size = len(sought.local) + len(sought.shared)
        self.by = np.zeros((len(data.inputs), size, data.measured.shape[1])) if by is None else by

    def keep(self, block: Index, _: FitData, found: Equations) -> None:
        """Keep what the equations of some windows say."""
        bounds = self._data.bounds
        self.by[:, :, bounds[block[0]] : bounds[block[-1] + 1]] = found.ways()

    def moved(self, latent: Array, step: Array, shift: Array) -> Array:
        """Return true values, shape (inputs, n), that go with a step of own and shared unknowns."""
        whole = np.hstack([step, np.broadcast_to(shift, (len(step), len(shift)))])
        to = latent + np.einsum("kpn,np->kn", self.by, np.repeat(whole, self._data.count, axis=0))
        return self._data.possible(np.where(np.isfinite(to), to, latent))


def eliminate(normal: Normal, local: int, *, prior: float = 1.0) -> tuple[Array, Array, Array]:
    """Eliminate the first unknowns of each window; return A⁻¹, G and S of `normal_equations`.

    The information of each prior is less than 1 for what would be known with wider ones.
    """
    found, shared = _arrow(normal, local, prior)
    return found.own, found.gain, shared - found.taken()


def _arrow(normal: Normal, local: int, prior: float = 1.0) -> tuple[Eliminated, Array]:
    priors = prior * np.eye(normal.score.shape[1])
    return arrow(normal.information, local, priors, lambda own: posterior_covariance(own, prior))


def square_root(matrix: Array) -> Array:
    """Return factors L with L Lᵀ the covariance matrices, triangular where rounding leaves them definite."""
    try:
        return np.asarray(np.linalg.cholesky(matrix), dtype=float)
    except np.linalg.LinAlgError:
        if matrix.ndim > 2:
            return np.array([square_root(one) for one in matrix])
    size, axes = np.linalg.eigh(matrix)
    return np.asarray(axes * np.sqrt(np.maximum(size, np.finfo(float).eps * size[-1])))


def newton(normal: Normal, sought: Unknowns, t: Array, common: Array) -> tuple[Array, Array, Array]:
    """Return a step towards the most probable unknowns within their bounds, own and shared, and its length.

    The length is squared, in posterior standard deviations; `normal` is at these unknowns.
    """
    local = t.shape[1]
    step, shift, found = _unbounded(normal, t, common)
    low, high, most = limits(sought.local)
    low_shared, high_shared, most_shared = limits(sought.shared)
    out = (t + step < low) | (t + step > high)
    out_shared = (common + shift < low_shared) | (common + shift > high_shared)
    hold = np.hstack([out, np.broadcast_to(out_shared, (len(t), len(common)))])
    # Hold at their bounds those that would leave, and solve again for the others.
    to = np.where(out, np.where(step < 0.0, low, high) - t, 0.0)
    to_shared = np.where(out_shared, np.where(shift < 0.0, low_shared, high_shared) - common, 0.0)
    if hold.any():
        step, shift, found = _unbounded(_held(normal, hold, to, to_shared, t, common), t, common)
    whole, shift = shift, np.clip(common + shift, low_shared, high_shared) - common
    shift = shift / max(np.max(np.abs(shift) / most_shared, initial=1.0), 1.0)
    if not np.all(np.abs(shift - whole) <= _NEAR * (1.0 + np.abs(whole))):
        # The windows' own unknowns go with as much of it as is taken.
        held = _held(normal, hold, to, np.where(out_shared, shift, 0.0), t, common)
        step = found.behind(held.score[:, :local] - t, shift)
    step = np.clip(t + step, low, high) - t
    step = step / np.maximum(np.max(np.abs(step) / most, axis=1, initial=1.0, keepdims=True), 1.0)
    own = normal.information[:, :local, :local] + np.eye(local)
    return step, shift, np.einsum("wa,wab,wb->w", step, own, step)


def _held(normal: Normal, hold: Mask, to: Array, to_shared: Array, t: Array, common: Array) -> Normal:
    """Return equations in which some unknowns step to where they are held, whatever the others do.

    They are taken out of the equations of the others: a weight that held them would take digits of all.
    `hold`, shape (w, p + q), tells which, and `to` and `to_shared` are their steps, 0 for the others.
    """
    every = np.hstack([to, np.broadcast_to(to_shared, (len(t), len(common)))])
    there = np.hstack([to + t, np.broadcast_to((to_shared + common) / max(len(t), 1), (len(t), len(common)))])
    score = normal.score - np.einsum("wab,wb->wa", normal.information, every)
    information = np.where(hold[:, :, None] | hold[:, None, :], 0.0, normal.information)
    return replace(normal, information=information, score=np.where(hold, there, score))


def _unbounded(normal: Normal, t: Array, common: Array) -> tuple[Array, Array, Eliminated]:
    local = t.shape[1]
    found, shared = _arrow(normal, local)
    return (
        *found.solve(normal.score[:, :local] - t, shared, normal.score[:, local:].sum(axis=0) - common),
        found,
    )


def limits(sought: tuple[Unknown, ...]) -> tuple[Array, Array, Array]:
    """Return lower and upper bounds and largest steps, each of shape (p,)."""
    table = np.array([[u.lower, u.upper, u.step] for u in sought]).reshape(-1, 3)
    return table[:, 0], table[:, 1], table[:, 2]


def inside(sought: tuple[Unknown, ...], t: Array) -> Array:
    low, high, _ = limits(sought)
    return np.clip(t, low, high)


def overshoot(normal: Normal, local: tuple[Unknown, ...], t: Array) -> Array:
    """Return how far beyond its bound the next step takes an unknown, (w, p); −1 where it is at none."""
    low, high, _ = limits(local)
    at_low, at_high = t <= low + _NEAR, t >= high - _NEAR
    if not (at_low | at_high).any():
        return np.full(t.shape, -1.0)
    own, _, _ = eliminate(normal, t.shape[1])
    step = np.einsum("wab,wb->wa", own, normal.score[:, : t.shape[1]] - t)
    outward = np.where(at_low, -step, step)
    return np.where(at_low | at_high, np.maximum(outward, 0.0), -1.0)


def truncate(t: Array, own: Array, beyond: Array, local: tuple[Unknown, ...]) -> tuple[Array, Array]:
    """Cut the distribution of the windows' unknowns (covariance `own`) off at bounds they are at."""
    low, high, _ = limits(local)
    t, own = t.copy(), own.copy()
    for w in np.flatnonzero((beyond >= 0.0).any(axis=1)):
        for j in np.argsort(-beyond[w]):
            # An unknown that moved along with another may be beyond its bound now.
            outside = max(low[j] - t[w, j], t[w, j] - high[j], beyond[w, j])
            variance = own[w, j, j]
            # Rounding leaves nothing of a variance that is all but none, and there is nothing to cut off.
            if outside < 0.0 or variance <= 0.0:
                continue
            deviation = math.sqrt(variance)
            mean, share = _half(min(outside / deviation, _FARTHEST))
            lower = t[w, j] - low[j] < high[j] - t[w, j]
            to = low[j] + mean * deviation if lower else high[j] - mean * deviation
            along = own[w, :, j] / variance
            t[w] += along * (to - t[w, j])
            own[w] -= np.outer(along, along) * variance * (1.0 - share)
            # What is left of a variance that goes along all the way may be rounded below none.
            np.fill_diagonal(own[w], np.maximum(np.diagonal(own[w]), 0.0))
    return np.clip(t, low, high), own


def _half(outside: float) -> tuple[float, float]:
    """Return mean and variance of what a standard normal distribution has beyond `outside`, from there on."""
    density = math.exp(-0.5 * outside**2) / math.sqrt(2.0 * math.pi)
    rate = density / (0.5 * math.erfc(outside / math.sqrt(2.0)))
    return rate - outside, 1.0 - rate * (rate - outside)
