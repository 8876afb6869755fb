"""From the most probable unknowns to their means and errors.

Where data say little, the posterior is skew, and its mode is off its mean by a third of a standard
deviation. The mean is, to second order, t̂ − ½ P ∇ log det(I + 1), with the information I and the
covariance P = (I + 1)⁻¹ (Tierney & Kadane 1986; the part of it that is there without a prior
is the bias of Box 1971).

The design at the estimated true values û is noisy too, which makes the information look larger by
ΔI = Σ A'ᵀ S⁻¹ A' var û. The scores u have the variance I but the slope H = I − ΔI, so that the data
alone give the unknowns with the information H I⁻¹ H, by H I⁻¹ u (the sandwich of White 1982). With
these in the place of I and u, what is known tends to the prior where all information is feigned.

Both are sums over the samples of a window, which change little from one sample to the next: some
samples of each window are enough for them.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from terrain_cli.estimation.line.moments import segment_sum
from terrain_cli.estimation.line.uncertainty import student
from terrain_cli.estimation.wheel_fit.excess_scatter import excess, memory
from terrain_cli.estimation.wheel_fit.fit_data import BALANCE, FitData
from terrain_cli.estimation.wheel_fit.gauss_newton import (
    Normal,
    State,
    accumulate,
    eliminate,
    inside,
    newton,
    overshoot,
    square_root,
    truncate,
)
from terrain_cli.estimation.wheel_fit.linearised import Equations, Problem, equations, solve_lower
from terrain_cli.estimation.wheel_fit.normal_equations import (
    covariance,
    inverse,
    no_wider,
    posterior_covariance,
)
from terrain_cli.estimation.wheel_fit.unknowns import Unknown
from terrain_cli.vocabulary.arrays import Array, Index, Mask

#: Samples of each window, and nodes on each arc, for the corrections. To the mean of a shared
#: unknown every window adds in the same direction: more samples, lest their errors add up too.
_SAMPLES, _SAMPLES_SHARED, _ORDER = 6, 30, 5
#: Samples of all moves that are worked on together: with more, memory grows and nothing is faster.
_TOGETHER = 16_384
_STEP = 0.3  # Length of a difference, in posterior standard deviations and in those of the noise
#: The mean is never taken to be further than this from the mode, in posterior standard deviations.
_FARTHEST = 2.0
_SMALL = 1.0  # Beyond this many of them a correction of shared unknowns is none
#: Degrees of freedom that Student's t is taken for at the least: fewer samples hardly know their own memory,
#: and white ones would now and then lose all that they tell.
_FEWEST = 10.0
#: Information of a prior ten times as wide, and of nothing.
WIDE, _NOTHING = 0.01, 1e-9


@dataclass(frozen=True, kw_only=True)
class Posterior:
    """What is known of the unknowns, in prior standard deviations from their prior means."""

    t: Array  # t, common: shape (w, p) and (q,): means
    common: Array
    own: Array  # Shape (w, p, p): covariance of each window's own unknowns with the shared ones held
    shared: Array  # Shape (q, q): covariance of the shared unknowns
    gain: Array  # Shape (w, p, q): change of the windows' own unknowns with the shared ones
    # sure, wide: shape (w, p + q): standard deviations from information that noise cannot have made, under
    # the priors as they are and under ones ten times as wide
    sure: Array
    wide: Array
    # misfit, dof: shape (w,): weighted sum of squares of the residuals in terms of the sensors' noise, and
    # their degrees of freedom
    misfit: Array
    dof: Array
    # Shape (w,): how much larger the long-run variance of the residuals is than the noise says
    inflation: Array
    excess: Array  # Shape (w,): as in `FitData`
    # Shape (w, p): which of a window's own unknowns the data would take beyond their bounds
    at_bound: Mask
    by_model: Array  # Shape (w, p, p): the part of `own` that is the model's error, alike in all windows


def posterior(
    problem: Problem, data: FitData, state: State, *, order: int | None, correlated: bool
) -> Posterior:
    """Return means and covariances from the most probable unknowns; `state.latent` becomes the means'."""
    local = state.t.shape[1]
    few = _Few(problem, data, state)
    at_mode, noise = few.at_mode()
    own, gain, shared = eliminate(at_mode, local)
    held = posterior_covariance(shared)
    way, way_shared = _to_mean(few, at_mode, own, gain, held)

    last = _Last(data, own, gain, held)
    # Where little is known the posterior is far from normal, and the way to its mean is not told.
    way[data.excess > 1.0] = 0.0
    for last_try in (False, True):
        move = way + gain @ way_shared
        t, common = _within(problem, state.t + move, state.common + way_shared)
        latent = state.latent.copy()
        normal = accumulate(problem, data, t, common, latent, order=order, each=last.keep)
        # At the mean the squares exceed those at the mode by less than 1 for each unknown: where they rise
        # more, the posterior bends, and the way is shortened.
        unknowns = float(at_mode.score.shape[1])
        risen = np.maximum(normal.misfit + np.sum(t**2, axis=1) - state.merit, unknowns)
        if last_try or not (risen > unknowns).any():
            break
        share = np.sqrt(unknowns / risen)
        way, way_shared = share[:, None] * way, share.min(initial=1.0) * way_shared
    state.latent[:] = latent
    taken = np.einsum("wab,wba->w", normal.information[:, :local, :local], eliminate(normal, local)[0])
    dof = segment_sum(data.seen.sum(axis=0).astype(float), data.bounds) - taken

    honest, sure = _honest(normal, noise)
    own, gain, shared = eliminate(honest, local)
    held = posterior_covariance(shared)
    # A step of the search from there leads back to the mode, and tells how far away it still was.
    step, shift, _ = newton(honest, problem.unknowns, t, common)
    t = t + _bounded(step + move, own)
    common = common + _bounded((shift + way_shared)[None], held[None])[0]
    t, common = _within(problem, t, common)
    beyond = overshoot(honest, problem.unknowns.local, t)

    scatter = excess(last.residual, data.seen, data.bounds, dof)[:, None, None]
    lasting, lasting_shared = np.ones((local, len(t))), np.ones((len(held), 1))
    if correlated:
        lasting, lasting_shared = last.memory()
        # Their noise is that of their long run already.
        lasting = np.where(data.excess > 1.0, 1.0, lasting)
    inner = honest.information[:, :local, :local]
    number = data.count.astype(float)
    lengthened = _lengthen(scatter * inner, last.axes, _surely(lasting, number).T)
    along = np.concatenate([gain, np.broadcast_to(np.eye(len(shared)), (len(gain), *shared.shape))], axis=1)
    plain, larger = (
        np.asarray(np.einsum("wax,wab,wby->xy", along, factor * honest.information, along), dtype=float)
        for factor in (1.0, scatter)
    )
    lengthened_shared = _lengthen(larger, last.axes_shared, _surely(lasting_shared[:, 0], number.sum()))
    priors = np.eye(len(shared)) + np.einsum("wpx,wpy->xy", gain, gain)
    sure = replace(sure, information=sure.information / scatter)
    t, cut_off = truncate(t, _sandwich(own, inner, lengthened, np.eye(local)), beyond, problem.unknowns.local)
    return Posterior(
        t=t,
        common=common,
        own=cut_off,
        shared=_sandwich(held, plain, lengthened_shared, priors),
        # What is at its bound stays there.
        gain=np.where(beyond[:, :, None] >= 0.0, 0.0, gain),
        sure=_width(sure, local, prior=1.0),
        wide=_width(sure, local, prior=WIDE),
        misfit=normal.misfit * data.excess,
        dof=dof,
        inflation=data.excess * scatter[:, 0, 0] * lasting.max(axis=0, initial=1.0),
        excess=data.excess.copy(),
        at_bound=beyond >= 0.0,
        by_model=np.zeros_like(cut_off),
    )


def with_model_error(found: Posterior, local: Sequence[Unknown], share: Array, usual: Array) -> Posterior:
    """Add that a model which misses a share of the torque, shape (w,), may be off by as much in strength.

    And by what effects that do not show add to the covariance, `usual`, shape (w, p, p).

    However many samples there are, they do not tell the part of a misfit that c and tan φ take up: it is as
    likely to be as large as what they leave (model discrepancy; Kennedy & O'Hagan 2001, Journal of the Royal
    Statistical Society B 63, 425). That is so along every way in which they may be off: their errors grow as
    if all samples told of the misfit once.
    """
    names = [one.name for one in local]
    places = [names.index(name) for name in ("cohesion", "tan_phi") if name in names]
    if not places:
        return found
    values = np.stack([local[place].value(found.t[:, place]) for place in places], axis=1)
    slopes = np.stack([local[place].slope(found.t[:, place]) for place in places], axis=1)
    known = found.own[:, places][:, :, places]
    covariance = known * slopes[:, :, None] * slopes[:, None, :]
    # The strength c + σ tan φ at the stress where it is known best.
    along = np.ones_like(values)
    along[:, 1:] = np.maximum(-covariance[:, :-1, -1] / covariance[:, -1:, -1], 0.0)
    strength = np.sum(along * values, axis=1)
    variance = np.einsum("wa,wab,wb->w", along, covariance, along)
    times = (share * strength) ** 2 / variance
    both = np.isin(np.arange(len(names)), places)
    own = found.own * (1.0 + times[:, None, None] * np.outer(both, both)) + usual
    own, t = no_wider(own, found.t)
    return replace(found, own=own, t=t, by_model=own - found.own)


def _surely(lasting: Array, number: Array) -> Array:
    """Widen what is known of samples that are not independent by Student's t."""
    independent = np.maximum(number / lasting - 1.0, _FEWEST)
    return np.asarray(lasting * np.maximum(student(independent) / student(number - 1.0), 1.0) ** 2)


def _honest(normal: Normal, noise: Array) -> tuple[Normal, Normal]:
    """Return what is left of the normal equations without that which the noise of the design feigns.

    First by the best weight of the data against the priors, then beyond twice the noise.
    """
    information = normal.information
    size, axes = np.linalg.eigh(information)
    root = np.sqrt(np.maximum(size, 0.0) + _NOTHING)
    scaled = axes / root[:, None, :]
    share, turn = np.linalg.eigh(np.swapaxes(scaled, 1, 2) @ noise @ scaled)
    # I = Q Qᵀ and ΔI = Q diag(share) Qᵀ.
    q = (axes * root[:, None, :]) @ turn
    back = np.swapaxes(turn, 1, 2) @ np.swapaxes(scaled, 1, 2)
    left = np.clip(1.0 - share, 0.0, 1.0)[:, None, :]
    sure = np.clip(1.0 - 2.0 * share, 0.0, 1.0)[:, None, :]
    across = np.swapaxes(q, 1, 2)
    score = np.einsum("wab,wb->wa", (q * left) @ back, normal.score)
    return (
        Normal((q * left**2) @ across, score, normal.misfit),
        Normal((q * sure) @ across, score, normal.misfit),
    )


def _lengthen(scores: Array, axes: Array, lasting: Array) -> Array:
    """Return the variance of scores whose parts along some axes last for several samples."""
    inside = np.swapaxes(axes, -1, -2) @ scores @ axes
    back = inverse(axes)
    root = np.sqrt(lasting)
    return np.asarray(np.swapaxes(back, -1, -2) @ (root[..., :, None] * inside * root[..., None, :]) @ back)


def _sandwich(own: Array, information: Array, scores: Array, priors: Array) -> Array:
    """Return the covariance where the variance of the scores is not the information that `own` stands for.

    `priors` is what `own` knows beside the data: own⁻¹ less the information.
    """
    found = own + own @ (scores - information) @ own
    if (np.diagonal(found, axis1=-2, axis2=-1) > 0.0).all():
        return np.asarray(found)
    # The same as a sum of squares, of which rounding makes nothing negative where there is hardly any noise.
    size, axes = np.linalg.eigh(priors + scores)
    half = own @ (axes * np.sqrt(np.maximum(size, 0.0))[..., None, :])
    return np.asarray(half @ np.swapaxes(half, -1, -2))


def _width(normal: Normal, local: int, *, prior: float) -> Array:
    """Return standard deviations of all unknowns under priors of some information."""
    own, gain, shared = eliminate(normal, local, prior=prior)
    held = posterior_covariance(shared, prior)
    return np.asarray(np.sqrt(np.einsum("waa->wa", covariance(own, gain, held))))


class _Last:
    """What the last equations say of each sample: its residuals and its part in the scores."""

    def __init__(self, data: FitData, own: Array, gain: Array, held: Array) -> None:
        self.bounds, self.gain = data.bounds, gain
        self.axes: Array = square_root(own)
        self.axes_shared: Array = square_root(held)
        self.residual = np.zeros_like(data.measured)
        self.score = np.zeros((own.shape[1], data.measured.shape[1]))
        self.score_shared = np.zeros((len(held), data.measured.shape[1]))

    def keep(self, block: Index, part: FitData, found: Equations) -> None:
        rows = slice(self.bounds[block[0]], self.bounds[block[-1] + 1])
        self.residual[:, rows] = found.bounded
        score = np.einsum("mpn,mn->pn", found.design, found.residual * found.weight)
        local = self.axes.shape[1]
        for into, by in ((self.score, self.axes), (self.score_shared, self.gain)):
            into[:, rows] = np.einsum("npj,pn->jn", np.repeat(by[block], part.count, axis=0), score[:local])
        self.score_shared[:, rows] = self.axes_shared.T @ (self.score_shared[:, rows] + score[local:])

    def memory(self) -> tuple[Array, Array]:
        """Return the samples to an independent one, along the axes of own and shared unknowns."""
        # What the data weigh beside the priors, of which the data and the priors together are 1.
        taken = np.clip(1.0 - np.einsum("wpj,wpj->jw", self.axes, self.axes), 0.0, 1.0)
        taken_shared = np.clip(1.0 - np.sum(self.axes_shared**2, axis=0), 0.0, 1.0)[:, None]
        return (
            memory(self.score, self.bounds, taken=taken),
            memory(self.score_shared, self.bounds, taken=taken_shared, together=True),
        )


def _to_mean(few: _Few, at_mode: Normal, own: Array, gain: Array, held: Array) -> tuple[Array, Array]:
    """Return the way from the mode to the mean, of own unknowns with the shared ones held, and of these."""
    local = own.shape[1]

    def volume(normal: Normal) -> Array:
        return np.asarray(np.linalg.slogdet(normal.information[:, :local, :local] + np.eye(local))[1])

    def volume_shared(normal: Normal) -> float:
        return float(np.linalg.slogdet(eliminate(normal, local)[2])[1])

    base, base_shared = volume(at_mode), volume_shared(at_mode)
    axes = np.moveaxis(square_root(own), 2, 0)
    move = np.zeros(own.shape[:2])
    several = max(_TOGETHER // max(few.latent.shape[1], 1), 1)
    for some in np.split(axes, range(several, len(axes), several)):
        change = volume(few.normal(_STEP * some, 0.0)).reshape(some.shape[:2]) - base
        move -= 0.5 * np.einsum("kwp,kw->wp", some, change / _STEP)
    move = _bounded(move, own)
    move_shared = np.zeros(len(held))
    for axis in square_root(held).T if len(held) else held:
        there = few.normal(_STEP * (gain @ axis)[None], _STEP * axis)
        change_shared = float(np.sum(volume(there) - base)) + volume_shared(there) - base_shared
        move_shared -= 0.5 * axis * change_shared / _STEP
    if np.any(np.abs(move_shared) > _SMALL * np.sqrt(np.diagonal(held))):
        # Not a correction of second order any more, and for unknowns that all windows share there is
        # no other window to average it out: the mode is kept.
        move_shared[:] = 0.0
    return move, move_shared


def _within(problem: Problem, t: Array, common: Array) -> tuple[Array, Array]:
    return inside(problem.unknowns.local, t), inside(problem.unknowns.shared, common)


def _bounded(move: Array, own: Array) -> Array:
    """Shorten moves beyond `_FARTHEST`."""
    length = np.max(np.abs(move) / np.sqrt(np.einsum("waa->wa", own)), axis=1, initial=0.0)
    return np.asarray(move / np.maximum(length / _FARTHEST, 1.0)[:, None])


class _Few:
    """Some samples of each window, which stand for all of them."""

    def __init__(self, problem: Problem, data: FitData, state: State) -> None:
        rows, count = data.thin(_SAMPLES_SHARED if len(state.common) else _SAMPLES)
        self.problem, self.state = problem, state
        self.data = data.take(rows, count, np.arange(len(count)))
        self.latent = state.latent[:, rows]
        self.weight = (data.count / np.maximum(count, 1))[:, None, None]

    def normal(self, moves: Array, move_shared: Array | float) -> Normal:
        """Return the normal equations away from the mode: of all windows by the first move, then the next.

        `moves` has the shape (k, w, p).
        """
        number, windows, local = moves.shape
        data = self.data.only(np.tile(np.arange(windows), number))
        t = (self.state.t + moves).reshape(number * windows, local)
        t, common = _within(self.problem, t, self.state.common + move_shared)
        latent, weight = np.tile(self.latent, number), np.tile(self.weight, (number, 1, 1))
        found = accumulate(self.problem, data, t, common, latent, order=_ORDER)
        return Normal(weight * found.information, weight[:, 0] * found.score, found.misfit)

    def at_mode(self) -> tuple[Normal, Array]:
        """Return the normal equations at the mode, and how much of the information is noise."""
        data, state = self.data, self.state
        size = state.t.shape[1] + len(state.common)
        information, noise = np.zeros((2, len(state.t), size, size))
        score, misfit = np.zeros((len(state.t), size)), np.zeros(len(state.t))
        for block in data.blocks():
            part = data.only(block)
            latent = self.latent[:, data.bounds[block[0]] : data.bounds[block[-1] + 1]]

            def at(guess: Array, part: FitData = part, block: Index = block) -> Equations:
                return equations(self.problem, part, state.t[block], state.common, guess, order=_ORDER)

            base = at(latent)
            information[block], score[block], misfit[block] = base.normal(part.bounds)
            noise[block] = _noise_of_design(base, at, latent, part)
        return Normal(self.weight * information, self.weight[:, 0] * score, misfit), self.weight * noise


def _noise_of_design(
    base: Equations, at: Callable[[Array], Equations], latent: Array, data: FitData
) -> Array:
    """Return Σ A'ᵀ S⁻¹ A' var û by window."""
    size = base.design.shape[1]
    plain = base.unwhitened()
    bends = []
    for row, name in enumerate(data.inputs):
        if name == "load" and BALANCE in data.outputs:
            # The soil's stresses follow from the sinkage; the load is only compared.
            bends.append(np.zeros_like(plain))
            continue
        moved = latent.copy()
        moved[row] += _STEP * base.spread[row]
        bends.append(solve_lower(base.factor, (at(moved).unwhitened() - plain) / _STEP))
    bend = np.array(bends)
    # Variance of û in that of the noise.
    left = np.eye(len(bend))[:, :, None] - np.einsum("akn,aln->kln", base.inward, base.inward)
    mixed = np.einsum("kln,lapn->kapn", left, bend) * base.weight
    total = np.empty((len(data.windows), size, size))
    for a in range(size):
        for b in range(a + 1):
            product = np.einsum("kmn,kmn->n", mixed[:, :, a], bend[:, :, b])
            total[:, a, b] = total[:, b, a] = segment_sum(product, data.bounds)
    return np.asarray(total)
