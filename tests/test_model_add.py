"""`terrain-est model add` and `model remove` on logs of which it is known what the model lacks."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest
from changed_models import DIGS, MODEL, ROVER

from terrain_cli import models
from terrain_cli.commands.model_changes import add

ROOT = Path(__file__).resolve().parent.parent
SHARED = ROOT.parent / "shared" / "data"
SLACK = """
id = "slack"
title = "Something between motor and sensor takes torque"
changes = "torque"
law = "torque + most"
[parameters.most]
unit = "mN m"
null = 0.0
scale = 100.0
"""
CUT = ("--segments", "none", "-q")
LINE = 'format = "terrain-est/model/1"\nbase = "linear"  # the paper\n'


def with_model(logs, path):
    shutil.copytree(logs, path, dirs_exist_ok=True)
    (path / "model.toml").write_text(MODEL, "utf-8")
    return path


@pytest.fixture
def here(logs, tmp_path, monkeypatch):
    """Return a folder of one's own with the logs and a model file."""
    monkeypatch.chdir(with_model(logs, tmp_path))
    return tmp_path


@pytest.fixture(scope="module")
def right(logs, tmp_path_factory, terrain_est_here):
    """Add what a log lacks, once for all tests; return the model file then, and what was said."""
    path = with_model(logs, tmp_path_factory.mktemp("right"))
    args = ("add", "model.toml", "slip-sinkage", "--data", "sinks.csv")
    done = terrain_est_here("model", *args, *CUT, "--json", cwd=path)
    assert (done.returncode, done.stderr) == (0, "")
    return path / "model.toml", json.loads(done.stdout)


@pytest.fixture
def added(right, here):
    file, said = right
    shutil.copy(file, here)
    return said


@pytest.fixture
def model(terrain_est_here):
    def run(*args):
        done = terrain_est_here("model", *args)
        assert (done.returncode, done.stderr) == (0, "")
        return done.stdout

    return run


def change(model, *args):
    """Return what a change says as JSON, its numbers all known by then."""
    return json.loads(model(*args, *CUT, "--json"))


@pytest.mark.usefixtures("here")
class TestRightEffect:
    def test_error_falls_to_the_noise(self, added):
        assert added["format"] == "terrain-est/model-change/1"
        assert (added["action"], added["changed"]) == ("add", ["slip-sinkage"])
        assert (added["pays"], added["kept"]) == (True, True)
        sinkage = added["channels"]["sinkage"]
        assert sinkage["heldout_after"] < sinkage["heldout_before"] / 3.0
        assert sinkage["heldout_after"] == pytest.approx(sinkage["noise"], rel=0.3)
        assert sinkage["difference_interval"][1] < 0.0
        for one in added["channels"].values():
            low, high = one["heldout_after_interval"]
            assert low < one["heldout_after"] < high
        assert added["ratio_interval"][1] < 1.0
        assert "the held-out error fell in" in added["sentence"]

    def test_alarm_is_silent_afterwards(self, added):
        assert added["alarm"]["failures_before"]
        assert added["alarm"]["silent"]
        assert added["conclusion"]["state"] == "fits"

    def test_says_what_other_commands_say_of_the_same_model(self, added, here, terrain_est_here):
        common = ("sinks.csv", "--model", "model.toml", *CUT)
        compared = json.loads(terrain_est_here("compare", *common, "--json", cwd=here).stdout)
        terrain_est_here("estimate", *common, "--csv", "--summary", "soil.json", cwd=here)
        (own,) = json.loads((here / "soil.json").read_text("utf-8"))["inputs"]
        others = [compared["parameters"][0], own["wheels"][0]["model"]["parameters"]]
        for one in added["parameters"]:
            for other in (*others, models.load("model.toml").history[0]["parameters"]):
                assert other[one["name"]]["value"] == pytest.approx(one["value"], rel=1e-5)
                assert other[one["name"]]["se"] == pytest.approx(one["se"], rel=1e-5)
        assert compared["conclusion"] == added["conclusion"]
        assert len(compared["failures"]) == len(added["alarm"]["failures_after"])
        for name, errors in compared["channels"].items():
            assert added["channels"][name]["noise"] == pytest.approx(errors["noise"], rel=0.02)

    def test_parameter_and_shift_of_the_soil(self, added):
        n1 = added["parameters"][0]
        assert (n1["name"], n1["unit"], n1["determined"]) == ("slip-sinkage.n1", "1", True)
        assert n1["value"] == pytest.approx(0.4, abs=4.0 * n1["se"])
        assert added["absent_p_value"] < 1e-6
        assert added["shift"].keys() == {"c", "phi"}
        assert added["shift"]["c"]["largest_se"] >= added["shift"]["c"]["median_se"] > 0.0
        assert added["unidentifiable"] == {"parameters": [], "segments": []}

    def test_file_gets_it_and_keeps_what_its_user_wrote(self, added, here):
        text = (here / "model.toml").read_text("utf-8")
        assert 'effects = ["slip-sinkage"]               # none yet' in text
        assert all(line.partition("#")[2] in text for line in MODEL.splitlines())
        (entry,) = models.load("model.toml").history
        assert entry["changed"] == ["slip-sinkage"]
        assert entry["when"].endswith("Z")
        assert entry["data"] == added["data"]
        assert entry["data"]["sources"] == ["sinks.csv"]
        assert entry["channels"]["sinkage"] == added["channels"]["sinkage"]
        assert entry["parameters"]["slip-sinkage.n1"]["value"] == added["parameters"][0]["value"]

    def test_a_person_reads_the_verdict_first(self, model):
        told = model("add", "model.toml", "slip-sinkage", "--data", "sinks.csv", *CUT)
        assert told.startswith("model.toml: slip-sinkage is added: the held-out error fell in")
        assert "\nsinkage z (mm)" in told
        assert re.search("^slip-sinkage.n1.*±", told, re.MULTILINE)
        assert "\nmoved: c by" in told

    def test_removing_it_says_what_it_was_worth(self, here, added, model):
        assert added["pays"]
        with (here / "model.toml").open("a", encoding="utf-8") as file:
            file.write("\n[fixed.slip-sinkage]\nn1 = 0.3\n")
        removed = change(model, "remove", "model.toml", "slip-sinkage", "--data", "sinks.csv")
        assert (removed["pays"], removed["kept"]) == (False, True)
        assert removed["sentence"].startswith(
            "slip-sinkage is removed, though it pays: the held-out error rose"
        )
        file = models.load("model.toml")
        assert (file.effects, file.fixed) == ((), {})
        assert [entry["action"] for entry in file.history] == ["add", "remove"]


@pytest.mark.usefixtures("here")
class TestWrongEffect:
    def test_is_refused_and_the_file_untouched(self, here, model):
        before = (here / "model.toml").read_bytes()
        told = model("add", "model.toml", "drivetrain-friction", "--data", "clean.csv", *CUT)
        said = "model.toml: the held-out error did not fall: drivetrain-friction is not added"
        assert told.startswith(said)
        assert (here / "model.toml").read_bytes() == before

    def test_is_kept_if_asked(self, model):
        found = change(model, "add", "model.toml", "drivetrain-friction", "--keep", "--data", "clean.csv")
        assert (found["pays"], found["kept"]) == (False, True)
        assert "as --keep asks" in found["sentence"]
        file = models.load("model.toml")
        assert file.effects == ("drivetrain-friction",)
        assert file.history[0]["because"].startswith("--keep")
        gone = change(model, "remove", "model.toml", "drivetrain-friction", "--data", "clean.csv")
        assert gone["pays"]
        assert gone["sentence"].startswith("drivetrain-friction is removed: ")
        assert models.load("model.toml").effects == ()


def test_what_was_tried_in_vain_is_not_proposed_again(here, model, terrain_est_here):
    """By any verb, for the same data and the same model, where the history says so."""
    before = Path("model.toml").read_bytes()
    told = model("add", "model.toml", "drivetrain-friction", "--data", "sinks.csv", *CUT).splitlines()
    assert "drivetrain-friction is not added" in told[0]
    assert Path("model.toml").read_bytes() == before
    with Path("model.toml").open("ab") as file:
        file.write(
            b'[[history]]\naction = "add"\nchanged = ["drivetrain-friction"]\nbecause = "it did not pay"\n'
            b'base = "wong-reece"\neffects = []\nkept = false\n'
            b'data = { sources = ["sinks.csv"], samples = 480 }\n'
        )
    said = terrain_est_here("compare", "sinks.csv", "--model", "model.toml", *CUT).stdout.splitlines()[-1]
    assert said == told[-1]
    tried = "drivetrain-friction was tried, and held-out data do not support it."
    assert f"{tried} Next: terrain-est model add" in said
    other = terrain_est_here("compare", "clean.csv", "--model", "model.toml", *CUT).stdout
    assert "was tried" not in other
    listed = model("history", "model.toml")
    assert "after 0 changes on record" in listed
    assert "\nnot drivetrain-friction: 480 samples of sinks.csv; " in listed


def test_an_effect_of_ones_own_lies_beside_the_model(here, model):
    (here / "models").mkdir()
    shutil.move("model.toml", "models/model.toml")
    found = change(model, "add", "models/model.toml", "digs.toml", "--data", "sinks.csv")
    assert found["pays"]
    assert found["changed"] == ["digs-itself-in"]
    assert models.load("models/model.toml").effects == ("../digs.toml",)
    assert "removed" in model("remove", "models/model.toml", "digs.toml")
    assert models.load("models/model.toml").effects == ()


def test_parameters_are_in_the_unit_of_the_effect(here, model, terrain_est_here):
    """And the same ones in `compare`."""
    (here / "slack.toml").write_text(SLACK, "utf-8")
    found = change(model, "add", "model.toml", "slack.toml", "--keep", "--data", "clean.csv")
    (slack,) = found["parameters"]
    assert slack["unit"] == "mN m"
    # Some hundredths of a N m.
    assert 1.0 < slack["se"] < 500.0
    told = terrain_est_here("compare", "clean.csv", "--model", "model.toml", "--json", *CUT)
    (compared,) = json.loads(told.stdout)["parameters"]
    assert compared["slack.most"]["unit"] == "mN m"
    assert compared["slack.most"]["value"] == pytest.approx(slack["value"], rel=1e-4, abs=1e-3)
    assert compared["slack.most"]["se"] == pytest.approx(slack["se"], rel=1e-4)


def test_all_that_follows_data_is_data(here, model):
    (here / "logs").mkdir()
    shutil.copy("clean.csv", "logs/clean.csv")
    found = change(model, "add", "model.toml", "digs.toml", "--keep", "--data", "sinks.csv", "logs/*.csv")
    assert found["data"]["sources"] == ["sinks.csv", "logs/clean.csv"]
    assert (found["data"]["samples"], found["data"]["segments"]) == (960, 2)
    # It is one wheel: its parameter is between those of the two drives.
    (dig,) = found["parameters"]
    assert 0.0 < dig["value"] < 0.4
    assert found["shift"]["c"]["source"] in found["data"]["sources"]
    assert found["shift"]["c"]["segment"] == 1


def test_several_effects_at_once(here, model):
    found = change(model, "add", "model.toml", "slip-sinkage", "drivetrain-friction", "--data", "sinks.csv")
    assert found["changed"] == ["slip-sinkage", "drivetrain-friction"]
    assert {one["name"].partition(".")[0] for one in found["parameters"]} == set(found["changed"])


def test_without_data_it_is_added_and_said_to_be_untested(here, model):
    told = model("add", "model.toml", "hardpan")
    assert told == "model.toml: hardpan is added, without a test: no --data was given\n"
    (entry,) = models.load("model.toml").history
    assert (entry["tested"], entry["because"]) == (False, "no data were given")
    found = json.loads(model("remove", "model.toml", "hardpan", "--json"))
    assert (found["tested"], found["pays"], found["kept"]) == (False, None, True)


def test_another_base_is_weighed_with_the_noise_that_reaches_the_first(here, model, terrain_est_here):
    """The full model predicts torque from the sinkage alone, with its noise; the line has the load too."""
    (here / "line.toml").write_text(LINE, "utf-8")
    (here / "full").mkdir()
    drive = ("--seed", "5", "--duration", "120", "--noise", "2%")
    assert terrain_est_here("simulate", "-o", "full/drive.csv", *drive).returncode == 0
    found = change(model, "add", "line.toml", "linearised-stresses", "--data", "full/drive.csv")
    assert found["pays"]
    for name in ("torque", "drawbar_pull"):
        error = found["channels"][name]
        assert error["heldout_after"] == pytest.approx(error["noise"], rel=0.05)
    told = model("remove", "line.toml", "linearised-stresses", "--data", "full/drive.csv", *CUT)
    assert "with the noise that reaches the base wong-reece" in told


def test_assumptions_are_lifted_and_made_again(here, model):
    (here / "line.toml").write_text(LINE, "utf-8")
    found = change(model, "add", "line.toml", "assumed-shear-modulus", "--keep", "--data", "clean.csv")
    (k,) = found["parameters"]
    assert (k["name"], k["unit"]) == ("shear_modulus", "m")
    assert 0.005 < k["value"] < 0.05
    assert models.load("line.toml").priors.keys() == {"shear_modulus"}
    assert "linearised-stresses is added" in model("add", "line.toml", "linearised-stresses", "--keep")
    assert 'base = "wong-reece"  # the paper' in (here / "line.toml").read_text("utf-8")
    model("remove", "line.toml", "linearised-stresses", "assumed-shear-modulus")
    file = models.load("line.toml")
    assert (file.model.base, dict(file.fixed), dict(file.priors)) == ("linear", {}, {})


@pytest.mark.parametrize(
    ("words", "inputs", "effects"),
    [
        (["m.toml", "x", "--data", "a", "b", "c"], ("a", "b", "c"), ("x",)),
        (["m.toml", "x", "y", "--data=a", "b", "--seed", "1"], ("a", "b"), ("x", "y")),
        (["m.toml", "x", "--data", "-", "b", "-q"], ("-", "b"), ("x",)),
        (["m.toml", "x", "--data", "a", "--data", "b"], ("a", "b"), ("x",)),
        (["--data", "a", "b", "--", "m.toml", "x"], ("a", "b"), ("x",)),
        (["--seed", "1", "m.toml", "x"], (), ("x",)),
    ],
)
def test_words_behind_data(words, inputs, effects):
    context = add.make_context("add", words)
    assert (context.params["file"], context.params["inputs"]) == ("m.toml", inputs)
    assert context.params["effects"] == effects


@pytest.mark.parametrize(
    ("args", "code", "message"),
    [
        (["add", "model.toml", "slip-sinkage", "--data", "gone.csv"], 66, "gone.csv"),
        (["add", "gone.toml", "slip-sinkage"], 78, "gone.toml: no such model file"),
        (["add", "linear", "slip-sinkage"], 2, "linear is a base, not a file"),
        (["add", "model.toml", "slip-sinkag"], 2, "did you mean slip-sinkage?"),
        (["add", "model.toml", "gone-effect.toml"], 66, "gone-effect.toml"),
        (["add", "model.toml", "bad.toml"], 78, "bad.toml"),
        (["add", "model.toml", "slip-sinkage", "slip-sinkage"], 2, "in the model already"),
        (["add", "line.toml", "slip-sinkage"], 78, "which the base linear does not have"),
        (["add", "model.toml", "linearised-stresses"], 2, "does not make the assumption"),
        (["add", "model.toml", "multi-pass", "--data", "clean.csv"], 65, "needs pass_number"),
        (["add", "model.toml"], 2, "no EFFECT is given"),
        (["add", "model.toml", "--until-quiet"], 2, "--until-quiet needs --data"),
        (["add", "model.toml", "--until-quiet", "--keep", "--data", "clean.csv"], 2, "contradict"),
        (["add", "model.toml", "hardpan", "--draft", "d.toml"], 2, "--draft is for --until-quiet"),
        (["remove", "model.toml", "hardpan"], 2, "the model has no effect hardpan"),
        (["remove", "model.toml"], 2, "EFFECT"),
    ],
)
def test_what_is_wrong_changes_nothing(terrain_est_here, here, args, code, message):
    (here / "line.toml").write_text(LINE, "utf-8")
    (here / "bad.toml").write_text(DIGS.replace("abs(slip)", "abs(slop)"))
    before = {path.name: path.read_bytes() for path in here.iterdir()}
    done = terrain_est_here("model", *args)
    assert (done.returncode, done.stdout) == (code, "")
    assert message in done.stderr
    assert {path.name: path.read_bytes() for path in here.iterdir()} == before


def test_a_write_that_fails_leaves_the_old_file(here):
    """A limit on the size of files fails a write in the middle, as a full disk does."""
    (here / "model.toml").write_text(MODEL + "# more\n" * 1000, "utf-8")
    before = (here / "model.toml").read_bytes()
    code = (
        "import resource, signal; signal.signal(signal.SIGXFSZ, signal.SIG_IGN)\n"
        "resource.setrlimit(resource.RLIMIT_FSIZE, (4096, 4096))\n"
        "from terrain_cli.app import main; main(['model', 'add', 'model.toml', 'hardpan'])"
    )
    done = subprocess.run(
        [sys.executable, "-c", code],
        env={"PYTHONPATH": str(ROOT), "PYTHONDONTWRITEBYTECODE": "1"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 73
    assert "model.toml" in done.stderr
    assert (here / "model.toml").read_bytes() == before
    assert not [path for path in here.iterdir() if path.name.startswith(".")]


def test_keys_are_documented(here, added):
    text = (ROOT / "docs" / "model.md").read_text("utf-8")
    (entry,) = tomllib.loads((here / "model.toml").read_text("utf-8"))["history"]
    parts = [added, entry, added["channels"]["torque"], added["parameters"][0], added["shift"]["c"]]
    parts += [added["unidentifiable"], added["alarm"], added["data"], *entry["parameters"].values()]
    assert not {key for part in parts for key in part if f"`{key}`" not in text}


@pytest.mark.skipif(not SHARED.is_dir(), reason="../shared/data is not there")
class TestMeasuredWheel:
    """A smooth wheel in dry sand, in the soil bin of CMU: no torque, 189 steady runs."""

    @pytest.fixture
    def bench(self, tmp_path, monkeypatch):
        channels = (
            '[channels]\nload = { column = "Fz_load_N", unit = "N" }\n'
            'drawbar_pull = { column = "Fx_tractive_N", unit = "N" }\n'
            'sinkage = { column = "sinkage_mm", unit = "mm" }\n'
        )
        (tmp_path / "rover.toml").write_text(
            ROVER.replace("0.125", "0.058").replace("0.1\n", "0.05\n") + channels
        )
        (tmp_path / "model.toml").write_text(MODEL, "utf-8")
        shutil.copy(SHARED / "cmu-smooth-wheel.csv", tmp_path)
        monkeypatch.chdir(tmp_path)
        return ("--data", "cmu-smooth-wheel.csv", "--where", "slip_angle_deg == 0 and slip >= 0")

    # Without skidding even more.
    @pytest.mark.parametrize(("slips", "less"), [("", 2.7), (" and slip >= -0.05", 4.0)])
    def test_slip_sinkage_pays(self, bench, model, slips, less):
        some = [word.replace(" and slip >= 0", slips) for word in bench]
        found = change(model, "add", "model.toml", "slip-sinkage", *some)
        assert found["pays"]
        sinkage = found["channels"]["sinkage"]
        assert sinkage["heldout_after"] < sinkage["heldout_before"] / less

    @pytest.mark.parametrize("effect", ["bulldozing", "drawbar-bias"])
    @pytest.mark.parametrize("slips", [" and slip >= 0", ""], ids=["driving", "all"])
    def test_a_wrong_effect_does_not(self, bench, model, effect, slips):
        before = Path("model.toml").read_bytes()
        some = [word.replace(" and slip >= 0", slips) for word in bench]
        found = change(model, "add", "model.toml", effect, *some)
        assert (found["pays"], found["kept"]) == (False, False)
        assert Path("model.toml").read_bytes() == before
