"""Least squares on channels without their own noise: a fit that a wrong model does not lead astray.

The fit of `estimation.wheel_fit` takes load, sinkage and slip for noisy and is the best there is where the
model is right. Where something is missing it puts the blame on them: soils come out that no prior would
allow. Here they count as exact, and what the model cannot explain counts as noise that lasts for
a block.
"""

from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from terrain_cli.comparison import smoothed_model
from terrain_cli.comparison.smoothed_model import SmoothedData
from terrain_cli.comparison.whitening import Whitening
from terrain_cli.estimation.wheel_fit import Fit, normal_equations
from terrain_cli.estimation.wheel_fit.damped_search import damped
from terrain_cli.estimation.wheel_fit.fit_result import LARGEST_OPEN, at_end, strengths
from terrain_cli.estimation.wheel_fit.gauss_newton import Normal, inside, newton
from terrain_cli.estimation.wheel_fit.posterior import WIDE
from terrain_cli.estimation.wheel_fit.unknowns import Unknowns
from terrain_cli.mechanics.wheel_model import Model
from terrain_cli.vocabulary.arrays import Array, Index

_ITERATIONS, _ROUNDS = 24, 2
#: Damping at first; the least factor by which a step that falls as promised eases it, and the factor by which
#: one that does not fall raises it, twice as much each time (Madsen, Nielsen & Tingleff 2004, section 3.2).
_DAMPING, _EASED, _HARDER = 1e-3, 1.0 / 3.0, 2.0
_ROUGH = 400  # Samples of a window with which a search is begun
PRESENT = 0.3  # Typical sizes from its null at which an effect is there where a search begins with it
_CARRIED = 3  # Times that a neutral soil's stiffness is corrected
#: Fall of the cost that the next step promises, as a share, at which the search is over; and at which the
#: beginning is known that leads lowest.
_SETTLED, _ROUGHLY = 1e-5, 1e-3
_FAR = 0.1  # Share of a sinkage, and of the samples, from which on a change is more than a small one
_PER_BLOCK = 4.0  # Independent values that a misfit has in a block


@dataclass(frozen=True, kw_only=True)
class Solution:
    """A model fitted to the samples of one wheel."""

    model: Model
    unknowns: Unknowns
    t: Array  # shape (w, q): in prior standard deviations from the prior means
    common: Array  # shape (m,): in the same
    residual: Array  # shape (n, c): in units of the noise
    design: Array  # shape (n, c, q + m): derivatives of the prediction by t and common, in the same units
    sinkage: Array | None  # shape (n,): under the load; None where it is given
    spread: float  # Variance of the misfit in units of the noise's, as it counts against the prior

    @property
    def merit(self) -> float:
        """Cost with the prior's part: what a search makes small."""
        return _cost(self.residual, self.t, self.common, 1.0)

    def of_samples(self, window: Index) -> dict[str, Array]:
        """Return every parameter of some samples, (n,), by the window of each."""
        return smoothed_model.parameters(self.unknowns, self.t[window], self.common, window)


def covariance(data: SmoothedData, solution: Solution, prior: float = 1.0) -> tuple[Array, Array]:
    """Return the covariance of each window's parameters, and of the common ones alone.

    In their own units: of the window's own and the common ones, (w, q + m, q + m), and (m, m). The priors
    have `prior` times their information.
    """
    w, q = solution.t.shape
    m = len(solution.common)
    information, _ = moments(solution.design, solution.residual, data.window, data.windows)
    found, shared = normal_equations.arrow(information / solution.spread, q, prior * np.eye(q + m))
    held = normal_equations.inverse(shared - found.taken())
    whole = normal_equations.covariance(found.own, found.gain, held)
    scale = np.abs(solution.unknowns.slopes(solution.t, solution.common))
    outside = scale[0, q:] if w else np.zeros(m)
    return whole * scale[:, :, None] * scale[:, None, :], held * np.outer(outside, outside)


def parameters(solution: Solution) -> dict[str, Array]:
    """Return the parameters sought, in their own units, (w,): what is common stands in every window."""
    sought = (*solution.unknowns.local, *solution.unknowns.shared)
    both = zip(sought, (*solution.t.T, *solution.common), strict=True)
    return {u.name: np.full(len(solution.t), u.value(np.asarray(number))) for u, number in both}


def as_fit(data: SmoothedData, solution: Solution, fit: Fit) -> Fit:
    """Put a solution in the place of what another fit of the same windows found; empty windows stay NaN."""
    own, common = covariance(data, solution)
    found = parameters(solution)
    names, empty = tuple(found), fit.n == 0
    outside = [u.name for u in solution.unknowns.shared]
    error = {name: np.sqrt(own[:, j, j]) for j, name in enumerate(names)}
    wide = np.sqrt(np.einsum("waa->wa", covariance(data, solution, WIDE)[0]))
    wide /= np.abs(solution.unknowns.slopes(solution.t, solution.common))
    every = (*solution.unknowns.local, *solution.unknowns.shared)
    sought = zip(every, (*solution.t.T, *solution.common), wide.T, strict=True)
    values = {name: np.where(empty, np.nan, found[name]) for name in names if name in fit.values}
    errors = {name: np.where(empty, np.nan, error[name]) for name in values}
    changed: dict[str, Any] = {}
    if {"cohesion", "tan_phi"} <= values.keys():
        changed = {n: np.where(empty, np.nan, one) for n, one in strengths(names, own, values).items()}
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
        undetermined={
            **fit.undetermined,
            **{u.name: (open_by > LARGEST_OPEN) | at_end(u, t) | empty for u, t, open_by in sought},
        },
        **changed,
    )


def solve(
    model: Model,
    sought: Unknowns,
    data: SmoothedData,
    t: Array,
    common: Array,
    *,
    rounds: int = _ROUNDS,
    settled: float = _SETTLED,
) -> Solution:
    """Fit a model, by the method of Levenberg and Marquardt, from soils `t`, (w, q), and `common`, (m,).

    The misfit is weighed against the prior anew at most `rounds` times. A search is over where the next step
    promises a fall of the cost below the share `settled`.
    """
    within = _of_wheels(sought)
    t, common = inside(within.local, t), inside(within.shared, common)

    state = _linear(model, sought, data, t, common, _carrying(model, sought, data, t, common))
    spread = _spread(data, state.left)
    for _ in range(rounds):
        damping, harder, begun = _DAMPING, _HARDER, state
        cost = _cost(state.left, t, common, spread)
        normal = _normal(data, state, spread)
        for _ in range(_ITERATIONS):
            here = damped(normal, np.full(len(t), damping))
            step, shift, _ = newton(here, within, t, common)
            promised = _promised(normal, t, common, step, shift)
            if 0.0 <= promised < settled * cost:
                break
            trial = _linear(model, sought, data, t + step, common + shift, state.sinkage)
            if _far(trial.sinkage, state.sinkage):
                # Too far for one step of Newton: the soil may not carry the load at all.
                exact = _carrying(model, sought, data, t + step, common + shift, state.sinkage)
                trial = _linear(model, sought, data, t + step, common + shift, exact)
            fall = cost - _cost(trial.left, t + step, common + shift, spread)
            if fall > 0.0:
                damping *= max(_EASED, 1.0 - (2.0 * fall / max(promised, fall) - 1.0) ** 3)
                t, common, state, cost, harder = t + step, common + shift, trial, cost - fall, _HARDER
                normal = _normal(data, state, spread)
            else:
                damping, harder = damping * harder, 2.0 * harder
        if state is not begun:
            sinkage = state.sinkage
            if sinkage is not None and np.isnan(sinkage[np.isfinite(data.inputs["load"])]).any():
                # Those that were out of reach before need not be any more.
                sinkage = _carrying(model, sought, data, t, common, sinkage)
            state = _linear(model, sought, data, t, common, sinkage)
        weighed = _spread(data, state.left)
        if abs(np.log(weighed / spread)) < 0.1:
            break
        spread = weighed
    return Solution(
        model=model,
        unknowns=sought,
        t=t,
        common=common,
        residual=state.left,
        design=state.design,
        sinkage=state.sinkage,
        spread=spread,
    )


def search(
    model: Model, sought: Unknowns, data: SmoothedData, beginnings: Iterable[tuple[Array | None, Array]]
) -> Solution:
    """Fit a model from several beginnings, of which a part of the samples chooses one.

    Each has the soils, (w, q), or None for the neutral soil, and what is common to them, (m,).
    """
    few = rough(data)
    tried = [
        solve(
            model,
            sought,
            few,
            neutral(model, sought, few, common) if soil is None else soil,
            common,
            rounds=1,
            settled=_ROUGHLY,
        )
        for soil, common in beginnings
    ]
    best = min(tried, key=lambda one: one.merit)
    return solve(model, sought, data, best.t, best.common)


def rough(data: SmoothedData) -> SmoothedData:
    """Return the samples with which a search is begun."""
    step = max(1, len(data.use) // (_ROUGH * data.windows))
    return smoothed_model.thinned(data, np.arange(0, len(data.use), step))


def neutral(model: Model, sought: Unknowns, data: SmoothedData, common: Array) -> Array:
    """Return the soil expected before anything is known, (w, q), as stiff as the measured sinkage says."""
    t = np.zeros((data.windows, len(sought.local)))
    names = [u.name for u in sought.local]
    if "stiffness" not in names or "sinkage" not in data.measured or model.base == "linear":
        return t
    column = names.index("stiffness")
    sunk: Array | None = None
    for _ in range(_CARRIED):
        sunk = _carrying(model, sought, data, t, common, sunk)
        if sunk is None:
            return t
        with np.errstate(invalid="ignore", divide="ignore"):
            # Twice as deep is, for an ordinary soil, nearly three times as stiff.
            off = 1.5 * np.log(sunk / data.measured["sinkage"])
        for label in range(data.windows):
            own = off[(data.window == label) & data.use]
            usual = float(np.median(own[np.isfinite(own)])) if np.isfinite(own).any() else 1.0
            t[label, column] += np.clip(usual, -2.0, 2.0) / sought.local[column].sd
    return inside(_of_wheels(sought).local, t)


class _State(NamedTuple):
    """Residuals, design, and the sinkages that were predicted."""

    left: Array
    design: Array
    sinkage: Array | None


def _linear(
    model: Model, sought: Unknowns, data: SmoothedData, t: Array, common: Array, guess: Array | None
) -> _State:
    names = [u.name for u in (*sought.local, *sought.shared)]
    numbers = smoothed_model.parameters(sought, t[data.window], common, data.window)
    if guess is None:
        found, tables = smoothed_model.forecast(model, data, numbers, names, order=smoothed_model.ORDER)
    else:
        found, tables, guess = smoothed_model.nearby(model, data, numbers, names, guess)
    design = data.white(tables, data.seen)
    design *= sought.slopes(t, common)[data.window][:, None]
    left = smoothed_model.residual(data, found)
    # Where there is no answer there is no slope either.
    design[np.all(np.abs(left) >= smoothed_model.NO_ANSWER, axis=1)] = 0.0
    return _State(left, design, guess)


def _carrying(
    model: Model, sought: Unknowns, data: SmoothedData, t: Array, common: Array, guess: Array | None = None
) -> Array | None:
    """Return the sinkages at which the soil carries the load; None where these are given."""
    if "sinkage" in data.inputs or model.base == "linear":
        return None
    numbers = smoothed_model.parameters(sought, t[data.window], common, data.window)
    whole = replace(data, white=Whitening(("sinkage",), np.eye(1)))
    return smoothed_model.forecast(model, whole, numbers, order=smoothed_model.ORDER, guess=guess)[0][
        "sinkage"
    ]


def _far(sinkage: Array | None, before: Array | None) -> bool:
    """Tell whether sinkages have moved so far that one step does not find them."""
    if sinkage is None or before is None:
        return False
    known = np.isfinite(before)
    near = np.abs(sinkage[known] - before[known]) <= _FAR * before[known]
    return float(np.mean(near)) < 1.0 - _FAR if known.any() else True


def _cost(left: Array, t: Array, common: Array, spread: float) -> float:
    return float(smoothed_model.bounded(left).sum() / spread + (t**2).sum() + (common**2).sum())


def _spread(data: SmoothedData, left: Array) -> float:
    """Weigh the misfit against the prior: beyond the noise it has few independent values in a block."""
    count = max(int(data.seen.sum()), 1)
    ratio = float(smoothed_model.bounded(left).sum()) / count
    beyond = max(ratio - 1.0, 0.0)
    return 1.0 + beyond * float(max(count / (_PER_BLOCK * data.blocks * left.shape[1]), 1.0))


def weights(left: Array) -> Array:
    """Return the weights of Huber of residuals in units of the noise: 1 within `BEND`."""
    return np.asarray(np.minimum(1.0, smoothed_model.BEND / np.maximum(np.abs(left), 1e-300)))


def moments(design: Array, left: Array, cell: Index, cells: int) -> tuple[Array, Array]:
    """Sum up JᵀJ and Jᵀr by cell, with the weights of Huber."""
    weighted = design * weights(left)[..., None]
    score = normal_equations.products(weighted, left[..., None], cell, cells)
    return normal_equations.products(weighted, design, cell, cells), score[..., 0]


def _normal(data: SmoothedData, state: _State, spread: float) -> Normal:
    """Return the normal equations of each window as they count against the prior."""
    information, score = moments(state.design, state.left, data.window, data.windows)
    return Normal(information / spread, score / spread, np.zeros(data.windows))


def _promised(normal: Normal, t: Array, common: Array, step: Array, shift: Array) -> float:
    """Return by how much the cost would fall in a step if residuals were linear."""
    whole = np.hstack([step, np.broadcast_to(shift, (len(step), len(shift)))])
    rise = np.einsum("wa,wab,wb->", whole, normal.information, whole) - 2.0 * np.sum(whole * normal.score)
    return -float(rise + np.sum(step * (step + 2.0 * t)) + np.sum(shift * (shift + 2.0 * common)))


def _of_wheels(sought: Unknowns) -> Unknowns:
    """Keep friction from driving a wheel on."""
    local, shared = (
        tuple(replace(u, lower=max(u.lower, -u.mean / u.sd)) if u.name == "tan_phi" else u for u in some)
        for some in (sought.local, sought.shared)
    )
    return replace(sought, local=local, shared=shared)
