"""What is summed over blocks in one pass, against plain loops over the samples."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from terrain_cli.segmentation import blocks, noise
from terrain_cli.segmentation.moments import FINE, Moments

SMALL_SLAB, SMALL_GAP = 24, 8


@pytest.fixture(autouse=True)
def _small_slabs(monkeypatch):
    monkeypatch.setattr(blocks, "_SLAB", SMALL_SLAB)
    monkeypatch.setattr(blocks, "_GAP", SMALL_GAP)


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


def measured(x, y, step, scale=2.0):
    out = np.full((blocks.ROWS, -(-len(x) // step)), np.nan)
    blocks.measure(x, y, step, scale, blocks.slabs(len(x), step), out)
    return out


def by_hand(x, y, step, scale=2.0):
    n = len(x)
    rows = np.zeros((blocks.ROWS, -(-n // step)))
    for i in range(n):
        block = i // step
        rows[blocks.POWERS, block] += x[i], y[i], x[i] ** 2, x[i] * y[i], y[i] ** 2
        for k, values in enumerate((x, y)):
            to = abs(values[i] - values[i - 1]) if i else 0.0
            behind = abs(values[i + 1] - values[i]) if i < n - 1 else 0.0
            rows[blocks.STEPS, block][k] += to
            rows[blocks.LARGEST_STEPS, block][k] = max(rows[blocks.LARGEST_STEPS, block][k], to, behind)
        if 0 < i < n - 1:
            dx, dy = (values[i - 1] - 2.0 * values[i] + values[i + 1] for values in (x, y))
            size = abs(dx) + scale * abs(dy)
            rows[blocks.SECONDS, block] += dx * dx, dx * dy, dy * dy
            rows[blocks.SIZE, block] += size
            rows[blocks.LARGEST_SIZE, block] = max(rows[blocks.LARGEST_SIZE, block], size)
    return rows


@settings(deadline=None)
@given(series())
def test_one_pass_is_plain_loops(case):
    np.testing.assert_allclose(measured(*case), by_hand(*case), rtol=1e-12, atol=1e-6)


@settings(deadline=None)
@given(series(), st.lists(st.integers(0, 119), min_size=1, max_size=5))
def test_what_depends_on_changed_samples_is_measured_again(case, changed):
    x, y, step = case
    out = measured(x, y, step)
    place = np.unique(np.array(changed) % len(x))
    x[place] += 500.0
    blocks.measure(x, y, step, 2.0, blocks.about(place, len(x), step), out)
    np.testing.assert_allclose(out, measured(x, y, step), rtol=1e-12, atol=1e-6)


@given(series(), st.data())
def test_differences_are_those_of_the_samples_of_a_block(case, data):
    x, _, step = case
    n = len(x)
    some = np.array(sorted(data.draw(st.sets(st.integers(0, (n - 1) // step), min_size=1))))
    rises, seconds = blocks.differences(x, some, step)
    padded = np.concatenate([x[:1], x, np.full(2 * step, x[-1])])
    for row, block in enumerate(some):
        around = padded[block * step : (block + 1) * step + 2]
        np.testing.assert_allclose(rises[row], np.diff(around))
        np.testing.assert_allclose(seconds[row], np.diff(around, 2))


def tame_by_hand(x, y, step):
    """Look at every sample, three times."""
    n = len(x)
    number = blocks.sizes(n, step)
    number[0] -= 1
    for _ in range(3):
        wild = np.zeros(n, dtype=bool)
        middles = []
        for values in (x, y):
            steps = measured(values, values, step)[blocks.STEPS][0]
            limit = noise.OUTLIER * np.repeat(noise._moving_mean(steps, number, step), step)[:n]
            padded = np.pad(values, 2, mode="reflect")
            middles.append(np.median([padded[k : k + n] for k in range(5)], axis=0))
            wild |= np.abs(values - middles[-1]) > limit
        x, y = np.where(wild, middles[0], x), np.where(wild, middles[1], y)
    return x, y


@settings(deadline=None, max_examples=300)
@given(series())
def test_no_wild_sample_is_overlooked(case):
    x, y, step = case
    before = x.copy(), y.copy()
    found_x, found_y, out, scale = noise.tame(x, y, step)
    np.testing.assert_array_equal((found_x, found_y), tame_by_hand(x, y, step))
    np.testing.assert_array_equal((x, y), before)
    np.testing.assert_allclose(out, measured(found_x, found_y, step, scale), rtol=1e-12, atol=1e-6)


@settings(deadline=None)
@given(series())
def test_the_excess_is_what_a_limit_takes_off(case):
    x, y, step = case
    out = measured(x, y, step)
    limit = np.full(out.shape[1], 400.0)
    expected = np.zeros((3, out.shape[1]))
    for i in range(1, len(x) - 1):
        dx, dy = (values[i - 1] - 2.0 * values[i] + values[i + 1] for values in (x, y))
        beyond = 1.0 - min(1.0, 400.0 / max(abs(dx) + 2.0 * abs(dy), 1e-300)) ** 2
        expected[:, i // step] += beyond * dx * dx, beyond * dx * dy, beyond * dy * dy
    excess = noise._excess(x, y, step, 2.0, limit, out[blocks.LARGEST_SIZE])
    np.testing.assert_allclose(excess, expected, rtol=1e-9, atol=1e-6)


@settings(deadline=None)
@given(series(), st.data())
def test_sums_up_to_any_bound_agree(case, data):
    x, y, step = case
    moments, n = Moments(x, y, step), len(x)
    sample = np.array([data.draw(st.integers(0, n - 1))])
    bounds, sums = moments.around(sample, data.draw(st.integers(1, 2 * step)))
    np.testing.assert_allclose(
        sums[:, 0], moments.before(np.minimum(bounds[0], n)), rtol=1e-9, atol=1e-12 * sums.max()
    )
    whole = moments.between(np.array([0]), np.array([n]))[:, 0]
    assert whole[-1] == n
    alone = moments.between(np.arange(n), np.arange(1, n + 1))
    np.testing.assert_allclose(alone.sum(axis=1), whole, rtol=1e-6)


@settings(deadline=None)
@given(series(), st.integers(1, 3))
def test_sums_up_to_bounds_within_blocks_agree(case, multiple):
    x, y, _ = case
    moments = Moments(x, y, multiple * FINE)
    bounds, sums = moments.finer(np.arange(len(moments.edges) - 1))
    assert bounds.ravel().tolist() == list(range(0, bounds.size * FINE, FINE))
    inside = bounds <= len(x)
    np.testing.assert_allclose(
        sums[:, inside], moments.before(bounds[inside]), rtol=1e-9, atol=1e-12 * sums.max()
    )
