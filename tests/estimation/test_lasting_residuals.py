"""What is left of a window is a misfit where it goes on for longer than noise of sensors does."""

from __future__ import annotations

import numpy as np
import pytest

from terrain_cli.estimation.wheel_fit.excess_scatter import going_on

SECOND, N = 10.0, 3_000
BOUNDS = np.array([0, N])
ALL = np.ones((1, N), dtype=bool)


def remembering(rng, seconds):
    """Return noise of variance 1 that decays in so many seconds."""
    decay, series = np.exp(-1.0 / (SECOND * seconds)), rng.standard_normal(N)
    for step in range(1, N):
        series[step] = decay * series[step - 1] + np.sqrt(1.0 - decay**2) * series[step]
    return series


@pytest.mark.parametrize("seconds", [0.15, 0.5, 1.0])
def test_noise_of_sensors_is_no_misfit(seconds):
    rng = np.random.default_rng(1)
    assert not any(going_on(remembering(rng, seconds)[None], ALL, BOUNDS, SECOND)[0] for _ in range(100))


@pytest.mark.parametrize("beside", [0.1, 0.5])
def test_what_goes_with_the_drive_is_one(beside):
    wave = np.sqrt(2.0) * np.sin(2.0 * np.pi * np.arange(N) / (15.0 * SECOND))
    left = wave[None] + beside * remembering(np.random.default_rng(2), 0.5)
    assert going_on(left, ALL, BOUNDS, SECOND).tolist() == [True]
    # Little of the scatter is none: what noise of inputs bends is in the residuals as well.
    left = 0.3 * wave[None] + remembering(np.random.default_rng(2), 0.5)
    assert going_on(left, ALL, BOUNDS, SECOND).tolist() == [False]


def test_a_window_has_its_own_and_short_ones_have_it_together():
    wave = np.sin(2.0 * np.pi * np.arange(N) / (15.0 * SECOND))
    noise = remembering(np.random.default_rng(3), 0.5)
    left = np.concatenate([noise[: N // 2], wave[N // 2 :]])[None]
    assert going_on(left, ALL, np.array([0, N // 2, N]), SECOND).tolist() == [False, True]
    short = np.arange(0, N + 1, 300)
    assert going_on(wave[None], ALL, short, SECOND).all()
    assert not going_on(noise[None], ALL, short, SECOND).any()
    # One alone tells nothing.
    assert not going_on(wave[None, :300], ALL[:, :300], np.array([0, 300]), SECOND).any()


def test_nothing_is_told_without_samples():
    nothing = np.zeros((1, 0))
    assert going_on(nothing, nothing > 0.0, np.array([0, 0]), SECOND).tolist() == [False]
    assert going_on(np.zeros((1, N)), ~ALL, BOUNDS, SECOND).tolist() == [False]
