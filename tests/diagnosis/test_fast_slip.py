"""Slip that changes fast, under noise that lasts: over how wide a gap a fitted wheel interpolates it."""

from dataclasses import replace

import numpy as np
import pytest
from hidden_drives import Kind, Rover, windows_of
from simulator import SOILS, Wheel

from terrain_cli.comparison.compare import fit_wheels
from terrain_cli.estimation.estimators import FitSettings
from terrain_cli.mechanics.wheel_model import Model

#: A wheel on which 5 % of its radius make a misfit that lasts longer than the noise.
ROVER = Rover(
    wheel=Wheel(radius=0.3, width=0.25, grouser_height=0.024, grouser_count=12),
    load=600.0,
    speed=0.168,
    soils=2 * (replace(SOILS["LETE sand"], shear_modulus=0.01),),
)
WRONG_RADIUS = {"wheel-radius": {"relative_error": 0.05}}


@pytest.mark.parametrize("effects", [{}, WRONG_RADIUS], ids=["nothing", "wrong radius"])
def test_slip_that_changes_fast_is_there_under_noise_and_misfits_that_last(effects):
    kind = Kind(effects, noise="ar1", share=0.03, soils=1, rover=ROVER)
    (wheel,), _ = fit_wheels(windows_of(78501606, kind, "none"), Model(), FitSettings({}, {}, (), None))
    channels = wheel.smoothed(wheel.gaps, np.arange(len(wheel)))
    slip, known = wheel.channels["slip"], np.isfinite(channels["slip"])
    off = float(np.std(channels["slip"][known] - slip[known]))
    assert off < 0.2 * float(np.std(slip))
    assert wheel.gaps["slip"] < wheel.memory


def test_white_noise_is_left_out_by_the_next_samples():
    (wheel,), _ = fit_wheels(
        windows_of(5, Kind({}, noise="white", soils=1), "none"), Model(), FitSettings({}, {}, (), None)
    )
    assert wheel.memory == max(wheel.gaps.values()) == 0


def test_a_load_that_hardly_varies_is_told_by_farther_samples_than_slip():
    """Its neighbours share its noise for as long as that lasts, and tell nothing else."""
    kind = Kind({}, course="poor-load", noise="ar1", share=0.03, soils=1, rover=ROVER)
    (wheel,), _ = fit_wheels(windows_of(78501607, kind, "none"), Model(), FitSettings({}, {}, (), None))
    assert wheel.gaps["load"] > wheel.gaps["slip"]
    narrow = dict.fromkeys(wheel.gaps, wheel.gaps["slip"])
    own, shared = (_alike(wheel, wheel.interpolated(gaps)["load"]) for gaps in (wheel.gaps, narrow))
    assert abs(own) < 0.5 * abs(shared)


def _alike(wheel, load):
    left = wheel.residuals["sinkage"]
    known = np.isfinite(load) & np.isfinite(left)
    return np.corrcoef(load[known], left[known])[0, 1]
