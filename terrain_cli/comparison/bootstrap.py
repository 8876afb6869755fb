"""Chance, judged block by block: wild bootstrap of scores, and resampling of errors."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Callable

    from terrain_cli.vocabulary.arrays import Array


#: Webb's six points: as symmetric as signs, but without their few distinct draws (Webb 2023,
#: Canadian Journal of Economics 56(3), doi 10.1111/caje.12661).
WEBB = np.sqrt([0.5, 1.0, 1.5])
DRAWS = 1999
#: Draws of one matrix product.
_SLAB = 500


@dataclass(frozen=True)
class MaxTest:
    """Test of many scores together."""

    # Shape (m,): sum of the blocks' scores over the root of the sum of their squares; 0 where not testable
    t: Array
    # Shape (m,): share of draws whose largest |t| over all scores reaches this one. No matter how many are
    # tested, one of them falls below α in a share α of the cases where nothing is there
    p_values: Array


def webb_weights(draws: int, blocks: int, rng: np.random.Generator) -> Array:
    """Draw Webb's weights: ± √½, ± 1 or ± √1.5, all equally likely, so of mean 0 and variance 1."""
    return np.concatenate([-WEBB, WEBB])[rng.integers(0, 6, (draws, blocks))]


def max_test(
    scores: Array, *, shrunk: float = 1.0, draws: int = DRAWS, seed: int = 0, chance: Array | None = None
) -> MaxTest:
    """Test whether any of many scores is beyond chance.

    Blocks are taken as independent; nothing is assumed of what happens within one, nor of how the scores are
    related. The null hypothesis is imposed: the blocks' own scores, each times a random weight, are what
    chance would give (Kline & Santos 2012, doi 10.1515/2156-6674.1005).

    `scores`, shape (blocks, m), are what each block adds to each score, whose expectation is 0 under the null
    hypothesis. `shrunk` is the standard deviation of the residuals behind them over that of the noise: a fit
    takes its share of them block by block, but nothing off a score's sum. `chance`, of the same shape, are
    scores of what is left when the strongest effect is taken off: what chance would give, where something
    that is missing would pass for chance in the scores themselves.
    """
    blocks, count = scores.shape
    noise = scores if chance is None else chance
    squares = noise**2
    power = squares.sum(axis=0)
    known = power > 0.0
    t, p_values = np.zeros(count), np.ones(count)
    if blocks < 2 or not known.any():
        return MaxTest(t, p_values)
    scale = np.sqrt(power[known])
    # Unit scale first: scores of different channels differ by orders of magnitude.
    inside, squares = noise[:, known] / scale, squares[:, known] / scale**2
    t[known] = shrunk * scores[:, known].sum(axis=0) / scale
    rng = np.random.default_rng(seed)
    largest = np.empty(draws)
    for start in range(0, draws, _SLAB):
        weights = webb_weights(min(_SLAB, draws - start), blocks, rng)
        drawn = np.abs(weights @ inside) / np.sqrt((weights**2) @ squares)
        largest[start : start + len(weights)] = drawn.max(axis=1)
    largest.sort()
    beyond = draws - np.searchsorted(largest, np.abs(t[known]) * (1.0 - 1e-12))
    p_values[known] = (1.0 + beyond) / (1.0 + draws)
    return MaxTest(t, p_values)


def resample(sums: Array, statistic: Callable[[Array], Array], *, seed: int = 0) -> Array:
    """Resample whole blocks with replacement, and return the statistic of each draw, shape (draws,).

    `sums`, shape (blocks, m), is what each block adds to the sums of which the statistic is made; the
    statistic takes such sums of all draws, shape (draws, m).
    """
    blocks = len(sums)
    rng = np.random.default_rng(seed)
    chosen = rng.multinomial(blocks, np.full(blocks, 1.0 / blocks), size=DRAWS)
    return statistic(chosen @ sums)
