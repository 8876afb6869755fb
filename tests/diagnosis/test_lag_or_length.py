"""A lag in time and one in distance: at one speed nobody can tell them apart, at several anybody can."""

import math

import numpy as np
import pytest
from hidden_drives import Kind, Rover, sized, windows_of

from terrain_cli import effects
from terrain_cli.diagnosis import diagnose
from terrain_cli.improvement import change_trial
from terrain_cli.models import ModelFile

LAG = {"sensor-lag": {"sinkage_lag": 0.5}}
ROLLS_ON = sized("sinkage-relaxation")
AMONG = [effects.find(name) for name in ("sensor-lag", "sinkage-relaxation", "sinkage-bias")]
SEED = 42000001


def found(hidden, course):
    return diagnose(windows_of(SEED, Kind(hidden, course=course, seconds=64.0)), ModelFile(), effects=AMONG)


@pytest.mark.parametrize(("hidden", "name"), [(LAG, "sensor-lag"), (ROLLS_ON, "sinkage-relaxation")])
def test_told_apart_where_the_speed_varies(hidden, name):
    diagnosis = found(hidden, "rich")
    assert (diagnosis.verdict, diagnosis.effect) == ("effect", name)


def test_a_lag_whose_size_follows_the_speed_is_none():
    """What stands in for a distance that no effect of the catalogue has is longer where the wheel is slow."""
    windows = windows_of(SEED, Kind(ROLLS_ON, seconds=96.0))
    diagnosis = diagnose(windows, ModelFile(), effects=AMONG[::2])
    assert (diagnosis.verdict, diagnosis.family) == ("family", ("sensor-lag",))


def test_at_one_speed_a_family_and_the_drive_at_several():
    diagnosis = found(LAG, "poor-speed")
    assert diagnosis.verdict == "family"
    assert {*diagnosis.family} == {"sensor-lag", "sinkage-relaxation"}
    (drive,) = diagnosis.next_drive
    assert drive.power > 0.9
    assert len(drive.settings["speed"]["steps"]) > 2


@pytest.mark.parametrize("form", ["catalogue", "other"])
@pytest.mark.parametrize("channel", ["torque", "sinkage"])
def test_a_lag_is_found_with_its_size(channel, form):
    """A pure delay, and a first-order filter: as a rate, half of the first was found."""
    hidden = {"sensor-lag": {f"{channel}_lag": 0.4, "form": form}}
    windows = windows_of(SEED, Kind(hidden, course="rich", seconds=64.0))
    candidates = diagnose(windows, ModelFile(), effects=AMONG).candidates
    found = next(one for one in candidates if one.effect == "sensor-lag")
    assert found.sizes[f"{channel}_lag"].value == pytest.approx(0.4, rel=0.15)


def rough_load(seed):
    """Return a load that wanders by 15 % within 0.15 s."""
    steps, kept = 2_000, math.exp(-0.05 / 0.15)
    away = np.zeros(steps)
    for step, new in enumerate(np.random.default_rng(seed).normal(size=steps - 1), start=1):
        away[step] = kept * away[step - 1] + math.sqrt(1.0 - kept**2) * new
    away = np.clip(1.0 + 0.15 * away, 0.5, 1.6)
    return lambda t: np.interp(t, 0.05 * np.arange(steps), away)


@pytest.mark.parametrize("hidden", [{"sensor-lag": {"torque_lag": 0.3}}, {}])
def test_a_lag_under_a_load_that_changes_faster_is_no_noise(hidden):
    """What it leaves changes as fast as noise."""
    kind = Kind(hidden, seconds=64.0, share=0.01, rover=Rover(rough=rough_load(1)))
    windows, file = windows_of(SEED, kind), ModelFile()
    told = change_trial.compared(windows, file).scores()
    diagnosis = diagnose(windows, file)
    assert told.raised == diagnosis.alarm.raised == bool(hidden)
    if hidden:
        assert told.effects[0] == "sensor-lag"
        assert (diagnosis.verdict, diagnosis.effect) == ("effect", "sensor-lag")
        lag = diagnosis.candidates[0].sizes["torque_lag"]
        assert lag.value == pytest.approx(0.3, abs=0.01)
