import numpy as np
import pytest

from terrain_cli.comparison import blocks, comparison_criteria


def merged(scores, chain):
    return blocks.merged(scores, chain, fewest=16, independent=comparison_criteria.UNRELATED_BLOCKS)


def test_stretches_are_cut_into_equal_blocks_that_do_not_cross_them():
    cut = blocks.fine([100, 35, 7], shortest=10, most=100)
    assert [len(np.unique(part)) for part in cut] == [10, 3, 1]
    assert [int(part[0]) for part in cut] == [0, 10, 13]
    assert all(np.all(np.diff(part) >= 0) for part in cut)
    assert min(np.bincount(np.concatenate(cut))[:13]) >= 10


def test_there_are_not_more_blocks_than_asked_for():
    assert len(np.unique(blocks.fine([100_000], shortest=10, most=50)[0])) == 50


def test_unrelated_neighbours_are_not_joined():
    scores = np.random.default_rng(1).normal(size=(64, 50))
    assert np.array_equal(merged(scores, np.zeros(64, dtype=int)), np.arange(64))


def test_related_neighbours_are_joined_within_their_chain():
    rng = np.random.default_rng(2)
    scores = np.repeat(rng.normal(size=(32, 50)), 2, axis=0)
    chain = np.repeat([0, 1], 32)
    label = merged(scores, chain)
    assert np.array_equal(label, np.repeat(np.arange(32), 2))
    odd = merged(scores[1:], chain[1:])
    assert len({tuple(np.unique(chain[1:][odd == j])) for j in np.unique(odd)}) == 2


def test_a_drift_is_not_joined_to_nothing():
    scores = np.cumsum(np.random.default_rng(3).normal(size=(64, 20)), axis=0)
    assert merged(scores, np.zeros(64, dtype=int)).max() == 15


@pytest.mark.parametrize("count", [1, 2])
def test_few_blocks_stay_as_they_are(count):
    assert len(merged(np.ones((count, 3)), np.zeros(count, dtype=int))) == count
