"""Cuts that one soil explains as well: what `estimate` takes back, and what all verbs then say."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from known_misfits import Kind, windows_of

import terrain_cli as terrain
from terrain_cli import effects
from terrain_cli.comparison.compare import needed_segments
from terrain_cli.estimation import estimators
from terrain_cli.mechanics.wheel_model import Model
from terrain_cli.models import ModelFile
from terrain_cli.windows.joined_inputs import with_inputs

FULL = estimators.full_model()
FRICTION = {"drivetrain-friction": {"Tc": 0.5, "Bv": 0.1}}


@cache
def drive(*, missing=True):
    """Return a drive over one soil, with friction of which the model does not know or without."""
    return windows_of(3, Kind(effects=FRICTION if missing else {}), "none")


def cut_in(windows, parts, *, by_soil=True):
    bounds = np.linspace(0, len(windows.rows), parts + 1).astype(np.intp)
    return replace(windows, bounds=bounds, by_soil=by_soil)


def estimated(windows):
    return estimators.estimate(windows, "auto", FULL, needed=needed_segments)


def test_false_cuts_are_taken_back_where_the_model_misses():
    found, whole = estimated(cut_in(drive(), 4)), estimated(drive())
    assert len(found.windows) == 1
    assert "ok" not in found.estimates.status
    np.testing.assert_allclose(found.estimates.c, whole.estimates.c, rtol=1e-9)
    (told,) = [one for one in found.windows.samples.remarks if "one soil predicts as well" in one]
    assert "each of 4 segments" in told


def test_cuts_that_hide_an_effect_are_taken_back():
    """Each pass on a soil of its own leaves nothing to the effect of passes."""
    file = ModelFile(model=Model("wong-reece", (effects.find("multi-pass"),)))
    whole = windows_of(3, Kind(effects={"multi-pass": {"stiffness_gain": 0.6}}), "none")
    (windows,) = with_inputs([cut_in(whole, 8)], file.model.effects)
    hidden = estimators.estimate(windows, "auto", file)
    found = estimators.estimate(windows, "auto", file, needed=needed_segments)
    gain = "multi-pass.stiffness_gain"
    assert (len(hidden.windows), hidden.common.determined(gain)) == (8, False)
    assert (len(found.windows), found.common.determined(gain)) == (1, True)
    assert found.common.values[gain] == pytest.approx(0.6, abs=3.0 * found.common.errors[gain])


@pytest.mark.parametrize(
    ("windows", "why"),
    [
        (cut_in(drive(), 4, by_soil=False), "cut as somebody asked"),
        (cut_in(drive(missing=False), 4), "nothing is missing"),
    ],
    ids=lambda one: one if isinstance(one, str) else "",
)
def test_other_cuts_stay(windows, why):
    assert len(estimated(windows).windows) == 4, why


def test_soils_that_differ_stay():
    windows = windows_of(3, Kind(effects=FRICTION, two=True))
    assert len(windows) > 1
    assert len(needed_segments(windows, FULL)) == len(windows)


def test_a_drive_that_breaks_off_stays_in_pieces():
    windows = drive()
    samples, half = windows.samples, len(windows.rows) // 2
    stretch = np.where(np.arange(len(samples)) < windows.rows[half], 0, 1)
    broken = replace(cut_in(windows, 4), samples=replace(samples, stretch=stretch, drive=None))
    assert needed_segments(broken, FULL).bounds.tolist() == [0, half, len(windows.rows)]


def test_every_verb_has_the_same_segments():
    windows = cut_in(drive(), 4)
    table = terrain.estimate(windows)
    found = terrain.compare(windows)
    assert len(table) == 1
    assert len(found.segments) == 1
    np.testing.assert_allclose(found.segments["c_kPa"], table["c_kPa"], rtol=1e-9)
    step = terrain.add_effect(terrain.ModelFile(), "drivetrain-friction", windows)
    assert step.pays
