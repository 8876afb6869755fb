"""A lag in time and one in distance: at one speed nobody can tell them apart, at several anybody can."""

import numpy as np
import pandas as pd
import pytest
from hidden_drives import Kind, sized, windows_of
from simulator import CHANNELS, DRY_SAND, Drive, Sensor, Track, Wheel, base_contact, simulate

import terrain_cli as terrain
from terrain_cli import effects
from terrain_cli.diagnosis import diagnose
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


def wandering(mean, spread, rng):
    """Return a course that forgets within a second, as a load on stones does."""
    values = np.zeros(900)
    for j in range(1, len(values)):
        values[j] = 0.9 * values[j - 1] + np.sqrt(1.0 - 0.9**2) * rng.normal()
    return lambda t: mean * (1.0 + spread * np.interp(t, 0.1 * np.arange(len(values)), values))


def test_a_lag_shows_where_load_and_slip_change_within_it(tmp_path):
    """Its trace near zero is then that of noise, and all that it leaves passed for noise."""
    rng = np.random.default_rng(5)
    course = wandering(80.0, 0.2, rng), wandering(0.35, 0.3, rng)
    drive = Drive(
        [Track("wheel", [(base_contact(DRY_SAND), 80.0)], *course)],
        Wheel(0.125, 0.1),
        lambda t: 0.07 + 0.0 * t,
        rate=20.0,
        sensors=dict.fromkeys(("load", "torque", "sinkage", "slip"), Sensor(relative=0.02)),
        channels=(*CHANNELS, "slip"),
        seed=5,
    )
    table = simulate(drive).wheels["wheel"].aligned()
    time = table["time"]
    frame = pd.DataFrame(table | {"torque": np.interp(time - 0.3, time, table["torque"])})
    rover = tmp_path / "rover.toml"
    rover.write_text("[wheel]\nradius = 0.125\nwidth = 0.1\n[soil]\nshear_modulus = 0.018\n")
    windows = [terrain.segment(one) for one in terrain.from_frame(frame, rover)]
    found = diagnose(windows, ModelFile(), effects=AMONG)
    assert (found.verdict, found.effect) == ("effect", "sensor-lag")
    (lag,) = (one.sizes["torque_lag"] for one in found.candidates if one.effect == "sensor-lag")
    assert lag.value == pytest.approx(0.3, abs=0.03)
