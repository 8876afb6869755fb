"""The search against exhaustive ones."""

import itertools

import numpy as np
import ruptures
from hypothesis import given
from hypothesis import strategies as st

from terrain_cli.segmentation import change_points, lines
from terrain_cli.segmentation.moments import Moments
from terrain_cli.segmentation.search import CHUNK, Limits, candidates

SOILS = ((1000.0, 0.55), (3000.0, 0.7), (1500.0, 0.3))


def three_soils(seed, n=120, noise=0.01):
    """Return samples on three lines whose x varies all the time, noise in y alone."""
    rng = np.random.default_rng(seed)
    x = rng.uniform(8e3, 1.4e4, n)
    cuts = [0, n // 3 + rng.integers(-5, 6), 2 * n // 3 + rng.integers(-5, 6), n]
    y = np.concatenate(
        [c + t * x[a:b] for (c, t), (a, b) in zip(SOILS, itertools.pairwise(cuts), strict=True)]
    )
    return x, y * (1.0 + noise * rng.standard_normal(n)), cuts


def exhaustive(moments, n, least, penalty):
    """Return the best bounds by trying every window: what `candidates` finds must cost no more."""
    best = [0.0] + [np.inf] * n
    last = [0] * (n + 1)
    for end in range(1, n + 1):
        starts = np.array([a for a in range(end - least + 1) if np.isfinite(best[a])], dtype=np.intp)
        if len(starts) == 0:
            continue
        costs = lines.best_line(moments.between(starts, np.full_like(starts, end)))[1]
        total = np.array(best)[starts] + costs + penalty
        best[end], last[end] = total.min(), starts[total.argmin()]
    bounds = [n]
    while bounds[-1]:
        bounds.append(int(last[bounds[-1]]))
    return bounds[::-1]


@given(st.integers(0, 200), st.sampled_from([10, 25]), st.sampled_from([5.0, 12.5, 50.0]))
def test_the_candidates_of_one_chunk_are_the_exact_optimum(seed, least, penalty):
    x, y, _ = three_soils(seed, noise=0.05)
    moments = Moments(x, y, 1)
    bounds, factor = candidates(moments, Limits(least), penalty)
    assert len(x) <= CHUNK
    assert bounds.tolist() == exhaustive(moments, len(x), least, penalty * factor)


def test_ruptures_finds_the_same_where_its_cost_is_the_same():
    """Noise in y alone and x that always varies: least squares is right there, and full rank."""
    for seed in range(5):
        x, y, _ = three_soils(seed)
        design = np.column_stack([y, x / 1e4, np.ones_like(x)]) / 1e3
        variance = float(np.median(np.abs(np.diff(y - 0.55 * x)))) ** 2 / 1e6
        other = ruptures.Pelt(model="linear", min_size=10, jump=1).fit(design).predict(pen=25.0 * variance)
        assert change_points(x, y, min_samples=10).tolist() == [0, *other]


def test_seams_between_chunks_leave_no_trace():
    rng = np.random.default_rng(4)
    n = 12 * CHUNK
    x = rng.uniform(8e3, 1.4e4, n)
    y = (1000.0 + 0.6 * x) * (1.0 + 0.02 * rng.standard_normal(n))
    assert change_points(x, y).tolist() == [0, n]
    # A change just beside where chunks of blocks of 4 samples meet, closer than the least window.
    for change in (6 * CHUNK - 7, 6 * CHUNK, 6 * CHUNK + 3):
        stronger = np.where(np.arange(n) < change, y, 1.3 * y)
        assert change_points(x, stronger, min_samples=60).tolist() == [0, change, n]
