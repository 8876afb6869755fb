"""Scores in blocks shorter than the memory of the noise."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.signal import lfilter

from terrain_cli.comparison.blocks import max_test
from terrain_cli.comparison.whitening import Whitening
from terrain_cli.diagnosis import signatures
from terrain_cli.diagnosis.signatures import SignatureEvidence, of_short_blocks

SAMPLES, KEPT = 300, 0.8
#: A tenth is left after so many samples.
MEMORY = 10


def least(seed, effect=0.0, memory=MEMORY):
    """Test four slow signatures on noise that lasts, in which one of them may be hidden; two segments."""
    rng = np.random.default_rng(seed)
    noise = lfilter([(1.0 - KEPT**2) ** 0.5], [1.0, -KEPT], rng.normal(size=(SAMPLES + 50, 1)), axis=0)[50:]
    time = np.linspace(0.0, 1.0, SAMPLES)
    slow = np.stack([np.sin(2.0 * np.pi * k * time + seed) for k in (1, 2, 3, 5)], axis=1)[:, None, :]
    level = np.ones((SAMPLES, 1, 1))
    window = np.repeat([0, 1], SAMPLES // 2)
    wheel = SimpleNamespace(memory=memory, window=window, group=window)
    known = SignatureEvidence(
        {}, Whitening(("torque",), np.eye(1)), noise + effect * slow[:, :, 1], noise != 0.0, level
    )
    rows = np.arange(SAMPLES)
    found, even = of_short_blocks(wheel, rows, known, slow, rows, SAMPLES)
    both = np.concatenate([found.blocks, even.blocks], axis=1)
    p_values = max_test(both, shrunk=found.shrunk, draws=199, seed=seed).p_values
    return np.minimum(*np.split(p_values, 2))


def test_noise_that_lasts_is_beyond_5_percent_in_5_percent_of_cases():
    """Three standard deviations of the binomial; were the noise taken for white, half would be."""
    trials = range(100)
    assert np.mean([least(seed).min() <= 0.05 for seed in trials]) <= 0.05 + 3.0 * (0.05 * 0.95 / 100) ** 0.5
    assert np.mean([least(seed, memory=0).min() <= 0.05 for seed in trials]) > 0.3


def test_what_is_hidden_in_noise_that_lasts_is_found():
    found = np.array([least(seed, effect=2.0) for seed in range(20)])
    assert np.mean(found[:, 1] <= 0.01) > 0.9
    assert found[:, 1].mean() < found[:, [0, 2, 3]].mean()


def test_samples_of_another_segment_are_no_neighbours():
    """A step between segments is theirs, and scores nothing."""
    window = np.repeat([0, 1], 50)
    wheel = SimpleNamespace(memory=MEMORY, window=window, group=window)
    steps = np.where(window == 1, 100.0, 0.0)[:, None]
    known = SignatureEvidence(
        {}, Whitening(("torque",), np.eye(1)), steps, np.isfinite(steps), np.ones((100, 1, 1))
    )
    rows = np.arange(100)
    slow = np.linspace(0.0, 1.0, 100)[:, None, None]
    found, even = of_short_blocks(wheel, rows, known, slow, rows, 100)
    assert even.blocks.sum() == pytest.approx(0.0, abs=1e-9)
    assert found.blocks.sum() == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize("unit", [1.0, 0.01])
def test_an_effect_that_acts_in_a_few_stretches_most_is_found_by_all_of_them(unit):
    """A torque that follows the acceleration is nearly all in a few starts and stops, whatever its unit."""
    rng = np.random.default_rng(4)
    count = 200
    effect = rng.normal(size=(count, 1)) * np.where(np.arange(count) % 67 == 0, 30.0, 0.5)[:, None]
    window = np.zeros(count, dtype=int)
    wheel = SimpleNamespace(memory=0, window=window, group=window)
    residual = 3.0 * effect + rng.normal(size=(count, 1))
    known = SignatureEvidence(
        {}, Whitening(("torque",), np.eye(1)), residual, residual != 0.0, np.ones((count, 1, 1))
    )
    rows = np.arange(count)
    plain, even = (
        max_test(found.blocks, shrunk=found.shrunk, draws=999).p_values[0]
        for found in of_short_blocks(wheel, rows, known, unit * effect[..., None], rows, count)
    )
    assert plain > 0.05
    assert even < 0.01


@pytest.mark.parametrize(("blocks", "count"), [(17, signatures._MOST_BLOCKS), (500, 500)])
def test_points_and_drives_that_are_scored_together_have_as_many_blocks(blocks, count):
    rows, block = np.arange(50), np.arange(50) * blocks // 50
    samples = SimpleNamespace(labels={})
    drive, points = (
        SimpleNamespace(ordered=ordered, windows=SimpleNamespace(samples=samples))
        for ordered in (True, False)
    )
    short, most = signatures.short_blocks(drive, rows, block, blocks)
    kept, least = signatures.short_blocks(points, rows, block, blocks)
    assert most == least == count
    assert short.max() < count
    np.testing.assert_array_equal(kept, block)


def of_points(seed, effect=0.0):
    """Test eight signatures on three channels of six steady points, of which a soil has four parameters."""
    rng = np.random.default_rng(seed)
    columns, soil = rng.normal(size=(6, 3, 8)), rng.normal(size=(6, 3, 4))
    window, known = np.zeros(6, dtype=int), np.ones((6, 3), dtype=bool)
    residual = signatures.beyond_soil(
        (rng.normal(size=(6, 3)) + effect * columns[..., 2])[..., None], soil, window
    )[..., 0]
    white = Whitening(("torque", "drawbar_pull", "sinkage"), np.eye(3))
    evidence = SignatureEvidence({}, white, residual, known, soil)
    left = signatures.beyond_soil(columns, soil, window)
    ((_, p_values),) = signatures.test_of_points([(evidence, window)], [left], seed=seed)
    return p_values


def test_chance_gives_scores_of_a_few_points_as_often_as_is_said():
    least = [of_points(seed).min() for seed in range(200)]
    assert np.mean(np.array(least) < 0.1) == pytest.approx(0.1, abs=0.05)


def test_a_few_points_show_a_strong_effect():
    assert all(np.argmin(of_points(seed, 10.0)) == 2 and of_points(seed, 10.0)[2] < 0.01 for seed in range(5))
