import numpy as np
import pytest

from terrain_cli.windows import sample_blocks
from terrain_cli.windows.running_moments import block_noise, correlation_factor, tame
from terrain_cli.windows.sample_blocks import ReplacedSamples

X, Y = 12_000.0, 8_000.0


def noise_of(x, y, step=4):
    """Return the noise of samples, none of which is taken for wild."""
    rows, _, _ = sample_blocks.summed(x, y, step, 1.5, np.empty((6, len(x) + step)))
    return block_noise(rows, sample_blocks.sizes(len(x), step), step, np.full(2, 1e-9 * X))


def tamed(x, y, step):
    """Return the samples with those that are wild replaced."""
    tame(found := ReplacedSamples(x, y), step)
    return found.between(0, len(x))


def samples(n=4000, seed=0, load=0.0):
    """Return noise of 4 % on x and 3 % on y, and x moved along a line of slope 0.6 at random."""
    rng = np.random.default_rng(seed)
    moved = load * X * rng.standard_normal(n)
    return X + moved + 0.04 * X * rng.standard_normal(n), Y + 0.6 * moved + 0.03 * Y * rng.standard_normal(n)


def test_noise_is_learnt_from_differences():
    xx, xy, yy = noise_of(*samples()).mean(axis=1)
    assert np.sqrt(xx) == pytest.approx(0.04 * X, rel=0.03)
    assert np.sqrt(yy) == pytest.approx(0.03 * Y, rel=0.03)
    assert abs(xy) < 0.05 * np.sqrt(xx * yy)


def test_a_drifting_or_stepping_load_is_no_noise():
    x, y = samples()
    move = 0.3 * X * np.sin(np.arange(4000) / 8.0) + np.where(np.arange(4000) % 500 < 250, 0.0, 0.3 * X)
    xx, _, yy = noise_of(x + move, y + 0.6 * move).mean(axis=1)
    assert np.sqrt(xx) == pytest.approx(0.04 * X, rel=0.15)
    assert np.sqrt(yy) == pytest.approx(0.03 * Y, rel=0.15)


def test_a_load_that_varies_from_sample_to_sample_is_no_noise():
    x, y = samples(load=0.1)
    xx, xy, yy = noise_of(x, y).mean(axis=1)
    across = yy - 2 * 0.6 * xy + 0.36 * xx
    assert across == pytest.approx((0.03 * Y) ** 2 + (0.6 * 0.04 * X) ** 2, rel=0.2)
    assert np.sqrt(xx) == pytest.approx(0.04 * X, rel=0.5)


def test_noise_grows_with_the_values():
    x, y = samples()
    growth = np.repeat([1.0, 2.0], 2000)
    xx = noise_of(growth * x, growth * y)[0]
    assert xx[700:].mean() / xx[:300].mean() == pytest.approx(4.0, rel=0.15)


def test_samples_without_noise_are_not_known_better_than_the_floor():
    noise = noise_of(np.full(50, X), np.zeros(50))
    assert np.isfinite(noise).all()
    assert (noise[[0, 2]] > 0.0).all()


def test_wild_samples_are_replaced_and_others_left():
    x, y = samples(n=2000)
    assert np.mean(tamed(x, y, 4)[0] != x) < 0.002
    wild_x, wild_y = x.copy(), y.copy()
    for start, length in ((100, 1), (300, 2), (500, 1), (502, 1)):
        wild_x[start : start + length] *= 3.0
        wild_y[start : start + length] *= 0.1
    x, y = tamed(wild_x, wild_y, 4)
    assert x.max() < 1.3 * X
    assert y.min() > 0.7 * Y


def test_a_step_is_not_wild():
    x = np.repeat([X, 2 * X], 500)
    y = np.repeat([Y, 3 * Y], 500)
    np.testing.assert_array_equal(tamed(x, y, 4), (x, y))


@pytest.mark.parametrize("memory", [0.0, 0.5, 0.8])
def test_the_correlation_factor_is_that_of_the_long_run_variance(memory):
    rng = np.random.default_rng(1)
    n = 40_000
    r = rng.standard_normal(n)
    for j in range(1, n):
        r[j] += memory * r[j - 1]
    differences = r[:-2] - 2 * r[1:-1] + r[2:]
    r /= np.sqrt(np.mean(differences**2) / 6.0)
    # Of a first-order autoregression with innovations of variance 1; second differences keep
    # (6 − 8 ρ + 2 ρ²)/6 of its variance 1/(1 − ρ²).
    kept = (6 - 8 * memory + 2 * memory**2) / 6 / (1 - memory**2)
    expected = 1 / (1 - memory) ** 2 / kept
    found = correlation_factor(r, np.arange(500, n, 500), fitted=160)
    assert found == pytest.approx(expected, rel=0.15)


def test_the_correlation_factor_sums_the_products_at_all_lags_with_bartletts_weights():
    noise = np.random.default_rng(2).standard_normal(3_002)
    # As neighbours go apart, prewhitening takes nothing off.
    r = noise[:-2] - 0.2 * noise[1:-1] + 0.6 * noise[2:]
    white = r[1:]
    lags = int(1.5 * len(white) ** (1.0 / 3.0))
    products = [white[lag:] @ white[: len(white) - lag] for lag in range(1, lags + 1)]
    weights = 1.0 - np.arange(1, lags + 1) / (lags + 1.0)
    long_run = white @ white + 2.0 * weights @ products
    found = correlation_factor(r, np.zeros(0, dtype=np.intp), fitted=4)
    assert found == pytest.approx(long_run / (len(r) - 4))


def test_residuals_of_nothing_are_not_correlated():
    assert correlation_factor(np.zeros(50), np.array([20]), fitted=4) == 1.0
