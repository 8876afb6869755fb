import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from terrain_cli.comparison.neighbours import from_neighbours


@given(st.integers(0, 8), st.integers(1, 5), st.integers(0, 59))
def test_a_sample_has_no_part_in_its_own_value_nor_in_that_of_near_ones(gap, reach, place):
    values, group = np.zeros(60), np.zeros(60, dtype=int)
    values[place] = 1.0
    moved = from_neighbours(values, group, gap=gap, reach=reach) - from_neighbours(
        np.zeros(60), group, gap=gap, reach=reach
    )
    near = np.abs(np.arange(60) - place) <= gap
    assert moved[near] == pytest.approx(0.0, abs=1e-12)


def test_a_cubic_is_kept_but_for_the_width_of_the_means():
    t = np.linspace(-1.0, 1.0, 101)
    values = 1.0 + 2.0 * t - t**2 + t**3
    smooth = from_neighbours(values, np.zeros(101, dtype=int), gap=2, reach=1)
    assert smooth[12:-12] == pytest.approx(values[12:-12], abs=1e-12)


def test_noise_is_another_one():
    noise = np.random.default_rng(1).normal(size=20_000)
    smooth = from_neighbours(noise, np.zeros(20_000, dtype=int), gap=0, reach=3)
    assert abs(np.corrcoef(noise, smooth)[0, 1]) < 0.03


def test_groups_are_no_neighbours():
    values, group = np.repeat([0.0, 5.0], 20), np.repeat([0, 1], 20)
    assert from_neighbours(values, group, gap=1, reach=3) == pytest.approx(values)


def test_a_sample_alone_has_none():
    assert np.isnan(from_neighbours(np.array([1.0, 2.0]), np.array([0, 1]), gap=0, reach=3)).all()
    assert len(from_neighbours(np.zeros(0), np.zeros(0, dtype=int), gap=0, reach=3)) == 0


def test_unknown_samples_are_passed_over():
    values = np.ones(50)
    values[::3] = np.nan
    assert from_neighbours(values, np.zeros(50, dtype=int), gap=0, reach=3) == pytest.approx(1.0)
