"""The fuzzing of benchmarks/fuzz.py for a moment, at random: each target runs, and what it finds is told."""

from __future__ import annotations

import importlib.util
import json
import sys
from pathlib import Path

import pytest

from formats.errors import DamagedError

FILE = Path(__file__).resolve().parent.parent / "benchmarks" / "fuzz.py"


@pytest.fixture(scope="module")
def fuzz():
    """Import the program, which is in no package."""
    path = list(sys.path)
    spec = importlib.util.spec_from_file_location("fuzz", FILE)
    module = importlib.util.module_from_spec(spec)
    sys.modules["fuzz"] = module
    spec.loader.exec_module(module)
    yield module
    del sys.modules["fuzz"]
    sys.path[:] = path


@pytest.fixture(scope="module")
def targets(fuzz):
    return fuzz.targets()


def test_every_target_has_its_share(fuzz, targets):
    assert targets.keys() == fuzz.SHARES.keys()


@pytest.mark.parametrize("seed", [1, 2])
def test_nothing_is_found_at_random(fuzz, targets, tmp_path, seed):
    for name, (target, seeds) in targets.items():
        run = fuzz.Run(name, target, 25, tmp_path / f"{name}.json")
        for data in seeds:
            run.one(data)
        assert run.accepted == len(seeds), (name, run.findings)
        fuzz.at_random(run, seeds, 25, seed)
        assert run.findings == {}, name
        assert run.done == 25 + len(seeds)


def test_what_goes_wrong_is_told_once(fuzz, tmp_path):
    def target(data):
        if data == b"crash":
            raise KeyError(data)
        if data == b"lines":
            raise DamagedError("a", "two\nlines")
        raise DamagedError("a", "one line")

    run = fuzz.Run("x", target, 5, tmp_path / "x.json")
    for data in (b"crash", b"crash", b"lines", b"fine", b"crash"):
        run.one(data)
    content = json.loads((tmp_path / "x.json").read_text())
    assert content["done"] == 5
    assert content["accepted"] == 0
    assert [key.partition(" in ")[0] for key in content["findings"]] == ["KeyError", "several lines"]
    assert sorted(path.read_bytes() for path in tmp_path.glob("*.bin")) == [b"crash", b"lines"]


def test_what_takes_too_long_is_told(fuzz, tmp_path, monkeypatch):
    monkeypatch.setattr(fuzz, "PATIENCE", 0.2)

    def target(_):
        while True:
            pass

    run = fuzz.Run("x", target, 1, tmp_path / "x.json")
    run.one(b"")
    assert next(iter(run.findings)).startswith("TimeoutError")
