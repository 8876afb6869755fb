"""What residuals may follow."""

from dataclasses import replace

import numpy as np
import pytest
from known_misfits import Kind, windows_of

from terrain_cli.comparison import comparison_outcome, drivers, residual_noise, shapes


def test_what_an_effect_derives_from_the_misfit_is_no_driver():
    windows = windows_of(1, Kind())
    derived = dict.fromkeys(("rut_slope", "sinkage_rate"), np.zeros(len(windows.samples)))
    asked = replace(windows.samples, drivers={**windows.samples.drivers, **derived})
    assert not derived.keys() & drivers.of_wheel(replace(windows, samples=asked)).keys()


def test_how_far_a_column_scatters_is_no_driver():
    windows = windows_of(1, Kind())
    columns = dict.fromkeys(
        ("Fx_std", "sigma z", "Std", "standing", "wind_std_x"), np.ones(len(windows.samples))
    )
    asked = replace(windows.samples, drivers={**windows.samples.drivers, **columns})
    found = drivers.of_wheel(replace(windows, samples=asked))
    assert columns.keys() & found.keys() == {"standing"}


def test_pitch_and_roll_are_those_of_the_course():
    windows = windows_of(1, Kind())
    samples = windows.samples
    n = len(samples)
    own = {"pitch": np.full(n, 0.1), "roll": np.full(n, 0.2), "yaw_rate": np.full(n, 0.3)}
    omega = np.where(np.arange(n) < n // 2, 1.0, -1.0)
    for turns in ({}, {"angular_velocity": omega}):
        channels = {k: v for k, v in samples.channels.items() if k != "angular_velocity"} | own | turns
        found = drivers.of_wheel(replace(windows, samples=replace(samples, channels=channels)))
        way = np.where(omega[windows.rows] < 0.0, -1.0, 1.0) if turns else 1.0
        for name, column in own.items():
            np.testing.assert_array_equal(
                found[name].values, column[windows.rows] * (way if name != "yaw_rate" else 1.0)
            )


def lasting(seed, decay=15.0, n=1_000):
    """Return a series whose correlation falls e times in so many samples."""
    rng, kept = np.random.default_rng(seed), np.exp(-1.0 / decay)
    noise = rng.normal(size=n) * np.sqrt(1.0 - kept**2)
    series = [rng.normal()]
    for one in noise[1:]:
        series.append(kept * series[-1] + one)
    return np.array(series)


def driver(name, values):
    return comparison_outcome.Driver(name, "", values)


@pytest.mark.parametrize("seed", range(78_957_010, 78_957_015))
def test_what_follows_a_rough_load_is_no_noise_that_lasts(seed):
    """A pull that heaps of soil take looked like noise of a second: 50 s were four independent stretches."""
    load, speed = lasting(seed), lasting(seed + 100)
    every = {"load": driver("load", load), "velocity": driver("velocity", speed)}
    white = np.random.default_rng(seed).normal(size=1_000)
    group = np.zeros(1_000, dtype=np.intp)
    misfit = 3.0 * load + load**2 + white
    assert residual_noise.of_series(misfit, group, 20.0).forgotten > 15
    left = drivers.beside(misfit, 25, every, {})
    assert residual_noise.of_series(left, group, 20.0).forgotten == 0
    assert np.std(left) == pytest.approx(1.0, abs=0.1)
    # Noise of its own that lasts remains, whatever it has in common with drivers by chance.
    noise = lasting(seed + 200) + 0.3 * white
    assert drivers.beside(noise, 25, every, {}) is noise


def test_what_follows_the_clock_alone_is_not_taken_off():
    clock = np.arange(1_000.0)
    every = {"time": driver("time", clock), "sinkage": driver("sinkage", clock)}
    assert drivers.beside(clock, 25, every, {}) is clock


@pytest.mark.parametrize("grousers", [14, 40])
def test_what_swings_with_the_grousers_is_no_noise_that_lasts(grousers):
    """At a wheel speed that wanders it has no period in time, and is over within seconds as noise is."""
    rng = np.random.default_rng(78_972_901)
    n, rate = 1_200, 20.0
    speed = np.repeat(rng.uniform(0.2, 0.5, n // 150), 150)
    angle = drivers.Driver(drivers.ANGLE, "rad", np.cumsum(speed) / rate)
    noise = rng.normal(size=n)
    group = np.zeros(n, dtype=int)
    residual = noise + 5.0 * np.sin(grousers * angle.values + 0.3)
    memory = residual_noise.of_series(residual, group, rate).forgotten
    assert memory > 0
    left = drivers.beside(residual, memory, {drivers.ANGLE: angle}, {}, grousers)
    np.testing.assert_allclose(left, noise, atol=0.5)
    assert residual_noise.of_series(left, group, rate).forgotten == 0
    # Of a wheel of whose grousers nothing is known, more in a turn than any has are not looked for.
    found = np.std(drivers.beside(residual, memory, {drivers.ANGLE: angle}, {})) < 2.0
    assert found == (grousers in shapes.HARMONICS)
