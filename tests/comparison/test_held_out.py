from dataclasses import replace

import numpy as np
import pytest
from known_misfits import Kind, windows_of
from scipy.optimize import lsq_linear

from terrain_cli.comparison import held_out, prediction
from terrain_cli.comparison.fit_settings import FitSettings
from terrain_cli.comparison.fitted_wheel import FittedWheel
from terrain_cli.effects import catalogue
from terrain_cli.estimation.wheel_fit import fit
from terrain_cli.mechanics.wheel_model import Model

SETTINGS = FitSettings({}, {}, (), None)


def test_blocks_are_left_out_and_parts_of_a_window_that_is_one_block():
    window = np.repeat([0, 1], [30, 20])
    block = np.repeat([0, 1, 2], [10, 20, 20])
    fold = held_out.folds(window, block)
    assert [len(np.unique(fold[part])) for part in (slice(0, 10), slice(10, 30), slice(30, 50))] == [1, 1, 4]
    assert np.unique(np.bincount(fold)).tolist() == [5, 10, 20]


def test_leaving_out_is_solving_the_rest():
    """The arrow against dense normal equations, window by window and fold by fold."""
    rng = np.random.default_rng(1)
    windows, local, size = 4, 2, 3
    window, fold = np.repeat(np.arange(windows), 3), np.tile([0, 1, 2], windows)
    fold[6:9] += 3
    design, error = rng.normal(size=(12, 20, size)), rng.normal(size=(12, 20))
    information, score = np.einsum("cni,cnj->cij", design, design), np.einsum("cni,cn->ci", design, error)
    prior = np.diag(rng.uniform(0.5, 1.0, size))

    def places(one):
        return np.r_[one * local : (one + 1) * local, windows * local]

    def solved(kept):
        whole = np.diag(np.append(np.tile(np.diag(prior)[:local], windows), prior[-1, -1]))
        pull = np.zeros(len(whole))
        for cell in np.flatnonzero(kept):
            at = places(window[cell])
            whole[np.ix_(at, at)] += information[cell]
            pull[at] += score[cell]
        return np.linalg.solve(whole, pull)

    moved = held_out.leave_out(information, score, window, fold, prior, local)
    every = solved(np.ones(12, dtype=bool))
    for cell in range(12):
        expected = (solved(fold != fold[cell]) - every)[places(window[cell])]
        assert moved[cell] == pytest.approx(expected, abs=1e-12)


def test_a_common_parameter_stops_at_its_bound_and_the_others_make_do_with_that():
    """Against the minimum of the same squares with that parameter held, by scipy."""
    rng = np.random.default_rng(7)
    local, size, cells = 2, 4, 5
    design, error = rng.normal(size=(cells, 30, size)), rng.normal(size=(cells, 30))
    information, score = np.einsum("cni,cnj->cij", design, design), np.einsum("cni,cn->ci", design, error)
    window, fold, prior = np.zeros(cells, dtype=int), np.arange(cells), 0.1 * np.eye(size)
    free = held_out.leave_out(information, score, window, fold, prior, local)
    base = np.linalg.solve(information.sum(axis=0) + prior, score.sum(axis=0))
    low = np.array([0.5 * free[:, local].min(), -np.inf])
    assert (free[:, local] < low[0]).any()
    moved = held_out.leave_out(
        information, score, window, fold, prior, local, (low, np.array([np.inf, np.inf]))
    )
    for cell in range(cells):
        kept = fold != cell
        rows = np.concatenate([design[kept].reshape(-1, size), np.sqrt(prior)])
        right = np.append(error[kept].ravel(), np.zeros(size))
        bounds = (np.full(size, -np.inf), np.full(size, np.inf))
        bounds[0][local] = base[local] + low[0]
        expected = lsq_linear(rows, right, bounds).x - base
        assert moved[cell] == pytest.approx(expected, abs=1e-6)


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
