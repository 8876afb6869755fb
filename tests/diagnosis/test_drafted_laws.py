"""Laws that are drafted: whatever they follow, a model can read."""

import tomllib
from dataclasses import replace

import numpy as np
import pytest
from changed_models import ROVER, write_log
from hidden_drives import Kind, windows_of

from terrain_cli import effects
from terrain_cli.comparison.fitted_wheel import FittedWheel
from terrain_cli.diagnosis import diagnose, drafted_laws, refit_ranking
from terrain_cli.estimation.estimators import FitSettings
from terrain_cli.mechanics.wheel_model import Model
from terrain_cli.models import ModelFile
from terrain_cli.telemetry import effect_inputs

NOTHING = FitSettings({}, {}, (), None)


@pytest.fixture(scope="module")
def wheel():
    (windows,) = windows_of(77, Kind(seconds=32.0, rate=10.0))
    samples = windows.samples
    kept = {name: column for name, column in samples.channels.items() if name != "acceleration"}
    return FittedWheel(replace(windows, samples=replace(samples, channels=kept)), Model(), NOTHING)


def test_what_a_draft_follows_is_what_a_model_computes(wheel):
    samples, found = wheel.windows.samples, drafted_laws.drivers(wheel)
    units = {name: one.unit for name, one in drafted_laws.readable(wheel).items()}
    assert {"velocity_rate", "wheel_angle", "ambient_light", "slip"} <= found.keys()
    for driver, column in found.items():
        form = "periodic" if driver == drafted_laws.ANGLE else "magnitude"
        draft = drafted_laws.write("torque", driver, form, column, units[driver], usual=0.3)
        assert effect_inputs.not_read(samples, [draft.effect]) == []
        for one in draft.effect.parameters:
            assert one.scale == float(f"{one.scale:.3g}")
        if driver == "velocity_rate":
            read = effect_inputs.of_samples(samples, [draft.effect])[driver]
            np.testing.assert_allclose(read[wheel.windows.rows], column)
            (parameter,) = draft.effect.parameters
            assert parameter.unit == "N m/(m/s²)"


def test_acceleration_that_was_recorded_is_followed_itself(wheel):
    windows = wheel.windows
    channels = {**windows.samples.channels, "acceleration": np.linspace(0.0, 1.0, len(windows.samples))}
    measured = FittedWheel(
        replace(windows, samples=replace(windows.samples, channels=channels)), Model(), NOTHING
    )
    found = drafted_laws.drivers(measured)
    assert "velocity_rate" not in found
    np.testing.assert_array_equal(found["acceleration"], channels["acceleration"][windows.rows])


def test_a_model_takes_a_draft_on_the_rate_of_the_speed(terrain_est_here, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "rover.toml").write_text(ROVER, "utf-8")
    write_log(tmp_path / "log.csv", seconds=16.0)
    column = np.array([-0.1, 0.1, 0.2, -0.2])
    draft = drafted_laws.write("torque", "velocity_rate", "linear", column, "m/s²", usual=0.3)
    (tmp_path / "law.toml").write_text(draft.text, "utf-8")
    assert terrain_est_here("model", "new", "model.toml").returncode == 0
    done = terrain_est_here("model", "add", "model.toml", "law.toml", "-q", "--data", "log.csv")
    assert done.returncode == 0, done.stderr
    assert "torque-with-velocity-rate-linear" in done.stdout


def test_a_law_with_its_least_in_the_middle_of_a_driver_far_from_zero_is_drafted():
    """A board whose voltage wanders about 24 V shifts the zero of the sinkage either way."""
    (windows,) = windows_of(78, Kind(seconds=64.0, rate=10.0))
    samples = windows.samples
    voltage = 24.0 + 1.5 * np.sin(2.0 * np.pi * samples.time / 13.0)
    channels = {
        **samples.channels,
        "ambient_light": voltage,
        "sinkage": samples.channels["sinkage"] + 0.004 * (voltage - 23.7) ** 2,
    }
    found = diagnose([replace(windows, samples=replace(samples, channels=channels))], ModelFile())
    assert found.verdict == "unknown"
    assert (found.unknown.channel, found.unknown.driver) == ("sinkage", "ambient_light")
    assert found.unknown.form == "quadratic"
    assert found.unknown.explained > 0.95
    lowest, highest = np.quantile(voltage, [0.02, 0.98])
    middle = tomllib.loads(found.unknown.draft)["parameters"]["middle"]
    assert (middle["lower"], middle["upper"]) == pytest.approx((lowest, highest), rel=1e-3)


@pytest.mark.parametrize("effect", [None, "sensor-lag"])
def test_a_gain_that_follows_a_column_is_drafted_as_one(effect):
    """A motor's torque constant, or the amplifier of a cell, that changes with the supply voltage.

    A model that has a late channel predicts all samples, and the column is known at those that are fitted.
    """
    model = Model(effects=(effects.find(effect),)) if effect else Model()
    (windows,) = windows_of(81, Kind(seconds=64.0, rate=10.0))
    samples = windows.samples
    voltage = 26.0 + 2.0 * np.sin(2.0 * np.pi * samples.time / 13.0)
    torque = samples.channels["torque"] * (1.0 + 0.06 * (voltage - 28.0))
    channels = {**samples.channels, "supply": voltage, "torque": torque}
    found = diagnose([replace(windows, samples=replace(samples, channels=channels))], ModelFile(model=model))
    assert found.verdict == "unknown"
    assert (found.unknown.channel, found.unknown.driver, found.unknown.form) == ("torque", "supply", "gain")
    assert "the gain of torque varies with supply (linear), which" in found.sentence
    assert tomllib.loads(found.unknown.draft)["law"] == "torque * (1 + a * supply + b)"


def test_a_step_is_drafted_where_it_is():
    """An amplifier that is off above some temperature, which is not the median of a drive."""
    (windows,) = windows_of(82, Kind(seconds=64.0, rate=10.0))
    samples = windows.samples
    heat = 30.0 + 6.0 * np.sin(2.0 * np.pi * samples.time / 13.0)
    pull = samples.channels["drawbar_pull"] - np.where(heat > 33.0, 6.0, 0.0)
    channels = {**samples.channels, "board": heat, "drawbar_pull": pull}
    found = diagnose([replace(windows, samples=replace(samples, channels=channels))], ModelFile())
    assert found.verdict == "unknown"
    assert (found.unknown.channel, found.unknown.driver) == ("drawbar_pull", "board")
    assert found.unknown.form == "step"
    assert tomllib.loads(found.unknown.draft)["parameters"]["at"]["null"] == pytest.approx(33.0, abs=0.3)


def test_a_swing_is_drafted_as_often_in_a_turn_as_it_returns():
    """Teeth of a gear, or grousers of which rover.toml says nothing."""
    (windows,) = windows_of(83, Kind(seconds=64.0, rate=10.0))
    samples = windows.samples
    bare = replace(samples, geometry=samples.geometry._replace(grouser_count=0))
    angle = drafted_laws.drivers(FittedWheel(replace(windows, samples=bare), Model(), NOTHING))["wheel_angle"]
    torque = samples.channels["torque"].copy()
    torque[windows.rows] += 0.3 * np.nanstd(torque) * np.sin(4.0 * angle + 0.5)
    swings = replace(bare, channels={**samples.channels, "torque": torque})
    found = diagnose([replace(windows, samples=swings)], ModelFile())
    assert (found.verdict, found.unknown.driver, found.unknown.form) == ("unknown", "wheel_angle", "periodic")
    assert "torque varies with wheel angle (4 times in a turn of the wheel), which" in found.sentence
    assert found.unknown.explained > 0.9
    law = tomllib.loads(found.unknown.draft)["law"]
    assert law == "torque + a * sin(4 * wheel_angle) + b * cos(4 * wheel_angle)"


def test_a_law_that_makes_the_soil_impossible_is_not_drafted(monkeypatch):
    """A slip that is off by six tenths, in the place of a bent law, at a cohesion of -0.6 kPa."""
    (windows,) = windows_of(82, Kind(seconds=64.0, rate=10.0))
    samples = windows.samples
    heat = 30.0 + 6.0 * np.sin(2.0 * np.pi * samples.time / 13.0)
    pull = samples.channels["drawbar_pull"] - np.where(heat > 33.0, 6.0, 0.0)
    channels = {**samples.channels, "board": heat, "drawbar_pull": pull}
    judged = []
    monkeypatch.setattr(
        refit_ranking, "makes_soil_impossible", lambda _, one: "board" in one.id and not judged.append(one.id)
    )
    found = diagnose([replace(windows, samples=replace(samples, channels=channels))], ModelFile())
    assert "drawbar-pull-with-board-step" in judged
    assert found.unknown is None or found.unknown.driver != "board"


@pytest.mark.parametrize(("driver", "drafted"), [("supply", True), ("velocity", False), ("slip", False)])
def test_no_gain_follows_what_the_wheel_does(driver, drafted):
    assert ("gain" in drafted_laws.forms("torque", driver, on_or_off=False)) is drafted
    assert "gain" not in drafted_laws.forms("tan_phi", driver, on_or_off=False)


@pytest.mark.parametrize(
    ("driver", "drafted"),
    [("cell_temperature", True), ("motor_temperature", True), ("time", True), ("velocity", False)],
)
def test_the_zero_of_a_load_cell_may_follow_its_surroundings(driver, drafted):
    assert ("linear" in drafted_laws.forms("load", driver, on_or_off=False)) is drafted


def test_a_load_cell_whose_zero_warms_up_is_drafted():
    (windows,) = windows_of(78, Kind(seconds=64.0, rate=10.0))
    samples = windows.samples
    load = samples.channels["load"]
    warm = np.linspace(0.0, 30.0, len(load)) + 4.0 * np.sin(np.arange(len(load)) / 37.0)
    channels = {**samples.channels, "load": load + 0.004 * load.mean() * warm, "cell_temperature": warm}
    found = diagnose([replace(windows, samples=replace(samples, channels=channels))], ModelFile())
    assert found.effect is None
    assert (found.unknown.channel, found.unknown.driver) == ("load", "cell_temperature")


def test_what_follows_the_time_is_told_with_its_other_cause():
    """A tether that pulls more and more, or a soil that varies along the drive."""
    (windows,) = windows_of(79, Kind(seconds=64.0, rate=10.0))
    samples = windows.samples
    pull = samples.channels["drawbar_pull"] - 0.004 * samples.time**2
    channels = {**samples.channels, "drawbar_pull": pull}
    found = diagnose([replace(windows, samples=replace(samples, channels=channels))], ModelFile())
    assert found.verdict == "unknown"
    assert found.unknown.channel == "drawbar_pull"
    assert found.unknown.driver in drafted_laws.ALONG
    assert found.unknown.explained > 0.95
    assert "A soil that varies along the drive looks much the same." in found.sentence
    assert found.unknown.law.endswith(", or the soil varies along the drive")


@pytest.mark.parametrize(
    ("column", "law"),
    [
        (np.linspace(22.0, 26.0, 50), "torque + a * (supply - middle)^2 + b"),
        (np.linspace(-26.0, -22.0, 50), "torque + a * (supply - middle)^2 + b"),
        (np.linspace(0.1, 0.9, 50), "torque + a * supply^2"),
        (np.linspace(-1.0, 4.0, 50), "torque + a * supply^2"),
    ],
)
def test_a_square_is_about_zero_where_the_driver_comes_near_it(column, law):
    draft = drafted_laws.write("torque", "supply", "quadratic", column, "V", usual=0.3)
    assert draft.effect.laws["torque"].text == law


@pytest.mark.parametrize(
    ("form", "column", "law", "typical"),
    [
        ("linear", np.linspace(0.1, 0.3, 50), "(moisture - typical)", 0.2),
        ("quadratic", np.linspace(21.0, 60.0, 50), "(moisture^2 - typical^2)", 40.0),
        ("saturating", np.linspace(-9.0, -4.0, 50), "(tanh(moisture / s) - tanh(typical / s))", -6.0),
        # Of a slope, 0 is no extrapolation.
        ("linear", np.linspace(-0.2, 0.3, 50), "moisture", None),
    ],
)
def test_a_law_of_the_soil_leaves_it_as_it_is_in_the_middle_of_the_driver(form, column, law, typical):
    draft = drafted_laws.write("cohesion", "moisture", form, column, usual=0.2)
    assert draft.effect.laws["cohesion"].text == f"cohesion * (1 + a * {law})"
    held = {one.name: one.null for one in draft.effect.parameters if one.held}
    assert held == ({} if typical is None else {"typical": pytest.approx(typical)})


@pytest.mark.parametrize(
    ("changes", "driver", "same", "words"),
    [
        ("drawbar_pull", "yaw_rate", (), "drawbar pull varies with yaw rate"),
        ("drawbar_pull", "x", ("time",), "drawbar pull varies with x or time"),
        ("slip", "slip", (), "slip is off by a constant and a factor"),
        ("torque", "", (), "torque is off by a constant"),
        ("tan_phi", "humidity", (), "the soil's tan φ varies with humidity"),
        # What the law changes is said, not in which channel it shows most.
        ("stiffness", "sinkage", (), "the soil's stiffness varies with sinkage"),
    ],
)
def test_a_law_in_a_few_words(changes, driver, same, words):
    draft = drafted_laws.Draft(changes=changes, driver=driver, form="step", text="", effect=None)
    assert draft.in_words(same) == words
    assert draft.along == (driver == "x")
