"""The blind study of benchmarks/diagnosis_study.py in small, on drives that it does not score."""

from __future__ import annotations

import json
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hidden_drives import (
    FULL,
    LOAD,
    SHAPES,
    WHEEL,
    Kind,
    Rover,
    drive_of,
    samples_of,
    sized,
    windows_of,
)
from next_drives import appended
from simulator import EFFECTS, simulate
from uncatalogued import OUTSIDE

from terrain_cli.effects import catalogue
from terrain_cli.telemetry.effect_inputs import missing

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "benchmarks"))

import diagnosis_drives
import diagnosis_study
import diagnosis_table

SEED = 77


def columns(kind, seed=SEED):
    return simulate(drive_of(seed, kind)).wheels["wheel"].aligned()


# The drives


@pytest.mark.parametrize("name", FULL)
def test_sizes_are_within_what_the_program_knows_and_scale_from_none(name):
    bounds = {p.name: p for p in catalogue()[name].parameters}
    nulls = EFFECTS[name].parameters
    for size in (0.5, 1.0, 2.0):
        given = sized(name, size)[name]
        for parameter in FULL[name]:
            assert bounds[parameter].lower <= given[parameter] <= bounds[parameter].upper
            away = FULL[name][parameter] - nulls[parameter]
            if (name, parameter) in SHAPES:
                assert given[parameter] == FULL[name][parameter]
            elif parameter != "c1" or size < 2.0:
                assert given[parameter] == pytest.approx(nulls[parameter] + size * away)


def test_every_effect_can_be_tested_on_a_rich_drive():
    samples = samples_of(SEED, Kind(seconds=32.0))
    there = {*samples.channels, "time", "grouser_count", "grouser_height"}
    assert {name: missing(effect, there) for name, effect in catalogue().items()} == dict.fromkeys(FULL, ())
    assert len(samples) == 640


def test_a_rich_drive_varies_what_a_poor_one_does_not():
    rich, poor = (columns(Kind(course=course, share=0.0)) for course in ("rich", "poor"))
    for name in ("load", "velocity", "pitch", "yaw_rate", "slip_angle", "motor_temperature", "pass_number"):
        assert np.ptp(poor[name]) == pytest.approx(0.0, abs=1e-9)
        assert np.ptp(rich[name]) > 0.4 * max(np.abs(rich[name]).max(), 1e-3)
    for drive in (rich, poor):
        assert drive["slip"].min() < 0.08
        assert drive["slip"].max() > 0.6


@pytest.mark.parametrize("name", [name for name, one in OUTSIDE.items() if not one.soil])
def test_an_effect_in_no_catalogue_changes_its_channel_alone(name):
    plain, bent = columns(Kind(share=0.0)), columns(Kind(outside=name, share=0.0))
    (channel,) = OUTSIDE[name].right
    for other in plain:
        if other != channel:
            np.testing.assert_allclose(plain[other], bent[other], rtol=1e-12)
    away = bent[channel] - plain[channel]
    noise = 0.45 if channel == "drawbar_pull" else 0.03 * plain[channel].mean()
    assert 0.5 < np.sqrt(np.mean(away**2)) / noise < 8.0


def test_moist_soil_is_slippery():
    bent = columns(Kind(outside="moisture", course="poor", share=0.0, seconds=24.0))
    plain = columns(Kind(course="poor", share=0.0, seconds=24.0))
    dry = bent["moisture"] == 0.0
    np.testing.assert_allclose(bent["torque"][dry], plain["torque"][dry], rtol=1e-5)
    assert np.all(bent["torque"][bent["moisture"] == 0.2] < plain["torque"][bent["moisture"] == 0.2])


def test_the_drive_that_is_recommended_is_driven_with_the_same_effect_on_the_same_soil():
    kind = Kind(sized("drivetrain-friction"), course="poor")
    settings = {"load": {"steps": [0.7, 1.3]}, "motor_temperature": [20.0, 80.0], "duration": 60.0}
    (windows,) = appended(SEED + 1, replace(kind, share=1e-6), SEED, settings)
    channels = windows.samples.channels
    assert len(windows.samples) == 1200
    assert [channels["load"][100], channels["load"][-100]] == pytest.approx(
        [0.7 * LOAD, 1.3 * LOAD], rel=1e-3
    )
    assert np.ptp(channels["motor_temperature"]) == pytest.approx(60.0, rel=0.01)
    first = columns(replace(kind, share=0.0))
    place = np.argmin(np.abs(first["slip"] - 0.3))
    near = np.abs(channels["slip"] - first["slip"][place]) < 2e-3
    low, high = channels["torque"][near].min(), channels["torque"][near].max()
    assert low < first["torque"][place] < high


def test_a_wheel_comes_back_in_its_own_rut():
    kind = Kind(sized("multi-pass"), course="poor", share=1e-6)
    (windows,) = appended(SEED + 1, kind, SEED, {"drive": "passes", "duration": 55.0, "pitch_deg": 5.0})
    channels, time = windows.samples.channels, windows.samples.time
    back = (time > 20.0) & (time < 34.0)
    assert np.all(channels["velocity"][back] < 0.0)
    assert np.all(channels["angular_velocity"][back] < 0.0)
    np.testing.assert_allclose(np.degrees(channels["pitch"][back]), -5.0)
    passes = [channels["pass_number"][place].mean() for place in (time < 14.0, back, time > 41.0)]
    assert passes == [0.0, 1.0, 2.0]
    assert np.all(channels["torque"] > 0.0)
    assert np.mean(channels["sinkage"][back]) < 0.9 * np.mean(channels["sinkage"][time < 14.0])


# What is found


@pytest.fixture(scope="module")
def records():
    """Return what the study notes of some drives."""
    effect = {"section": "effects", "size": 1.0, "form": "catalogue", "course": "rich", "noise": "white"}
    # As short as what is asserted of them holds.
    length = {"length": 32.0}
    jobs = [
        {"section": "clean", "noise": "ar1", "course": "rich", "seed": 72},
        {**effect, "effect": "motor-temperature", "seed": 74, "size": 2.0},
        {**effect, "effect": "max-stress-angle", "seed": 75},
        {"section": "outside", "effect": "eccentric", "noise": "white", "seed": 78},
    ]
    jobs = [{**job, **length} for job in jobs]
    # Two that segments take for five soils, and for a drift.
    jobs += [
        {"section": "outside", "effect": effect, "noise": "white", "seed": seed, "length": 64.0}
        for effect, seed in (("drill", 1500), ("warm-cell", 1200))
    ]
    return [diagnosis_drives.run(job) for job in jobs]


def test_no_drive_of_the_study_fails(records):
    assert [one["found"]["error"] for one in records if "error" in one["found"]] == []


def test_a_clean_log_is_quiet(records):
    assert [one["found"]["verdict"] for one in records if one["section"] == "clean"] == ["none"]


def test_hidden_effects_are_in_the_family_and_no_name_is_wrong(records):
    hidden = [one for one in records if one["section"] == "effects"]
    assert all(diagnosis_table.alarmed(one) and diagnosis_table.in_family(one) for one in hidden)
    assert not any(diagnosis_table.wrong(one) for one in records)


def test_noise_of_the_sinkage_is_not_taken_for_something_left_over(records):
    (angle,) = [one for one in records if one.get("effect") == "max-stress-angle"]
    assert diagnosis_table.right(angle)
    assert diagnosis_table.close(angle)


def test_what_no_catalogue_explains_is_placed_and_its_draft_takes_half_of_the_error_off(records):
    outside = [one for one in records if one["section"] == "outside"]
    placed = [(one["found"]["unknown"]["channel"], one["found"]["unknown"]["driver"]) for one in outside]
    assert placed == [
        ("torque", "wheel_angle"),
        ("sinkage", "drill_out"),
        ("drawbar_pull", "motor_temperature"),
    ]
    assert all(map(diagnosis_table.halved, outside))


# The table


def test_intervals_are_those_of_wilson():
    # Newcombe 1998, Statistics in Medicine 17, table I: method 3.
    assert diagnosis_table.interval(81, 263) == pytest.approx((0.2553, 0.3662), abs=1e-4)
    assert diagnosis_table.interval(0, 20) == pytest.approx((0.0, 0.1611), abs=1e-4)
    assert "missed" in diagnosis_table.goal("", [True] * 6 + [False] * 94, most=0.05, bound=0.07)
    assert "missed" in diagnosis_table.goal("", [True] * 4 + [False] * 96, most=0.05, bound=0.07)
    assert diagnosis_table.goal("", [True] * 4 + [False] * 396, most=0.05, bound=0.07).endswith("met")


def test_a_study_goes_on_where_it_was(records, tmp_path, capsys):
    folder = tmp_path / "tuning"
    folder.mkdir()
    wanted = list(diagnosis_drives.jobs("clean", 1, 1000))
    found = {name: records[0][name] for name in ("found", "seconds", "code")}
    lines = [json.dumps(job | found) + "\n" for job in wanted]
    (folder / "clean.jsonl").write_text("".join(lines), encoding="utf-8")
    before = (folder / "clean.jsonl").read_bytes()
    diagnosis_study.main(
        ["--tuning", "--section", "clean", "--number", "1", "--cache", str(tmp_path), "--jobs", "1"]
    )
    assert (folder / "clean.jsonl").read_bytes() == before
    table = capsys.readouterr().out
    for noise in diagnosis_drives.NOISES:
        line = next(line for line in table.splitlines() if line.endswith("missed") and f", {noise} " in line)
        assert "0.0 ( 0.0– 79.3) of 1" in line


def test_a_drive_that_fails_counts_as_missed():
    job = {
        "section": "effects",
        "effect": "slope",
        "size": 1.0,
        "form": "catalogue",
        "course": "rich",
        "noise": "white",
    }
    failed = {**job, "seed": 1, "found": {"error": "ValueError: no"}, "seconds": 1.0, "code": "0"}
    table = list(diagnosis_table.table({"effects": [failed]}))
    assert any("FAILED 1: ValueError: no" in line for line in table)
    assert any(line.startswith("rich drive, full size: detected") and " 0.0 " in line for line in table)


# Other vehicles


def test_what_has_a_unit_goes_with_the_size_of_the_rover():
    rover = Rover(wheel=replace(WHEEL, radius=2.0 * WHEEL.radius), load=3.0 * LOAD)
    friction, lag = (sized(name, rover=rover)[name] for name in ("drivetrain-friction", "sensor-lag"))
    assert friction["Tc"] == pytest.approx(6.0 * FULL["drivetrain-friction"]["Tc"])
    assert sized("crust", rover=rover)["crust"]["strength"] == pytest.approx(
        3.0 / 4.0 * FULL["crust"]["strength"]
    )
    assert lag["torque_lag"] == FULL["sensor-lag"]["torque_lag"]


def test_other_vehicles_are_carried_and_are_the_same_again():
    jobs = list(diagnosis_drives.jobs("vehicles", 1))
    assert len({job["seed"] for job in jobs}) == len(jobs)
    kinds = [diagnosis_drives.vehicle(job["seed"]) for job in jobs]
    assert len({kind.rover.wheel.radius for kind in kinds}) == 6
    assert len({kind.rover.soils[0].name for kind in kinds}) > 6
    rough = [
        kind.rover.rough(np.linspace(0.0, 100.0, 50))
        for kind in (kinds[0], diagnosis_drives.vehicle(jobs[0]["seed"]))
    ]
    np.testing.assert_array_equal(*rough)
    (windows,) = windows_of(jobs[0]["seed"], replace(kinds[0], share=1e-6, seconds=16.0))
    assert np.all(windows.samples.channels["sinkage"] < 0.4 * kinds[0].rover.wheel.radius)


def test_the_table_of_other_vehicles_counts_what_a_drive_can_show():
    job = {"section": "vehicles", "effect": "slope", "seed": 1, "seconds": 1.0, "code": "0"}
    about = {"radius": 0.05, "soil": "snow", "modulus": 0.01, "share": 0.01, "noise": "white"}
    weak, strong = ({**job, "found": {"strength": size, "about": about}} for size in (1.0, 9.0))
    table = list(diagnosis_table.vehicle_table([weak, strong]))
    shown = next(line for line in table if line.startswith("  of those that the drive can show"))
    assert "of 1 " in shown
    assert shown.endswith("missed")
    assert any(line.startswith("snow ") and line.endswith("of 2") for line in table)
