import numpy as np
import pytest

from terrain_cli.comparison import blocks, comparison_criteria
from terrain_cli.comparison.blocks import (
    max_test,
    resample,
    root_intervals,
    webb_weights,
)


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


def test_short_blocks_are_joined_where_neighbours_are_alike_for_longer():
    rng = np.random.default_rng(4)
    loose = rng.normal(size=(400, 30))
    assert blocks.long_enough(loose, independent=0.1) is None
    patches = np.repeat(rng.normal(size=(20, 30)), 20, axis=0)
    label = blocks.long_enough(patches + loose, independent=0.1)
    assert np.array_equal(np.unique(label), np.arange(12))
    sums = blocks.joined(patches, label)
    assert sums.shape == patches.shape
    assert sums.sum(axis=0) == pytest.approx(patches.sum(axis=0))
    assert not sums[12:].any()
    # Blocks of which only the first ones are filled.
    assert np.array_equal(blocks.joined(np.vstack([patches, np.zeros((9, 30))]), label)[:400], sums)


def test_patches_that_nothing_follows_are_chance():
    rng = np.random.default_rng(5)
    least = []
    for j in range(200):
        scores = np.repeat(rng.normal(size=(20, 10)), 20, axis=0) + rng.normal(size=(400, 10))
        together = blocks.joined(scores, blocks.long_enough(scores, independent=0.1))
        least.append([max_test(one, draws=399, seed=j).p_values.min() for one in (scores, together)])
    alone, joined = np.mean(np.array(least) < 0.01, axis=0)
    assert alone > 0.5
    # 1 % and three standard deviations of the binomial.
    assert joined < 0.031


def test_webb_weights_have_mean_0_and_variance_1():
    weights = webb_weights(20_000, 5, np.random.default_rng(1))
    assert weights.mean() == pytest.approx(0.0, abs=0.02)
    assert (weights**2).mean() == pytest.approx(1.0, abs=0.02)
    assert len(np.unique(weights)) == 6


def test_chance_alone_is_beyond_5_percent_in_5_percent_of_cases():
    # Scores related to one another and of unequal blocks, as bases of a few drivers are.
    rng = np.random.default_rng(2)
    mix = rng.normal(size=(8, 60))
    size = rng.uniform(0.5, 2.0, (24, 1))
    least = [
        max_test(size * rng.normal(size=(24, 8)) @ mix, draws=399, seed=j).p_values.min() for j in range(300)
    ]
    # ± 3 standard deviations of the binomial.
    assert 0.012 <= np.mean(np.array(least) < 0.05) <= 0.088


def test_a_steady_score_is_found_among_many_and_no_other():
    rng = np.random.default_rng(3)
    scores = rng.normal(size=(24, 200))
    scores[:, 7] += 2.0
    test = max_test(scores)
    assert test.p_values[7] < 0.01
    assert np.delete(test.p_values, 7).min() > 0.05


def test_the_unit_of_a_score_does_not_matter():
    rng = np.random.default_rng(4)
    scores = rng.normal(size=(16, 5))
    scaled = scores * 10.0 ** np.arange(-8, 12, 4)
    assert max_test(scaled).p_values == pytest.approx(max_test(scores).p_values)


def test_what_one_block_alone_says_is_nothing():
    scores = np.zeros((20, 2))
    scores[3, 0] = 1e6
    test = max_test(scores)
    assert test.p_values[0] > 0.5
    assert test.t[1] == 0.0


def test_resampled_blocks_scatter_like_a_mean():
    sums = np.stack([np.random.default_rng(5).normal(size=400), np.ones(400)], axis=1)
    draws = resample(sums, lambda drawn: drawn[:, 0] / drawn[:, 1])
    assert draws.std() == pytest.approx(sums[:, 0].std() / 20.0, rel=0.1)


def test_intervals_of_a_root_mean_square_hold_with_few_blocks():
    """Of eight blocks that miss by different sizes, the quantiles of resampled blocks hold in 87 %."""
    rng = np.random.default_rng(6)
    held = []
    for _ in range(400):
        squares = rng.chisquare(10, 8) / 10.0
        sums = np.stack([100.0 * squares, np.full(8, 100.0)], axis=1)
        (interval,) = root_intervals(sums)
        held.append(interval.low < 1.0 < interval.high)
    assert 0.92 < np.mean(held) < 0.98
