import numpy as np
import pytest
from scipy.signal import butter, lfilter, sosfilt

from terrain_cli.comparison.residual_noise import between, of_neighbours, of_points, of_series

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


def test_unrepeated_test_points_tell_the_noise_by_their_neighbours():
    rng = np.random.default_rng(6)
    slip = rng.permutation(np.linspace(0.0, 1.0, 60))
    smooth = 4.0 * np.exp(-slip / 0.4)
    noise = of_neighbours(smooth + 0.3 * rng.normal(size=60), one(60), slip[:, None])
    assert noise == pytest.approx(0.3, rel=0.25)
    assert of_neighbours(7.0 - 3.0 * slip, one(60), slip[:, None]) == pytest.approx(0.0, abs=1e-12)


def test_points_at_another_load_are_no_neighbours():
    slip, load = np.tile(np.linspace(0.0, 1.0, 6), 2), np.repeat([0.0, 0.5], 6)
    conditions = np.stack([slip, load], axis=1)
    assert of_neighbours(slip + 9.0 * load, one(12), conditions) == pytest.approx(0.0, abs=1e-12)
    places = between(one(12), conditions)
    assert len(places.middle) == 8
    assert set(zip(places.before, places.after, strict=True)) == {
        (k, k + 2) for k in (0, 1, 2, 3, 6, 7, 8, 9)
    }
    # A load measured with some noise is the same load still.
    near = np.stack([slip, load + np.random.default_rng(1).uniform(0.0, 0.02, 12)], axis=1)
    assert len(between(one(12), near).middle) == 8


def test_two_points_at_one_slip_are_neighbours():
    slip = np.array([0.1, 0.1, 0.3, 0.3, 0.5])
    off = between(one(5), slip[:, None]).off(np.array([1.0, 3.0, 5.0, 5.0, 5.0]))
    np.testing.assert_allclose(off, [2.0 / np.sqrt(2.0), 0.0, 0.0], atol=1e-12)


def test_three_points_between_others_are_too_few():
    slip = np.linspace(0.0, 1.0, 5)
    assert np.isnan(of_neighbours(slip**2, one(5), slip[:, None]))
    slip = np.linspace(0.0, 1.0, 6)
    assert np.isfinite(of_neighbours(slip**2, one(6), slip[:, None]))


def test_points_at_loads_all_over_a_range_have_no_neighbours():
    slip = np.linspace(0.0, 1.0, 40)
    load = np.random.default_rng(9).permutation(np.linspace(0.2, 0.6, 40))
    assert len(between(one(40), np.stack([slip, load], axis=1)).middle) == 0
    assert np.isnan(of_neighbours(slip, one(40), np.stack([slip, load], axis=1)))


@pytest.mark.parametrize(("rate", "lasts"), [(20.0, 0.5), (50.0, 0.5), (50.0, 1.0)])
def test_noise_that_lasts_as_long_as_that_of_sensors_is_no_misfit(rate, lasts):
    n = int(100.0 * rate)
    found = [of_series(autoregressive(np.exp(-1.0 / (rate * lasts)), s, n), one(n), rate) for s in range(8)]
    assert np.mean([level.deviation for level in found]) == pytest.approx(1.0, rel=0.1)
    assert np.mean([level.forgotten for level in found]) == pytest.approx(2.3 * lasts * rate, rel=0.35)


@pytest.mark.parametrize("rate", [25.0, 100.0])
def test_noise_of_any_spectrum_is_no_misfit(rate):
    """A filter in the sensor leaves a noise as smooth as a misfit that follows the drive."""
    n = int(60.0 * rate)
    for seed in range(4):
        white = np.random.default_rng(seed).normal(size=2 * n)
        smooth = sosfilt(butter(3, 0.5, output="sos", fs=rate), white)[n:]
        level = of_series(smooth, one(n), rate)
        assert level.deviation == pytest.approx(np.std(smooth), rel=0.05)


def test_noise_alone_is_known_as_well_as_the_residual():
    residual = autoregressive(0.8, 7)
    assert of_series(residual, one(), 20.0).deviation == pytest.approx(np.std(residual), rel=1e-9)


def test_a_misfit_is_seen_in_many_runs():
    """Each of 20 runs is long enough to show that its error goes on."""
    time = np.arange(N) / 20.0
    group = np.repeat(np.arange(20), N // 20)
    residual = np.random.default_rng(8).normal(size=N) + 2.0 * np.sin(2.0 * np.pi * time / 9.0)
    assert of_series(residual, group, 20.0).deviation == pytest.approx(1.0, rel=0.1)
