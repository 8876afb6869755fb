"""`terrain-est diagnose` on logs of the simulator: what is hidden in them is known."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from changed_models import DIGS, ROVER, once, write_log

from terrain_cli import diagnosis
from terrain_cli.commands import comparison_options
from terrain_cli.commands.diagnose import command
from terrain_cli.diagnosis import diagnosis_criteria
from terrain_cli.views.figures.model_figures import MOST_CANDIDATES

ROOT = Path(__file__).resolve().parent.parent
KEYS = {
    "format",
    "model",
    "data",
    "channels",
    "alarm",
    "verdict",
    "effect",
    "family",
    "together",
    "together_or",
    "together_heldout_rmse",
    "candidates",
    "unknown",
    "next_drive",
    "not_testable",
    "warnings",
}
WHOLE = ("--segments", "none")
#: At ten samples a second.
SECONDS = 60.0


#: As a laboratory heads its columns.
HEATER = "Heater power [of 5 W]"


def with_heater(path):
    """Add a column that drives the torque in a way that no effect of the catalogue does."""
    table = pd.read_csv(path)
    some = np.random.default_rng(4).integers(0, 5, size=len(table) // 25 + 1)
    table[HEATER] = np.repeat(some, 25)[: len(table)] / 4.0
    table["torque"] += 0.8 * table[HEATER]
    return table


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Write a clean log, one with slip-sinkage, and one with an effect that is in no catalogue."""
    path = tmp_path_factory.mktemp("logs")
    (path / "rover.toml").write_text(ROVER, "utf-8")
    (path / "digs.toml").write_text(DIGS, "utf-8")
    write_log(path / "clean.csv", seconds=SECONDS)
    write_log(path / "sinks.csv", {"slip-sinkage": {"n1": 0.4}}, seed=2, seconds=SECONDS)
    with_heater(path / "clean.csv").to_csv(path / "heated.csv", index=False)
    return path


@pytest.fixture(scope="module")
def done(folder, terrain_est_here):
    """Return the answers to the three logs, as the command gives them.

    What is told to a person and what is written as JSON come from one diagnosis.
    """
    (folder / "law.toml").write_text("old", "utf-8")

    def run(name, *args):
        return terrain_est_here("diagnose", name, *WHOLE, *args, cwd=folder)

    found = {
        "clean": run("clean.csv", "--json", "-q", "--draft", "needless.toml"),
        "heated": run("heated.csv", "--json", "--draft", "law.toml", "--force", "--plot", "pictures"),
    }
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(diagnosis, "diagnose", once(diagnosis.diagnose))
        found["sinks, for a person"] = run("sinks.csv")
        found["sinks"] = run("sinks.csv", "--json", "-q")
    return found


@pytest.fixture(scope="module")
def found(done):
    answers = {name: json.loads(one.stdout) for name, one in done.items() if name != "sinks, for a person"}
    assert all(one.returncode == 0 for one in done.values())
    return answers


def test_clean_log_lacks_nothing(found, done, folder):
    clean = found["clean"]
    assert (clean["verdict"], clean["effect"], clean["family"]) == ("none", None, [])
    assert clean["alarm"]["raised"] is False
    assert clean["alarm"]["p_value"] > clean["alarm"]["level"]
    assert clean["unknown"] is None
    assert not any(one["refitted"] or one["in_family"] for one in clean["candidates"])
    assert not (folder / "needless.toml").exists()
    assert "needless.toml: not written" in done["clean"].stderr


def test_missing_effect_is_named(found):
    sinks = found["sinks"]
    assert (sinks["verdict"], sinks["effect"], sinks["family"]) == (
        "effect",
        "slip-sinkage",
        ["slip-sinkage"],
    )
    assert sinks["alarm"]["raised"] is True
    assert sinks["alarm"]["p_value"] < sinks["alarm"]["level"]
    assert sinks["alarm"]["gain"] > 2.0 * sinks["alarm"]["gain_se"]
    first, *others = sinks["candidates"]
    assert first["effect"] == "slip-sinkage"
    assert first["in_family"]
    assert not any(one["in_family"] for one in others)
    assert first["explained"] > 0.9

    def beyond(errors):
        """Return the squares beyond the noise, each in units of the error without the effect."""
        return sum(
            max(errors[name] ** 2 - one["noise"] ** 2, 0.0) / one["heldout_rmse"] ** 2
            for name, one in sinks["channels"].items()
        )

    before = beyond({name: one["heldout_rmse"] for name, one in sinks["channels"].items()})
    for one in sinks["candidates"]:
        if one["refitted"]:
            share = max(1.0 - beyond(one["heldout_rmse"]) / before, 0.0)
            assert one["explained"] == pytest.approx(share), one["effect"]
    n1 = first["parameters"]["n1"]
    assert (n1["value"], n1["unit"]) == (pytest.approx(0.4, abs=4.0 * n1["se"]), "1")
    before, after = sinks["channels"]["sinkage"]["heldout_rmse"], first["heldout_rmse"]["sinkage"]
    assert after < before / 3.0


def test_picture_shows_the_best_candidates_that_were_fitted(found, done, folder):
    assert {path.name for path in (folder / "pictures").iterdir()} == {"candidates.png", "candidates.svg"}
    drawn = (folder / "pictures" / "candidates.svg").read_text("utf-8")
    fitted = [one["effect"] for one in found["heated"]["candidates"] if one["refitted"]]
    assert fitted
    assert all(name in drawn for name in fitted[:MOST_CANDIDATES])
    assert "2 pictures in pictures" in done["heated"].stderr


def test_what_is_in_no_catalogue_gets_a_law(found, folder, terrain_est_here):
    heated = found["heated"]
    assert (heated["verdict"], heated["effect"], heated["family"]) == ("unknown", None, [])
    unknown = heated["unknown"]
    assert (unknown["channel"], unknown["driver"]) == ("torque", HEATER)
    assert unknown["explained"] > 0.7
    checked = terrain_est_here("effects", "check", folder / "law.toml")
    assert checked.returncode == 0, checked.stderr
    law = (folder / "law.toml").read_text("utf-8")
    assert 'changes = "torque"' in law
    assert f"`{HEATER}`" in law
    assert "The law is in law.toml." in heated["sentence"]
    assert "--draft" not in heated["sentence"]


def test_the_next_law_is_drafted_under_a_name_that_is_free(done, folder, monkeypatch):
    """The first one may be an effect of the model by now, and is read."""
    assert done["heated"].returncode == 0
    monkeypatch.chdir(folder)
    with command.make_context("diagnose", ["heated.csv"]) as context:
        assert comparison_options.repeated(context, "wong-reece").law == "law-2.toml"


@pytest.mark.parametrize(
    ("draft", "code", "said"),
    [
        ("digs.toml", 73, "digs.toml: is there already\n  --force replaces it"),
        ("rover.toml", 2, "--draft rover.toml would be written onto the rover file rover.toml"),
        ("nowhere/law.toml", 73, "nowhere/law.toml: no such folder"),
        (".", 73, "is a folder"),
    ],
)
def test_draft_that_cannot_be_written_is_told_before_the_work(draft, code, said, folder, terrain_est_here):
    # Not even the input is looked for.
    done = terrain_est_here("diagnose", "nowhere.csv", "--draft", draft, cwd=folder)
    assert (done.returncode, done.stdout) == (code, "")
    assert said in done.stderr
    assert (folder / "rover.toml").read_text("utf-8") == ROVER
    assert (folder / "digs.toml").read_text("utf-8") == DIGS


def test_draft_replaces_a_file_when_told_to(done, folder):
    assert "law.toml: the law is written" in done["heated"].stderr
    assert "old" not in (folder / "law.toml").read_text("utf-8")


def test_has_the_keys_of_the_contract(found):
    for answer in found.values():
        assert answer.keys() >= KEYS
        assert answer["format"] == "terrain-est/diagnosis/1"
        assert answer["model"] == {"base": "wong-reece", "effects": []}
        assert answer["data"].keys() == {"sources", "samples", "segments", "blocks"}
        assert answer["data"]["samples"] == 10.0 * SECONDS
        assert answer["data"]["segments"] == 1
        assert {name: one["unit"] for name, one in answer["channels"].items()} == {
            "torque": "N m",
            "drawbar_pull": "N",
            "sinkage": "m",
        }
        assert answer["alarm"].keys() >= {"raised", "p_value", "level"}
        for one in answer["candidates"]:
            assert one.keys() >= {"effect", "score", "p_value", "explained", "heldout_rmse", "parameters"}
            assert one["heldout_rmse"].keys() == answer["channels"].keys()
            assert 0.0 <= one["explained"] <= 1.0
            assert all(
                size.keys() == {"value", "se", "unit", "wheels"} for size in one["parameters"].values()
            )
        assert all(one.keys() == {"effect", "because"} for one in answer["not_testable"])
        tried = {one["effect"] for one in answer["candidates"]}
        assert not tried & {one["effect"] for one in answer["not_testable"]}


def test_begins_with_the_sentence(found, done):
    told = done["sinks, for a person"].stdout
    assert told.splitlines()[0] == found["sinks"]["sentence"]
    assert "slip-sinkage" in told.splitlines()[0]
    assert "alarm: raised" in told
    assert "not testable on these data:" in told


def test_first_scores_are_told_before_the_refits_and_leave_stdout_as_it_is(done):
    loud = done["sinks, for a person"]
    assert "first scores" not in loud.stdout
    assert "first scores" in done["heated"].stderr
    assert done["sinks"].stderr == ""
    head, *scores = loud.stderr.splitlines()
    assert re.fullmatch(r"first scores of \d+ effects, in standard errors, before any fit:", head)
    found = [re.fullmatch(r"  (\S+) +(\d+\.\d)  p 0\.\d{4}", line) for line in scores]
    assert found[0][1] == "slip-sinkage"
    sizes = [float(one[2]) for one in found]
    assert sizes == sorted(sizes, reverse=True)
    assert len(sizes) == 5


def test_first_scores_come_before_any_effect_is_fitted(folder):
    from terrain_cli import models, rover, telemetry
    from terrain_cli.diagnosis import diagnose
    from terrain_cli.windows import cut_windows

    samples = telemetry.read(str(folder / "sinks.csv"), rover.load(folder / "rover.toml"), compared=True)
    events = []
    diagnose(
        [cut_windows.cut(one, "none") for one in samples],
        models.resolve("wong-reece"),
        progress=events.append,
        early=lambda found: events.append(found.scores),
    )
    at = next(place for place, event in enumerate(events) if isinstance(event, dict))
    assert max(events[at], key=events[at].get) == "slip-sinkage"
    assert not any(str(event).startswith("fitting with") for event in events[:at])
    assert any(str(event).startswith("fitting with") for event in events[at:])


def test_own_effect_stands_beside_those_of_the_catalogue(folder, terrain_est_here):
    args = ("--effect", folder / "digs.toml", *WHOLE, "--json", "-q")
    done = terrain_est_here("diagnose", folder / "clean.csv", *args)
    assert (done.returncode, done.stderr) == (0, "")
    (own,) = (one for one in json.loads(done.stdout)["candidates"] if one["effect"] == "digs-itself-in")
    dig = own["parameters"]["dig"]
    assert abs(dig["value"]) < 4.0 * dig["se"] < 0.2


def test_what_a_model_has_is_no_candidate(folder, tmp_path, terrain_est_here):
    model = tmp_path / "model.toml"
    model.write_text('format = "terrain-est/model/1"\nbase = "wong-reece"\neffects = ["slip-sinkage"]\n')
    done = terrain_est_here("diagnose", folder / "sinks.csv", "--model", model, *WHOLE, "--json", "-q")
    assert done.returncode == 0, done.stderr
    answer = json.loads(done.stdout)
    assert answer["model"]["effects"] == ["slip-sinkage"]
    assert answer["verdict"] == "none"
    assert "slip-sinkage" not in {one["effect"] for one in answer["candidates"]}


def sinking_points(folder, slip):
    """Write a wheel that sinks three times as deep as it slips, in steady points at one load."""
    slip = np.array(slip)
    sinkage = 0.005 * (1.0 + 4.0 * slip)
    table = pd.DataFrame({"load": 80.0, "slip": slip, "sinkage": sinkage})
    table["torque"] = 5.5 * (1.0 - np.exp(-slip / 0.12))
    table["drawbar_pull"] = table["torque"] / 0.125 - 80.0 * np.sqrt(sinkage / 0.25)
    table.to_csv(folder / "points.csv", index=False)
    (folder / "rover.toml").write_text(ROVER, "utf-8")
    return folder / "points.csv"


def test_few_test_points_are_not_said_to_miss_nothing(tmp_path, terrain_est_here):
    done = terrain_est_here("diagnose", sinking_points(tmp_path, [0.05, 0.1, 0.3, 0.45, 0.6]), "-q")
    assert done.returncode == 0, done.stderr
    sentence = done.stdout.splitlines()[0]
    assert sentence.startswith("Probable cause: slip-sinkage ")
    assert "but 5 independent stretches of data are too few to be sure" in sentence
    assert "Nothing is missing" not in done.stdout


def test_of_two_samples_nothing_is_told(tmp_path, terrain_est_here):
    """What is late of two samples looks like two soils."""
    (tmp_path / "rover.toml").write_text(ROVER, "utf-8")
    lines = (ROOT / "sample_data" / "run.csv").read_text("utf-8").splitlines()
    # Of each of two wheels.
    (tmp_path / "short.csv").write_text("\n".join(lines[:5]) + "\n", "utf-8")
    done = terrain_est_here("diagnose", "short.csv", "-q", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    (same,) = [line for line in done.stdout.splitlines() if line.endswith("looks the same in these data")]
    assert {"sinkage-relaxation", "sensor-lag"} <= set(same.strip().partition(":")[0].split(", "))
    assert "1 independent stretch of data is too few" in done.stdout


def test_six_points_that_sink_the_deeper_the_more_they_slip(tmp_path, terrain_est_here):
    done = terrain_est_here("diagnose", sinking_points(tmp_path, [0.05, 0.1, 0.2, 0.3, 0.45, 0.6]), "--json")
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    assert (found["verdict"], found["effect"]) == ("family", None)
    assert found["family"][0] == "slip-sinkage"
    assert "6 independent stretches of data are too few to be sure" in found["sentence"]


@pytest.mark.parametrize(
    ("args", "code", "said"),
    [
        (["nowhere.csv"], 66, "nowhere.csv"),
        (["clean.csv", "--model", "nowhere.toml"], 78, "nowhere.toml"),
        (["clean.csv", "--effect", "bad.toml"], 78, "yaw_rat"),
        (["clean.csv", "--effect", "cable-dragg"], 2, "cable-dragg"),
        (["clean.csv", "--rover", "bad.toml"], 78, "bad.toml"),
        (["few.csv"], 65, "few.csv"),
        ([], 2, "INPUT"),
    ],
)
def test_errors(args, code, said, folder, terrain_est_here):
    (folder / "bad.toml").write_text(DIGS.replace("abs(slip)", "abs(yaw_rat)"), "utf-8")
    pd.read_csv(folder / "clean.csv").drop(columns=["sinkage", "torque", "drawbar_pull"]).to_csv(
        folder / "few.csv", index=False
    )
    done = terrain_est_here("diagnose", *args, cwd=folder)
    assert (done.returncode, done.stdout) == (code, ""), done.stderr
    assert said in done.stderr
    assert "Traceback" not in done.stderr


def keys_of(value):
    """Yield every key of a document, but not those that are names of channels, parameters or wheels."""
    if isinstance(value, list):
        for one in value:
            yield from keys_of(one)
    elif isinstance(value, dict):
        for key, one in value.items():
            yield key
            named = key in {"channels", "parameters", "heldout_rmse", "wheels"} and isinstance(one, dict)
            yield from keys_of(list(one.values()) if named else one)


def test_keys_are_documented(found):
    text = (ROOT / "docs" / "diagnose.md").read_text("utf-8")
    keys = {key for answer in found.values() for key in keys_of(answer)} | KEYS
    assert {"pair", "manoeuvre", "power", "settings", "gain_se", "in_family"} - keys <= {
        "pair",
        "manoeuvre",
        "power",
        "settings",
    }
    assert sorted(key for key in keys if f"`{key}`" not in text) == []


def test_forms_of_drafts_are_documented():
    from terrain_cli.diagnosis import drafted_laws

    text = (ROOT / "docs" / "diagnose.md").read_text("utf-8")
    forms = re.search(r"`form` \((.*?)\)", text)[1]
    assert re.findall(r"`(\w+)`", forms) == list(drafted_laws.FORMS)


def test_what_is_smaller_than_asked_for_is_told_and_raises_no_alarm(folder, terrain_est_here):
    """Sinkage that grows with slip is nearly half of the sinkage here."""
    told = terrain_est_here("diagnose", folder / "sinks.csv", *WHOLE, "--smallest-share", "0.9", "--json")
    found = json.loads(told.stdout)
    alarm = found["alarm"]
    assert (alarm["raised"], found["verdict"], found["family"]) == (False, "none", [])
    assert alarm["p_value"] < alarm["level"]
    assert 0.1 < alarm["share"] < alarm["smallest_share"] == 0.9
    assert alarm["channel"] in found["channels"]
    assert found["sentence"].startswith("Slip-sinkage is only ")
    assert "That is not chance, but less than the 90 % that an alarm needs" in found["sentence"]
    assert found["conclusion"]["state"] == "fits"
    assert "less than --smallest-share asks for" in found["conclusion"]["sentence"]


def test_the_help_quotes_the_smallest_share_in_force(terrain_est_here):
    text = " ".join(terrain_est_here("diagnose", "--help").stdout.split())
    assert f"[{diagnosis_criteria.SMALLEST_SHARE:g}]" in text
