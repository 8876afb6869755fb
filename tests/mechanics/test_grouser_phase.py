"""The angle of the wheel in a log that is cut, against ripples that begin each stretch at any phase."""

from __future__ import annotations

import numpy as np
import pytest

from terrain_cli.mechanics import grouser_phase, rates

GROUSERS = 12


def log(seed, stretches, samples, amplitude):
    """Return stretch, angle and time, with two channels of noise that ripple a quarter of a turn apart."""
    rng = np.random.default_rng(seed)
    stretch = np.repeat(np.arange(stretches), samples)
    time = 0.1 * np.arange(len(stretch))
    angle = rates.wheel_angle(time, stretch, 0.6 + 0.05 * np.sin(time / 7.0))
    psi = GROUSERS * angle + rng.uniform(0.0, 2.0 * np.pi, stretches)[stretch]
    wave = amplitude * np.stack([np.cos(psi), np.sin(psi)])
    return stretch, angle, time, wave + 0.2 * time + rng.normal(size=wave.shape)


def waves(angle, time, channel):
    """Fit cosine and sine of the whole log, and return them."""
    psi = GROUSERS * angle
    design = np.column_stack([np.cos(psi), np.sin(psi), np.ones(len(time)), time])
    return np.linalg.lstsq(design, channel, rcond=None)[0][:2]


def test_one_amplitude_serves_stretches_that_begin_anywhere():
    stretch, angle, time, shown = log(1, 8, 150, 3.0)
    assert np.hypot(*waves(angle, time, shown[0])) < 1.5
    found = grouser_phase.aligned(angle, stretch, GROUSERS, shown, [time])
    np.testing.assert_allclose(waves(found, time, shown[0]), [3.0, 0.0], atol=0.25)
    # What one channel is told by serves the others, with their phase to it.
    np.testing.assert_allclose(waves(found, time, shown[1]), [0.0, 3.0], atol=0.25)


@pytest.mark.parametrize(
    ("stretches", "samples", "amplitude", "grousers"),
    [(1, 900, 3.0, GROUSERS), (6, 150, 0.0, GROUSERS), (20, 20, 3.0, GROUSERS), (6, 150, 3.0, 0)],
    ids=["one stretch", "noise", "too short", "smooth"],
)
def test_the_angle_stays_where_nothing_tells_or_needs_a_phase(stretches, samples, amplitude, grousers):
    stretch, angle, time, shown = log(2, stretches, samples, amplitude)
    np.testing.assert_array_equal(grouser_phase.aligned(angle, stretch, grousers, shown, [time]), angle)


def test_a_channel_that_is_hardly_there_or_never_changes_tells_nothing():
    stretch, angle, time, shown = log(3, 6, 150, 3.0)
    gone = np.where(np.arange(len(time)) < 100, shown[1], np.nan)
    found = grouser_phase.aligned(angle, stretch, GROUSERS, [gone, np.ones(len(time)), shown[0]], [time])
    alone = grouser_phase.aligned(angle, stretch, GROUSERS, shown[:1], [time])
    np.testing.assert_allclose(found, alone, rtol=0.0, atol=1e-12)


def test_noise_does_not_align_itself(monkeypatch):
    """In units of its own error a wave that is not there is normal, though phases are told by the data."""
    monkeypatch.setattr(grouser_phase, "_STANDS_OUT", 0.0)
    found = []
    for seed in range(150):
        stretch, angle, time, shown = log(seed, 10, 90, 0.0)
        aligned = grouser_phase.aligned(angle, stretch, GROUSERS, shown, [time])
        found.append([waves(aligned, time, channel) / np.sqrt(2.0 / len(time)) for channel in shown])
    found = np.array(found).reshape(150, 4)
    np.testing.assert_allclose(found.mean(axis=0), 0.0, atol=0.3)
    np.testing.assert_allclose(found.std(axis=0), 1.0, atol=0.2)
