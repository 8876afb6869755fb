"""A damped search whose cost never rises, for windows where `gauss_newton` fails; and where searches begin.

Levenberg–Marquardt: every step, which the true values of the inputs take too, is shortened until the
sum of squares falls (Boggs & Rogers 1990). It takes more steps than Gauss–Newton, and ends in the valley
in which it began however wrong the model is.
"""

from collections.abc import Iterator
from dataclasses import replace
from itertools import product

import numpy as np

from terrain_cli.estimation.line.moments import segment_sum
from terrain_cli.estimation.wheel_fit.fit_data import FitData
from terrain_cli.estimation.wheel_fit.gauss_newton import (
    Normal,
    State,
    Ways,
    accumulate,
    initial,
    inside,
    newton,
    without_wild,
)
from terrain_cli.estimation.wheel_fit.linearised import Problem
from terrain_cli.estimation.wheel_fit.unknowns import present
from terrain_cli.mechanics.dual import value
from terrain_cli.vocabulary.arrays import Array

#: Samples of a window, and nodes on each arc, that are enough to begin with.
_SAMPLES, _ORDER = 3, 5
#: Unknowns in which the model bends most, and how far from the prior mean another search begins.
_BENT = ("shear_modulus", "sinkage_exponent")
_APART = 1.2
_STIFFER = 5  # Times that a soil is taken e times as stiff because the wheel sinks to its axle
#: Scales by which effects are present where a search begins with them. Of 48 short drives with bulldozing 5
#: ended in another valley with no such beginning, 2 with one at one scale, none with two.
_PRESENT = 2.0
ITERATIONS = 60
#: Damping at first, its least and most, and what a step that falls or does not makes of it.
_DAMPING, _LEAST, _MOST, _EASED, _RAISED = 1e-2, 1e-9, 1e8, 0.2, 5.0
#: Steps that win less of the sum of squares than this, and than this share of it, are the last.
_FALL, _SHARE = 0.01, 1e-3


def centre(problem: Problem, data: FitData) -> tuple[Array, Array]:
    """Begin at the prior means, with the stiffness that carries the load there."""
    sought = problem.unknowns
    t, common = np.zeros((len(data.windows), len(sought.local))), np.zeros(len(sought.shared))
    return carried(problem, data, inside(sought.local, t), common), common


def others(problem: Problem, data: FitData, common: Array) -> Iterator[Array]:
    """Yield further beginnings, far apart in what the model is most curved in, shape (w, p)."""
    names = [u.name for u in problem.unknowns.local]
    columns = [names.index(name) for name in _BENT if name in names]
    for signs in product((-_APART, _APART), repeat=len(columns)):
        t = np.zeros((len(data.windows), len(names)))
        t[:, columns] = signs
        yield carried(problem, data, inside(problem.unknowns.local, t), common)


def with_effects(problem: Problem, data: FitData, t: Array, common: Array) -> Iterator[tuple[Array, Array]]:
    """Yield beginnings at which the effects that windows share are there, t of shape (w, p) and common (q,).

    A search that begins without them may end in another valley: the shape of the contact, sought in every
    window, takes the place of bulldozing, and a large exponent that of a firm layer; it begins below that.
    Of what only shapes an effect the data say nothing without it.
    """
    names = [u.name for u in problem.unknowns.local]
    softer = problem.model.bends and "sinkage_exponent" in names
    for side in (1, -1):
        for begun in present(problem.unknowns, common, data.channels, side * _PRESENT):
            soil = t
            if softer:
                soil = np.zeros_like(t)
                soil[:, names.index("sinkage_exponent")] = -_APART
                soil = carried(problem, data, inside(problem.unknowns.local, soil), begun)
            yield soil, begun


def carried(problem: Problem, data: FitData, t: Array, common: Array) -> Array:
    """Choose each window's stiffness so that the soil carries the load."""
    names = [u.name for u in problem.unknowns.local]
    if problem.model.base == "linear" or "load" not in data.channels or "stiffness" not in names:
        return t
    column = names.index("stiffness")
    stiffness = problem.unknowns.local[column]
    few, moved = data.thinned(_SAMPLES), t.copy()
    if "sinkage" in few.channels:
        at_sinkage = replace(problem, given="sinkage")
        carried = value(at_sinkage.predict(few, t, common, by=False, order=_ORDER).load)
        load = few.channels["load"]
        seen = (load > 0.0) & (carried > 0.0)
        sums = [segment_sum(np.where(seen, part, 0.0), few.bounds) for part in (load, carried)]
        ratio = np.divide(sums[0], sums[1], out=np.ones(len(t)), where=sums[1] > 0.0)
        moved[:, column] += np.clip(np.log(np.maximum(ratio, 1e-3)), -3.0, 3.0) / stiffness.sd
    else:
        for _ in range(_STIFFER):
            sunk = ~np.isfinite(value(problem.predict(few, moved, common, by=False, order=_ORDER).torque))
            moved[:, column] += (segment_sum(sunk.astype(float), few.bounds) > 0.0) / stiffness.sd
    moved[:, column] = np.clip(moved[:, column], stiffness.lower, stiffness.upper)
    return moved


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
    # The true values that go with the beginning, before it is judged.
    _, _, state.latent, _ = _cost(problem, data, state.t, common, state.latent, order)
    normal, state.merit[:], state.latent, ways = _cost(problem, data, state.t, common, state.latent, order)
    for _ in range(iterations):
        active = np.arange(len(t)) if together else np.flatnonzero(~state.converged)
        if len(active) == 0 or state.converged.all():
            break
        part, rows = data.only(active), data.rows_of(active)
        some = Normal(normal.information[active], normal.score[active], normal.misfit[active])
        here = damped(some, damping[active])
        step, shift, _ = newton(here, sought, state.t[active], state.common)
        moved, moved_common = state.t[active] + step, state.common + shift
        latent = Ways(part, sought, ways[:, :, rows]).moved(state.latent[:, rows], step, shift)
        tried, merit, latent, tried_ways = _cost(problem, part, moved, moved_common, latent, order)
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
        ways[:, :, rows[inside]] = tried_ways[:, :, inside]
        for name in ("information", "score", "misfit"):
            getattr(normal, name)[at] = getattr(tried, name)[better]
        if together and better.all():
            state.common = moved_common
        # A short step wins little too: that one may not be the last.
        done = (better & (fall < least) & (damping[active] <= _DAMPING)) | (damping[active] >= _MOST)
        state.converged[active] = done
        damping[active] = np.clip(damping[active] * np.where(better, _EASED, _RAISED), _LEAST, _MOST)
    return state


def _cost(
    problem: Problem, data: FitData, t: Array, common: Array, latent: Array, order: int | None
) -> tuple[Normal, Array, Array, Array]:
    """Return equations and sum of squares, the true values of the inputs, and how these move (`Ways`)."""
    latent, ways = latent.copy(), Ways(data, problem.unknowns)
    # A step too far may lead beyond all numbers, and is not taken.
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        normal = accumulate(problem, data, t, common, latent, order=order, each=ways.keep)
        merit = normal.misfit + np.sum(t**2, axis=1)
    # Where the model gives no number nothing is missed, and nothing learnt but what is known beforehand.
    wild = without_wild(normal)
    told = normal.information.any(axis=(1, 2)) | normal.score.any(axis=1)
    dumb = ~told & (normal.score.shape[1] > 0)
    return normal, np.where(dumb | wild, np.inf, merit), latent, ways.by


def damped(normal: Normal, damping: Array) -> Normal:
    """Damp every unknown of each window by a share of its information (Marquardt 1963)."""
    diagonal = 1.0 + np.einsum("waa->wa", normal.information)
    extra = (damping[:, None] * diagonal)[:, :, None] * np.eye(diagonal.shape[1])
    return replace(normal, information=normal.information + extra)
