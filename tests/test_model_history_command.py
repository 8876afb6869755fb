"""`terrain-est model history`, and the same ladder in the report."""

from __future__ import annotations

import json
import re
import shutil

import pytest
from changed_models import MODEL

CUT = ("--segments", "none", "-q")
#: Entries as the program writes them: an effect that pays, one added by hand, one that was removed again.
HISTORY = """
[[history]]
action = "add"
changed = ["slip-sinkage"]
because = "the held-out error fell in sinkage from 6.36 to 0.792 mm"
when = "2026-05-04T09:30:00Z"
version = "0.1.0"
base = "wong-reece"
effects = ["slip-sinkage"]
tested = true
data = { sources = ["a.csv", "b.csv", "c.csv"], samples = 800, segments = 1, blocks = 40 }
channels.torque = { unit = "N m", heldout_before = 0.42, heldout_before_interval = [0.37, 0.48], heldout_after = 0.17, heldout_after_interval = [0.16, 0.18], difference = -0.25, difference_interval = [-0.3, -0.2], noise = 0.168 }
channels.sinkage = { unit = "m", heldout_before = 0.00636, heldout_before_interval = [0.00567, 0.00713], heldout_after = 0.000792, noise = 0.00077 }
ratio = 0.23
failures_before = 3
failures_after = 0

[[history]]
added = "a note by hand"
on = 2026-05-05

[[history]]
action = "add"
changed = ["hardpan", "load-bias"]
because = "no data were given"
tested = false

[[history]]
action = "remove"
changed = ["hardpan"]
because = "asked for; in no channel did it change by more than chance and 2%"
tested = true
channels.torque = { unit = "N m", heldout_before = 0.17, heldout_after = 0.18, heldout_after_interval = [0.16, 900.0] }
"""  # noqa: E501 - as the program writes it


@pytest.fixture
def here(tmp_path, monkeypatch):
    (tmp_path / "model.toml").write_text(MODEL + HISTORY, "utf-8")
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.usefixtures("here")
class TestTable:
    def test_rows(self, terrain_est_here):
        done = terrain_est_here("model", "history", "model.toml")
        assert (done.returncode, done.stderr) == (0, "")
        lines = [re.split(r"\s{2,}", line.strip()) for line in done.stdout.splitlines()]
        assert lines[0] == ["model.toml: wong-reece, after 4 changes on record"]
        assert lines[2] == [
            "step",
            "change",
            "held-out rms error",
            "before",
            "95 %",
            "after",
            "95 %",
            "noise",
        ]
        torque = [
            "1",
            "+ slip-sinkage",
            "torque T (N m)",
            "0.42",
            "0.37 … 0.48",
            "0.17",
            "0.16 … 0.18",
            "0.168",
        ]
        assert lines[3] == torque
        # Lengths as a person reads them; what is not known is not guessed.
        assert lines[4] == ["sinkage z (mm)", "6.36", "5.67 … 7.13", "0.792", "–", "0.77"]
        assert lines[5] == ["2", "added a note by hand, on 2026-05-05"]
        assert lines[6] == ["3", "+ hardpan and load-bias"]
        assert "800 samples of a.csv, b.csv and 1 more; the held-out error fell" in done.stdout
        assert "3  + hardpan and load-bias: not tested; no data were given" in done.stdout

    def test_json_has_the_entries_as_they_are(self, terrain_est_here):
        found = json.loads(terrain_est_here("model", "history", "model.toml", "--json").stdout)
        assert found["format"] == "terrain-est/model-history/1"
        assert (found["base"], found["effects"]) == ("wong-reece", [])
        assert [step.get("action") for step in found["steps"]] == ["add", None, "add", "remove"]
        assert found["steps"][0]["channels"]["torque"]["heldout_before_interval"] == [0.37, 0.48]

    def test_picture(self, here, terrain_est_here):
        done = terrain_est_here("model", "history", "model.toml", "--plot", "made/here")
        assert (done.returncode, done.stderr) == (0, "2 pictures in made/here\n")
        assert {path.name for path in (here / "made" / "here").iterdir()} == {"ladder.png", "ladder.svg"}
        text = (here / "made" / "here" / "ladder.svg").read_text("utf-8")
        for said in ("torque (N m)", "sinkage (mm)", "+ slip-sinkage", "− hardpan", "noise", "before (95 %)"):
            assert said in text
        # What was not tested has no place in it.
        assert "load-bias" not in text

    def test_show_tells_it_in_short(self, terrain_est_here):
        told = terrain_est_here("model", "show", "model.toml").stdout
        assert "  1. + slip-sinkage: the held-out error fell in sinkage from 6.36 to 0.792 mm" in told
        assert "  2. added a note by hand" in told


def test_a_file_without_history(here, terrain_est_here):
    (here / "model.toml").write_text(MODEL, "utf-8")
    done = terrain_est_here("model", "history", "model.toml", "--plot", "pictures")
    assert done.returncode == 0
    assert done.stdout == "model.toml: wong-reece, after 0 changes on record\n"
    assert done.stderr == "no step was tried on data: no picture\n"
    assert terrain_est_here("model", "history", "gone.toml").returncode == 78
    assert terrain_est_here("model", "history", "wong-reece").returncode == 2


@pytest.mark.parametrize(
    "entry",
    [
        'action = "add"',
        'action = "add"\nchanged = []',
        'action = "add"\nchanged = "x"\nchannels = 3',
        'action = "add"\nchanged = ["x"]\nchannels = { torque = 3 }\ndata = 1',
        'action = "add"\nchanged = ["x"]\nchannels.torque = { heldout_before = "much", noise = [] }',
        'action = "add"\nchanged = ["x"]\ndata = { sources = 3 }',
        'action = "add"\nchanged = ["x"]\nchannels.torque = { heldout_before_interval = [1] }',
        "action = 3",
    ],
)
def test_what_another_hand_wrote_is_shown_as_far_as_it_is_known(here, terrain_est_here, entry):
    (here / "model.toml").write_text(f"{MODEL}\n[[history]]\n{entry}\n", "utf-8")
    for args in (["history"], ["history", "--json"], ["show"]):
        done = terrain_est_here("model", *args[:1], "model.toml", *args[1:])
        assert (done.returncode, done.stderr) == (0, "")


def test_a_ladder_that_was_climbed(logs, here, terrain_est_here):
    """Added, removed and added again: each step begins where the one before ended."""
    shutil.copytree(logs, here, dirs_exist_ok=True)
    (here / "model.toml").write_text(MODEL, "utf-8")
    for verb in ("add", "remove", "add"):
        done = terrain_est_here("model", verb, "model.toml", "slip-sinkage", "--data", "sinks.csv", *CUT)
        assert done.returncode == 0
    steps = json.loads(terrain_est_here("model", "history", "model.toml", "--json").stdout)["steps"]
    assert [step["action"] for step in steps] == ["add", "remove", "add"]
    errors = [
        (step["channels"]["sinkage"]["heldout_before"], step["channels"]["sinkage"]["heldout_after"])
        for step in steps
    ]
    assert errors[0] == errors[2]
    assert errors[0] == pytest.approx(errors[1][::-1], rel=0.05)
    page = terrain_est_here("report", "sinks.csv", "--model", "model.toml", "-o", "page.html", *CUT)
    assert page.returncode == 0
    text = (here / "page.html").read_text("utf-8")
    for said in (
        "How the model came about",
        "Held-out error of sinkage",
        "− slip-sinkage",
        "+ slip-sinkage",
        "change, as numbered above",
    ):
        assert said in text
    without = terrain_est_here("report", "sinks.csv", "-o", "page.html", *CUT)
    assert without.returncode == 0
    assert "How the model came about" not in (here / "page.html").read_text("utf-8")
