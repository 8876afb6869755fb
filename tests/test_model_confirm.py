"""`model add` with `--confirm LOG` or `--keep-aside SHARE`: proof on data that did not choose the effect."""

from __future__ import annotations

import json
import tomllib
from pathlib import Path

import pytest
from changed_models import MODEL, write_all, write_log

from terrain_cli import diagnosis, improvement
from terrain_cli.comparison import kept_aside


@pytest.fixture(scope="module")
def logs(tmp_path_factory):
    path = tmp_path_factory.mktemp("logs")
    write_all(path)
    write_log(path / "again.csv", {"slip-sinkage": {"n1": 0.3}}, seed=7)
    return path


@pytest.fixture(scope="module", autouse=True)
def tried_once():
    """Try the one change of these tests once on each log, and with each share kept aside."""
    known, tried = {}, improvement.tried_in_forms

    def again(wheels, *args, **options):
        key = tuple((one.samples.source, kept_aside.number([one.samples])) for one in wheels)
        if key not in known:
            known[key] = tried(wheels, *args, **options)
        return known[key]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(improvement, "tried_in_forms", again)
        yield


@pytest.fixture
def model(logs, tmp_path, monkeypatch, terrain_est_here):
    """Return a function that adds slip-sinkage, found on sinks.csv, with a proof."""
    monkeypatch.chdir(logs)

    def add(*args):
        file = tmp_path / "model.toml"
        file.write_text(MODEL, "utf-8")
        done = terrain_est_here("model", "add", file, "slip-sinkage", *args, "--segments", "none", "-q")
        return done, tomllib.loads(file.read_text("utf-8"))

    return add


def test_an_effect_that_another_drive_shows_too_is_added(model):
    done, file = model("--data", "sinks.csv", "--confirm", "again.csv", "--json")
    said = json.loads(done.stdout)
    assert (done.returncode, file["effects"]) == (0, ["slip-sinkage"])
    assert "confirmed on again.csv, which did not choose it" in said["sentence"]
    (entry,) = file["history"]
    assert entry["proof"] == "another drive"
    proof = entry["confirmation"]
    assert proof == said["confirmation"]
    assert proof["confirmed"]
    assert (entry["data"]["sources"], proof["data"]["sources"]) == (["sinks.csv"], ["again.csv"])
    sinkage = proof["channels"]["sinkage"]
    assert sinkage["heldout_after"] < 0.5 * sinkage["heldout_before"]


def test_one_that_another_drive_does_not_show_is_not(model):
    done, file = model("--data", "sinks.csv", "--confirm", "clean.csv")
    assert done.returncode == 0
    assert "slip-sinkage is not added" in done.stdout
    assert "not confirmed on clean.csv" in done.stdout
    assert "on clean.csv:" in done.stdout
    assert "history" not in file
    # Alone, the drive that named it would name it again.
    last = done.stdout.splitlines()[-1]
    assert "slip-sinkage was tried, and another drive does not confirm it. Next" in last
    _, command = last.split("Next: terrain-est ")
    assert command.startswith("diagnose sinks.csv clean.csv --model ")
    assert command.endswith("model.toml --segments none")
    _, file = model("--data", "sinks.csv", "--confirm", "clean.csv", "--keep")
    assert file["history"][0]["confirmation"]["confirmed"] is False


def test_without_it_the_history_says_that_the_same_data_proved_it(model):
    _, file = model("--data", "sinks.csv")
    assert file["history"][0]["proof"] == "same data"
    assert file["history"][0]["proof_because"] == "no others were kept aside"
    assert "confirmation" not in file["history"][0]


def test_stretches_kept_aside_are_the_proof(model):
    done, file = model("--data", "sinks.csv", "--keep-aside", "0.5")
    assert done.returncode == 0
    first, *lines = done.stdout.splitlines()
    assert "slip-sinkage is added: on the stretches kept aside, the held-out error fell in" in first
    assert "proof: stretches kept aside, 240 samples that diagnose with the same --keep-aside" in done.stdout
    assert "note: sinks.csv: 240 of 480 samples are kept aside, in 8 stretches" in lines
    (entry,) = file["history"]
    assert (entry["proof"], entry["data"]["kept_aside"]) == ("stretches kept aside", 240)
    assert "proof_because" not in entry


def test_a_diagnosis_does_not_see_them_and_says_what_to_do_next(logs, monkeypatch, terrain_est_here):
    monkeypatch.chdir(logs)
    shown, diagnosed = [], diagnosis.diagnose

    def diagnose(wheels, *args, **options):
        shown.extend(wheels)
        return diagnosed(wheels, *args, **options)

    monkeypatch.setattr(diagnosis, "diagnose", diagnose)
    done = terrain_est_here(
        "diagnose", "sinks.csv", "--segments", "none", "--keep-aside", "0.25", "--json", "-q"
    )
    found = json.loads(done.stdout)
    assert (found["data"]["samples"], found["data"]["kept_aside"]) == (360, 120)
    (windows,) = shown
    assert not windows.samples.aside[windows.rows].any()
    assert found["family"][0] == "slip-sinkage"
    assert " --keep-aside 0.25 " in found["conclusion"]["command"]
    assert "sinks.csv: 120 of 480 samples are kept aside, in 8 stretches" in found["warnings"]


@pytest.mark.parametrize(
    ("args", "says"),
    [
        (("--keep-aside", "0.5"), "--keep-aside needs --data"),
        (("--data", "sinks.csv", "--keep-aside", "0.5", "--confirm", "clean.csv"), "exclude each other"),
        (("--data", "sinks.csv", "--keep-aside", "1"), "not in the range 0<x<1"),
        (("--confirm", "clean.csv"), "--confirm needs --data"),
        (("--data", "sinks.csv", "--confirm", Path("sub", "..", "sinks.csv")), "is also an input of --data"),
        (("--data", "sinks.csv", "--until-quiet", "--confirm", "clean.csv"), "needs an EFFECT"),
    ],
)
def test_what_is_no_proof_is_refused(model, logs, args, says):
    (logs / "sub").mkdir(exist_ok=True)
    done, file = model(*args)
    assert done.returncode == 2
    assert says in done.stderr
    assert file["effects"] == []
