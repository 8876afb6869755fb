"""`--salvage` on the command line: what is said, where, and with which exit code."""

from __future__ import annotations

import csv
import json
import shutil
from pathlib import Path

import pytest

from terrain_cli.app import main

SAMPLE = Path(__file__).resolve().parent.parent / "sample_data"


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """Work in a folder with the sample drive, whole and cut off."""
    monkeypatch.chdir(tmp_path)
    for name in ("rover.toml", "run.bag", "run.mcap"):
        shutil.copy(SAMPLE / name, tmp_path)
    for name in ("run.bag", "run.mcap"):
        data = Path(name).read_bytes()
        Path(f"cut_{name}").write_bytes(data[: len(data) * 2 // 3])
    return tmp_path


@pytest.fixture
def run(folder, capfd):
    """Return a function that runs the command here and returns exit code, stdout and stderr."""

    def run(*args):
        with pytest.raises(SystemExit) as end:
            main([str(arg) for arg in args])
        captured = capfd.readouterr()
        assert "Traceback" not in captured.err
        return end.value.code, captured.out, captured.err

    return run


cut = pytest.mark.parametrize("name", ["cut_run.bag", "cut_run.mcap"])


@cut
@pytest.mark.parametrize("verb", ["inspect", "estimate", "compare"])
def test_without_salvage_it_fails_with_the_hint(run, name, verb):
    code, out, err = run(verb, name)
    assert (code, out) == (65, "")
    message, hint = err.splitlines()
    assert message.startswith(f"terrain-est: {name}: cut off")
    assert hint.startswith("  add --salvage to read what is left of it")


@cut
def test_estimate(run, name):
    quickest = ("--segments", "none", "--method", "least-squares")
    code, out, err = run("estimate", name, "--salvage", "--summary", "soil.json", *quickest)
    assert code == 0
    assert "  damaged: cut off at byte " in err
    assert "  salvaged: " in err
    assert "  lost: what came after the last; how much" in err
    content = json.loads(Path("soil.json").read_text())
    assert content["settings"]["salvage"] is True
    (entry,) = content["inputs"]
    assert entry["salvage"]["damage"]
    assert entry["salvage"]["lost_s"] is None
    assert 0.5 < entry["salvage"]["fraction"] < 1.0
    assert any(remark.startswith("damaged: ") for remark in entry["wheels"][0]["remarks"])
    whole = run("estimate", name.removeprefix("cut_"), *quickest)[1]
    used = [sum(int(row["n_samples"]) for row in csv.DictReader(text.splitlines())) for text in (out, whole)]
    assert 0.5 < used[0] / used[1] < 1.0


def test_a_whole_log_is_not_changed_by_it(run):
    plain, saved = run("estimate", "run.bag"), run("estimate", "run.bag", "--salvage")
    assert plain == saved
    run("estimate", "run.bag", "--salvage", "--summary", "soil.json")
    (entry,) = json.loads(Path("soil.json").read_text())["inputs"]
    assert entry["salvage"] | {"read": 0, "expected": 0} == {
        "damage": [],
        "what": "messages",
        "read": 0,
        "expected": 0,
        "set_aside": 0,
        "fraction": 1.0,
        "fraction_of": "messages",
        "lost_s": 0,
        "lost_at_least_s": 0,
        "lost": [],
        "checked": False,
    }
    run("estimate", "run.bag", "--summary", "soil.json")
    assert json.loads(Path("soil.json").read_text())["inputs"][0]["salvage"] is None


@cut
def test_compare(run, name):
    # What is said of the damage is the same for the linear base, which is fitted at once.
    args = ("compare", name, "--salvage", "--segments", "none", "--model", "linear", "--json")
    code, out, err = run(*args)
    assert code == 0
    assert f"{name}: salvaged: " in err
    assert any(f"{name}: salvaged: " in warning for warning in json.loads(out)["warnings"])
    assert run(*args, "--quiet")[2] == ""


@cut
def test_inspect(run, name):
    code, out, err = run("inspect", name, "--salvage")
    assert (code, err) == (0, "")
    assert "  damaged: cut off at byte " in out
    assert "  salvaged: " in out
    code, out, _ = run("inspect", name, "--salvage", "--json")
    (entry,) = json.loads(out)["inputs"]
    assert entry["salvage"]["damage"][0].startswith("cut off at byte ")
    assert entry["salvage"]["read"] == sum(stream["records"] for stream in entry["streams"])


def test_inspect_shows_the_others(run):
    code, out, err = run("inspect", "cut_run.bag", "run.bag", "cut_run.mcap")
    assert code == 65
    assert out.startswith("run.bag: ROS 1 bag")
    assert [line.split(": ")[1] for line in err.splitlines() if line.startswith("terrain-est")] == [
        "cut_run.bag",
        "cut_run.mcap",
    ]
    code, out, _ = run("inspect", "cut_run.bag", "run.bag", "--json")
    content = json.loads(out)
    assert code == 65
    assert [entry["source"] for entry in content["inputs"]] == ["run.bag"]
    (failed,) = content["failed"]
    assert failed["source"] == "cut_run.bag"
    assert "--salvage" in failed["hint"]


def test_a_log_of_which_nothing_is_left(run):
    Path("stub.mcap").write_bytes(Path("run.mcap").read_bytes()[:400])
    code, out, err = run("estimate", "stub.mcap", "--salvage")
    assert (code, out) == (65, "")
    assert err.startswith("terrain-est: stub.mcap: nothing can be read of it: cut off at byte 400")
