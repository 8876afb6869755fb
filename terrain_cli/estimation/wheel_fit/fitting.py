"""The steps of a fit: noise, search, wild samples, errors.

Wild samples are too far from the fit for noise: spikes, dropped digits, the edge of another soil. A few lead
a fit by least squares astray however many samples there are. They are found by a robust fit (Huber's
weights), and left out of the final one (Rousseeuw & Leroy 1987, sections 1.2 and 4.4).
"""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import fields, replace
from functools import partial

import numpy as np
from numpy.typing import ArrayLike

from terrain_cli.errors import UsageError
from terrain_cli.estimation.line.moments import segment_sum
from terrain_cli.estimation.line.uncertainty import student
from terrain_cli.estimation.wheel_fit import damped_search, missing_effects, valley
from terrain_cli.estimation.wheel_fit.channel_series import BY_CHANCE, EACH, spikes, steadied
from terrain_cli.estimation.wheel_fit.excess_scatter import exceeded, going_on
from terrain_cli.estimation.wheel_fit.fit_data import FitData, Noise, collect
from terrain_cli.estimation.wheel_fit.fit_result import Fit, missed_share, parameters, residuals_of
from terrain_cli.estimation.wheel_fit.gauss_newton import (
    TOLERANCE,
    State,
    Ways,
    accumulate,
    eliminate,
    initial,
    inside,
    newton,
)
from terrain_cli.estimation.wheel_fit.late_channels import nothing_late
from terrain_cli.estimation.wheel_fit.learnt_noise import LikelyNoise, ScaledDifferences
from terrain_cli.estimation.wheel_fit.linearised import Equations, Problem
from terrain_cli.estimation.wheel_fit.noise_modes import FEW, Learnt, beginnings, mixed, modes, widened
from terrain_cli.estimation.wheel_fit.normal_equations import inverse, no_wider
from terrain_cli.estimation.wheel_fit.posterior import Posterior, posterior, with_model_error
from terrain_cli.estimation.wheel_fit.unknowns import unknowns
from terrain_cli.estimation.wheel_fit.window_search import (
    ENOUGH,
    enough_nodes,
    lower_elsewhere,
    mend,
    search,
    settled_search,
)
from terrain_cli.mechanics.effect import Effect, Prior, mean_load
from terrain_cli.mechanics.wheel_model import Given, Model, WheelGeometry
from terrain_cli.vocabulary.arrays import Array, Index, Mask
from terrain_cli.vocabulary.choices import FIT_SAMPLES

_MOST = 0.1  # Share of a window's samples above which it is the model that misses, and not they. Judged.
_PASSES = 3  # Passes in which the true values of the inputs come to rest
#: Rounds after which noise is left as it is where most windows are lost: it does not settle on a misfit.
_ROUNDS_LOST = 8
#: Step in posterior standard deviations up to which one for each round of the noise will do. In 18 fits of
#: 2,500 to 7,500 samples 1, 3 and 10 evaluate the model 1,148, 1,115 and 1,107 times (1,512 with a whole
#: search in each round), and c, φ and strength move by less than 0.005 standard errors.
_ONE_STEP = 3.0
_GROUP = 100_000  # Samples fitted at a time, where windows share nothing


def wild_samples(problem: Problem, data: FitData, found: State, order: int | None) -> Mask:
    """Tell which samples are too far from a robust fit, of these or of some, for the noise of `problem`."""
    every, free = data.measured.shape[1], np.arange(1, data.measured.shape[0] + 1)
    limits = np.concatenate([[np.inf], exceeded(free, BY_CHANCE / max(every, 1))])
    far = np.flatnonzero(_squared(problem, data, found, order, 1) > limits[data.seen.sum(axis=0)])
    wild = np.zeros(data.measured.shape[1], dtype=bool)
    if len(far):
        # True values of the inputs that come to rest take a residual down, not up.
        part = data.take(far, np.diff(np.searchsorted(far, data.bounds)), np.arange(len(data.windows)))
        squared = _squared(problem, part, found, order, _PASSES)
        wild[far] = squared > limits[part.seen.sum(axis=0)]
    share = segment_sum(wild.astype(float), data.bounds) / np.maximum(data.count, 1)
    return np.asarray(wild & np.repeat(share <= _MOST, data.count))


def _squared(problem: Problem, data: FitData, found: State, order: int | None, passes: int) -> Array:
    """Return the sum of squares of each sample's residuals after some passes, shape (n,)."""
    squared = np.zeros(data.measured.shape[1])

    def keep(block: Index, _: FitData, equations: Equations) -> None:
        rows = slice(data.bounds[block[0]], data.bounds[block[-1] + 1])
        squared[rows] = np.einsum("an,an->n", equations.residual, equations.residual)

    latent = data.given.copy()
    for _ in range(passes):
        accumulate(problem, data, found.t, found.common, latent, order=order, each=keep)
    return squared


def fit(
    model: Model,
    wheel: WheelGeometry,
    channels: Mapping[str, ArrayLike],
    bounds: ArrayLike,
    *,
    fixed: Mapping[str, ArrayLike] | None = None,
    priors: Mapping[str, Prior] | None = None,
    shared: Collection[str] = (),
    local: Collection[str] = (),
    noise: Noise | None = None,
    by_differences: bool = False,
    robust: bool = False,
    given: Given = "sinkage",
    correlated: bool = True,
    second: float = 0.0,
    min_samples: int = FIT_SAMPLES,
    joint: Collection[int] = (),
    begun: Noise | None = None,
    near: Fit | None = None,
    suspects: Sequence[Effect] | None = None,
    noise_errors: bool = True,
) -> Fit:
    """Fit a wheel–soil model to windows of samples, with noise in every channel.

    `channels`, shape (n,), are in SI units, NaN where not measured: slip and sinkage (or load, see `given`),
    with whichever of load, torque and drawbar_pull there are, and what the effects need. Window j is the
    samples bounds[j] to bounds[j + 1] − 1; from 0 to n.

    Held are the parameters `fixed`, of soil or effects, one value for all windows or one for each. `priors`
    stand in place of the weak ones from published soils (`unknowns.DEFAULT`), and of those of the effects:
    their null value, give or take five typical sizes. Parameters of the soil that are `shared` are one for
    all windows; those of the effects are, but for `local` ones, which differ from window to window.

    The noise is learnt from the data if not given (`learnt_noise`), `by_differences` only its white part;
    learning begins where it has `begun`, with what was learnt from most of these samples, and then takes half
    of the time. Both begin where a fit of nearly the same ended, if there is one `near`. A `robust` fit gives
    samples far from it less weight (Huber 1964), at the cost of 5 % of efficiency. `given`: predict load,
    torque and drawbar pull at the sinkage measured; or solve for the sinkage from the load, and predict
    sinkage, torque and drawbar pull. Steady test points are not `correlated`: they do not follow each other
    in time; of others there are so many in a `second`. Windows of fewer than `min_samples` are "too-few-
    samples"; of the windows `joint` the joint posterior of c and φ is laid out on a grid. `suspects` are
    effects that the model lacks, which would show here (`Fit.moved`); with them, even if there are none,
    errors hold what a model that misses the torque may be off (`posterior.with_model_error`). They hold that
    of learnt noise unless it is not asked for (`noise_errors`): it takes as long as all else.

    InputError: a channel that the model needs is missing.
    """
    data = collect(model, channels, bounds, given)
    if correlated and not by_differences:
        data = steadied(data.without(spikes(data)), second)
    if min_samples < 1:
        raise UsageError(f"windows of at least {min_samples} samples", hint="1 or more")
    under = mean_load(data.channels), wheel.radius
    fixed = {**nothing_late(model, data.channels), **(fixed or {})}
    sought = unknowns(model, fixed=fixed, priors=priors, shared=shared, local=local, under=under)
    problem = Problem(
        model=model,
        wheel=wheel,
        given=given,
        unknowns=sought,
        noise=noise or Noise(),
        robust=robust or not by_differences,
    )
    learner: LikelyNoise | ScaledDifferences | None = None
    state = ended = _where_ended(near, problem, data)
    likely = [Learnt(problem=problem, begun=ended)]
    if noise is None:
        learner = (
            ScaledDifferences(data, ordered=correlated)
            if by_differences
            else LikelyNoise(data, problem.unknowns, ordered=correlated, second=second, near=True)
        )
        known = None if by_differences else _of_channels(learner.noise, near.noise if near else None, begun)
        if known is None:
            problem, dof, state = _learn(problem, data, learner, ended)
            likely = [Learnt(problem=problem, dof=dof, begun=ended, others=learner.others())]
        else:
            problem = replace(problem, noise=known)
    if not by_differences:
        data, ended = _without_wild(problem, data, state)
        problem = replace(problem, robust=robust)
        likely = [replace(likely[0], problem=problem, begun=ended)]
        if learner is not None:
            likely = _anew(likely[0], data, state, correlated, second, elsewhere=near is None)
    fits = [
        _fitted(one, data, correlated=correlated, tempered=by_differences, noise_errors=noise_errors)
        for one in likely
    ]
    found, problem = mixed([part for part, _ in fits], likely), likely[0].problem
    order = enough_nodes(problem.noise, data)
    if not by_differences:
        own, t = no_wider(found.own, found.t)
        found = replace(found, t=inside(problem.unknowns.local, t), own=own)
    spread = float(student(np.array([likely[0].dof]))[0]) / 1.959964 if learner else 1.0
    filled = data.count > 0
    about = parameters((*model.soil, *local), sought, found, filled, spread)
    said = problem.predict(data, found.t, found.common, by=False, order=order)
    left, torque_rmse = residuals_of(data, said)
    result = Fit(
        model=model,
        under=under,
        n=data.count,
        **vars(about),
        noise=problem.noise,
        chi2=np.where(filled, found.misfit, np.nan),
        dof=np.where(filled, found.dof, np.nan),
        inflation=found.inflation,
        excess=found.excess,
        torque_rmse=torque_rmse,
        goes_on=going_on(left, data.seen, data.bounds, second)
        if correlated
        else np.zeros(len(data.windows), dtype=bool),
        moved=np.zeros(len(data.windows), dtype=bool),
        follows=np.zeros(len(data.windows), dtype=bool),
        second=second if correlated else 0.0,
        converged=fits[0][1],
        min_samples=min_samples,
    )
    if suspects is not None:
        # Neighbouring test points tell of no misfit that lasts.
        share = missed_share(data, left) if correlated else np.zeros(len(data.windows))
        at = problem, data, found.t, found.common
        moved, usual = missing_effects.moved(*at, result, suspects)
        follows, wandering = missing_effects.following(*at, result)
        result, usual = replace(result, follows=follows, moved=moved), usual + wandering
        wrong = np.where(result.missed | result.moved, share, 0.0)
        if wrong.any() or usual.any():
            found = with_model_error(found, sought.local, wrong, usual)
            about = parameters((*model.soil, *local), sought, found, filled, spread)
            result = replace(result, **vars(about))
    return replace(result, grids=valley.grids(problem, data, found, about, joint, order))


def _of_channels(like: Noise, *several: Noise | None) -> Noise | None:
    """Return the first noise that is one of the same channels as another; None if there is none."""
    return next((one for one in several if one and one.relative.keys() == like.relative.keys()), None)


def _where_ended(near: Fit | None, problem: Problem, data: FitData) -> State | None:
    """Return where the search of a fit of the same windows ended; None if it did not, or there is none."""
    if near is None or not near.converged.all():
        return None
    sought = problem.unknowns
    t = [u.sought(near.values[u.name]) for u in sought.local]
    common = np.array([float(u.sought(near.shared[u.name])) for u in sought.shared])
    columns = np.nan_to_num(np.stack(t, axis=1)) if t else np.zeros((len(data.windows), 0))
    state = initial(data, inside(sought.local, columns), inside(sought.shared, common))
    state.converged[:] = True
    return state


def _anew(
    near: Learnt, data: FitData, ended: State | None, ordered: bool, second: float, *, elsewhere: bool
) -> list[Learnt]:
    """Learn the noise of samples without wild ones, to the end; of few samples every noise that is likely.

    `near` is what was learnt of all samples, and `ended` where the last search for it did, if there was one.
    It is sought `elsewhere` whether effects lead lower, where no fit before has done so.
    """
    problem = near.problem
    learning = partial(LikelyNoise, data, problem.unknowns, ordered=ordered, second=second)
    if 0 < data.measured.shape[1] <= FEW:
        usual = replace(problem, noise=learning().noise)
        learners = [(learning(), one) for one in beginnings(usual, data)]
        found = modes(data, ((learner, *_learn(problem, data, learner, one)) for learner, one in learners))
        if found:
            return found
    # Noise that most windows do not tell is told by more of their samples no better.
    if ended is not None and _mostly_lost(ended):
        return [near]
    # Anew where the first one was lost: its end hangs on the last digit.
    certain = ended is None or bool(ended.converged.all())
    learner = learning(begun=problem.noise if certain else None)
    problem, dof, end = _learn(problem, data, learner, near.begun if certain else None)
    begun = end if _of_all(end, data) else near.begun
    lower = lower_elsewhere(problem, data, begun) if elsewhere and begun is not None else None
    if lower is not None:
        problem, dof, end = _learn(problem, data, learner, lower)
        begun = end if _of_all(end, data) else lower
    return [replace(near, problem=problem, dof=dof, begun=begun, others=learner.others())]


def _mostly_lost(ended: State) -> bool:
    return 2 * int(ended.lost.sum()) > len(ended.lost)


def _of_all(ended: State | None, data: FitData) -> bool:
    """Tell whether a search found its end in all windows."""
    return ended is not None and len(ended.t) == len(data.windows) and bool(ended.converged.all())


def _fitted(
    learnt: Learnt, data: FitData, *, correlated: bool, tempered: bool, noise_errors: bool
) -> tuple[Posterior, Mask]:
    """Fit all windows, and tell which converged: together where they share something, else in groups."""
    data = replace(data, excess=data.excess.copy())
    order = enough_nodes(learnt.problem.noise, data)
    problem, begun = learnt.problem, learnt.begun
    groups = [np.arange(len(data.windows))] if problem.unknowns.shared else list(data.blocks(_GROUP))
    parts, converged = [], []
    for group in groups or [np.arange(0)]:
        part = data if len(group) == len(data.windows) else data.only(group)
        state = search(problem, part, order, None if begun is None else begun.only(group))
        found = posterior(problem, part, state, order=order, correlated=correlated)
        parts.append(mend(problem, part, state, found, order=order, correlated=correlated, tempered=tempered))
        converged.append(state.converged)
    one = parts[0]
    together = {
        f.name: getattr(one, f.name)
        if f.name in {"common", "shared"}
        else np.concatenate([getattr(part, f.name) for part in parts])
        for f in fields(one)
    }
    found = Posterior(**together)
    if noise_errors:
        found = widened(problem, data, found, learnt.others)
    return found, np.concatenate(converged)


def _without_wild(problem: Problem, data: FitData, ended: State | None) -> tuple[FitData, State | None]:
    """Return the samples that are not too far from a robust fit for noise, and where its search ended.

    `ended` is where the search of all or some windows ended as this noise was learnt, if it was.
    None for few samples: there another noise may have its valley elsewhere, and to begin anew takes no time.
    """
    order = enough_nodes(problem.noise, data)
    some = data.thinned(ENOUGH)
    found = search(problem, some, order, ended if _of_all(ended, data) else None)
    if not found.converged.all():
        # Far from a fit that is lost are the best of samples.
        found = settled_search(problem, some, found, order)
    wild = wild_samples(problem, data, found, order)
    ends = found if some.measured.shape[1] < data.measured.shape[1] else None
    return data.without(wild), ends


def _learn(
    problem: Problem, data: FitData, learner: LikelyNoise | ScaledDifferences, begun: State | None = None
) -> tuple[Problem, float, State]:
    """Learn the noise; return it with its degrees of freedom, and where the last search ended."""
    problem = replace(problem, noise=learner.noise)
    filled = np.flatnonzero(data.count > 0)
    if len(filled) == 0:
        nothing = data.only(filled)
        return problem, 1.0, initial(nothing, *damped_search.centre(problem, nothing))
    most = learner.samples
    chosen = filled[np.unique(np.linspace(0, len(filled) - 1, most // EACH).astype(int))]
    sample = data.only(chosen).thinned(most // len(chosen))
    local, dof = len(problem.unknowns.local), 1.0
    state = initial(sample, *damped_search.centre(problem, sample))
    if begun is not None:
        lost = ~begun.converged[chosen, None]
        state = initial(sample, np.where(lost, state.t, begun.t[chosen]), begun.common)
    elif next(damped_search.with_effects(problem, sample, state.t, state.common), None) is not None:
        state = search(problem, sample, enough_nodes(problem.noise, sample))
    near = begun is not None and bool(begun.converged[chosen].all())
    for number in range(1, learner.rounds + 1):
        order = enough_nodes(problem.noise, sample)
        # One step in each round brings the unknowns along with the noise, where it is a short one.
        if not near:
            state = settled_search(problem, sample, state, order)
        learner.begin(sample)
        ways = Ways(sample, problem.unknowns)

        def keep(block: Index, part: FitData, found: Equations, ways: Ways = ways) -> None:
            learner.add(block, part, found)
            ways.keep(block, part, found)

        normal = accumulate(problem, sample, state.t, state.common, state.latent, order=order, each=keep)
        own, gain, shared = eliminate(normal, local)
        held = inverse(shared)
        taken = np.einsum("wab,wba->", normal.information[:, :local, :local], own)
        taken += np.trace(np.eye(len(shared)) - held)
        dof = max(float(sample.seen.sum() - taken), 1.0)
        settled = learner.settled(float(normal.misfit.sum()), dof, (own, gain, held))
        problem = replace(problem, noise=learner.noise)
        step, shift, length = newton(normal, problem.unknowns, state.t, state.common)
        longest = max(length.max(initial=0.0), shift @ shared @ shift)
        whole, near = not near, not state.lost.any() and longest <= _ONE_STEP**2
        if near:
            state.t, state.common = state.t + step, state.common + shift
            state.latent = ways.moved(state.latent, step, shift)
        settled = settled and (whole or longest <= TOLERANCE**2)
        if settled or (_mostly_lost(state) and number == _ROUNDS_LOST):
            break
    return problem, dof / learner.lasting, state
