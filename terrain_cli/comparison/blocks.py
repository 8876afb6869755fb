"""Blocks: stretches of a drive whose errors have nothing to do with one another."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Sequence

    from terrain_cli.comparison.comparison_outcome import Series
    from terrain_cli.vocabulary.arrays import Array, Index


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


def merged(scores: Array, chain: Index, *, fewest: int, independent: float) -> Index:
    """Join neighbouring blocks until the scores of those next to one another are unrelated.

    Scores, shape (blocks, m), are in the order of the blocks. Only blocks of one `chain`, shape (blocks,),
    are joined; those of a chain are contiguous. It ends before there are fewer than `fewest`; a correlation
    of neighbours up to `independent` is called none. Returned is the block that each became part of, from 0.
    """
    label = np.arange(len(scores))
    while True:
        if _neighbours(scores, chain) <= independent:
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


def _neighbours(scores: Array, chain: Index) -> float:
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


def squares(parts: Sequence[tuple[Series, Index]]) -> Array:
    """Sum up squared held-out errors by block: sum and number, shape (blocks, 2), of those that have any.

    Each series comes with the block of each of its samples.
    """
    count = 1 + max(int(block.max(initial=0)) for _, block in parts)
    found = np.zeros((count, 2))
    for one, block in parts:
        error = one.measured - one.heldout
        known = np.isfinite(error)
        found[:, 0] += np.bincount(block[known], error[known] ** 2, count)
        found[:, 1] += np.bincount(block[known], minlength=count)
    return found[found[:, 1] > 0.0]
