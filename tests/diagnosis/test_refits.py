"""What an effect leaves on held-out blocks, as `compare` has it."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from hidden_drives import Kind, Rover, sized, windows_of

import terrain_cli as terrain
from terrain_cli import effects
from terrain_cli.comparison.fitted_wheel import FittedWheel
from terrain_cli.diagnosis import diagnose, refit_ranking, refits
from terrain_cli.estimation.estimators import FitSettings
from terrain_cli.mechanics.wheel_model import Model
from terrain_cli.models import ModelFile

LAGS = ("torque_lag", "drawbar_pull_lag", "sinkage_lag")


@pytest.fixture(scope="module")
def wheel():
    (windows,) = windows_of(9_600_001, Kind(seconds=32.0), "none")
    return FittedWheel(windows, Model(), FitSettings({"shear_modulus": 0.018}, {}, (), None))


def test_a_right_model_leaves_the_noise_also_of_a_channel_of_which_no_level_is_known(wheel):
    block = np.arange(len(wheel)) * 8 // len(wheel)
    levels = {name: wheel.noise[name].deviation for name in ("torque", "drawbar_pull")}
    found = refits.held_out_errors([wheel], [block], levels)
    assert found.keys() == wheel.measured.keys() > levels.keys()
    for name, error in found.items():
        assert error == pytest.approx(wheel.noise[name].deviation, rel=0.1)


@pytest.mark.parametrize("seconds", [16.0, 32.0])
def test_a_model_that_predicts_nothing_where_its_fit_ended_at_first_is_compared(seconds):
    wrong = Model(effects=tuple(effects.find(name) for name in ("gear-efficiency", "flexible-wheel")))
    windows = windows_of(2, Kind(sized("bulldozing"), seconds=seconds))
    errors = terrain.compare(windows, ModelFile(model=wrong)).found.channels
    assert errors.keys() == {"torque", "drawbar_pull", "sinkage"}
    assert all(np.isfinite(one.rmse) for one in errors.values())


def over_rough_ground(seed, seconds, hidden):
    """Return the windows of a drive whose load is another one from sample to sample, by 15 %."""
    kind = Kind(hidden, share=0.01, seconds=seconds)
    away = 1.0 + 0.15 * np.random.default_rng(seed).standard_normal(int(seconds * kind.rate) + 1).clip(-3, 3)
    rough = Rover(rough=lambda t: np.interp(t, np.arange(len(away)) / kind.rate, away))
    return windows_of(seed, replace(kind, rover=rough), "none")


@pytest.mark.parametrize("seed", [1, 2])
def test_a_load_that_changes_from_sample_to_sample_is_no_noise(seed):
    """Interpolated from its neighbours it left seven to ten times the noise."""
    (windows,) = over_rough_ground(seed, 32.0, {})
    wheel = FittedWheel(windows, Model(), FitSettings({"shear_modulus": 0.018}, {}, (), None))
    data = refits.ground([wheel], [np.arange(len(wheel)) // 40], 3_000)
    left = data.data[0].white.undone(data.base[0].residual, data.data[0].seen)
    for name, error in left.items():
        assert float(np.std(error)) < 1.5 * wheel.noise[name].deviation


def with_lags(windows, **held):
    """Fit a model with late sensors, and some of their parameters held."""
    fixed = {"shear_modulus": 0.018, **{f"sensor-lag.{name}": value for name, value in held.items()}}
    late = Model(effects=(effects.find("sensor-lag"),))
    return FittedWheel(windows, late, FitSettings(fixed, {}, (), None))


@pytest.mark.parametrize("filtered", [0.0, 1.0])
def test_a_lag_that_is_none_is_told_on_rough_ground(filtered):
    """By steady inputs alone it was off by half a sample, and doubled the errors of all channels."""
    (windows,) = over_rough_ground(1, 32.0, {})
    wheel, late = with_lags(windows, **dict.fromkeys(LAGS, 0.0)), with_lags(windows, filtered=filtered)
    block = [np.arange(len(wheel)) // 40]
    before, after = (refits.held_out_errors([one], block, wheel.levels) for one in (wheel, late))
    assert all(after[name] < 1.02 * error for name, error in before.items())


@pytest.mark.parametrize("filtered", [0.0, 1.0])
def test_a_lag_takes_no_noise_off(wheel, filtered):
    """Torque and pull predicted from the sinkage as measured have its noise, and less of it if filtered."""
    late = with_lags(
        wheel.windows, torque_lag=0.025, drawbar_pull_lag=0.025, sinkage_lag=0.0, filtered=filtered
    )
    for name in ("torque", "drawbar_pull"):
        assert np.std(late.residuals[name]) > 0.995 * np.std(wheel.residuals[name])


def test_a_lag_is_no_smaller_than_quick_changes_show():
    """Predicted from an interpolated load it took a quarter of what it truly takes."""
    late, true = (over_rough_ground(2, 64.0, effects) for effects in (sized("sensor-lag", form="other"), {}))
    shown, torque = (one.samples.channels["torque"] for (one,) in (late, true))
    found = diagnose(late, ModelFile())
    assert found.alarm.raised
    size = float(np.sqrt(np.mean((shown - torque) ** 2) / np.mean(shown**2)))
    # No more than all that the model leaves: the lag leads the soil astray that is fitted without it, too.
    assert 0.5 * size < found.alarm.share < found.comparison.channels["torque"].nrmse


def test_of_models_that_predict_the_same_none_is_better():
    """However sure the difference is: it is that of where two searches ended."""
    worse, same, better = (SimpleNamespace(loss=np.full(40, 190.0) + more) for more in (0.0, -0.001, -1.0))
    assert not refit_ranking.beats(same, worse)
    assert refit_ranking.beats(better, worse)
