"""Steady test points of a rig, at several loads and slips and without a clock."""

from __future__ import annotations

import json
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from hidden_drives import FULL, SOILS, WHEEL, sized
from simulator import CHANNELS, FURTHER, Drive, Track, base_contact, constant, simulate

from terrain_cli import effects
from terrain_cli.diagnosis import screening

SLIPS = (0.05, 0.1, 0.2, 0.3, 0.4, 0.5, 0.65)
ROVER = (
    "[wheel]\nradius = 0.125\nwidth = 0.1\ngrouser_height = 0.01\ngrouser_count = 12\n"
    "[soil]\nshear_modulus = 0.018\n"
)


def table(effect, loads, repeats, seed=1):
    """Return what a rig measures: each load at each slip, a second long, and its middle."""
    settings = [(load, slip) for load in loads for slip in SLIPS]
    n = len(settings)

    def profile(column):
        values = np.array([setting[column] for setting in settings])
        return lambda t: values[np.clip(np.asarray(t, dtype=float).astype(int), 0, n - 1)]

    track = Track(
        "wheel",
        [(base_contact(SOILS[seed % 4]), float(n))],
        profile(0),
        profile(1),
        constant(0.0),
        constant(30.0),
    )
    level = constant(0.0)
    drive = Drive(
        [track],
        WHEEL,
        constant(0.07),
        level,
        level,
        level,
        effects=sized(effect) if effect else {},
        rate=10.0,
        channels=(*CHANNELS, *FURTHER),
        seed=seed,
    )
    truth = simulate(drive).wheels["wheel"].aligned()
    rows = np.tile([int(np.argmin(np.abs(truth["time"] - (j + 0.5)))) for j in range(n)], repeats)
    rng = np.random.default_rng(seed)
    noise = {"load": 0.01, "slip": 0.01, "torque": 0.03, "sinkage": 0.03}
    columns = {name: truth[name][rows] * (1.0 + s * rng.normal(size=len(rows))) for name, s in noise.items()}
    return pd.DataFrame(
        {
            "load_N": columns["load"],
            "slip": columns["slip"],
            "torque_Nm": columns["torque"],
            "sinkage_m": columns["sinkage"],
            "drawbar_pull_N": truth["drawbar_pull"][rows] + 0.45 * rng.normal(size=len(rows)),
        }
    )


@pytest.fixture
def asked(terrain_est_here, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "rover.toml").write_text(ROVER, "utf-8")

    def ask(command, *args, **kwargs):
        table(*args, **kwargs).to_csv(tmp_path / "rig.csv", index=False)
        done = terrain_est_here(command, "rig.csv", "--json", "-q")
        assert done.returncode == 0, done.stderr
        return json.loads(done.stdout)

    return ask


@pytest.mark.parametrize(
    ("effect", "repeats", "parameter", "size", "alike"),
    [
        ("slip-sinkage", 1, None, None, []),
        ("gear-efficiency", 2, "eta", 0.8, []),
        # On a wheel that is larger than told the shear surface lies further out too.
        ("grousers", 2, "lambda_s", 0.75, ["wheel-radius"]),
    ],
)
def test_an_effect_is_named_at_three_loads_repeated_or_not(asked, effect, repeats, parameter, size, alike):
    found = asked("diagnose", effect, (40.0, 60.0, 80.0), repeats)
    assert found["family"] == [effect, *alike]
    assert found["effect"] == (None if alike else effect)
    if parameter:
        estimated = found["candidates"][0]["parameters"][parameter]
        assert abs(estimated["value"] - size) < max(3.0 * estimated["se"], 0.05)


def test_a_name_may_leave_what_so_few_points_leave_by_chance(asked):
    """Fourteen points know an error and its noise to a third: 1.3 times the noise is no other effect."""
    assert asked("diagnose", "gear-efficiency", (40.0, 80.0), 1, seed=3)["effect"] == "gear-efficiency"


def test_grousers_whose_slip_is_that_of_their_tips_are_told_from_a_gear_by_a_wheel_that_brakes(
    asked, monkeypatch
):
    """What a gear takes of the torque it gives back there; a shear surface further out does not."""
    plain = table

    def of_tips(*args, **kwargs):
        found = plain(*args, **kwargs)
        rolled = np.where(found["slip"] >= 0.0, 1.0 - found["slip"], 1.0 / (1.0 + found["slip"]))
        rolled = rolled * WHEEL.radius / (WHEEL.radius + WHEEL.grouser_height)
        found["slip"] = np.where(rolled <= 1.0, 1.0 - rolled, 1.0 / rolled - 1.0)
        return found

    monkeypatch.setitem(FULL, "grousers", {"lambda_s": 1.0})
    monkeypatch.setitem(globals(), "table", of_tips)
    found = asked("diagnose", "grousers", (40.0, 60.0, 80.0), 2)
    assert (found["verdict"], found["effect"]) == ("family", None)
    assert {"grousers", "gear-efficiency"} <= set(found["family"])
    (drive,) = [one for one in found["next_drive"] if set(one["pair"]) == {"grousers", "gear-efficiency"}]
    assert min(drive["settings"]["slip"]) < 0.0 < max(drive["settings"]["slip"])
    monkeypatch.setitem(globals(), "SLIPS", (-0.2, -0.1, *SLIPS))
    # The law of the catalogue leaves a part of theirs: the one name is probable.
    assert asked("diagnose", "grousers", (40.0, 60.0, 80.0), 2)["family"] == ["grousers"]


@pytest.mark.parametrize("loads", [(60.0,), (40.0, 60.0, 80.0)], ids=["one load", "three loads"])
def test_nothing_is_missing_from_a_clean_table(asked, loads):
    found = asked("diagnose", None, loads, 2)
    assert (found["verdict"], found["alarm"]["raised"]) == ("none", False)


@pytest.mark.parametrize("seed", [1, 2])
def test_at_one_load_the_sinkage_is_seen_to_follow_slip(asked, seed):
    failures = asked("compare", "slip-sinkage", (60.0,), 3, seed=seed)["failures"]
    assert ("sinkage", "slip") in [(one["channel"], one["driver"]) for one in failures[:2]]


@pytest.mark.parametrize("time", [None, np.arange(3.0)])
def test_only_what_can_be_recorded_is_asked_for(time):
    """A rate of test points cannot; the slope of a rut is that of what is measured."""
    samples = SimpleNamespace(time=time, geometry=SimpleNamespace(grouser_count=0, grouser_height=0.0))
    channels = dict.fromkeys(("load", "torque", "sinkage", "slip"), np.ones(3))
    wheel = SimpleNamespace(windows=SimpleNamespace(samples=samples), channels=channels)
    names = ("load-transfer", "sinkage-relaxation", "sensor-lag", "acceleration-torque", "grousers")
    found = screening.unrecorded([effects.find(name) for name in names], [wheel])
    assert found == (
        *("drawbar_pull", "acceleration", "pitch"),
        *(() if time is None else ("velocity", "angular_velocity")),
    )
