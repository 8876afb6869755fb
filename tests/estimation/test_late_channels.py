"""Where a search for lags begins."""

import numpy as np
import pandas as pd
import pytest
from wheel_samples import WHEEL, free

import terrain_cli as terrain
from terrain_cli import effects
from terrain_cli.estimation.wheel_fit import fitting
from terrain_cli.estimation.wheel_fit.late_channels import nearest_lags, nothing_late
from terrain_cli.mechanics.past import along
from terrain_cli.mechanics.wheel_model import Model

SAMPLES = 1200
TIME = 0.05 * np.arange(SAMPLES)
SPEED = 0.1 + 0.04 * np.sin(0.7 * TIME)
LAG, FILTERED = "sensor-lag.torque_lag", "sensor-lag.filtered"


def model(name="sensor-lag"):
    return Model("wong-reece", (effects.find(name),))


def past(predicted):
    return along(TIME, np.zeros(SAMPLES, dtype=int), SPEED, {"torque": predicted, "sinkage": predicted})


def filtered(true, samples):
    kept, shown = np.exp(-1.0 / samples), true.copy()
    for k in range(1, SAMPLES):
        shown[k] = kept * shown[k - 1] + (1.0 - kept) * true[k]
    return shown


@pytest.mark.parametrize(
    ("held", "late", "close"),
    [({}, 12, 1e-9), ({}, -9, 1e-9), ({LAG: 0.0}, 12, 0.0), ({FILTERED: 1.0}, 12, 0.16)],
)
def test_a_lag_is_found_where_every_sample_differs(held, late, close):
    rng = np.random.default_rng(3)
    true = rng.normal(size=SAMPLES)
    shown = filtered(true, late) if FILTERED in held else np.roll(true, late)
    shown += 0.1 * rng.normal(size=SAMPLES)
    # Wild samples, and one that is not known.
    shown[::97], shown[5] = 30.0, np.nan
    measured = {"torque": shown, "sinkage": true + 0.1 * rng.normal(size=SAMPLES)}
    found = nearest_lags(model(), past(true), measured, held)
    assert found.pop("sensor-lag.sinkage_lag") == 0.0
    assert found == ({} if LAG in held else {LAG: pytest.approx(0.05 * late, abs=close)})


def test_a_lag_on_the_way_is_found_as_a_length():
    way = np.cumsum(SPEED * 0.05)

    def rut(place):
        return np.sin(40.0 * place) + 0.3 * np.sin(97.0 * place)

    _, placed = effects.find("sinkage-relaxation").forms
    said = nearest_lags(Model("wong-reece", (placed,)), past(rut(way)), {"sinkage": rut(way - 0.02)}, {})
    assert said == {"sinkage-relaxation.length": pytest.approx(0.02, abs=0.003)}


def test_where_nothing_changes_no_lag_is_nearer_than_none():
    rng = np.random.default_rng(4)
    steady = np.ones(SAMPLES)
    measured = {name: steady + rng.normal(size=SAMPLES) for name in ("torque", "sinkage")}
    slowly = past(1.0 + 0.01 * np.sin(0.1 * TIME))
    assert set(nearest_lags(model(), slowly, measured, {}).values()) == {0.0}
    assert not any(nearest_lags(model(), past(steady), measured, {}).values())
    assert not any(nearest_lags(model(), slowly, {"torque": np.full(SAMPLES, np.nan)}, {}).values())
    assert nearest_lags(model(), {}, measured, {}) == {}


def test_without_a_past_nothing_is_late():
    channels = {"torque": np.ones(SAMPLES)}
    held = nothing_late(model(), channels)
    assert set(held.values()) == {0.0}
    assert {LAG, FILTERED} < held.keys()
    assert nothing_late(model(), {**channels, **past(np.ones(SAMPLES))}) == {}
    assert nothing_late(model("slip-sinkage"), channels) == {}


def test_the_last_of_several_fits_alone_has_the_errors_of_learnt_noise(tmp_path, monkeypatch):
    truth = free(1, 300, 11)
    (tmp_path / "rover.toml").write_text(
        f"[wheel]\nradius = {WHEEL.radius}\nwidth = {WHEEL.width}\n[soil]\nshear_modulus = 0.02\n"
    )
    frame = pd.DataFrame(truth.measured(3, 0.01) | {"time": 0.1 * np.arange(300)})
    (samples,) = terrain.from_frame(frame, tmp_path / "rover.toml")
    windows = terrain.segment(samples, "none")
    count, fits = [], []
    widened, fitted = fitting.widened, fitting._fitted
    monkeypatch.setattr(fitting, "widened", lambda *of: count.append(1) or widened(*of))
    monkeypatch.setattr(fitting, "_fitted", lambda *of, **how: fits.append(1) or fitted(*of, **how))
    late = terrain.ModelFile(model=model())
    found = terrain.estimate(windows, model=late)
    assert len(fits) > 2
    assert len(count) == 1
    assert abs(found["phi_deg"][0] - np.degrees(truth.phi[0])) < 3.0 * found["phi_se_deg"][0]
