"""The arrow of windows and what they share, against dense least squares."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from profiles import examples
from scipy.optimize import lsq_linear

from terrain_cli.estimation.wheel_fit import normal_equations


@st.composite
def drives(draw):
    """Return local, windows, window of each sample, block of each sample, design, residuals and prior."""
    local, shared = draw(st.integers(0, 3)), draw(st.integers(0, 3))
    windows, blocks, channels = draw(st.integers(1, 4)), draw(st.integers(2, 4)), draw(st.integers(1, 2))
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    n = 12 * windows
    window, block = rng.permutation(np.arange(n) % windows), rng.integers(0, blocks, n)
    design = rng.normal(size=(n, channels, local + shared)) * 10.0 ** rng.uniform(-2, 2, local + shared)
    # Priors may be correlated, but none of an own unknown is with that of a shared one.
    root = rng.normal(size=(local + shared, local + shared))
    root[:local, local:] = root[local:, :local] = 0.0
    return (
        local,
        windows,
        window,
        block,
        design,
        rng.normal(size=(n, channels)),
        root @ root.T + np.eye(len(root)),
    )


def dense(local, windows, prior):
    """Return the prior of the whole arrow."""
    own = np.kron(np.eye(windows), prior[:local, :local])
    whole = np.zeros((windows * local + len(prior) - local,) * 2)
    whole[: len(own), : len(own)] = own
    whole[len(own) :, len(own) :] = prior[local:, local:]
    return whole


def places(window, local, windows, size):
    return [
        *range(window * local, (window + 1) * local),
        *range(windows * local, windows * local + size - local),
    ]


@given(drives())
@examples(30)
def test_solution_and_covariance_are_those_of_the_dense_system(drive):
    local, windows, window, _, design, residual, prior = drive
    information = normal_equations.products(design, design, window, windows)
    score = normal_equations.products(design, residual[..., None], window, windows)[..., 0]
    found, shared = normal_equations.arrow(information, local, prior)
    own, common = found.solve(score[:, :local], shared, score[:, local:].sum(axis=0))
    whole = normal_equations.covariance(found.own, found.gain, np.linalg.inv(shared - found.taken()))

    wide = normal_equations.widened(design, local, window, windows).reshape(residual.size, -1)
    matrix = wide.T @ wide + dense(local, windows, prior)
    expected, inverse = np.linalg.solve(matrix, wide.T @ residual.ravel()), np.linalg.inv(matrix)
    np.testing.assert_allclose(np.append(own, common), expected, rtol=1e-7, atol=1e-10)
    for one in range(windows):
        at = places(one, local, windows, len(prior))
        np.testing.assert_allclose(whole[one], inverse[np.ix_(at, at)], rtol=1e-6, atol=1e-10)
    explained = normal_equations.explained(matrix, wide.T @ residual.ravel())
    assert explained == pytest.approx(expected @ matrix @ expected, rel=1e-7)


@given(drives())
@examples(30)
def test_leaving_a_block_out_is_solving_the_rest(drive):
    local, windows, window, block, design, residual, prior = drive
    pairs, cell = np.unique(np.stack([window, block]), axis=1, return_inverse=True)
    cells, cell = pairs.shape[1], cell.ravel()
    information = normal_equations.products(design, design, cell, cells)
    score = normal_equations.products(design, residual[..., None], cell, cells)[..., 0]
    moved = normal_equations.leave_out(information, score, *pairs, prior, local)
    wide = normal_equations.widened(design, local, window, windows)
    n, channels = residual.shape

    def solved(kept):
        table = wide[kept].reshape(kept.sum() * channels, -1)
        return np.linalg.solve(
            table.T @ table + dense(local, windows, prior), table.T @ residual[kept].ravel()
        )

    every = solved(np.ones(n, dtype=bool))
    for one, (label, fold) in enumerate(pairs.T):
        expected = (solved(block != fold) - every)[places(label, local, windows, len(prior))]
        np.testing.assert_allclose(moved[one], expected, rtol=1e-6, atol=1e-9)


def test_a_shared_unknown_stops_at_its_bound_and_the_others_make_do_with_that():
    """Against the minimum of the same squares with that unknown held, by scipy."""
    rng = np.random.default_rng(7)
    local, size, cells = 2, 4, 5
    design, error = rng.normal(size=(cells, 30, size)), rng.normal(size=(cells, 30))
    information, score = np.einsum("cni,cnj->cij", design, design), np.einsum("cni,cn->ci", design, error)
    window, fold, prior = np.zeros(cells, dtype=int), np.arange(cells), 0.1 * np.eye(size)
    free = normal_equations.leave_out(information, score, window, fold, prior, local)
    base = np.linalg.solve(information.sum(axis=0) + prior, score.sum(axis=0))
    low = np.array([0.5 * free[:, local].min(), -np.inf])
    assert (free[:, local] < low[0]).any()
    moved = normal_equations.leave_out(
        information, score, window, fold, prior, local, (low, np.array([np.inf, np.inf]))
    )
    for cell in range(cells):
        kept = fold != cell
        rows = np.concatenate([design[kept].reshape(-1, size), np.sqrt(prior)])
        right = np.append(error[kept].ravel(), np.zeros(size))
        bounds = (np.full(size, -np.inf), np.full(size, np.inf))
        bounds[0][local] = base[local] + low[0]
        expected = lsq_linear(rows, right, bounds).x - base
        assert moved[cell] == pytest.approx(expected, abs=1e-6)


def test_what_nothing_determines_is_not_inverted():
    """A direction without information is left out whatever the units of the others."""
    scale = np.array([1e-4, 1.0, 1e4])
    design = np.array([[1.0, 1.0, 0.0], [2.0, 2.0, 0.0], [0.0, 0.0, 3.0]]) * scale
    found = normal_equations.pseudo_inverse(np.stack([design.T @ design, np.zeros((3, 3))]))
    assert found[0] * np.outer(scale, scale) == pytest.approx(
        np.array([[0.05, 0.05, 0.0], [0.05, 0.05, 0.0], [0.0, 0.0, 1.0 / 9.0]])
    )
    assert not found[1].any()


def test_no_axis_is_wider_than_the_prior():
    turn, _ = np.linalg.qr(np.random.default_rng(1).standard_normal((3, 3)))
    wide = turn @ np.diag([9.0, 0.5, 0.01]) @ turn.T
    found, mean = normal_equations.no_wider(wide[None], turn[:, :1].T * 3.0)
    np.testing.assert_allclose(found[0], turn @ np.diag([1.0, 0.5, 0.01]) @ turn.T, atol=1e-12)
    # Nine times as wide as the prior: a ninth of the way is left.
    np.testing.assert_allclose(mean[0], turn[:, 0] / 3.0, atol=1e-12)
    same, there = normal_equations.no_wider(found, mean)
    np.testing.assert_allclose(same, found, atol=1e-12)
    np.testing.assert_allclose(there, mean, atol=1e-12)
