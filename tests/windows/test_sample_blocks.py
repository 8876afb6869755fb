"""What is summed over blocks in one pass, against plain loops over the samples."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from profiles import examples

from terrain_cli.windows import running_moments, sample_blocks
from terrain_cli.windows.running_moments import FINE, RunningMoments
from terrain_cli.windows.sample_blocks import ReplacedSamples

SMALL_SLAB, SMALL_REACH = 24, 6


@pytest.fixture(autouse=True)
def _small_slabs(monkeypatch):
    monkeypatch.setattr(sample_blocks, "_SLAB", SMALL_SLAB)
    monkeypatch.setattr(sample_blocks, "REACH", SMALL_REACH)


@st.composite
def series(draw, shortest=3):
    """Return x, y with a few wild samples, and the samples in a block."""
    n, step = draw(st.integers(shortest, 120)), draw(st.integers(1, 9))
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    x, y = 1e4 + 100.0 * rng.standard_normal(n), 5e3 + 80.0 * rng.standard_normal(n)
    for place in draw(st.lists(st.integers(0, n - 1), max_size=4)):
        x[place] *= draw(st.sampled_from([0.1, 1.2, 3.0]))
        y[place] *= draw(st.sampled_from([1.0, 1.3]))
    return x, y, step


def summed(x, y, step, scale=2.0):
    return sample_blocks.summed(x, y, step, scale, np.full((6, len(x) + step), np.nan))


def steps_by_hand(x, y):
    """Return the steps to the samples, and their second differences."""
    rises = [np.abs(np.diff(values, prepend=values[0])) for values in (x, y)]
    seconds = [np.concatenate([[0.0], np.diff(values, 2), [0.0]]) for values in (x, y)]
    return rises, seconds


def mean_by_hand(values, step):
    """Return the mean around each sample, and of at least as many blocks near the ends."""
    blocks_of = np.arange(len(values)) // step
    near, last = max(1, round(sample_blocks.REACH / step)), blocks_of[-1]
    first = np.clip(blocks_of - near, 0, max(last - 2 * near, 0))
    chosen = [values[(blocks_of >= f) & (blocks_of <= f + 2 * near)] for f in first]
    # There is no step to the first sample.
    return np.array([some.sum() / (len(some) - (f == 0)) for f, some in zip(first, chosen, strict=True)])


def by_hand(x, y, step, scale=2.0):
    n = len(x)
    rows = np.zeros((sample_blocks.ROWS, -(-n // step)))
    _, (dx, dy) = steps_by_hand(x, y)
    size = np.abs(dx) + scale * np.abs(dy)
    limit = sample_blocks.WILD * mean_by_hand(size, step)
    for i in range(n):
        block = i // step
        rows[sample_blocks.POWERS, block] += x[i], y[i], x[i] ** 2, x[i] * y[i], y[i] ** 2
        kept = min(1.0, limit[i] / max(size[i], 1e-300)) ** 2
        rows[sample_blocks.SECONDS, block] += kept * dx[i] ** 2, kept * dx[i] * dy[i], kept * dy[i] ** 2
    return rows


@given(series())
def test_one_pass_is_plain_loops(case):
    found, expected = summed(*case)[0], by_hand(*case)
    np.testing.assert_allclose(
        found[sample_blocks.POWERS], expected[sample_blocks.POWERS], rtol=1e-12, atol=1e-6
    )
    # Whether a step is wild hangs on a mean of halves, which sums in another order.
    np.testing.assert_allclose(
        found[sample_blocks.SECONDS], expected[sample_blocks.SECONDS], rtol=1e-9, atol=1e-6
    )


@given(series())
def test_what_is_far_from_a_neighbour_is_found(case):
    x, y, step = case
    _, place, limit = summed(*case)
    rises, _ = steps_by_hand(x, y)
    expected = sample_blocks.OUTLIER * np.stack([mean_by_hand(rise, step) for rise in rises])
    np.testing.assert_allclose(limit, expected[:, place], rtol=1e-9)
    either = [np.maximum(rise, np.append(rise[1:], 0.0)) for rise in rises]
    assert set(np.flatnonzero((either > expected * (1.0 + 1e-9)).any(axis=0))) <= set(place)


@given(series(shortest=60), st.lists(st.integers(0, 119), min_size=1, max_size=5))
def test_replaced_samples_are_measured_slab_by_slab_as_all_at_once(case, changed):
    x, y, step = np.tile(case[0], 12), np.tile(case[1], 12), case[2]
    samples = ReplacedSamples(x, y)
    place = np.unique(np.array(changed) % len(x))
    samples.replace(place, np.stack([x[place], y[place]]) + 500.0)
    found, _, _ = running_moments._measure(samples, step, np.array([2.0, 1.0]))
    x[place] += 500.0
    y[place] += 500.0
    expected = summed(x, y, step)[0]
    np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-9 * expected.max())


def test_what_is_long_is_measured_slab_by_slab(monkeypatch):
    rng = np.random.default_rng(2)
    x, y = 1e4 + 100.0 * rng.standard_normal(5000), 5e3 + 80.0 * rng.standard_normal(5000)
    x[::700] *= 3.0
    monkeypatch.setattr(sample_blocks, "_SLAB", 10_000)
    whole = running_moments.tame(ReplacedSamples(x, y), 4)
    monkeypatch.setattr(sample_blocks, "_SLAB", 400)
    for part, one in zip(running_moments.tame(ReplacedSamples(x, y), 4), whole, strict=True):
        np.testing.assert_allclose(part, one, rtol=1e-9)


@given(series(), st.lists(st.integers(0, 119), max_size=6), st.data())
def test_few_samples_are_replaced_without_a_copy(case, changed, data):
    x, y, step = case
    n = len(x)
    samples, new = ReplacedSamples(x, y), np.stack([x, y])
    before = new.copy()
    for number in range(2):
        place = np.array(changed, dtype=int) % n
        new[:, place] += 1.0 + number
        samples.replace(place, new[:, place])
    np.testing.assert_array_equal((x, y), before)
    place = np.array(data.draw(st.lists(st.integers(0, n + step), min_size=1)))
    np.testing.assert_array_equal(samples.at(place), new[:, np.minimum(place, n - 1)])
    block = np.array(data.draw(st.lists(st.integers(0, n // step), min_size=1)))
    inside = np.minimum(block[:, None] * step + np.arange(step), n - 1)
    np.testing.assert_array_equal(samples.blocks(block, step), new[:, inside])
    first = data.draw(st.integers(0, n - 1))
    last = data.draw(st.integers(first + 1, n))
    np.testing.assert_array_equal(samples.between(first, last), new[:, first:last])


def tame_by_hand(x, y, step):
    """Look at every sample, three times."""
    n = len(x)
    for _ in range(3):
        wild = np.zeros(n, dtype=bool)
        middles = []
        for values, rise in zip((x, y), steps_by_hand(x, y)[0], strict=True):
            limit = sample_blocks.OUTLIER * mean_by_hand(rise, step)
            padded = np.pad(values, 2, mode="reflect")
            middles.append(np.median([padded[k : k + n] for k in range(5)], axis=0))
            wild |= np.abs(values - middles[-1]) > limit
        x, y = np.where(wild, middles[0], x), np.where(wild, middles[1], y)
    return x, y


@pytest.mark.parametrize("count", [1, 2, 12, 13, 14, 15, 18, 19, 30])
def test_near_the_ends_the_mean_is_that_of_the_first_or_last_blocks(count):
    """Some 2 reaches and more of blocks: all cases between one mean for all and one for each."""
    values = np.random.default_rng(count).uniform(1.0, 2.0, count)
    width = min(2 * SMALL_REACH + 1, count)
    first = np.clip(np.arange(count) - SMALL_REACH, 0, count - width)
    expected = [values[f : f + width].mean() for f in first]
    found = sample_blocks.moving_mean(values[None], np.ones(count, dtype=int), 1)[0]
    np.testing.assert_allclose(found, expected, rtol=1e-12)


@examples(300)
@given(series())
def test_no_wild_sample_is_overlooked(case):
    x, y, step = case
    before = x.copy(), y.copy()
    samples = ReplacedSamples(x, y)
    sums, _ = running_moments.tame(samples, step)
    found = samples.between(0, len(x))
    np.testing.assert_array_equal(found, tame_by_hand(x, y, step))
    np.testing.assert_array_equal((x, y), before)
    np.testing.assert_allclose(sums, summed(*found, step)[0][sample_blocks.POWERS], rtol=1e-12)


@given(series(), st.data())
def test_sums_up_to_any_bound_agree(case, data):
    x, y, step = case
    moments, n = RunningMoments(x, y, step), len(x)
    sample = np.array([data.draw(st.integers(0, n - 1))])
    bounds, sums = moments.around(sample, data.draw(st.integers(1, 2 * step)))
    np.testing.assert_allclose(
        sums[:, 0], moments.before(np.minimum(bounds[0], n)), rtol=1e-9, atol=1e-12 * sums.max()
    )
    whole = moments.between(np.array([0]), np.array([n]))[:, 0]
    assert whole[-1] == n
    alone = moments.between(np.arange(n), np.arange(1, n + 1))
    np.testing.assert_allclose(alone.sum(axis=1), whole, rtol=1e-6)


@given(series(), st.integers(1, 3))
def test_sums_up_to_bounds_within_blocks_agree(case, multiple):
    x, y, _ = case
    moments = RunningMoments(x, y, multiple * FINE)
    bounds, sums = moments.finer(np.arange(len(moments.edges) - 1))
    assert bounds.ravel().tolist() == list(range(0, bounds.size * FINE, FINE))
    inside = bounds <= len(x)
    np.testing.assert_allclose(
        sums[:, inside], moments.before(bounds[inside]), rtol=1e-9, atol=1e-12 * sums.max()
    )
