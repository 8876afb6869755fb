"""The notebook interface gives what the command line gives."""

from __future__ import annotations

import inspect
import json
import pydoc
import subprocess
import sys
from io import StringIO
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from changed_models import once
from matplotlib.figure import Figure

import terrain_cli as terrain
from terrain_cli import diagnosis, improvement, models
from terrain_cli.api import diagnosis_result
from terrain_cli.errors import ConfigurationError, InputError, UsageError

SAMPLE = Path(__file__).parent.parent / "sample_data"
DRIVE = {"drive": "slip-sweep", "duration": 30.0, "rate": 4.0, "noise": "3%", "seed": 3}
SINKS = {"slip-sinkage": {"n1": 0.4}}


@pytest.fixture(scope="module")
def wheels():
    return terrain.read(SAMPLE / "run.csv", SAMPLE / "rover.toml")


def test_the_steps_give_the_table_of_the_command(wheels):
    frame = terrain.estimate([terrain.segment(wheel) for wheel in wheels])
    command = [sys.executable, "-m", "terrain_cli", "estimate", str(SAMPLE / "run.csv"), "--quiet"]
    printed = subprocess.run(command, check=True, capture_output=True, text=True).stdout
    expected = pd.read_csv(StringIO(printed))
    assert list(frame) == list(expected)
    for name in expected:
        if pd.api.types.is_float_dtype(frame[name]):
            np.testing.assert_allclose(frame[name], expected[name], rtol=1e-12, err_msg=name)
    assert frame["status"].tolist() == expected["status"].tolist()


def test_a_frame_is_as_good_as_a_file(wheels):
    frame = pd.read_csv(SAMPLE / "run.csv")
    again = terrain.from_frame(frame, SAMPLE / "rover.toml")
    assert [one.wheel for one in again] == [one.wheel for one in wheels]
    for one, other in zip(again, wheels, strict=True):
        np.testing.assert_allclose(one.channels["torque"], other.channels["torque"], rtol=1e-12)
        assert one.reasons() == other.reasons()


def test_times_of_a_frame_may_be_timestamps(wheels):
    frame = pd.read_csv(SAMPLE / "run.csv")
    frame["time"] = pd.to_datetime(frame["time"], unit="s", utc=True)
    again = terrain.from_frame(frame, SAMPLE / "rover.toml")
    np.testing.assert_allclose(again[0].time, wheels[0].time, atol=1e-6)


def test_where_keeps_only_what_satisfies_it(wheels):
    few = terrain.read(SAMPLE / "run.csv", SAMPLE / "rover.toml", where="load > 80")
    assert 0 < len(few[0]) < len(wheels[0])
    assert few[0].channels["load"].min() > 80
    with pytest.raises(UsageError, match="cannot read"):
        terrain.read(SAMPLE / "run.csv", SAMPLE / "rover.toml", where="__import__('os')")


def test_the_trace_ends_at_the_estimate(wheels):
    cut = terrain.segment(wheels[0], "none")
    trace = terrain.trace(cut)
    last = trace.groupby("segment").last()
    estimate = terrain.estimate(cut, "least-squares").set_index("segment")
    np.testing.assert_allclose(last["c_kPa"], estimate["c_ls_kPa"], rtol=1e-9)
    np.testing.assert_allclose(last["phi_deg"], estimate["phi_ls_deg"], rtol=1e-9)


def test_the_summary_groups_by_terrain_and_wheel(wheels):
    cut = [terrain.segment(wheel) for wheel in wheels]
    groups = terrain.summarise(cut)
    assert [(g["terrain"], g["wheel"]) for g in groups] == [("", "front-left"), ("", "front-right")]
    assert sum(g["samples"] for g in groups) == terrain.estimate(cut)["n_samples"].sum()


def test_without_a_rover_the_missing_geometry_is_asked_for(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    frame = pd.DataFrame({"load": [80.0] * 5, "torque": [3.0] * 5, "sinkage": [0.01] * 5, "slip": [0.3] * 5})
    with pytest.raises(ConfigurationError, match="radius") as error:
        terrain.from_frame(frame)
    assert "[wheel]" in error.value.hint


@pytest.fixture(scope="module")
def folder(tmp_path_factory, terrain_est_here):
    """Write a small log in which the wheel sinks, and a clean one."""
    path = tmp_path_factory.mktemp("logs")
    args = [part for name, value in DRIVE.items() for part in (f"--{name}", value)]
    for name, more in (("sinks.csv", ("--effect", "slip-sinkage:n1=0.4")), ("clean.csv", ())):
        done = terrain_est_here("simulate", *args, *more, "-o", path / name, "--truth", path / f"{name}.json")
        assert done.returncode == 0, done.stderr
    return path


@pytest.fixture(scope="module")
def windows(folder):
    return [terrain.segment(wheel) for wheel in terrain.read(folder / "sinks.csv")]


@pytest.fixture(scope="module")
def compared(windows):
    return terrain.compare(windows)


@pytest.fixture(scope="module")
def trial(windows, folder):
    """Add the effect that is missing; the model file is not there before."""
    return terrain.add_effect("wong-reece", "slip-sinkage", windows, path=folder / "model.toml")


@pytest.fixture(scope="module")
def printed(terrain_est_here):
    def run(*args):
        done = terrain_est_here(*args, "-q")
        assert done.returncode == 0, done.stderr
        return done.stdout

    return run


@pytest.fixture
def fitting_once(monkeypatch):
    """Have the command's table and its JSON come from one comparison of its own."""
    monkeypatch.setattr(improvement, "compared", once(improvement.compared))


@pytest.mark.usefixtures("fitting_once")
def test_compare_is_the_command(compared, folder, printed):
    assert compared.to_json() + "\n" == printed("compare", folder / "sinks.csv", "--json")
    assert f"{compared}\n" == printed("compare", folder / "sinks.csv")
    assert "\n" not in repr(compared)


@pytest.mark.usefixtures("fitting_once")
def test_two_models_are_those_of_the_command(windows, trial, folder, printed):
    both = terrain.compare(windows, against=trial.model)
    args = ("--model", "wong-reece", "--model", folder / "model.toml")
    assert both.to_json() + "\n" == printed("compare", folder / "sinks.csv", *args, "--json")
    assert f"{both}\n" == printed("compare", folder / "sinks.csv", *args)
    sinkage = both.differences.set_index("name").loc["sinkage"]
    assert sinkage["moved"]
    assert sinkage["difference"] < 0.0


def test_tables_of_a_comparison_hold_its_document(compared):
    document = json.loads(compared.to_json())
    assert list(compared.channels.index) == ["torque", "drawbar_pull", "sinkage"]
    for name, errors in document["channels"].items():
        row = compared.channels.loc[name]
        assert row["rmse"] == errors["rmse"]
        assert [row["heldout_low"], row["heldout_high"]] == errors["heldout_interval"]
    assert list(compared.failures["sentence"]) == [one["sentence"] for one in document["failures"]]
    assert len(compared.failures) > 0
    (segment,) = document["segments"]
    row = compared.segments.iloc[0]
    assert row["status"] == segment["status"]
    # Empty where the data do not determine it.
    assert row["phi_deg"] == segment["phi_deg"] or (segment["phi_deg"] is None and np.isnan(row["phi_deg"]))
    assert row["drawbar_pull_rmse_N"] == segment["drawbar_pull"]["rmse"]
    assert row["torque_bias_Nm"] == segment["torque"]["bias"]
    assert compared.differences.empty


@pytest.mark.parametrize("model", [None, "linear"])
def test_drawbar_pull_is_compared_whatever_was_read(model, folder):
    wheels = terrain.read(folder / "clean.csv", model=model)
    assert {"drawbar_pull", "pitch", "pass_number"} <= wheels[0].channels.keys()
    result = terrain.compare(wheels, "linear")
    assert "drawbar_pull" in result.channels.index


def test_data_in_any_form_give_the_same(folder):
    wheels = terrain.read(folder / "clean.csv")
    frame = pd.read_csv(folder / "clean.csv")
    forms = [[terrain.segment(wheels[0])], wheels[0], str(folder / "clean.csv"), frame]
    tables = [terrain.compare(form, rover=folder / "rover.toml").channels for form in forms]
    for table in tables[1:]:
        pd.testing.assert_frame_equal(table, tables[0])
    pd.testing.assert_frame_equal(terrain.estimate(wheels), terrain.estimate(folder / "clean.csv"))


def test_a_notebook_shows_tables(compared, trial):
    html = compared._repr_html_()
    assert html.count("<table") == 3
    assert "drawbar_pull_rmse_N" in html
    assert "n1" in trial._repr_html_()


def test_a_notebook_takes_no_name_for_html():
    drive = terrain.simulate(**DRIVE)
    wheels = terrain.from_frame(drive.frame, drive.rover, source="<i>")
    html = terrain.compare(wheels)._repr_html_()
    assert "&lt;i&gt;" in html
    assert "<i>" not in html


def test_pictures_are_those_of_plot(compared, trial):
    for name in ("predicted-measured", "residual-sinkage", "track-torque", "rim-stress", "convergence"):
        assert isinstance(compared.plot(name), Figure)
    assert isinstance(trial.plot(), Figure)
    drive = terrain.simulate(**DRIVE, wheels=2)
    shown = drive.plot().get_axes()
    assert {"torque T (N m)", "sinkage z (mm)"} <= {axes.get_title(loc="left") for axes in shown}
    assert all(len(axes.get_lines()) == 2 for axes in shown[:3])
    with pytest.raises(UsageError, match="did you mean residual-sinkage") as error:
        compared.plot("residual-sinkge")
    assert "strength" in error.value.hint


def test_diagnose_is_the_command(folder, printed, monkeypatch):
    result = terrain.diagnose(folder / "clean.csv")
    monkeypatch.setattr(diagnosis, "diagnose", once(diagnosis.diagnose))
    assert result.to_json() + "\n" == printed("diagnose", folder / "clean.csv", "--json")
    assert f"{result}\n" == printed("diagnose", folder / "clean.csv")
    assert (result.verdict, result.effect, result.family, result.next_drive) == ("none", None, (), [])
    document = json.loads(result.to_json())
    assert list(result.candidates["effect"]) == [one["effect"] for one in document["candidates"]]
    assert {"sinkage_heldout_rmse_m", "score"} <= {*result.candidates}
    assert result.sentence in result._repr_html_()
    with pytest.raises(UsageError, match="candidates: these data have nothing"):
        result.plot()


def test_diagnose_does_not_see_what_is_kept_aside(wheels, monkeypatch):
    shown = []
    monkeypatch.setattr(diagnosis_result, "diagnosed", lambda some, *_, **__: shown.extend(some))
    terrain.diagnose(wheels, keep_aside=0.5)
    assert [one.samples.wheel for one in shown] == [one.wheel for one in wheels]
    for one in shown:
        assert len(one.rows) == pytest.approx(len(one.samples.usable) / 2, rel=0.05)
        assert not one.samples.aside[one.rows].any()


def test_add_effect_is_the_command(trial, folder, printed, terrain_est_here):
    assert (trial.kept, trial.pays) == (True, True)
    assert trial.path == folder / "model.toml"
    assert models.load(trial.path) == trial.model
    ours = trial.path.read_text("utf-8")
    trial.path.unlink()
    assert terrain_est_here("model", "new", trial.path).returncode == 0
    told = printed("model", "add", trial.path, "slip-sinkage", "--data", folder / "sinks.csv", "--json")
    assert trial.to_json() + "\n" == told
    # But for the time of the change.
    theirs = [{**one, "when": ""} for one in models.load(trial.path).history]
    assert [{**one, "when": ""} for one in trial.history] == theirs
    trial.path.write_text(ours, "utf-8")


def test_what_a_trial_measured(trial, windows):
    errors = trial.errors.loc["sinkage"]
    assert errors["after_high"] < errors["before_low"]
    assert errors["difference_high"] < 0.0
    assert errors["after"] < 1.5 * errors["noise"]
    n1 = trial.parameters.set_index("name").loc["slip-sinkage.n1"]
    assert abs(n1["value"] - 0.4) < 4.0 * n1["se"]
    assert str(trial).startswith(trial.sentence)
    with pytest.raises(UsageError, match="in the model already"):
        terrain.add_effect(trial.model, "slip-sinkage", windows)


def test_an_effect_that_does_not_pay_changes_nothing(folder, tmp_path):
    clean = folder / "clean.csv"
    refused = terrain.add_effect("wong-reece", "slip-sinkage", clean, path=tmp_path / "model.toml")
    assert not refused.kept
    assert refused.model == terrain.load_model("wong-reece")
    assert list(tmp_path.iterdir()) == []
    assert isinstance(refused.plot(), Figure)
    # Half of 120 samples makes no eight stretches of ten.
    kept = terrain.add_effect("wong-reece", "slip-sinkage", clean, keep=True, keep_aside=0.5)
    assert (kept.kept, kept.pays) == (True, False)
    assert [effect.id for effect in kept.model.model.effects] == ["slip-sinkage"]
    assert kept.history[-1]["because"].startswith("--keep")
    assert kept.history[-1]["proof"] == "same data"
    assert kept.history[-1]["proof_because"] == "too short to keep any aside"
    assert "clean.csv: too short to keep stretches aside: 120 samples, and 160 are needed" in str(kept)


def test_own_effects_are_found_from_the_model_file(folder, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "models").mkdir()
    law = SAMPLE / "tutorial" / "cable-drag.toml"
    (tmp_path / law.name).write_bytes(law.read_bytes())
    kept = terrain.add_effect(
        "wong-reece", law.name, folder / "clean.csv", path="models/model.toml", keep=True
    )
    assert kept.model.effects == (f"../{law.name}",)
    assert [one.id for one in terrain.load_model("models/model.toml").model.effects] == ["cable-drag"]


def test_simulate_is_the_command(folder):
    drive = terrain.simulate(**DRIVE, effects=SINKS)
    read = pd.read_csv(folder / "sinks.csv")
    pd.testing.assert_frame_equal(drive.frame, read, check_exact=True)
    assert json.loads(drive.to_json()) == json.loads((folder / "sinks.csv.json").read_text("utf-8"))
    assert len(drive.truth) == len(read)
    assert set(drive.truth["slip-sinkage.n1"]) == {0.4}
    assert drive.rover.default.radius == 0.125
    (samples,) = drive.samples
    np.testing.assert_allclose(samples.channels["torque"], read["torque"], rtol=1e-12)
    assert "slip-sinkage" in str(drive)


def test_a_drive_file_is_a_base_for_keywords(tmp_path):
    (tmp_path / "drive.toml").write_text('drive = "slope"\nduration = 20\nrate = 2\n')
    drive = terrain.simulate(tmp_path / "drive.toml", duration=10.0, part=[{"duration": 10.0, "slip": 0.2}])
    assert len(drive.frame) == pytest.approx(20, abs=1)
    assert drive.truth["slip"].to_numpy() == pytest.approx(0.2)
    hidden = terrain.simulate(hide=True, seed=4, rate=1.0)
    assert [one.hidden for one in hidden.log.scenario.effects] == [True]
    assert hidden.log.scenario.effects[0].effect.id not in str(hidden)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"drive": "slip-swep"}, "simulate.*did you mean slip-sweep"),
        ({"durations": 3.0}, "durations: unknown key"),
        ({"effects": "slip-snkage"}, "did you mean slip-sinkage"),
        ({"noise": {"torq": "3%"}}, "did you mean torque"),
    ],
)
def test_wrong_keywords_are_told(given, message):
    with pytest.raises(UsageError, match=message):
        terrain.simulate(**given)


def test_report_is_the_command(folder, tmp_path, printed):
    page = terrain.report(folder / "clean.csv", tmp_path / "page.html")
    assert page.read_text("utf-8") == printed("report", folder / "clean.csv", "-o", "-")


def test_without_torque_errors_are_compared_and_no_soil_is_estimated(folder):
    frame = pd.read_csv(folder / "clean.csv").drop(columns="torque")
    wheels = terrain.from_frame(frame, folder / "rover.toml")
    assert list(terrain.compare(wheels).channels.index) == ["drawbar_pull", "sinkage"]
    for function in (terrain.estimate, terrain.summarise):
        with pytest.raises(InputError, match="c and φ need torque"):
            function(wheels)
    with pytest.raises(InputError, match="c and φ need torque"):
        terrain.trace(terrain.segment(wheels[0]))
    with pytest.raises(InputError, match="no sample"):
        terrain.compare([])


def test_help_lists_every_function():
    program = "import sys, terrain_cli; dir(terrain_cli); print('pandas' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", program], check=True, capture_output=True, text=True)
    assert done.stdout == "False\n"
    text = pydoc.plain(pydoc.render_doc(terrain))
    functions = [name for name in terrain.__all__ if name[0].islower()]
    assert {"compare", "diagnose", "add_effect", "simulate", "report"} <= {*functions}
    for name in functions:
        assert f"\n    {name}(" in text
        assert name in (terrain.__doc__ or "")
        said = inspect.getdoc(getattr(terrain, name))
        assert all(f"\n{part}\n" in said for part in ("Parameters", "Returns", "Raises"))
