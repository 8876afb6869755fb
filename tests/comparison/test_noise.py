import numpy as np
import pytest
from scipy.signal import lfilter

from terrain_cli.comparison.noise import of_points, of_series

N = 4000


def autoregressive(rho, seed, n=N):
    white = np.random.default_rng(seed).normal(size=n)
    return lfilter([np.sqrt(1.0 - rho**2)], [1.0, -rho], white)


def one(n=N):
    return np.zeros(n, dtype=int)


@pytest.mark.parametrize(("rho", "forgotten"), [(0.0, (0, 0)), (0.5, (2, 6)), (0.8, (7, 15))])
def test_noise_and_its_memory_are_known(rho, forgotten):
    for seed in range(5):
        level = of_series(2.0 * autoregressive(rho, seed), one())
        assert level.deviation == pytest.approx(2.0, rel=0.12)
        assert forgotten[0] <= level.forgotten <= forgotten[1]


@pytest.mark.parametrize("rho", [0.0, 0.8])
def test_a_misfit_that_follows_the_drive_is_no_noise(rho):
    time = np.arange(N) / 50.0
    misfit = 1.5 * np.sin(2.0 * np.pi * time / 11.0) + np.sin(2.0 * np.pi * time / 5.0)
    level = of_series(autoregressive(rho, 1) + misfit, one())
    assert level.deviation == pytest.approx(1.0, rel=0.12)


def test_soil_that_varies_in_patches_is_no_noise():
    rng = np.random.default_rng(2)
    patches = np.repeat(rng.normal(size=N // 200), 200)
    assert of_series(rng.normal(size=N) + 2.0 * patches, one()).deviation == pytest.approx(1.0, rel=0.1)


def test_no_difference_is_taken_across_groups():
    rng = np.random.default_rng(3)
    group = np.repeat(np.arange(N // 10), 10)
    residual = rng.normal(size=N) + 100.0 * rng.normal(size=N // 10)[group]
    assert of_series(residual, group).deviation == pytest.approx(1.0, rel=0.1)


def test_unknown_samples_are_passed_over():
    residual = autoregressive(0.0, 4)
    residual[::7] = np.nan
    assert of_series(residual, one()).deviation == pytest.approx(1.0, rel=0.06)


def test_too_few_samples_tell_nothing():
    assert np.isnan(of_series(np.ones(10), one(10)).deviation)


def test_repeated_test_points_tell_the_noise():
    rng = np.random.default_rng(5)
    slip = np.repeat(np.linspace(0.0, 1.0, 12), 3)
    drivers = np.stack([slip, np.zeros(36)], axis=1)
    noise = of_points(10.0 * slip + 0.3 * rng.normal(size=36), one(36), drivers)
    assert noise == pytest.approx(0.3, rel=0.4)


def test_test_points_all_unlike_do_not():
    slip = np.linspace(0.0, 1.0, 12)
    assert np.isnan(of_points(slip, one(12), slip[:, None]))
