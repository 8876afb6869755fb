"""`terrain-est model add --until-quiet`, and the drafts it writes."""

from __future__ import annotations

import json
import re
import shutil
from pathlib import Path
from types import SimpleNamespace

import pytest
from changed_models import DIGS, MODEL
from click.testing import CliRunner

from terrain_cli import diagnosis, models
from terrain_cli.app import cli
from terrain_cli.diagnosis.diagnosis_outcome import Alarm, NextDrive
from terrain_cli.improvement import change_trial

CUT = ("--segments", "none", "-q")


@pytest.fixture(autouse=True)
def here(logs, tmp_path, monkeypatch):
    shutil.copytree(logs, tmp_path, dirs_exist_ok=True)
    (tmp_path / "model.toml").write_text(MODEL, "utf-8")
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_a_wheel_that_sinks_as_it_slips(terrain_est_here, here):
    done = terrain_est_here(
        "model", "add", "model.toml", "--until-quiet", "--json", *CUT, "--data", "sinks.csv"
    )
    assert done.returncode == 0
    found = json.loads(done.stdout)
    assert found["format"] == "terrain-est/model-loop/1"
    kept = [step for step in found["steps"] if step["kept"]]
    assert all(step["pays"] == step["kept"] for step in found["steps"])
    first, last = (step["channels"]["sinkage"] for step in (kept[0], kept[-1]))
    assert last["heldout_after"] < first["heldout_before"] / 3.0
    assert last["heldout_after"] < 1.2 * last["noise"]
    assert found["silent"]
    file = models.load("model.toml")
    assert [effect.id for effect in file.model.effects] == found["model"]["effects"] == ["slip-sinkage"]
    assert [entry["action"] for entry in file.history] == [step["action"] for step in kept]
    assert all(entry["because"].startswith("--until-quiet; ") for entry in file.history)
    assert "# The left front wheel" in (here / "model.toml").read_text("utf-8")
    text = (Path(__file__).resolve().parent.parent / "docs" / "model.md").read_text("utf-8")
    assert not [key for key in found if f"`{key}`" not in text]


def test_it_ends_with_the_errors_that_compare_finds(terrain_est_here):
    """What two models leave on the same blocks is another error than either leaves on its own."""
    ended = terrain_est_here("model", "add", "model.toml", "--until-quiet", *CUT, "--data", "sinks.csv")
    done = terrain_est_here("compare", "sinks.csv", "--model", "model.toml", *CUT)
    assert ended.stdout.splitlines()[-1] == done.stdout.splitlines()[-1]
    for channel in ("torque", "drawbar pull", "sinkage"):
        told, compared = (
            next(line for line in out.stdout.splitlines() if line.startswith(channel))
            for out in (ended, done)
        )
        assert re.split("  +", told)[-3:-1] == re.split("  +", compared)[-2:]


def test_a_clean_log_leaves_the_file_as_it_is(terrain_est_here, here):
    done = terrain_est_here("model", "add", "model.toml", "--until-quiet", *CUT, "--data", "clean.csv")
    assert done.returncode == 0
    assert done.stdout.startswith("model.toml: the data show no missing effect")
    assert (
        "The model fits to within the noise: the held-out error is at most 1.0"
        in done.stdout.splitlines()[-1]
    )
    assert "the model is as it was" in done.stdout
    assert (here / "model.toml").read_text("utf-8") == MODEL


@pytest.fixture
def told_of(monkeypatch):
    """Return a function that runs the loop with a diagnosis that is told to it, and silence after that."""

    def run(*args, data="sinks.csv", **answer):
        nothing = {"effect": None, "family": (), "together": (), "together_or": (), "pair": None}
        nothing |= {"unrecorded": (), "next_drive": ()}
        quiet, raised = (
            Alarm(raised=False, p_value=1.0, level=0.01),
            Alarm(raised=True, p_value=0.0, level=0.01),
        )
        silence = {**nothing, "unknown": None, "alarm": quiet, "verdict": "none"}
        answers = [{**silence, "alarm": raised, **answer}, silence]

        def diagnose(wheels, file, *, effects, seed, progress):
            return SimpleNamespace(
                comparison=change_trial.compared(wheels, file),
                candidates=[],
                heldout={},
                soils=1,
                **answers.pop(0),
            )

        monkeypatch.setattr(diagnosis, "diagnose", diagnose)
        command = ["model", "add", "model.toml", "--until-quiet", *args, *CUT, "--data", data]
        done = CliRunner().invoke(cli, command, catch_exceptions=False)
        assert done.exit_code == 0
        return done.stdout

    return run


def test_one_kept_of_a_family_is_said_to_be_in_doubt(told_of):
    family = ("slip-sinkage", "load-bias", "multi-pass", "hardpan")
    drive = NextDrive(family[:2], "drive over stones", 0.9)
    said = told_of(verdict="family", family=family, next_drive=[drive])
    assert models.load("model.toml").effects == family[:1]
    (line,) = (line for line in said.splitlines() if line.startswith("kept slip-sinkage; "))
    (entry,) = models.load("model.toml").history
    assert entry["rivals"] == list(family[1:])
    assert entry["next_drive"]["pair"] == list(family[:2])
    for told in (*entry["rivals"], entry["next_drive"]["manoeuvre"]):
        assert told in line
        assert told in entry["because"]


class TestDrafts:
    """With a diagnosis that knows no name, and drafts a law."""

    @pytest.fixture
    def run(self, told_of):
        def run(draft, *args, **options):
            law = {"law": "sinkage follows slip", "sentence": "Sinkage follows slip."}
            unknown = SimpleNamespace(draft=draft, begins=False, explained=0.9, **law)
            return told_of(*args, verdict="unknown", unknown=unknown, **options)

        return run

    def test_without_a_place_the_loop_stops(self, run, here):
        told = run(DIGS)
        assert told.startswith(
            "model.toml: sinkage follows slip; --draft FILE.toml adds this law; the model is as it was"
        )
        assert (here / "model.toml").read_text("utf-8") == MODEL

    def test_one_that_pays_stays(self, run, here):
        told = run(DIGS, "--draft", "own/drafts")
        assert told.startswith("1. + digs-itself-in: the held-out error fell in")
        assert models.load("model.toml").effects == ("own/drafts/digs-itself-in.toml",)
        assert (here / "own" / "drafts" / "digs-itself-in.toml").read_text("utf-8") == DIGS

    def test_one_that_does_not_is_removed_again(self, run, here):
        told = run(DIGS, "--draft", "draft.toml", data="clean.csv")
        assert told.startswith("1. not digs-itself-in: ")
        assert not (here / "draft.toml").exists()
        assert models.load("model.toml").effects == ()

    def test_no_file_of_yours_is_written_over(self, run, here):
        (here / "draft.toml").write_text("mine", "utf-8")
        run(DIGS, "--draft", "draft.toml")
        assert (here / "draft.toml").read_text("utf-8") == "mine"
        assert models.load("model.toml").effects == ("draft-2.toml",)
