"""Windows are joined where one line that follows something recorded is as good as many."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from terrain_cli.windows.segmentation import PENALTY, change_points, needed

N = 3000
NONE = np.array([], dtype=np.intp)


def drive(seed, *, follows=0.0, soils=1, noise=150.0):
    """Return x, y and slip; y rises with slip squared, and two soils may take turns every 500 samples."""
    rng = np.random.default_rng(seed)
    time = np.arange(N)
    slip = 0.3 + 0.2 * np.sin(2.0 * np.pi * time / 390.0)
    x = 8e3 + 2e3 * np.sin(2.0 * np.pi * time / 170.0 + 1.0)
    second = (time // 500 % 2 == 1) & (soils == 2)
    cohesion, tan_phi = np.where(second, 3000.0, 1000.0), np.where(second, 0.5, 0.6)
    y = cohesion + x * tan_phi + follows * slip**2 + noise * rng.standard_normal(N)
    return x, y, slip


@pytest.mark.parametrize("seed", range(5))
def test_one_soil_whose_line_follows_slip_is_one(seed):
    x, y, slip = drive(seed, follows=8000.0)
    found = change_points(x, y)
    assert len(found) > 8
    assert needed(x, y, [slip], found, NONE).tolist() == [0, N]


@pytest.mark.parametrize("seed", range(5))
def test_true_changes_stay(seed):
    x, y, slip = drive(seed, follows=5000.0, soils=2)
    found = change_points(x, y)
    assert len(found) > 8
    left = needed(x, y, [np.sqrt(slip), slip], found, NONE)
    assert len(left) <= 8
    known = [true for true in range(500, N, 500) if np.abs(found - true).min() <= 40]
    assert len(known) >= 3
    assert all(np.abs(left - true).min() <= 40 for true in known)


def test_what_nothing_explains_stays():
    x, y, slip = drive(7, soils=2)
    found = change_points(x, y)
    assert len(found) == 7
    unknown, still = np.full(N, np.nan), np.ones(N)
    np.testing.assert_array_equal(needed(x, y, [slip, unknown, still], found, NONE), found)


def test_breaks_stay():
    x, y, slip = drive(3, follows=8000.0)
    breaks = np.array([1200])
    found = change_points(x, y, breaks=breaks)
    assert needed(x, y, [slip], found, breaks).tolist() == [0, 1200, N]


def test_a_constant_load_is_no_trouble():
    _, y, slip = drive(3, follows=8000.0)
    found = np.array([0, 1000, 2000, N])
    np.testing.assert_array_equal(needed(np.full(N, 8e3), y, [slip], found, NONE), found)
    x = np.repeat([7e3, 8e3, 9e3], 1000)
    assert needed(x, 1e3 + 0.5 * x + 8e3 * slip**2, [slip], found, NONE)[-1] == N


def test_each_bound_that_stays_pays_in_a_dense_solution():
    x, y, slip = drive(5, follows=20_000.0, soils=2)
    found = change_points(x, y)
    left = needed(x, y, [slip], found, NONE)
    assert 2 < len(left) < len(found)

    def sum_of_squares(bounds):
        scaled, d = (x - x.mean()) / x.std(), (slip - slip.mean()) / slip.std()
        inside = [(np.arange(N) >= a) & (np.arange(N) < b) for a, b in pairwise(bounds)]
        columns = [part * one for part in inside for one in (np.ones(N), scaled)]
        columns += [d, d**2, d * scaled]
        return np.linalg.lstsq(np.column_stack(columns), y, rcond=None)[1][0]

    variance = sum_of_squares(found) / N
    for place in range(1, len(left) - 1):
        gain = sum_of_squares(np.delete(left, place)) - sum_of_squares(left)
        assert gain / variance > 0.9 * PENALTY
