"""The search against exhaustive ones."""

import itertools

import numpy as np
import pytest
import ruptures
from hypothesis import given
from hypothesis import strategies as st
from soil_drives import Kind, clean, drive, mixed

from terrain_cli.windows import candidate_search, line_costs
from terrain_cli.windows.candidate_search import CHUNK, EXACT, Limits, candidates
from terrain_cli.windows.change_points import change_points
from terrain_cli.windows.merging import Criteria, Criterion, Refinement
from terrain_cli.windows.running_moments import LONG, RunningMoments

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
        costs = line_costs.best_line(moments.between(starts, np.full_like(starts, end)))[1]
        total = np.array(best)[starts] + costs + penalty
        best[end], last[end] = total.min(), starts[total.argmin()]
    bounds = [n]
    while bounds[-1]:
        bounds.append(int(last[bounds[-1]]))
    return bounds[::-1]


@given(st.integers(0, 200), st.sampled_from([10, 25]), st.sampled_from([5.0, 12.5, 50.0]))
def test_the_candidates_of_few_blocks_are_the_exact_optimum(seed, least, penalty):
    x, y, _ = three_soils(seed, n=EXACT, noise=0.05)
    moments = RunningMoments(x, y, 1)
    bounds, factor = candidates(moments, Limits(least), penalty)
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
    n, block = 1536, 4
    x = rng.uniform(8e3, 1.4e4, n)
    y = (1000.0 + 0.6 * x) * (1.0 + 0.02 * rng.standard_normal(n))
    assert change_points(x, y).tolist() == [0, n]
    # A change just beside where chunks meet, closer than the least window.
    seam = 32 * CHUNK * block
    for change in (seam - 7, seam, seam + 3):
        stronger = np.where(np.arange(n) < change, y, 1.3 * y)
        assert change_points(x, stronger, min_samples=60).tolist() == [0, change, n]


def test_places_thinned_round_by_round_hold_what_an_exact_search_finds(monkeypatch):
    """A few thousand samples, searched exactly at once and in rounds."""
    drives = [mixed(seed, Kind(load)) for load in ("waves", "steps") for seed in range(12)]
    in_rounds = sum(one.score(change_points(one.x, one.y, distance=one.distance)) for one in drives)
    monkeypatch.setattr(candidate_search, "EXACT", 10_000)
    exact = sum(one.score(change_points(one.x, one.y, distance=one.distance)) for one in drives)
    assert in_rounds[0] >= exact[0] - 0.01 * exact[1]
    assert in_rounds[2] <= exact[2] + 1


@pytest.mark.parametrize("before", [0, 10**7])
def test_short_stretches_of_soil_are_found_in_long_drives(before):
    """Also in blocks as long as many of these soils."""
    rng = np.random.default_rng(8)
    names = np.resize(["dry sand", "wet clayey soil", "upland sandy loam"], 120)
    lengths = rng.integers(100 if before else 150, 1500, len(names)).tolist()
    one = drive(rng, Kind(), names, lengths, 50)
    hits, changes, false, _ = one.score(change_points(one.x, one.y, distance=one.distance, before=before))
    assert hits >= 0.97 * changes
    assert false <= 1


@pytest.mark.parametrize("slip", ["constant", "waves"])
def test_one_soil_is_one_window_in_long_drives(slip):
    for seed in range(5):
        one = clean(seed, Kind("steps", slip, "linear"), shortest=29_999, longest=30_000)
        found = change_points(one.x, one.y, distance=one.distance, before=10**7)
        assert found.tolist() == [0, len(one.x)]


@given(st.integers(0, 100), st.integers(80, 700), st.sampled_from([15, LONG]))
def test_the_best_place_to_cut_is_found_to_the_sample(seed, change, step):
    """On the grid of blocks, on a finer one and sample by sample, as among all samples at once."""
    rng = np.random.default_rng(seed)
    n = 800
    x = rng.uniform(8e3, 1.4e4, n)
    y = (1000.0 + 0.6 * x) * np.where(np.arange(n) < change, 1.0, 1.3)
    y *= 1.0 + 0.01 * rng.standard_normal(n)
    moments = RunningMoments(x, y, step)
    criterion = Criterion(25.0, 0.02)
    refinement = Refinement(moments, Limits(10), Criteria(criterion, criterion, criterion))
    ends = np.array([0]), np.array([n])
    found, cost = refinement._best_between(ends[0], np.array([20]), np.array([n - 20]), ends[1])
    cuts = np.arange(20, n - 20)
    left = line_costs.best_line(moments.between(np.zeros_like(cuts), cuts))[1]
    right = line_costs.best_line(moments.between(cuts, np.full_like(cuts, n)))[1]
    assert found.tolist() == [cuts[(left + right).argmin()]]
    np.testing.assert_allclose(cost, (left + right).min(), rtol=1e-9)
