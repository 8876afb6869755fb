"""Strengths of soils at one stress, and the stresses under a wheel."""

from __future__ import annotations

import math

import numpy as np
import pandas as pd
import pytest
from drives import GEOMETRY, drive

import terrain_cli as terrain
from terrain_cli.estimation import strength

ROVER = "[wheel]\nradius = 0.125\nwidth = 0.1\n[soil]\nshear_modulus = 0.018\n"


@pytest.fixture
def windows(tmp_path):
    """Return two windows of one soil, of which the second is driven under twice the load."""
    run = drive(2, 60, 3, kind="steps", share=0.2, noises=0.01)
    table = pd.DataFrame(run.channels | {"time": np.arange(120) / 10.0, "terrain": np.repeat(["a", "b"], 60)})
    (tmp_path / "rover.toml").write_text(ROVER)
    (samples,) = terrain.from_frame(table, tmp_path / "rover.toml")
    return run, terrain.segment(samples, "terrain")


def test_the_mean_stress_is_the_load_by_the_ground_that_carries_it():
    # sin θ1 = 0.6 where 1 − z/r = 0.8.
    stress = strength.mean_stress(np.array([60.0, 60.0]), np.array([0.02, 0.0]), 0.1, 0.1)
    assert stress[0] == pytest.approx(60.0 / (0.1 * 0.1 * 0.6))
    assert math.isnan(stress[1])


@pytest.mark.parametrize(
    ("stresses", "rounded"),
    [
        ([9.3e3], 1e4),
        ([1.2e4, 1.5e4, 9e4], 2e4),
        ([4e3], 5e3),
        ([8e2], 1e3),
        ([], math.nan),
        ([math.nan, -1.0], math.nan),
    ],
)
def test_the_typical_stress_is_a_round_one(stresses, rounded):
    assert strength.typical_stress(np.array(stresses)) == pytest.approx(rounded, nan_ok=True)


def test_a_stress_that_was_never_driven_is_remarked(windows):
    _, cut = windows
    ends = [strength.stress_range(cut.samples)]
    assert not [
        *strength.extrapolation_notes("wheel", ends, 20e3),
        *strength.extrapolation_notes("wheel", ends, None),
    ]
    (told,) = strength.extrapolation_notes("wheel", [(math.nan, math.nan), *ends], 1e9)
    assert told.startswith("strengths at 1e+06 kPa are extrapolated: the wheel put ")


def test_strengths_are_those_of_the_line_at_one_stress(windows):
    _, cut = windows
    table = terrain.estimate(cut, "least-squares", at_stress=7.5)
    assert set(table["stress_kPa"]) == {7.5}
    expected = table["c_kPa"] + 7.5 * np.tan(np.radians(table["phi_deg"]))
    np.testing.assert_allclose(table["strength_at_stress_kPa"], expected)
    usual = terrain.estimate(cut, "least-squares")
    # W/(b r sin θ1) is 15 kPa at 90 N and 15 mm.
    assert set(usual["stress_kPa"]) == {20.0}


def test_the_pivot_stays_within_the_stresses_of_the_window(windows):
    run, cut = windows
    table = terrain.estimate(cut)
    stress = strength.mean_stress(run.load, run.sinkage, GEOMETRY["radius"], GEOMETRY["width"]) / 1e3
    for row, applied in zip(table.itertuples(), stress, strict=True):
        assert applied.min() <= row.sigma_star_kPa <= applied.max()
        line = row.c_kPa + row.sigma_star_kPa * math.tan(math.radians(row.phi_deg))
        assert row.strength_kPa == pytest.approx(line)


def test_the_error_of_a_strength_is_that_of_the_covariance(windows):
    _, cut = windows
    for row in terrain.estimate(cut).itertuples():
        slope = math.radians(row.phi_se_deg) / math.cos(math.radians(row.phi_deg)) ** 2
        a = np.array([1.0, row.stress_kPa * slope / row.c_se_kPa]) * row.c_se_kPa
        variance = a @ np.array([[1.0, row.corr_c_phi], [row.corr_c_phi, 1.0]]) @ a
        assert row.strength_at_stress_se_kPa == pytest.approx(math.sqrt(variance), rel=1e-6)
