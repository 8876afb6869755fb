"""How long residuals last: noise that forgets is not taken for a slow misfit."""

from __future__ import annotations

import numpy as np
import pytest

from terrain_cli.estimation.wheel_fit.excess_scatter import memory

SERIES, N = 400, 300
BOUNDS = np.array([0, N])


def remembering(rng, decay, share=1.0):
    """Return series of variance 1: a first-order process with this share of it, the rest white."""
    series = rng.standard_normal((SERIES, N))
    slow = series.copy()
    for step in range(1, N):
        slow[:, step] = decay * slow[:, step - 1] + np.sqrt(1.0 - decay**2) * series[:, step]
    return np.sqrt(share) * slow + np.sqrt(1.0 - share) * rng.standard_normal((SERIES, N))


def test_white_noise_is_never_taken_for_a_long_memory():
    found = memory(np.random.default_rng(1).standard_normal((SERIES, N)), BOUNDS)
    assert np.mean(found > 1.0) < 0.05
    assert found.max() < 4.0
    some = np.random.default_rng(1).standard_normal((SERIES // 8, 8, N))
    assert np.mean([memory(one, BOUNDS) > 1.0 for one in some]) < 0.05


@pytest.mark.parametrize(("decay", "share"), [(0.8, 1.0), (0.9, 0.5), (0.9, 1.0)])
def test_a_true_memory_is_found(decay, share):
    found = memory(remembering(np.random.default_rng(2), decay, share), BOUNDS)
    truth = 1.0 + 2.0 * share * decay / (1.0 - decay)
    assert 0.6 * truth < np.median(found) < 1.5 * truth


def test_a_drift_that_is_small_beside_white_noise_is_found():
    rows = remembering(np.random.default_rng(6), np.exp(-3.0 / N), 0.2)
    off = rows.mean(axis=1) / np.sqrt(rows.var(axis=1) * memory(rows, BOUNDS)[:, 0] / N)
    assert np.mean(np.abs(off) > 3.0) < 0.03


def test_a_drift_is_found_sooner_in_several_series():
    rows = remembering(np.random.default_rng(7), np.exp(-3.0 / N), 0.03)
    off = np.abs(rows.mean(axis=1)) / np.sqrt(rows.var(axis=1) / N)
    alone = np.concatenate([memory(one[None], BOUNDS)[:, 0] for one in rows])
    together = np.concatenate([memory(some, BOUNDS)[:, 0] for some in rows.reshape(-1, 8, N)])
    assert np.mean(off > 3.0 * np.sqrt(together)) < 0.5 * np.mean(off > 3.0 * np.sqrt(alone))


def test_pieces_of_one_series_have_one_memory():
    rows = remembering(np.random.default_rng(3), 0.8).reshape(1, -1)
    bounds = np.arange(SERIES + 1) * N
    assert memory(rows, bounds, together=True).shape == (1, 1)
    assert memory(rows, bounds, together=True)[0, 0] == pytest.approx(9.0, rel=0.15)
    assert memory(rows, bounds).shape == (1, SERIES)


def test_what_a_fit_takes_of_a_memory_is_put_back():
    rows = remembering(np.random.default_rng(5), 0.8, 1.0)
    truth = memory(rows, BOUNDS).mean()
    left = rows - rows.mean(axis=1, keepdims=True)
    found = memory(left, BOUNDS, taken=1.0).mean()
    assert memory(left, BOUNDS).mean() < found
    assert found == pytest.approx(truth, rel=0.1)
