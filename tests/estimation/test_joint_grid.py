"""Grids of c and φ: moments as told, wherever the valley lies and however it bends."""

from __future__ import annotations

import numpy as np
import pytest

from terrain_cli.estimation import joint_grid
from terrain_cli.estimation.joint_grid import Frame

MEAN = np.array([2_000.0, 0.6])


def covariance(correlation):
    errors = np.array([400.0, 0.03])
    return np.outer(errors, errors) * np.array([[1.0, correlation], [correlation, 1.0]])


def moments(grid):
    c, tan_phi = (np.ravel(axis) for axis in np.broadcast_arrays(grid.cohesion, grid.tan_phi[:, None]))
    weight = grid.probability.ravel()
    return np.average([c, tan_phi], axis=1, weights=weight), np.cov([c, tan_phi], aweights=weight, ddof=0)


@pytest.mark.parametrize("correlation", [-0.9999, -0.5, 0.0, 0.98])
def test_a_normal_distribution_has_its_moments(correlation):
    grid = joint_grid.grid(Frame(MEAN, covariance(correlation)))
    assert grid.log_density.shape == (joint_grid.SIDE, joint_grid.SIDE)
    assert grid.log_density.max() == 0.0
    assert grid.probability.sum() == pytest.approx(1.0)
    mean, found = moments(grid)
    np.testing.assert_allclose(mean, MEAN, rtol=1e-9)
    np.testing.assert_allclose(found, covariance(correlation), rtol=0.01, atol=1e-9)
    np.testing.assert_allclose(grid.cohesion[3] + grid.pivot * grid.tan_phi[3], grid.strength)


def test_a_skew_one_keeps_the_mean_and_moves_the_top():
    def shape(_reach):
        return lambda u, v: 0.15 * np.tanh(u) + 0.0 * v

    grid = joint_grid.grid(Frame(MEAN, covariance(-0.5)), shape)
    mean, _ = moments(grid)
    np.testing.assert_allclose((mean - MEAN) / np.sqrt(np.diagonal(covariance(0.0))), 0.0, atol=0.05)
    top = grid.tan_phi[np.unravel_index(np.argmax(grid.log_density), grid.log_density.shape)[0]]
    assert top > MEAN[1]


def test_a_flat_one_is_followed_further_but_not_beyond_its_bounds():
    asked = []

    def shape(reach):
        asked.append(reach.copy())
        return lambda u, v: np.full_like(u + v, -2.0)

    grid = joint_grid.grid(Frame(MEAN, covariance(-0.5)), shape, bounds=(0.55, 10.0))
    assert len(asked) == 3
    assert grid.tan_phi[0] == pytest.approx(0.55)
    assert grid.tan_phi[-1] == pytest.approx(MEAN[1] + 9.0 * 0.03)
    assert np.ptp(grid.strength) == pytest.approx(18.0 * Frame(MEAN, covariance(-0.5)).errors[1])


@pytest.mark.parametrize(
    "wrong", [np.zeros((2, 2)), np.full((2, 2), np.nan), np.diag([1.0, 0.0]), np.ones((2, 2))]
)
def test_what_has_no_error_has_no_grid(wrong):
    assert not joint_grid.possible(wrong)
    assert joint_grid.possible(covariance(-0.9999))
