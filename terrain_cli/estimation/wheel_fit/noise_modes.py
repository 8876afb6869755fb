"""Where few samples leave several noises likely, each with a soil of its own: all of them, by their weight.

Ten standard deviations of noise and some eight unknowns are learnt together. Few samples may go with a
slip that errs and one soil, or with a torque that errs and another; which of them a search meets hangs on
where it begins. The posterior is then a mixture of normal distributions, one about each mode (Laplace's
approximation at each: Gelman et al. 2013, Bayesian Data Analysis, 3rd ed., section 13.3).
"""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from terrain_cli.estimation.wheel_fit import damped_search
from terrain_cli.estimation.wheel_fit.fit_data import FitData, Noise
from terrain_cli.estimation.wheel_fit.gauss_newton import State, accumulate, eliminate, initial, inside
from terrain_cli.estimation.wheel_fit.learnt_noise import LikelyNoise
from terrain_cli.estimation.wheel_fit.linearised import Equations, Problem
from terrain_cli.estimation.wheel_fit.normal_equations import covariance, inverse, no_wider
from terrain_cli.estimation.wheel_fit.posterior import Posterior
from terrain_cli.estimation.wheel_fit.window_search import ENOUGH, enough_nodes, settled_search
from terrain_cli.vocabulary.arrays import Array, Index

#: Samples of all windows together up to which noise and soil are sought from several beginnings. Of the
#: six points of Ding et al. 2011, on a soil of some 32°, one beginning says 21.9 ± 4.0°, and all say
#: 26.0 ± 7.8°. The number is judged: with more, one beginning tells as much.
FEW = 30
_SAME = 0.05  # Two modes are one where no unknown, in prior standard deviations, differs by more
_COUNTS = 0.02  # Weight beside the likeliest one from which on a mode counts


@dataclass(frozen=True, kw_only=True)
class Learnt:
    """What is to be fitted, with its noise."""

    problem: Problem
    dof: float = np.inf  # Degrees of freedom that tell the noise; infinite where it was given
    begun: State | None = None  # Where a search with nearly this noise ended
    others: tuple[tuple[Noise, Noise], ...] = ()  # Noise one standard error away, to either side
    log_weight: float = 0.0  # Logarithm of the part of the posterior, up to what all modes have in common


def beginnings(problem: Problem, data: FitData) -> Iterator[State]:
    """Yield soils at which learning may begin: downhill from far apart."""
    centre, common = damped_search.centre(problem, data)
    order = enough_nodes(problem.noise, data)
    for t in (centre, *damped_search.others(problem, data, common)):
        state = damped_search.descend(problem, data, t, common, order=order)
        state.converged[:] = True
        yield state


def modes(data: FitData, ends: Iterable[tuple[LikelyNoise, Problem, float, State]]) -> list[Learnt]:
    """Return the different ends of learning, the likeliest first, without those that hardly count."""
    found: list[Learnt] = []
    for learner, problem, dof, state in ends:
        known = any(one.begun is not None and _same(one.begun, state) for one in found)
        weight = _log_weight(problem, data, state, learner)
        if state.converged.all() and not known and np.isfinite(weight):
            others = learner.others()
            found.append(Learnt(problem=problem, dof=dof, begun=state, others=others, log_weight=weight))
    found.sort(key=lambda one: -one.log_weight)
    return [one for one in found if one.log_weight >= found[0].log_weight + np.log(_COUNTS)]


def _same(one: State, other: State) -> bool:
    away = np.concatenate([(one.t - other.t).ravel(), one.common - other.common])
    return bool(np.all(np.abs(away) < _SAME))


def _log_weight(problem: Problem, data: FitData, state: State, learner: LikelyNoise) -> float:
    """Return the logarithm of the posterior about a mode: its height, and its width in unknowns and noise."""
    sizes = []

    def keep(_: Index, part: FitData, found: Equations) -> None:
        sizes.append(float(np.sum(np.log(np.einsum("aan->an", found.factor)), where=part.seen)))

    order = enough_nodes(problem.noise, data)
    normal = accumulate(problem, data, state.t, state.common, state.latent.copy(), order=order, each=keep)
    local = state.t.shape[1]
    own, _, shared = eliminate(normal, local)
    squares = float(normal.misfit.sum() + np.sum(state.t**2) + np.sum(state.common**2))
    width = float(np.linalg.slogdet(own)[1].sum() - np.linalg.slogdet(shared)[1])
    return 0.5 * (width - squares) - sum(sizes) + learner.log_weight


def mixed(parts: Sequence[Posterior], likely: Sequence[Learnt]) -> Posterior:
    """Return a normal distribution with the mean and the covariance of a mixture; all else of the first."""
    first = parts[0]
    if len(parts) == 1:
        return first
    weight = np.exp([one.log_weight - likely[0].log_weight for one in likely])
    weight /= weight.sum()

    def mean(of: Callable[[Posterior], Array]) -> Array:
        return np.asarray(np.tensordot(weight, np.array([of(part) for part in parts]), axes=1))

    def both(part: Posterior) -> Array:
        return np.hstack([part.t, np.broadcast_to(part.common, (len(part.t), len(part.common)))])

    local, middle = first.t.shape[1], mean(both)
    between = mean(lambda part: (both(part) - middle)[:, :, None] * (both(part) - middle)[:, None, :])
    whole = mean(lambda part: covariance(part.own, part.gain, part.shared)) + between
    common = mean(lambda part: part.common)
    shared = mean(lambda part: part.shared + np.outer(part.common - common, part.common - common))
    gain = whole[:, :local, local:] @ inverse(shared)
    apart = np.einsum("waa->wa", between)
    return replace(
        first,
        t=middle[:, :local],
        common=common,
        gain=gain,
        own=whole[:, :local, :local] - gain @ shared @ np.swapaxes(gain, 1, 2),
        shared=shared,
        sure=np.sqrt(mean(lambda part: part.sure**2) + apart),
        wide=np.sqrt(mean(lambda part: part.wide**2) + apart),
    )


def widened(
    problem: Problem, data: FitData, found: Posterior, others: Sequence[tuple[Noise, Noise]]
) -> Posterior:
    """Add what a standard error of the noise does to the unknowns to their covariance.

    To either side, each with half of the weight: to which one an axis points hangs on the last digit, and
    the unknowns do not follow the noise in proportion (the sigma points of Julier & Uhlmann 1997). It does
    nearly the same with some of the samples as with all. In the end no less is known than beforehand, along
    no axis: an unknown that the data leave open limits no other.
    """
    if not others:
        return found
    order = enough_nodes(problem.noise, data)
    some = data.thinned(ENOUGH)
    own, t = no_wider(found.own, found.t)
    shared = found.shared
    begun = settled_search(problem, some, initial(some, found.t, found.common), order)
    for noise in (noise for sides in others for noise in sides):
        # A first step is with the true values that went with the other noise, and leads nowhere.
        there = initial(some, begun.t, begun.common)
        there.latent[:] = begun.latent
        ends = settled_search(replace(problem, noise=noise), some, there, order)
        common = ends.common - begun.common
        way = ends.t - begun.t - found.gain @ common
        own = own + 0.5 * way[:, :, None] * way[:, None, :]
        shared = shared + 0.5 * np.outer(common, common)
    return replace(found, t=inside(problem.unknowns.local, t), own=no_wider(own, t)[0], shared=shared)
