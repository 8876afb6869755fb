"""Rows of drives in which the sinkage is late: right, and not missed, whatever the load does."""

import math

import numpy as np
import pandas as pd
import pytest
from simulator import CHANNELS, DRY_SAND, Drive, Sensor, Track, Wheel, base_contact, simulate, undulation

import terrain_cli as terrain
from terrain_cli.effects import find
from terrain_cli.estimation import estimators
from terrain_cli.mechanics.wheel_model import Model

ROVER = "[wheel]\nradius = 0.125\nwidth = 0.1\n[soil]\nshear_modulus = 0.018\n"
LAG = {"sensor-lag": {"sinkage_lag": 0.4, "filtered": 1.0}}
LENGTH = {"sinkage-relaxation": {"length": 0.05}}
HIDDEN = {"drawbar-bias": {"offset": 4.0}}


def load(rough, seed):
    """Return a load that wanders by this share within 0.6 s."""
    steps, kept = 1_000, math.exp(-0.1 / 0.6)
    away = np.zeros(steps)
    for step, new in enumerate(np.random.default_rng(seed).normal(size=steps - 1), start=1):
        away[step] = kept * away[step - 1] + math.sqrt(1.0 - kept**2) * new
    even = undulation(60.0, 0.1, 7.0, seed)
    return lambda t: even(t) * np.interp(t, 0.1 * np.arange(steps), 1.0 + rough * away)


def estimated(tmp_path, effects, rough, seed=7):
    (late,) = [find(name) for name in effects if name not in HIDDEN]
    soil = [(base_contact(DRY_SAND), 100.0)]
    noisy = dict.fromkeys(("load", "torque", "sinkage", "slip"), Sensor(relative=0.01))
    drive = Drive(
        [Track("wheel", soil, load(rough, seed), undulation(0.3, 0.8, 9.0, seed + 1))],
        Wheel(0.125, 0.1),
        undulation(0.07, 0.2, 11.0, seed),
        effects=effects,
        rate=10.0,
        sensors={**noisy, "drawbar_pull": Sensor(absolute=0.2)},
        channels=(*CHANNELS, "slip", "drawbar_pull"),
        seed=seed,
    )
    (tmp_path / "rover.toml").write_text(ROVER)
    frame = pd.DataFrame(simulate(drive).wheels["wheel"].aligned())
    (samples,) = terrain.from_frame(frame, tmp_path / "rover.toml")
    fixed = {"sensor-lag.filtered": 1.0} if late.id == "sensor-lag" else {}
    file = terrain.ModelFile(model=Model("wong-reece", (late,)), fixed=fixed)
    return estimators.estimate(terrain.segment(samples, "none"), "auto", file)


@pytest.mark.parametrize("rough", [0.0, 0.1])
@pytest.mark.parametrize("effects", [LAG, LENGTH])
def test_a_row_is_right_and_ok(tmp_path, effects, rough):
    row = estimated(tmp_path, effects, rough).estimates
    assert row.status[0] == "ok"
    assert abs(row.c[0] - DRY_SAND.cohesion) < 3.0 * row.c_se[0]
    assert abs(row.phi[0] - DRY_SAND.friction_angle) < 3.0 * row.phi_se[0]


def test_a_row_says_where_another_effect_is_missing_beside(tmp_path):
    assert estimated(tmp_path, {**LAG, **HIDDEN}, 0.1).estimates.status[0] != "ok"
