"""How often chance gives a gain, or leaves steady points as smooth along their slip; and how large it is."""

from types import SimpleNamespace

import numpy as np
import pytest
from hidden_drives import Kind, sized, windows_of
from scipy import stats

from terrain_cli.comparison.residual_noise import between
from terrain_cli.diagnosis import diagnose, refits
from terrain_cli.diagnosis.alarm import (
    missing_effects,
    of_fitted_gain,
    of_gain,
    of_gain_in_most,
    of_points,
    printed_shares,
)
from terrain_cli.diagnosis.diagnosed_log import Case, scores, soils
from terrain_cli.diagnosis.diagnosis_outcome import Alarm
from terrain_cli.models import ModelFile


def along(n, loads=1):
    slip, load = np.tile(np.linspace(0.0, 0.6, n), loads), np.repeat(0.5 * np.arange(loads), n)
    return between(np.zeros(n * loads, dtype=np.intp), np.stack([slip, load], axis=1))


def test_noise_is_as_smooth_as_chance_says():
    """Of 400 tables of white noise a tenth falls below 0.1, whatever the channels have in common."""
    rng = np.random.default_rng(7)
    found = []
    for _ in range(400):
        shared = rng.normal(size=(7, 1))
        found.append(of_points(shared + rng.normal(size=(7, 3)), along(7), 0))
    assert np.mean(np.array(found) < 0.1) == pytest.approx(0.1, abs=0.045)


def test_six_points_that_rise_are_no_chance():
    rising = np.array([-5.0, -4.0, -1.0, 1.0, 3.0, 6.0])[:, None]
    # Two orders of 720 rise or fall all along.
    assert of_points(rising, along(6), 0) == pytest.approx(2.0 / 720.0, abs=0.004)
    assert of_points(rising[[2, 0, 4, 1, 5, 3]], along(6), 0) > 0.2


def test_five_points_are_too_few_at_any_size():
    assert of_points(np.linspace(-1e3, 1e3, 5)[:, None], along(5), 0) > 0.01


def test_each_load_has_a_level_of_its_own():
    """What differs between loads alone is no slope along the slip."""
    rng = np.random.default_rng(8)
    levels = np.repeat([0.0, 50.0], 6)[:, None]
    assert of_points(levels + rng.normal(size=(12, 1)), along(6, 2), 0) > 0.05
    slopes = np.tile(np.linspace(-1.0, 1.0, 6), 2)[:, None]
    assert of_points(levels + slopes + 0.1 * rng.normal(size=(12, 1)), along(6, 2), 0) < 0.005


def test_six_blocks_that_all_gain_are_no_chance_though_one_gains_most():
    gain = np.array([28.0, 26.0, 6.0, 5.0, 30.0, 119.0])
    # The t-test gives 0.046.
    assert of_gain(gain) == pytest.approx(1.0 / 64.0)
    assert of_gain(np.append(gain[:5], -119.0)) >= 0.5
    assert of_gain(np.array([5.0, 5.1, 4.9, 5.0, 5.0, 5.1])) < 1e-6


def test_many_blocks_are_judged_by_their_mean():
    gain = np.random.default_rng(3).normal(0.6, 1.0, 25)
    assert of_gain(gain) == pytest.approx(stats.ttest_1samp(gain, 0.0, alternative="greater").pvalue)


def test_blocks_that_nearly_all_gain_are_no_chance_though_one_gains_most():
    rng = np.random.default_rng(3)
    most = np.append(rng.normal(30.0, 20.0, 19), 4000.0)
    assert of_gain(most) > 0.1
    assert of_gain_in_most(most) < 1e-4
    # One that gains alone, where the others lose what a needless parameter costs, may be chance.
    assert of_gain_in_most(np.append(rng.normal(-1.0, 2.0, 19), 4000.0)) > 0.1


@pytest.mark.parametrize("gain", [[4.0], [0.0, 0.0, 0.0]])
def test_one_block_or_none_that_gains_proves_nothing(gain):
    assert of_gain(np.array(gain)) == of_gain_in_most(np.array(gain)) == 1.0


def test_soil_that_varies_along_the_drive_is_no_effect():
    """Scores are related for longer than a short stretch: with such ones, multi-pass raised an alarm."""
    found = diagnose(windows_of(78900031, Kind(noise="soil-unlabelled")), ModelFile(), seed=78900031)
    assert not found.alarm.raised
    assert found.alarm.p_value > 0.05


@pytest.mark.parametrize("seed", [1, 2])
def test_what_a_large_effect_leaves_to_first_order_is_no_soil_that_varies(seed):
    """It lasts as that does: blocks as long as passes had no score beyond chance."""
    drive = windows_of(seed, Kind(sized("multi-pass"), share=0.01, seconds=64.0))
    file = ModelFile()
    case = Case(file=file, effects=missing_effects(file), seed=0, progress=lambda _: None)
    found = scores(case, soils(case, drive)).found
    assert found.p_values["multi-pass"] < 0.001


@pytest.mark.parametrize(
    ("after", "shares"),
    [
        ({"torque": 0.4, "sinkage": 0.001}, {"torque": 0.3 / 5.0, "sinkage": 0.0}),
        # Sinkage is predicted a little better, and torque worse by more of its noise.
        ({"torque": 0.51, "sinkage": 0.00099}, {"torque": 0.0, "sinkage": 0.0}),
    ],
)
def test_what_lowers_no_printed_error_has_no_size(monkeypatch, after, shares):
    measured = {"torque": np.full(9, 5.0), "sinkage": np.full(9, 0.02)}
    levels = {"torque": 0.5, "sinkage": 0.001}
    wheel = SimpleNamespace(measured=measured, residuals=measured, levels=levels)
    errors = {id(wheel): {"torque": 0.5, "sinkage": 0.001}}
    monkeypatch.setattr(refits, "held_out_errors", lambda some, *_: errors.get(id(some[0]), after))
    assert printed_shares([wheel], [SimpleNamespace()], []) == pytest.approx(shares)


@pytest.mark.parametrize(("share", "small", "idle"), [(0.0, False, True), (0.002, True, False)])
def test_what_lowers_no_error_is_no_small_effect(share, small, idle):
    alarm = Alarm(raised=False, p_value=0.0005, level=0.01, share=share, smallest_share=0.003)
    assert (alarm.small, alarm.idle) == (small, idle)


def test_a_form_of_a_law_that_gains_counts_though_the_plain_one_loses(monkeypatch):
    """A filter, where the wheel has one: a pure delay made every held-out error larger."""
    noise = np.random.default_rng(3).normal(size=20)
    losses = {None: 10.0 + noise, "delay": 20.0 - noise, "filter": 5.0 - noise}
    monkeypatch.setattr(refits, "refit", lambda _, one: SimpleNamespace(loss=losses[one]))
    monkeypatch.setattr(refits, "with_noise_of", lambda data, _: data)
    p_value, form = of_fitted_gain(None, SimpleNamespace(forms=("delay", "filter")))
    assert (form, p_value < 0.01) == ("filter", True)
    p_value, _ = of_fitted_gain(None, SimpleNamespace(forms=("delay",)))
    assert p_value > 0.01
