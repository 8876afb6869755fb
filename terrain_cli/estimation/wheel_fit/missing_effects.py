"""Whether effects that a model lacks show in its residuals, and how far each would move what was fitted.

Each parameter of an effect is tested at its null (Rao 1948). With the whitened residuals r, their derivatives
g by the parameter and J by what was fitted, u = gᵀr + Gᵀ (Jᵀr − t / w) is its score when all else is fitted
anew, and the information S left of it the variance of u (`normal_equations`). Priors are counted in: those of
the soil once in all w windows, which may be of one soil, and not in each of them. To first order
the parameter is u / S, and moves the others by G u / S. Where noise lasts, the variance of u is as many times
S as samples make an independent one.
"""

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from typing import Any, NamedTuple, Self

import numpy as np

from terrain_cli.estimation.line.moments import segment_sum, window_products
from terrain_cli.estimation.line.window_estimates import STRENGTH_HOLDS
from terrain_cli.estimation.wheel_fit.excess_scatter import memory
from terrain_cli.estimation.wheel_fit.fit_data import FitData
from terrain_cli.estimation.wheel_fit.fit_result import Fit, Parameters
from terrain_cli.estimation.wheel_fit.gauss_newton import accumulate
from terrain_cli.estimation.wheel_fit.linearised import Equations, Problem, solve_lower
from terrain_cli.estimation.wheel_fit.normal_equations import Eliminated, arrow, posterior_covariance
from terrain_cli.estimation.wheel_fit.unknowns import EFFECT_SCALES, Unknown, unknown
from terrain_cli.estimation.wheel_fit.wandering_channels import wandering
from terrain_cli.mechanics.dual import slopes
from terrain_cli.mechanics.effect import Effect, mean_load
from terrain_cli.mechanics.wheel_model import STRESSES, predict
from terrain_cli.vocabulary.arrays import Array, Bounds, Mask

#: Errors by which an effect moves c, φ or strength.
_FAR = 1.0
#: Errors by which a wandering channel may move them. Of 43 rows `ok` where the zero of the torque drifts by 5
#: to 15 % (16 of them off by more than three errors), 1, 0.7, 0.5, 0.3 and 0 leave 35, 27, 23, 17 and 12
#: (12, 7, 4, 3 and 2): what a window takes up is more than what it shows.
_WANDERS_FAR = 0.5
#: Samples of all windows together that are tested, and of each window at the least; nodes on each arc.
_SAMPLES, _EACH, _ORDER = 2_000, 6, 6
#: Probability before any data that there is an effect which need not show: all drivetrains have friction,
#: and some logs are corrected for it. Of 51 rows `ok` without drawbar pull under a friction of 2, 5 and 10 %
#: of the torque (vehicles, soils and code of their own) 12 are off by more than three errors; with 0.1 and
#: 0.3 2 and 1 are, and the strength's error of 36 clean rows grows by 1 and 3 % (6 and 17 % on average).
_USUAL = {"drivetrain-friction.Tc": 0.3}
#: Probability before any data that a log has any one other effect that the model lacks. Of a dozen that it
#: can show, with 0.1, 0.2, 0.3 and 0.5 together, none, none, none and one of 82 clean rows `ok` is lost. The
#: strength's error grows by 2 to 6 % on average; by 9 to 36 %, and 26 to 91 % without drawbar pull, if that
#: counts of which nothing tells.
_LACKS = 0.025
_CERTAIN = 50.0  # Logarithm of odds that leave no doubt
_STEPS = 3  # Steps in which the true values of the inputs come to rest
#: s by which residuals may lag behind the inputs: lags of sensors and of the rut take 0.05 to 0.5 s.
_LAGS = (0.0, 0.1, 0.2, 0.4, 0.8)
#: Share of a channel's residuals from which on they follow the inputs. It was at most 0.02 in 56 clean drives
#: of the tests' simulator, 0.06 in 57 of 58 of another (0.65 where load changes as fast as its noise), and
#: 0.04 in 20 whose noise lasts 0.15 to 0.6 s; on soil simulated as a continuum 0.30 to 0.77.
_FOLLOWS = 0.1
#: Samples that are looked at; parts of which each is told by the others, in so many pieces.
_MOST, _FOLDS, _PIECES = 20_000, 5, 2
#: Series shifted in time, which tell chance; and the ridge, as a share of the samples.
_SHIFTS, _RIDGE = 99, 0.01
_ROUNDING = 1e-9


def moved(
    problem: Problem, data: FitData, t: Array, common: Array, found: Fit, effects: Sequence[Effect]
) -> tuple[Mask, Array]:
    """Tell in which windows there is more probably than not an effect that moves c, φ or strength too far.

    That is by more than its error. Fitted were `t`, shape (w, p), and `common`, shape (q,), which `found` has
    in their own units. Shape (w,). Also return what effects that do not show add to the covariance of `t`,
    shape (w, p, p): the mean square of what they move it by, times the probability that the data lend them,
    and of usual ones times all of it (Bayesian model averaging; Hoeting et al. 1999, Statistical Science 14,
    382).
    """
    if not effects or not np.isin(found.status, STRENGTH_HOLDS).any():
        return np.zeros(len(t), dtype=bool), np.zeros((*t.shape, t.shape[1]))
    few = data.thinned(max(_SAMPLES // max(len(t), 1), _EACH))
    of = scores(problem, few, t, common, effects)
    ways = _in_errors(found, problem.unknowns.local)
    far = np.abs(np.einsum("kwp,wpm->kwm", ways, of.moves)) > _FAR
    usual = np.isin(of.names, [*_USUAL])
    each = [_LACKS / len(effect.parameters) for effect in effects for _ in effect.parameters]
    before = np.array([_USUAL.get(name, share) for name, share in zip(of.names, each, strict=True)])
    # A typical size is a prior standard deviation of 1 / EFFECT_SCALES.
    prior = EFFECT_SCALES**2
    left = 1.0 / (of.known + prior)
    size = of.score * np.sqrt(of.known) * left
    odds = before / (1.0 - before) * np.sqrt(prior * left)
    odds *= np.exp(np.minimum(0.5 * size**2 / left, _CERTAIN))
    likely = odds / (1.0 + odds)
    shows = np.prod(1.0 - far.any(axis=0) * likely, axis=1) < 0.5
    # What may be in any log, and nothing speaks for it, is in no error.
    told = np.where(usual, likely, np.maximum(likely - before, 0.0) * ~shows[:, None])
    return shows, np.einsum("wpm,wm,wqm->wpq", of.gain, told * (size**2 + left), of.gain)


def following(problem: Problem, data: FitData, t: Array, common: Array, found: Fit) -> tuple[Mask, Array]:
    """Tell in which windows residuals of a channel follow load, sinkage or slip, or their past, shape (w,).

    With the right model they do not, however long the sensors' noise lasts: the true values of the inputs
    that were found are independent of what is left. Of windows that `found` does not miss anyway. Or
    whether c, φ or strength may be off by more than its error as a channel wanders in time. Also return what
    channels and soil that may wander add to the covariance of `t`, shape (w, p, p).
    """
    follows, covariance = np.zeros(len(t), dtype=bool), np.zeros((*t.shape, t.shape[1]))
    windows = np.flatnonzero(np.isin(found.status, STRENGTH_HOLDS))
    # Of very many windows every so many stand for the others.
    windows = windows[:: max(-(-int(data.count[windows].sum()) // _MOST), 1)]
    if not found.second or not len(windows):
        return follows, covariance
    data = data.only(windows)
    rest = _AtRest.of(problem, data, t[windows], common)
    if problem.robust:
        # What is wild is no wave in time, and its inputs go with what is left of it.
        data = data.without(rest.weight < 1.0)
        rest = _AtRest.of(replace(problem, robust=False), data, t[windows], common)
    ways = _in_errors(found, problem.unknowns.local)[:, windows]
    for one in wandering(rest.parts, data, t[windows], problem.unknowns.local, found.second):
        covariance[windows] += one.covariance
        if one.moves is not None:
            far = np.abs(np.einsum("kwp,wp->kw", ways, one.moves)) > _WANDERS_FAR
            follows[windows] |= far.any(axis=0)
    predictors = _predictors(rest.latent, data.bounds, found.second)
    for residual in _centred(rest.residual, data.bounds):
        left, predicted = _held_out(residual, predictors)
        power, over = (
            segment_sum(part, data.bounds) for part in (left[:, 0] ** 2, (left - predicted)[:, 0] ** 2)
        )
        if not power.sum() > 0.0:
            continue
        shares = 1.0 - np.sum((left - predicted) ** 2, axis=0) / power.sum()
        if shares[0] > max(_FOLLOWS, shares[1:].max()):
            follows[windows] |= over < (1.0 - _FOLLOWS) * power
    return follows, covariance


def _predictors(inputs: Array, bounds: Bounds, second: float) -> Array:
    """Return inputs, shape (k, n), as they are and some time before, and their squares, standardised."""
    first = np.repeat(bounds[:-1], np.diff(bounds))
    rows = np.arange(inputs.shape[1])
    lags = sorted({round(lag * second) for lag in _LAGS})
    columns = [inputs[:, np.maximum(rows - lag, first)] for lag in lags]
    every = np.concatenate([*columns, _centred(inputs, bounds) ** 2])
    whole = _centred(every, bounds)
    # One that stays the same says nothing: what is left of it is rounding.
    size = whole.std(axis=1)
    told = size > _ROUNDING * np.abs(every).max(axis=1, initial=0.0)
    return np.asarray((whole[told] / size[told, None]).T)


def _centred(rows: Array, bounds: Bounds) -> Array:
    """Return series, shape (k, n), less their means by window."""
    count = np.diff(bounds)
    return np.asarray(rows - np.repeat(segment_sum(rows, bounds) / np.maximum(count, 1), count, axis=1))


def _held_out(residual: Array, predictors: Array) -> tuple[Array, Array]:
    """Return a series and shifted ones, shape (n, 1 + m), and what a ridge regression predicts held out."""
    n, size = predictors.shape
    shifted = [np.roll(residual, n * shift // (_SHIFTS + 1)) for shift in range(_SHIFTS + 1)]
    left = np.stack(shifted, axis=1)
    part = np.arange(n) * _FOLDS * _PIECES // max(n, 1) % _FOLDS
    gram, products = predictors.T @ predictors + _RIDGE * n * np.eye(size), predictors.T @ left
    predicted = np.empty_like(left)
    for fold in range(_FOLDS):
        own = part == fold
        rows = predictors[own]
        without = gram - rows.T @ rows, products - rows.T @ left[own]
        predicted[own] = rows @ np.linalg.solve(*without)
    return left, predicted


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


class ScoredEffects(NamedTuple):
    """What residuals say of parameters of effects that a model lacks, each alone; shape (m,) unless said."""

    names: tuple[str, ...]
    score: Array  # In standard deviations
    known: Array  # Information on the parameter, in prior standard deviations, without that of its prior
    gain: Array  # Shape (w, p, m): change of the windows' own unknowns with it
    moves: Array  # Shape (w, p, m): by how much it would move them


def scores(
    problem: Problem, data: FitData, t: Array, common: Array, effects: Sequence[Effect]
) -> ScoredEffects:
    """Score each parameter of some effects at its null."""
    model = replace(problem.model, effects=(*problem.model.effects, *effects))
    under = mean_load(data.channels), problem.wheel.radius
    added = [
        unknown(model, effect.qualified(one), under=under) for effect in effects for one in effect.parameters
    ]
    rest = _AtRest.of(problem, data, t, common)
    local, before = t.shape[1], len(common)
    shown = _signatures(problem, data, t, common, rest.latent, effects)
    shown *= np.array([one.sd for one in added])[:, None]
    both = np.concatenate([rest.design, solve_lower(rest.factor, shown)], axis=1)
    weighted = both * rest.weight
    information = window_products(weighted, both, data.bounds)
    score = segment_sum(np.einsum("apn,an->pn", weighted, rest.residual), data.bounds).T
    common = np.concatenate([common, np.zeros(len(added))])
    *_, moves = _eliminated(information, local, before, 1.0)
    share = 1.0 / max(int(np.count_nonzero(data.count)), 1)
    every, left, along, gain = _eliminated(information, local, before, share)
    score = score[:, local:].sum(axis=0) - common + every.pull(score[:, :local] - share * t)
    # What all windows share is eliminated as well.
    score = score[before:] + along.T @ score[:before]
    # That of their priors at the least, but for rounding.
    known = np.maximum(np.diag(left[before:, before:] + left[before:, :before] @ along), 1.0)
    size = score / known

    residual = rest.residual * rest.weight
    shown = both[:, local + before :] + np.einsum("apn,pm->amn", both[:, local : local + before], along)
    shown += np.einsum("apn,npm->amn", both[:, :local], np.repeat(gain, data.count, axis=0))
    # Chance is in what the effect leaves of its score.
    chance = np.einsum("amn,amn->mn", shown, residual[:, None] - size[:, None] * shown)
    lasting = memory(chance, data.bounds, together=True)[:, 0]
    return ScoredEffects(
        names=tuple(one.name for one in added),
        score=score / np.sqrt(known * lasting),
        known=(known - 1.0) / lasting,
        gain=moves,
        moves=moves * size,
    )


def _eliminated(
    information: Array, local: int, before: int, share: float
) -> tuple[Eliminated, Array, Array, Array]:
    """Eliminate the windows' own unknowns, of whose priors a share counts, and those that all share.

    Return the first, S of what is left, and how the shared and the own unknowns change with what was added to
    the `before` shared ones.
    """
    priors = np.diag(np.repeat([share, 1.0], [local, information.shape[1] - local]))
    found, shared = arrow(information, local, priors, partial(posterior_covariance, least=share))
    left = shared - found.taken()
    along = -np.linalg.solve(left[:before, :before], left[:before, before:])
    gain = found.gain[:, :, before:] + found.gain[:, :, :before] @ along
    return found, left, np.asarray(along, dtype=float), np.asarray(gain)


class _AtRest(NamedTuple):
    """The last equations once the true values of the inputs have come to rest, of all samples."""

    parts: list[Equations]
    latent: Array  # Shape (inputs, n)
    residual: Array  # residual, design, factor, weight: as in `Equations`
    design: Array
    factor: Array
    weight: Array

    @classmethod
    def of(cls, problem: Problem, data: FitData, t: Array, common: Array) -> Self:
        latent = data.given.copy()
        parts: list[Equations] = []
        for step in range(_STEPS + 1):
            each = (lambda _, __, one: parts.append(one)) if step == _STEPS else None
            accumulate(problem, data, t, common, latent, order=_ORDER, each=each)
        joined = (
            np.concatenate([getattr(one, name) for one in parts], axis=-1)
            for name in ("residual", "design", "factor", "weight")
        )
        return cls(parts, latent, *joined)


@np.errstate(all="ignore")
def _signatures(
    problem: Problem, data: FitData, t: Array, common: Array, latent: Array, effects: Sequence[Effect]
) -> Array:
    """Return derivatives of the outputs by parameters of effects at their nulls, shape (outputs, m, n)."""
    channels = {**data.channels, **dict(zip(data.inputs, latent, strict=True))}
    if "drawbar_pull" in data.outputs:
        # What an effect reads of it has not the noise that is in the residuals.
        said = problem.predict(data, t, common, by=False, order=_ORDER, latent=latent)
        channels["drawbar_pull"] = said.drawbar_pull
    values = problem.unknowns.values(t, common, data.count, data.windows)
    along = [bool(STRESSES.intersection(effect.laws)) for effect in effects]
    found: dict[tuple[str, str], Array] = {}
    # To change the stresses along the rim takes more time, which the other effects need not take.
    for stresses in {*along}:
        some = [effect for effect, one in zip(effects, along, strict=True) if one == stresses]
        model = replace(problem.model, effects=(*problem.model.effects, *some))
        known: dict[str, Any] = {**model.nulls(), **values}
        by = [effect.qualified(one) for effect in some for one in effect.parameters]
        there = predict(model, problem.wheel, channels, known, given=problem.given, by=by, order=_ORDER)
        for output in data.outputs:
            found |= {(output, name): slope for name, slope in slopes(getattr(there, output)).items()}
    names = [effect.qualified(one) for effect in effects for one in effect.parameters]
    zero = np.zeros(data.measured.shape[1])
    table = np.array([[found.get((output, name), 0.0) + zero for name in names] for output in data.outputs])
    return np.where(data.seen[:, None] & np.isfinite(table), table, 0.0)
