"""Windows of whole logs, judged on drives of the independent simulator."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from simulator import (
    DRY_SAND,
    LETE_SAND,
    SANDY_LOAM,
    UPLAND_SANDY_LOAM,
    WET_CLAYEY_SOIL,
    Drive,
    Track,
    constant,
    one_wheel,
    simulate,
    steps,
    undulation,
    wave,
)

import terrain_cli as terrain
from terrain_cli.errors import InputError, UsageError
from terrain_cli.rover import Rover, Wheel
from terrain_cli.windows.cut_windows import thinned

ROVER = Rover(default=Wheel(radius=Drive([]).wheel.radius, width=Drive([]).wheel.width), shear_modulus=0.018)


def samples_of(drive, **options):
    (log,) = simulate(drive).wheels.values()
    columns = {
        name: values for name, values in log.aligned().items() if name not in {"angular_velocity", "x"}
    }
    (wheel,) = terrain.from_frame(pd.DataFrame(columns), ROVER, **options)
    return wheel, log


def cuts(wheel, method="auto", **options):
    """Return the times at which windows begin, without the first."""
    windows = terrain.segment(wheel, method, **options)
    return wheel.time[windows.rows[windows.bounds[1:-1]]] + wheel.origin


@pytest.mark.parametrize("soils", [1, 2])
def test_what_follows_the_turn_of_the_wheel_is_no_change_of_soil(soils):
    """An eccentric wheel: a tenth of its torque comes and goes once in each of its 6 turns."""
    order = [(DRY_SAND, UPLAND_SANDY_LOAM)[k % soils] for k in range(4)]
    load, slip = undulation(80.0, 0.2, 7.0, seed=3), undulation(0.3, 0.3, 9.0, seed=4)
    drive = one_wheel([(soil, 40.0) for soil in order], load=load, slip=slip, noise=0.02, rate=10.0, seed=1)
    (log,) = simulate(drive).wheels.values()
    table = pd.DataFrame(log.aligned())
    angle = np.cumsum(np.gradient(table["time"]) * table["angular_velocity"])
    angle *= 12.0 * np.pi / angle.iloc[-1]
    table["torque"] *= 1.0 + 0.1 * np.sin(angle + 0.7)
    table["angular_velocity"] = np.gradient(angle, table["time"])
    table["velocity"] = table["angular_velocity"] * ROVER.default.radius * (1.0 - table["slip"])
    before, after = (
        cuts(terrain.from_frame(table.drop(columns=["x", *dropped]), ROVER)[0])
        for dropped in (["angular_velocity", "velocity"], [])
    )
    assert len(before) > 3 + 3 * (soils - 1)
    truth = np.array(log.boundaries)[: 3 * (soils - 1)]
    assert len(after) == len(truth)
    assert (np.abs(after[:, None] - truth) < 3.0).any(axis=1).all()


def test_what_follows_the_slip_angle_is_no_change_of_soil():
    """The wheel slides to either side in turn, and straight on between."""
    load, slip = undulation(80.0, 0.2, 7.0, seed=3), undulation(0.3, 0.3, 9.0, seed=4)
    drive = one_wheel(
        [(DRY_SAND, 120.0)],
        load=load,
        slip=slip,
        noise=0.01,
        rate=10.0,
        effects={"side-slip": {"k_growth": 1.2, "lateral": 4.0}},
        seed=1,
    )
    sideways = steps([(0.0, 10.0), (0.4, 10.0), (0.0, 10.0), (-0.4, 10.0)] * 3)
    drive = replace(drive, slip_angle=sideways, channels=(*drive.channels, "slip_angle"))
    wheel, _ = samples_of(drive)
    straight = {name: values for name, values in wheel.channels.items() if name != "slip_angle"}
    assert len(cuts(replace(wheel, channels=straight))) == 11
    assert len(cuts(wheel)) == 0


SOILS = (DRY_SAND, UPLAND_SANDY_LOAM, WET_CLAYEY_SOIL)


@pytest.mark.parametrize("model", ["linear", "wong-reece"])
def test_changes_of_soil_are_found_within_a_second(model):
    found = missed = false = 0
    for seed in range(10):
        order = [SOILS[(k * (1 + seed % 2) + seed) % 3] for k in range(3 + seed % 4)]
        load = undulation(80.0, 0.2, 7.0, seed=seed) if seed % 2 else steps([(70.0, 11.0), (95.0, 13.0)] * 9)
        drive = one_wheel(
            [(soil, 20.0) for soil in order], load=load, noise=0.03, rate=20.0, model=model, seed=seed
        )
        wheel, log = samples_of(drive)
        at = cuts(wheel)
        truth = np.array(log.boundaries)
        near = np.abs(at[:, None] - truth) <= 1.0
        found += int(near.any(axis=0).sum())
        missed += int((~near.any(axis=0)).sum())
        false += int((~near.any(axis=1)).sum())
    assert found >= 0.95 * (found + missed)
    assert false <= 0.05 * (found + missed)


def test_a_wheel_that_rolls_freely_is_on_no_other_soil():
    """Downhill a wheel skids a little: noise makes every sixth slip positive."""
    slip = steps([(0.12, 60.0), (-0.015, 30.0), (0.2, 60.0)])
    load = undulation(80.0, 0.2, 7.0, seed=3)
    wheel, _ = samples_of(one_wheel([(DRY_SAND, 150.0)], load=load, slip=slip, noise=0.02, rate=10.0, seed=1))
    noise = 0.015 * np.random.default_rng(79_935_902).standard_normal(len(wheel))
    noisy = replace(wheel, channels={**wheel.channels, "slip": wheel.channels["slip"] + noise})
    assert len(cuts(noisy)) == 0


def test_a_skid_across_two_soils_is_parted_where_the_sinkage_changes():
    """No sample of a skidding wheel has a line: four of 1,350 in the wrong soil made a clean log misfit."""
    slip = steps([(0.3, 19.2), (-0.1, 1.6), (0.25, 19.2)])
    soils = [(DRY_SAND, 20.0), (SANDY_LOAM, 20.0)]
    drive = one_wheel(soils, load=undulation(80.0, 0.2, 7.0), slip=slip, noise=0.02, rate=20.0)
    wheel, log = samples_of(drive, model="wong-reece")
    np.testing.assert_allclose(cuts(wheel), log.boundaries, atol=0.06)


def test_a_soil_of_another_shear_modulus_is_one_soil():
    """The k assumed is four times that of a soil, whose line then bends at every step of the slip."""
    slip = steps([(size, 8.0) for size in (0.25, 0.07, 0.4, 0.12, 0.55)] * 2)
    load = undulation(80.0, 0.2, 7.0, seed=3)
    soils = [(UPLAND_SANDY_LOAM, 40.0), (DRY_SAND, 40.0)]
    wheel, log = samples_of(one_wheel(soils, load=load, slip=slip, noise=0.02, rate=20.0, seed=1))
    k = 4.0 * UPLAND_SANDY_LOAM.shear_modulus
    told, sure = (wheel.geometry._replace(shear_modulus=k, shear_modulus_factor=f) for f in (2.0, 1.01))
    np.testing.assert_allclose(cuts(replace(wheel, geometry=told)), log.boundaries, atol=1.0)
    assert len(cuts(replace(wheel, geometry=sure))) > 1


def test_two_soils_as_strong_are_told_by_their_sinkage():
    """Sandy loam is as strong as dry sand under this wheel, and the wheel sinks half as deep."""
    drive = one_wheel(
        [(DRY_SAND, 20.0), (SANDY_LOAM, 20.0)] * 2, load=undulation(80.0, 0.2, 7.0), noise=0.02, rate=20.0
    )
    wheel, log = samples_of(drive)
    np.testing.assert_allclose(cuts(wheel), log.boundaries, atol=1.0)


@pytest.mark.parametrize("model", ["linear", "wong-reece"])
def test_a_load_step_on_one_soil_is_no_new_terrain(model):
    for seed, soil in enumerate((*SOILS, LETE_SAND)):
        load = steps([(70.0, 10.0), (95.0, 10.0), (80.0, 10.0)] * 2)
        drive = one_wheel([(soil, 60.0)], load=load, noise=0.03, rate=20.0, model=model, seed=seed)
        assert len(cuts(samples_of(drive)[0])) == 0


def test_a_steady_drive_on_flat_ground_is_one_window_that_gives_the_strength():
    drive = one_wheel([(DRY_SAND, 60.0)], load=constant(80.0), slip=constant(0.3), noise=0.03, model="linear")
    wheel, log = samples_of(drive)
    (row,) = terrain.estimate(terrain.segment(wheel), "least-squares").to_dict("records")
    assert row["status"] == "not-separable"
    truth = log.strength(row["sigma_star_kPa"] * 1e3).mean() / 1e3
    assert row["strength_kPa"] == pytest.approx(truth, rel=0.02)


@pytest.fixture(scope="module")
def clean():
    return samples_of(one_wheel([(DRY_SAND, 30.0)], slip=wave(0.3, 0.4, 11.0), noise=0.01, rate=20.0))[0]


def test_fixed_windows_in_samples_and_metres(clean):
    by_samples = terrain.segment(clean, "fixed", window_samples=100)
    assert set(np.diff(by_samples.bounds)) == {100}
    by_metres = terrain.segment(clean, "fixed", window_distance=0.5)
    lengths = (
        clean.distance[by_metres.rows[by_metres.bounds[1:] - 1]]
        - clean.distance[by_metres.rows[by_metres.bounds[:-1]]]
    )
    assert lengths[:-1] == pytest.approx(0.5, abs=0.02)


def test_fixed_windows_need_a_length(clean):
    with pytest.raises(UsageError, match="length"):
        terrain.segment(clean, "fixed")
    with pytest.raises(InputError, match="distance"):
        terrain.segment(replace(clean, distance=None), "fixed", window_distance=0.5)


def test_terrain_windows_follow_the_label():
    run = simulate(one_wheel([(DRY_SAND, 10.0), (LETE_SAND, 10.0), (DRY_SAND, 10.0)], rate=10.0))
    frame = pd.DataFrame(run.columns(terrain=True)).drop(columns=["angular_velocity"])
    (wheel,) = terrain.from_frame(frame, ROVER)
    assert cuts(wheel, "terrain") == pytest.approx([10.0, 20.0])
    table = terrain.estimate(terrain.segment(wheel, "terrain"))
    assert table["terrain"].tolist() == [DRY_SAND.name, LETE_SAND.name, DRY_SAND.name]


def test_no_windows_reach_across_runs_or_gaps():
    frame = pd.DataFrame(simulate(one_wheel([(DRY_SAND, 30.0)], rate=10.0)).columns())
    frame = frame.drop(columns=["angular_velocity"])
    frame["run"] = np.where(frame["time"] < 10.0, "a", "b")
    frame = frame[(frame["time"] < 20.0) | (frame["time"] > 22.0)]
    (wheel,) = terrain.from_frame(frame, ROVER)
    for method in ("auto", "none"):
        assert cuts(wheel, method) == pytest.approx([10.0, 22.1])


def test_steady_test_points_make_one_window_or_one_for_each_terrain():
    frame = pd.DataFrame(simulate(one_wheel([(DRY_SAND, 2.0)], rate=10.0)).columns())
    points = frame.drop(columns=["time", "angular_velocity", "velocity", "x", "y"])
    (wheel,) = terrain.from_frame(points, ROVER)
    assert terrain.segment(wheel).bounds.tolist() == [0, 20]
    points["terrain"] = ["sand", "loam"] * 10
    (wheel,) = terrain.from_frame(points, ROVER)
    windows = terrain.segment(wheel)
    assert windows.bounds.tolist() == [0, 10, 20]
    assert windows.rows[:3].tolist() == [0, 2, 4]


def test_the_windows_of_each_wheel_are_its_own():
    drive = Drive(
        [
            Track("left", [(DRY_SAND, 20.0), (WET_CLAYEY_SOIL, 20.0)]),
            Track("right", [(DRY_SAND, 25.0), (WET_CLAYEY_SOIL, 15.0)]),
        ],
        rate=20.0,
        seed=3,
    )
    frame = pd.DataFrame(simulate(drive).columns())
    left, right = terrain.from_frame(frame, ROVER)
    assert cuts(left) == pytest.approx([20.0], abs=1.0)
    assert cuts(right) == pytest.approx([25.0], abs=1.0)


@pytest.mark.parametrize("share", [0.05, 0.5, 1.0])
def test_thinned_windows_are_whole_pieces_spread_over_each(share):
    frame = pd.DataFrame(simulate(one_wheel([(DRY_SAND, 600.0)], rate=50.0)).columns())
    frame["run"] = np.where(frame["time"] < 300.0, "a", "b")
    (wheel,) = terrain.from_frame(frame.drop(columns=["angular_velocity"]), ROVER)
    whole = terrain.segment(wheel, "none")
    few = thinned(whole, share)
    assert len(few) == len(whole) == 2
    assert len(few.rows) == pytest.approx(share * len(whole.rows), rel=0.01)
    for j in range(2):
        (rows, all_rows) = (w.rows[w.bounds[j] : w.bounds[j + 1]] for w in (few, whole))
        assert np.isin(rows, all_rows).all()
        assert (rows[0], rows[-1]) == (all_rows[0], all_rows[-1])
    step, stretch = np.diff(few.rows), np.diff(few.samples.stretch[few.rows])
    assert np.array_equal(step != 1, (stretch != 0) & (step != 1))
    assert np.median(np.unique(few.samples.stretch[few.rows], return_counts=True)[1]) > 150
    assert np.array_equal(few.x, whole.x[np.searchsorted(whole.rows, few.rows)])
    # The original is as it was.
    assert wheel.stretch.max() == 1
