from dataclasses import replace

import numpy as np
import pytest
from known_misfits import Kind, windows_of

from terrain_cli.comparison import held_out
from terrain_cli.comparison.fitted_wheel import FittedWheel
from terrain_cli.effects import catalogue
from terrain_cli.estimation import prediction
from terrain_cli.estimation.estimators import FitSettings
from terrain_cli.estimation.wheel_fit import fit
from terrain_cli.mechanics.effect import Effect, Parameter
from terrain_cli.mechanics.wheel_model import Model, WheelGeometry

SETTINGS = FitSettings({}, {}, (), None)


def test_blocks_are_left_out_and_parts_of_a_window_that_is_one_block():
    window = np.repeat([0, 1], [30, 20])
    block = np.repeat([0, 1, 2], [10, 20, 20])
    fold = held_out.folds(window, block)
    assert [len(np.unique(fold[part])) for part in (slice(0, 10), slice(10, 30), slice(30, 50))] == [1, 1, 4]
    assert np.unique(np.bincount(fold)).tolist() == [5, 10, 20]


def test_leaving_a_block_out_of_what_the_data_hardly_tell_costs_hardly_anything():
    """The effect is not there, and the soil imitates it: no fit without a block would predict worse."""
    windows = windows_of(3, Kind(), "none")
    block = np.arange(len(windows.rows)) // 160
    plain = FittedWheel(windows, Model(), SETTINGS)
    scale = {name: level.deviation for name, level in plain.noise.items()}
    for effect in ("crust", "shear-modulus", "post-peak-softening"):
        wheel = FittedWheel(windows, Model(effects=(catalogue()[effect],)), SETTINGS)
        out = held_out.predict(wheel, block, scale)
        for name, measured in wheel.measured.items():
            held = np.sqrt(np.nanmean((measured - out[name]) ** 2))
            fitted = np.sqrt(np.nanmean(wheel.residuals[name] ** 2))
            assert held < 1.1 * fitted, (effect, name)


def test_along_a_curved_valley_the_linear_prediction_is_taken():
    fold = np.repeat([0, 1], 50)
    little, much = {"torque": np.full(100, 0.1)}, {"torque": np.where(fold == 0, 3.0, 0.05)}
    np.testing.assert_array_equal(held_out.nearer(little, much, fold), fold == 0)


def test_one_step_is_near_a_fit_without_the_block():
    windows = windows_of(3, Kind(), "none")
    block = np.arange(len(windows.rows)) // 320
    wheel = FittedWheel(windows, Model(), SETTINGS)
    scale = {name: level.deviation for name, level in wheel.noise.items()}
    out = held_out.predict(wheel, block, scale)
    for left in (0, 4):
        kept = block != left
        refitted = fit(
            Model(),
            wheel.geometry,
            {name: column[kept] for name, column in wheel.channels.items()},
            [0, kept.sum()],
            noise=wheel.fit.noise,
        )
        values = {name: column[0] for name, column in refitted.values.items()}
        expected = prediction.values(
            Model(),
            wheel.geometry,
            {name: column[~kept] for name, column in wheel.channels.items()},
            lambda rows, values=values: {name: np.full(len(rows), v) for name, v in values.items()},
        )
        for name, deviation in scale.items():
            assert np.abs(out[name][~kept] - expected[name]).max() < 0.1 * deviation


def test_heldout_errors_are_larger_where_a_window_is_short():
    windows = windows_of(3, Kind(), "none")
    short = replace(windows, bounds=np.arange(0, len(windows.rows) + 1, 40))
    wheel = FittedWheel(short, Model(), SETTINGS)
    block = np.arange(len(windows.rows)) // 40
    out = held_out.predict(wheel, block, {name: level.deviation for name, level in wheel.noise.items()})
    inside = np.sqrt(np.nanmean(wheel.residuals["torque"] ** 2))
    outside = np.sqrt(np.nanmean((wheel.measured["torque"] - out["torque"]) ** 2))
    assert inside < outside < 2.0 * inside


def test_derivatives_are_those_of_the_predictions():
    windows = windows_of(3, Kind(), "none")
    wheel = FittedWheel(windows, Model(), SETTINGS)
    rows = np.arange(0, len(windows.rows), 97)
    # On the model's own surface, where the sinkage measured is the one predicted.
    channels = {name: column[rows] for name, column in wheel.channels.items()}
    channels["sinkage"] = wheel.predicted["sinkage"][rows]
    names = wheel.soil
    table = prediction.derivatives(
        Model(), wheel.geometry, channels, lambda some: wheel.of_samples(rows[some]), names
    )
    for column, name in enumerate(names):

        def moved(by, name=name):
            def parameters(some):
                found = wheel.of_samples(rows[some])
                return {**found, name: found[name] * (1.0 + by)}

            return prediction.values(Model(), wheel.geometry, channels, parameters)

        up, down = moved(1e-4), moved(-1e-4)
        step = 2e-4 * wheel.parameters[name][0]
        for channel, slopes in table.items():
            expected = (up[channel] - down[channel]) / step
            assert slopes[:, column] == pytest.approx(expected, rel=1e-3, abs=1e-6 * np.abs(expected).max())


def test_no_contact_is_no_prediction_and_no_warning():
    gives_way = Effect(
        id="gives-way",
        title="The rim gives way, at worst beyond the axle",
        kind="contact",
        parameters=(Parameter("by", "m", 0.0, 0.1),),
        laws={"radius": lambda q: q["radius"] - q["by"]},
    )
    channels = {"slip": 0.2, "load": 60.0, "sinkage": 0.01, "torque": 1.0}
    soil = {
        "cohesion": 1e3,
        "tan_phi": 0.6,
        "shear_modulus": 0.018,
        "stiffness": 1e6,
        "sinkage_exponent": 0.9,
    }
    numbers = {
        **{name: np.full(2, number) for name, number in soil.items()},
        "gives-way.by": np.array([0.0, 0.2]),
    }
    with np.errstate(all="raise"):
        table = prediction.derivatives(
            Model(effects=(gives_way,)),
            WheelGeometry(0.125, 0.1),
            {name: np.full(2, number) for name, number in channels.items()},
            lambda rows: {name: column[rows] for name, column in numbers.items()},
            ["cohesion"],
        )
    assert table["torque"][0, 0] > 0.0
    assert np.isfinite(table["torque"]).all()


def test_the_pull_that_an_effect_reads_has_no_noise_of_the_load_and_the_slip():
    """Else load-transfer would take the noise off a measured load, and be found where nothing is missing."""
    windows = windows_of(4, Kind(), "none")
    model = Model(effects=(catalogue()["load-transfer"],))
    place = int(windows.rows[len(windows.rows) // 2])
    read = []
    for jump in (1.0, 1.1):
        channels = dict(windows.samples.channels)
        for name in ("load", "slip"):
            channels[name] = channels[name] * np.where(np.arange(len(channels[name])) == place, jump, 1.0)
        moved = replace(windows, samples=replace(windows.samples, channels=channels))
        read.append(FittedWheel(moved, model, SETTINGS).read["drawbar_pull"][len(windows.rows) // 2])
    assert read[1] == pytest.approx(read[0], rel=1e-3)
