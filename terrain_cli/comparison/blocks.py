"""Blocks: stretches of a drive whose errors are unrelated, and what chance would make of them."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from terrain_cli.comparison.comparison_outcome import Series
from terrain_cli.comparison.distributions import student_quantile
from terrain_cli.vocabulary.arrays import Array, Index, ratio

#: Webb's six points: as symmetric as signs, but without their few distinct draws (Webb 2023,
#: Canadian Journal of Economics 56(3), doi 10.1111/caje.12661).
WEBB = np.sqrt([0.5, 1.0, 1.5])
DRAWS = 1999
_SLAB = 500  # Draws of one matrix product
#: Joined blocks at the least, and how much longer than neighbours seem related on average they are. Over soil
#: that varies every 8 s, 9 of 80 tuning drives raised an alarm with short blocks, and 2 of 38 with these.
_FEWEST, _LONGER = 12, 4
_TINY = 1e-300  # Keeps the logarithm of an error of 0 finite


class Interval(NamedTuple):
    """A value with its 95 % interval; NaN where not known."""

    value: float
    low: float
    high: float


def fine(lengths: Sequence[int], shortest: int, *, most: int) -> list[Index]:
    """Cut stretches, of so many samples each, into equal contiguous blocks.

    A stretch of fewer samples than `shortest` is one block; `most` bounds the blocks of all stretches
    together, as far as each has one. Returned is the block of each sample, counted over all stretches.
    """
    length = max(shortest, int(np.ceil(sum(lengths) / most)))
    blocks, first = [], 0
    for n in lengths:
        count = max(1, n // length)
        blocks.append(first + (np.arange(n) * count) // max(n, 1))
        first += count
    return blocks


def at_times(time: Array, own: Array) -> Index:
    """Return the place of the last of some times before each of others, or of the first time."""
    order = np.argsort(time, kind="stable")
    return np.asarray(order[np.clip(np.searchsorted(time[order], own, side="right") - 1, 0, None)])


def merged(scores: Array, chain: Index, *, fewest: int, independent: float) -> Index:
    """Join neighbouring blocks until the scores of those next to one another are unrelated.

    Scores, shape (blocks, m), are in the order of the blocks. Only blocks of one `chain`, shape (blocks,),
    are joined; those of a chain are contiguous. It ends before there are fewer than `fewest`; a correlation
    of neighbours up to `independent` is called none. Returned is the block that each became part of, from 0.
    """
    label = np.arange(len(scores))
    while True:
        if neighbours(scores, chain) <= independent:
            return label
        starts = np.flatnonzero(np.concatenate([[True], chain[1:] != chain[:-1]]))
        place = np.arange(len(chain)) - np.repeat(starts, np.diff(np.append(starts, len(chain))))
        pair = np.concatenate([[0], np.cumsum((place[1:] % 2 == 0) | (chain[1:] != chain[:-1]))])
        count = int(pair[-1]) + 1
        if count < fewest or count == len(scores):
            return label
        joined = np.zeros((count, scores.shape[1]))
        np.add.at(joined, pair, scores)
        first = np.searchsorted(pair, np.arange(count))
        scores, chain, label = joined, chain[first], pair[label]


def neighbours(scores: Array, chain: Index) -> float:
    """Correlate the scores of blocks with those of the next, over all scores."""
    if len(scores) < 3:
        return 0.0
    about = scores - scores.mean(axis=0)
    power = (about**2).mean(axis=0)
    known = power > 0.0
    if not known.any():
        return 0.0
    same = chain[1:] == chain[:-1]
    if not same.any():
        return 0.0
    product = (about[1:] * about[:-1])[same][:, known].mean(axis=0) / power[known]
    return float(product.mean() + 1.0 / len(scores))


def long_enough(scores: Array, *, independent: float) -> Index | None:
    """Join short blocks where what makes neighbours alike lasts for longer, as patches of soil do.

    Some of many scores are related for longer than most: joined are `_LONGER` times as many blocks as leave
    neighbours unrelated on average. Returned is the block that each became part of; None where neighbours are
    unrelated as they come. Scores, shape (blocks, m), are in the order of the blocks.
    """
    count = len(scores)
    label = merged(scores, np.zeros(count, dtype=np.intp), fewest=_FEWEST, independent=independent)
    fewer = int(label.max(initial=-1)) + 1
    if fewer == count:
        return None
    return np.arange(count) * max(fewer // _LONGER, _FEWEST) // count


def joined(scores: Array, label: Index) -> Array:
    """Return the sums of scores over the blocks that the first ones became; as many rows, the last ones 0."""
    found = np.zeros_like(scores)
    np.add.at(found, label, scores[: len(label)])
    return found


def squares(parts: Sequence[tuple[Series, Index]]) -> Array:
    """Sum up squared held-out errors by the block of each sample: sum and number, where there are any."""
    count = 1 + max(int(block.max(initial=0)) for _, block in parts)
    found = np.zeros((count, 2))
    for one, block in parts:
        error = one.measured - one.heldout
        known = np.isfinite(error)
        found[:, 0] += np.bincount(block[known], error[known] ** 2, count)
        found[:, 1] += np.bincount(block[known], minlength=count)
    return found[found[:, 1] > 0.0]


def logarithmic_roots(sums: Array) -> Array:
    """Return the logarithms of root mean squares from sums of squares and their number, the last column."""
    n = sums[..., -1:]
    squares = np.maximum(sums[..., :-1], _TINY)
    return 0.5 * np.log(ratio(squares, n, np.nan))


def jackknife_error(without: Array) -> float:
    """Return the standard error of a value from what it is without each block; NaN where there is but one."""
    n = len(without)
    return float(np.sqrt((n - 1.0) / n * np.sum((without - without.mean()) ** 2))) if n > 1 else np.nan


def jackknife(value: Any, without: Array) -> Interval:
    """Return a value with its 95 % interval by Student's t, from what it is without each block."""
    if len(without) < 2:
        return Interval(float(value), np.nan, np.nan)
    reach = student_quantile(0.025, len(without) - 1.0) * jackknife_error(without)
    return Interval(float(value), float(value) - reach, float(value) + reach)


def root_intervals(sums: Array) -> list[Interval]:
    """Return root mean squares from sums by block, the last column of which is their number."""
    total = sums.sum(axis=0)
    roots, others = logarithmic_roots(total), logarithmic_roots(total - sums)
    return [exponential(jackknife(root, without)) for root, without in zip(roots, others.T, strict=True)]


def exponential(interval: Interval) -> Interval:
    """Return the interval of a value from that of its logarithm."""
    return Interval(*(float(np.exp(value)) for value in interval))


def error(difference: Array) -> float:
    """Return the standard error of a sum over blocks; infinite where there is but one."""
    return float(np.std(difference, ddof=1) * np.sqrt(len(difference))) if len(difference) > 1 else np.inf


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


def max_test(scores: Array, *, shrunk: float = 1.0, draws: int = DRAWS, seed: int = 0) -> MaxTest:
    """Test whether any of many scores is beyond chance.

    Blocks are taken as independent; nothing is assumed of what happens within one, nor of how the scores are
    related. The null hypothesis is imposed: the blocks' own scores, each times a random weight, are what
    chance would give (Kline & Santos 2012, doi 10.1515/2156-6674.1005).

    `scores`, shape (blocks, m), are what each block adds to each score, whose expectation is 0 under the null
    hypothesis. `shrunk` is the standard deviation of the residuals behind them over that of the noise: a fit
    takes its share of them block by block, but nothing off a score's sum.
    """
    blocks, count = scores.shape
    squares = scores**2
    power = squares.sum(axis=0)
    known = power > 0.0
    t, p_values = np.zeros(count), np.ones(count)
    if blocks < 2 or not known.any():
        return MaxTest(t, p_values)
    scale = np.sqrt(power[known])
    # Unit scale first: scores of different channels differ by orders of magnitude.
    inside, squares = scores[:, known] / scale, squares[:, known] / scale**2
    t[known] = shrunk * scores[:, known].sum(axis=0) / scale
    rng = np.random.default_rng(seed)
    largest = np.empty(draws)
    for start in range(0, draws, _SLAB):
        weights = webb_weights(min(_SLAB, draws - start), blocks, rng)
        drawn = (weights @ inside) ** 2
        drawn /= (weights**2) @ squares
        largest[start : start + len(weights)] = drawn.max(axis=1)
    largest.sort()
    beyond = draws - np.searchsorted(largest, (t[known] * (1.0 - 1e-12)) ** 2)
    p_values[known] = (1.0 + beyond) / (1.0 + draws)
    return MaxTest(t, p_values)


def resample(sums: Array, statistic: Callable[[Array], Array], *, seed: int = 0) -> Array:
    """Resample whole blocks with replacement, and return the statistic of each draw, shape (draws,).

    `sums`, shape (blocks, m), is what each block adds to the sums of which the statistic is made; the
    statistic takes such sums of all draws, shape (draws, m).
    """
    return statistic(_chosen(len(sums), seed) @ sums)


@lru_cache(maxsize=4)
def _chosen(blocks: int, seed: int) -> Array:
    """Return how often each block is drawn, shape (draws, blocks): the same for every channel and model."""
    rng = np.random.default_rng(seed)
    return rng.multinomial(blocks, np.full(blocks, 1.0 / blocks), size=DRAWS).astype(float)
