"""Refits in their order: which predicts better, which is physically possible, which cannot be told apart.

Held-out losses say which of two models predicts better. Whether that names the right one is another
matter: a law is never exactly that of the catalogue, and where a drive leaves two signatures alike, a bent
form of the one is what the other predicts. So for every rival its effect, at the size fitted, in its own
and in bent forms, is put into this very drive with the noise of its blocks, all candidates are fitted to
the outcome, and it is counted how often the best of now comes out ahead by as much as it is now. How far an
effect is bent is a nuisance parameter: only what these data leave open of it counts (Berger & Boos 1994, JASA
89(427), 1012–1016).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from terrain_cli.comparison import comparison_criteria, smoothed_fit, smoothed_model
from terrain_cli.comparison.blocks import error, resample, webb_weights
from terrain_cli.comparison.compare import NEVER_NEGATIVE
from terrain_cli.comparison.smoothed_fit import Solution
from terrain_cli.comparison.smoothed_model import SmoothedData
from terrain_cli.diagnosis import diagnosis_criteria as criteria
from terrain_cli.diagnosis.diagnosis_outcome import Hypothesis
from terrain_cli.diagnosis.refits import Ground, Refit
from terrain_cli.estimation.wheel_fit.normal_equations import products, widened
from terrain_cli.mechanics.effect import CERTAIN
from terrain_cli.mechanics.wheel_model import Model
from terrain_cli.vocabulary.arrays import Array, Index


def beats(one: Refit, other: Refit) -> bool:
    """Tell whether one model predicts better than another, beyond chance."""
    gain = other.loss - one.loss
    return float(gain.sum()) > max(criteria.BETTER * error(gain), criteria.LEAST_GAIN)


def as_good(one: Refit, other: Refit) -> bool:
    """Tell whether one model predicts no worse than another."""
    difference = one.loss - other.loss
    return float(difference.sum()) <= comparison_criteria.AS_GOOD * error(difference)


def imitates(data: Ground, hypothesis: Hypothesis, one: Refit, errors: float = CERTAIN) -> bool:
    """Tell whether an effect went to where nature has none, by so many errors: friction that drives, say."""
    bounded = [effect for effect in hypothesis.effects if effect.limits]
    wheels = []
    every = zip(data.wheels, data.data, one.solutions, strict=True)
    for wheel, part, solution in every if bounded else ():
        _, covariance = smoothed_fit.covariance(part, solution)
        fitted = zip(solution.unknowns.shared, solution.common, strict=True)
        values = {unknown.name: float(unknown.value(place)) for unknown, place in fitted}
        wheels.append((values, covariance, wheel.channels, wheel.under))
    return any(any(effect.imitations(wheels, errors, criteria.DRAFT_LEFT)) for effect in bounded)


def left_open(data: Ground, hypothesis: Hypothesis, one: Refit) -> bool:
    """Tell whether the data say no more of any parameter of an effect than was known before."""
    own = hypothesis.parameters
    told = []
    for part, solution in zip(data.data, one.solutions, strict=True):
        _, covariance = smoothed_fit.covariance(part, solution)
        for column, unknown in enumerate(solution.unknowns.shared):
            if unknown.name in own and not own[unknown.name].shape:
                told.append(float(covariance[column, column]) ** 0.5 < criteria.LEFT_OPEN * unknown.sd)
    return bool(told) and not any(told)


def makes_soil_impossible(data: Ground, one: Refit) -> bool:
    """Tell whether the soil is possible only without what was added.

    One that is impossible without it too may lack another effect besides.
    """
    return _impossible_soil(data, one.solutions) and not _impossible_soil(data, data.base)


def _impossible_soil(data: Ground, solutions: Sequence[Solution]) -> bool:
    """Tell whether a cohesion or friction angle is clearly below nought, on data that suffice."""
    for part, solution, block in zip(data.data, solutions, data.block, strict=True):
        own, _ = smoothed_fit.covariance(part, solution)
        long = [
            len(np.unique(block[part.window == j])) >= comparison_criteria.FEWEST_BLOCKS
            for j in range(part.windows)
        ]
        for place, (name, values) in enumerate(smoothed_fit.parameters(solution).items()):
            error = np.sqrt(own[:, place, place])
            if name in NEVER_NEGATIVE and bool(np.any((values < -CERTAIN * error) & long)):
                return True
    return False


def doubt(data: Ground, hypothesis: Hypothesis, one: Refit) -> str:
    """Say why the size of an effect is not to be believed; nothing if it is."""
    if imitates(data, hypothesis, one):
        return "physically impossible"
    if one.at_bound(hypothesis):
        return "at its bound"
    if makes_soil_impossible(data, one):
        return "with a physically impossible soil"
    return "left open by the data" if left_open(data, hypothesis, one) else ""


FORMS = (0.0, 0.5, -0.4)  # Powers of its own size by which an effect is bent into other forms
_BENT = (0.05, 4.0)  # What a bent effect is at the least and at the most, in its usual sizes
DRAWS = 60  # Draws of the noise for each form


@dataclass(frozen=True)
class Rivals:
    """What the data can tell apart."""

    family: tuple[int, ...]  # Places of those that cannot be told from the best, which is the first
    earned: bool  # Whether the best may be named alone
    share: Array  # shape (k,): how often each is found first where it is the truth


def judge(data: Ground, refits: Sequence[Refit], hypotheses: Sequence[Hypothesis], seed: int) -> Rivals:
    """Tell which of several explanations, the best first, remain."""
    count = len(refits)
    cells = [_design(data, *pair) for pair in zip(refits, hypotheses, strict=True)]
    # The same draws for every truth and candidate: only what they predict differs.
    weights = webb_weights(DRAWS, data.blocks, np.random.default_rng(seed))
    noise = refits[0].residuals
    firsts = np.zeros((count, len(FORMS)))
    mistaken = np.zeros((count, len(FORMS)))
    stolen = np.zeros(count)
    now = np.array([one.loss.sum() for one in refits])
    for truth in range(count):
        for column, form in enumerate(FORMS):
            most = _allowed(cells[0], cells[truth], form, noise)
            shown = [part.predicted + most * part.bend(form) for part in cells[truth]]
            losses = np.stack([_losses(cell, shown, noise, weights) for cell in cells], axis=1)
            first = losses.argmin(axis=1)
            firsts[truth, column] = np.mean(first == truth)
            if truth == 0:
                stolen += np.bincount(first, minlength=count) / (len(first) * len(FORMS))
            mistaken[truth, column] = np.mean(losses[:, truth] - losses[:, 0] >= now[truth] - now[0])
    tied = np.array([_tied(one.loss - refits[0].loss, seed) for one in refits])
    possible = mistaken.max(axis=1) > criteria.RULED_OUT
    # Whoever would be found in place of the best, were that the truth, is no worse an answer.
    within = tied | possible | (stolen > criteria.TIED)
    within[0] = True
    family = tuple(int(place) for place in np.flatnonzero(within))
    share = firsts.mean(axis=1)
    earned = len(family) == 1 and bool(share[0] >= criteria.EARNED)
    return Rivals(family, earned, share)


def _allowed(best: Sequence[_Part], truth: Sequence[_Part], form: float, residuals: Sequence[Array]) -> float:
    """Return the largest share of a bend that the residuals of the best allow, were another the truth.

    It is fitted to them beside all parameters of both, which may take up a part of it.
    """
    found, square = np.zeros(best[0].blocks), 0.0
    for one, other, residual in zip(best, truth, residuals, strict=True):
        design = np.concatenate([one.design, other.design], axis=2)
        flat, bend = design.reshape(-1, design.shape[2]), other.bend(form)
        moved = np.linalg.solve(flat.T @ flat + other.spread * np.eye(flat.shape[1]), flat.T @ bend.ravel())
        own = (residual != 0.0) * (bend - design @ moved)
        left = np.clip(residual, -smoothed_model.BEND, smoothed_model.BEND)
        found += np.bincount(one.block, (own * left).sum(axis=1), one.blocks)
        square += float((own**2).sum())
    # The noise has a variance of 1; the scatter of a few blocks may show too little of it.
    most = found.sum() + criteria.BETTER * np.sqrt(max((found**2).sum(), square))
    return float(np.clip(most / square, 0.0, 1.0)) if square > 0.0 else 1.0


def _tied(difference: Array, seed: int) -> bool:
    """Tell whether blocks leave it open which of two losses is smaller."""
    draws = resample(difference[:, None], lambda drawn: drawn[:, 0], seed=seed)
    return bool(np.mean(draws <= 0.0) > criteria.TIED)


def _design(data: Ground, refit: Refit, hypothesis: Hypothesis) -> list[_Part]:
    """Return, of each wheel, what a candidate predicts, and what a change of its parameters does to that."""
    parts = []
    for index, solution in enumerate(refit.solutions):
        part, base = data.data[index], data.base[index]
        predicted = _white(part, solution.model, solution.of_samples(part.window))
        if hypothesis.effects:
            without = _white(part, solution.model, absent(hypothesis, solution.of_samples(part.window)))
        else:
            without = _white(part, base.model, base.of_samples(part.window))
        design = widened(solution.design, solution.t.shape[1], part.window, part.windows)
        parts.append(
            _Part(predicted, predicted - without, design, data.block[index], data.blocks, solution.spread)
        )
    return parts


def _losses(parts: Sequence[_Part], shown: Sequence[Array], noise: Sequence[Array], weights: Array) -> Array:
    """Return held-out losses where something else was shown, over draws of the noise."""
    each = zip(parts, shown, noise, strict=True)
    return np.asarray(sum(part.losses(one, residual, weights) for part, one, residual in each))


class _Part:
    """One wheel of a candidate, block by block."""

    def __init__(
        self, predicted: Array, effect: Array, design: Array, block: Index, blocks: int, spread: float
    ) -> None:
        self.predicted, self.effect, self.block, self.blocks = predicted, effect, block, blocks
        self.design, self.spread = design, spread
        self.information = products(design, design, block, blocks)
        whole = self.information.sum(axis=0) + spread * np.eye(design.shape[2])
        self.inverse = np.linalg.inv(whole - self.information)

    def bend(self, form: float) -> Array:
        """Return by how much the effect changes when bent by a power of its own size."""
        return bent(self.effect, form, self.effect)

    def scores(self, residual: Array) -> Array:
        """Return the products of the design and a residual, by block."""
        return products(self.design, residual[..., None], self.block, self.blocks)[..., 0]

    def losses(self, shown: Array, residual: Array, weights: Array) -> Array:
        """Return held-out losses of `shown` plus weighted noise, over all draws."""
        apart = shown - self.predicted
        one, other = self.scores(apart), self.scores(residual)
        squares = np.bincount(self.block, (apart**2).sum(axis=1), self.blocks)
        mixed = np.bincount(self.block, (apart * residual).sum(axis=1), self.blocks)
        power = np.bincount(self.block, (residual**2).sum(axis=1), self.blocks)
        own = one[None] + weights[:, :, None] * other[None]
        left = own.sum(axis=1, keepdims=True) - own
        moved = np.einsum("bpq,dbq->dbp", self.inverse, left)
        loss = squares[None] + 2.0 * weights * mixed[None] + weights**2 * power[None]
        loss = loss - 2.0 * np.einsum("dbp,dbp->db", moved, own)
        loss = loss + np.einsum("dbp,bpq,dbq->db", moved, self.information, moved)
        return np.asarray(loss.sum(axis=1))


def _white(part: SmoothedData, model: Model, numbers: Mapping[str, Array]) -> Array:
    """Return what a model predicts, in units of the noise; 0 where nothing is measured."""
    found, _ = smoothed_model.forecast(model, part, numbers, order=smoothed_model.ORDER)
    return np.asarray(part.white({name: np.nan_to_num(column) for name, column in found.items()}, part.seen))


def absent(hypothesis: Hypothesis, numbers: Mapping[str, Array]) -> dict[str, Array]:
    own = hypothesis.parameters
    return {name: np.full_like(v, own[name].null) if name in own else v for name, v in numbers.items()}


def bent(effect: Array, form: float, like: Array) -> Array:
    """Return by how much an effect changes when bent by a power of its own size, told and kept in `like`."""
    usual = float(np.sqrt(np.mean((like**2).sum(axis=1))))
    if form == 0.0 or usual == 0.0:
        return np.zeros_like(effect)

    def bend(some: Array) -> Array:
        size = np.sqrt((some**2).sum(axis=1)) / usual
        return np.asarray(some * (np.clip(size, *_BENT) ** form)[:, None])

    norm = np.sqrt((like**2).sum() / max(float((bend(like) ** 2).sum()), 1e-300))
    return np.asarray(norm * bend(effect) - effect)
