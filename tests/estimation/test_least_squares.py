"""The line of equation [26]."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from terrain_cli.estimation.line.least_squares import fit_line
from terrain_cli.estimation.line.moments import of_windows


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
