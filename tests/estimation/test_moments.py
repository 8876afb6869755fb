"""Sums over windows against plain loops. The line of equation [26]."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from terrain_cli.estimation.line import moments as moments_of
from terrain_cli.estimation.line.moments import (
    X,
    fit_line,
    join,
    of_windows,
    running,
    segment_sum,
    window_products,
)

lengths = st.lists(st.integers(0, 12), min_size=1, max_size=6).filter(lambda counts: sum(counts) > 0)


def block(size, seed):
    """Return six rows of numbers far from zero."""
    rng = np.random.default_rng(seed)
    return 1e4 + 100.0 * rng.standard_normal((6, size))


def plain(a, b, lag):
    a, b = a - a.mean(), b - b.mean()
    return sum(0.5 * (a[t] * b[t - lag] + b[t] * a[t - lag]) for t in range(lag, len(a)))


def test_empty_windows_sum_to_zero():
    total = segment_sum(np.array([1.0, 2.0, 4.0]), np.array([0, 0, 2, 2, 3, 3]))
    np.testing.assert_array_equal(total, [0.0, 3.0, 0.0, 4.0, 0.0])


@example([7, 7, 7], 0)
@given(lengths, st.integers(0, 99))
def test_moments_of_windows_are_those_of_plain_loops(counts, seed):
    columns, bounds = block(sum(counts), seed), np.cumsum([0, *counts])
    moments = of_windows(columns, bounds)
    for j, (start, stop) in enumerate(pairwise(bounds)):
        window = columns[:, start:stop]
        if stop > start:
            np.testing.assert_allclose(moments.mean[:, j], window.mean(axis=1), rtol=1e-14)
        for (lag, a, b), values in moments.products.items():
            expected = plain(window[a], window[b], lag) if stop > start else 0.0
            assert values[j] == pytest.approx(expected, abs=1e-6)


@given(lengths, st.integers(0, 99), st.integers(1, 5))
def test_long_windows_piece_by_piece_are_all_at_once(counts, seed, piece):
    columns, bounds = block(sum(counts), seed), np.cumsum([0, *counts])
    together = of_windows(columns, bounds)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(moments_of, "_LONG", piece)
        one_by_one = of_windows(columns, bounds)
    np.testing.assert_array_equal(one_by_one.count, together.count)
    np.testing.assert_allclose(one_by_one.mean, together.mean, rtol=1e-14)
    assert one_by_one.products.keys() == together.products.keys()
    for key, values in one_by_one.products.items():
        np.testing.assert_allclose(values, together[key], rtol=1e-9, atol=1e-6)


@given(st.integers(1, 25), st.integers(0, 99))
def test_running_moments_are_those_of_the_samples_so_far(size, seed):
    columns = block(size, seed)
    moments = running(columns)
    for k in range(1, size + 1):
        so_far = of_windows(columns[:, :k], np.array([0, k]))
        assert moments.count[k - 1] == k
        np.testing.assert_allclose(moments.mean[:, k - 1], so_far.mean[:, 0], rtol=1e-13)
        for key, values in moments.products.items():
            assert values[k - 1] == pytest.approx(so_far[key][0], rel=1e-9, abs=1e-6)


def test_rounding_is_not_variation():
    columns = np.full((6, 8), 12345.678)
    columns[X, ::2] *= 1.0 + 1e-15
    assert not of_windows(columns, np.array([0, 8])).varies(X)[0]
    columns[X, 0] *= 1.0 + 1e-6
    assert of_windows(columns, np.array([0, 8])).varies(X)[0]


def test_windows_of_several_blocks_are_joined_in_order():
    columns, bounds = block(30, 4), np.array([0, 9, 15, 22, 30])
    whole = of_windows(columns, bounds)
    parts = join([of_windows(columns[:, :15], bounds[:3]), of_windows(columns[:, 15:], bounds[2:] - 15)])
    np.testing.assert_array_equal(parts.count, whole.count)
    np.testing.assert_allclose(parts.mean, whole.mean, rtol=1e-14)
    for key, values in whole.products.items():
        np.testing.assert_allclose(parts[key], values, rtol=1e-9, atol=1e-6)


@pytest.mark.parametrize("lengths", [(40, 0, 60), (3, 1, 0, 5, 2)])
def test_products_of_rows_are_summed_in_each_window(lengths):
    rng = np.random.default_rng(4)
    n = sum(lengths)
    bounds = np.concatenate([[0], np.cumsum(lengths)])
    rows = rng.standard_normal((2, 3, 4, n))
    weighted = rows * rng.uniform(0.5, 1.0, n)
    found = window_products(weighted, rows, bounds)
    for j, (first, last) in enumerate(pairwise(bounds)):
        part = slice(first, last)
        expected = np.einsum("kmpn,kmqn->kpq", weighted[..., part], rows[..., part])
        np.testing.assert_allclose(found[j], expected, atol=1e-12)


def line_through(x, y):
    columns = np.ones((6, len(x)))
    columns[0], columns[1] = x, y
    return fit_line(of_windows(columns, np.array([0, len(x)])))


def test_three_points_by_hand():
    # Means 2 and 4; Sxx = 2, Sxy = 3: slope 3/2, c = 1; residuals 1/2, −1, 1/2.
    line = line_through([1.0, 2.0, 3.0], [3.0, 3.0, 6.0])
    assert line.tan_phi[0] == pytest.approx(1.5)
    assert line.cohesion[0] == pytest.approx(1.0)
    assert line.residual[0] == pytest.approx(1.5)


@given(st.integers(0, 999), st.integers(3, 40))
def test_same_line_as_polyfit(seed, size):
    rng = np.random.default_rng(seed)
    x = 1e4 + rng.normal(0.0, 800.0, size)
    y = 900.0 + 0.6 * x + rng.normal(0.0, 100.0, size)
    slope, intercept = np.polyfit(x, y, 1)
    line = line_through(x, y)
    np.testing.assert_allclose((line.tan_phi[0], line.cohesion[0]), (slope, intercept), rtol=1e-7)
    np.testing.assert_allclose(line.residual[0], np.sum((y - intercept - slope * x) ** 2), rtol=1e-7)


@pytest.mark.parametrize("spread", [0.3, 0.05, 1e-3, 1e-6])
def test_condition_number_is_that_of_the_scaled_design(spread):
    x = 1e4 * (1.0 + spread * np.linspace(-1.0, 1.0, 9))
    design = np.column_stack([np.ones(9), x])
    expected = np.linalg.cond(design / np.linalg.norm(design, axis=0))
    assert line_through(x, x).condition_number[0] == pytest.approx(expected, rel=1e-6)


def test_without_variation_there_is_no_slope():
    line = line_through(np.full(4, 9e3), [1.0, 2.0, 3.0, 4.0])
    assert np.isnan(line.tan_phi[0])
    assert np.isnan(line.cohesion[0])
    assert line.condition_number[0] == np.inf
    assert line.residual[0] == pytest.approx(5.0)
