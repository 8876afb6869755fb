"""Odd drives whose units are right raise no doubt."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from formats import Labels
from terrain_cli import telemetry

RADIUS = 0.125


def steady(**columns):
    """Return a drive of 100 s at 10 Hz that is right, but for what is given."""
    time = np.arange(1000) / 10.0
    rng = np.random.default_rng(0)
    noisy = 1.0 + 0.02 * rng.standard_normal((4, 1000))
    table = {
        "time": time,
        "load": 80.0 * noisy[0],
        "torque": 3.0 * noisy[1],
        "sinkage": 0.02 * noisy[2],
        "angular_velocity": np.ones(1000),
        "velocity": 0.7 * RADIUS * noisy[3],
    }
    return pd.DataFrame({name: column for name, column in {**table, **columns}.items() if column is not None})


NOISE = np.random.default_rng(1).standard_normal(1000)
TIMES = np.arange(1000) / 10.0
#: Odd drives whose units are right.
RIGHT = {
    "one load, one speed": steady(load=np.full(1000, 81.4), velocity=np.full(1000, 0.09)),
    "a slip of 0.9 all the time": steady(
        velocity=0.1 * RADIUS * (1.0 + 0.05 * NOISE), torque=5.0 + 0.1 * NOISE
    ),
    "stuck, spinning on the spot": steady(velocity=2e-4 * NOISE, torque=5.0 + 0.1 * NOISE),
    "dragged with its brake on": steady(angular_velocity=np.full(1000, 0.05), torque=-4.0 + 0.1 * NOISE),
    "towed": steady(velocity=RADIUS * 1.1 * (1.0 + 0.01 * NOISE), torque=0.2 * NOISE),
    "backwards": steady(
        angular_velocity=-np.ones(1000), velocity=np.full(1000, -0.09), torque=-3.0 + 0.1 * NOISE
    ),
    "firm ground": steady(load=500.0 + NOISE, torque=12.0 + NOISE / 10.0, sinkage=0.001 + 1e-5 * NOISE),
    "a sample every 20 s": steady(
        time=TIMES * 201.0, velocity=np.full(1000, 0.09), x=0.09 * TIMES * 201.0, y=0.0 * TIMES
    ),
    "standing for the most part": steady(
        angular_velocity=np.where(TIMES > 60.0, 1.0, 0.0), velocity=np.where(TIMES > 60.0, 0.09, 0.0)
    ),
    "turning on the spot": steady(x=2e-3 * NOISE, y=2e-3 * np.cos(TIMES), yaw_rate=np.full(1000, 0.3)),
    "a receiver that wanders": steady(
        longitude=8.0 + 4.0 * np.cumsum(NOISE) / 111_195.0 / 30.0, latitude=47.0 + 2.0 * NOISE / 111_195.0
    ),
    "metres of a map": steady(
        x=465_000.0 + 0.0875 * TIMES + 0.05 * NOISE, y=5_400_000.0 + np.cumsum(NOISE) / 30.0
    ),
    "an attitude from 0 to 2π": steady(pitch=(0.1 * np.sin(TIMES)) % (2.0 * np.pi)),
    "a few wild slips at standstill": steady(slip=np.where(TIMES < 5.0, 40.0, 0.3)),
    "a sinkage of whole millimetres": steady(sinkage=np.full(1000, 0.02), load=80.0 + 8.0 * NOISE),
    "grousers outside the radius": steady(slip=np.full(1000, 0.2), velocity=np.full(1000, RADIUS * 0.95)),
}  # fmt: skip


@pytest.mark.parametrize("name", RIGHT)
@pytest.mark.parametrize("whole", [False, True], ids=["line", "model"])
def test_an_odd_drive_is_not_doubted(name, whole, judged):
    options = {"effects": (), "compared": True} if whole else {}
    assert judged(RIGHT[name], **options) == []


def test_a_rover_of_one_kilogram_on_the_moon_is_not_doubted(judged):
    light = steady(
        load=0.4 + 0.01 * NOISE,
        torque=0.004 + 1e-4 * NOISE,
        sinkage=0.003 + 1e-5 * NOISE,
        velocity=np.full(1000, 0.7 * 0.03),
    )
    assert judged(light, "[wheel]\nradius = 0.03\nwidth = 0.03\n[soil]\nshear_modulus = 0.018\n") == []


def test_test_points_are_not_doubted(judged):
    slip = np.linspace(0.0, 0.9, 10)
    points = pd.DataFrame({"slip": slip, "load": 60.0, "torque": 0.2 + 4.0 * slip**0.5, "sinkage": 0.01})
    assert judged(points) == []


def test_the_samples_that_are_looked_at_are_bounded(monkeypatch):
    from terrain_cli.telemetry import unit_doubts

    monkeypatch.setattr(unit_doubts, "MOST", 64)
    drive = steady()
    channels = {name: drive[name].to_numpy() for name in drive if name != "time"}
    gathered = unit_doubts.UnitEvidence(telemetry.Geometry(RADIUS, 0.1, 0.018), {})
    for begin in range(0, 1000, 90):
        rows = slice(begin, begin + 90)
        part = telemetry.Samples(
            source="run",
            wheel="w",
            geometry=gathered.geometry,
            origin=0.0,
            time=TIMES[rows],
            channels={name: column[rows] for name, column in channels.items()},
            labels={},
            stretch=np.zeros(len(TIMES[rows]), dtype=np.intp),
            distance=None,
            set_aside=Labels(np.full(len(TIMES[rows]), -1, dtype=np.int32), ()),
        )
        gathered.add(part)
    (kept,) = gathered.columns("load")
    assert 32 <= len(kept) <= 64
    # Evenly spread: each is so many rows behind the one before.
    places = np.searchsorted(np.sort(channels["load"]), kept)
    assert len(np.unique(places)) == len(kept)
    assert gathered.count == 1000
    assert gathered.ends["load"] == (channels["load"].min(), channels["load"].max())
