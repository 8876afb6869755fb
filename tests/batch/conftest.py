"""A small mission to work on, by a batch without processes of its own."""

from __future__ import annotations

from pathlib import Path

import missions
import pytest

from terrain_cli.batch import batch_run


@pytest.fixture
def pools(monkeypatch):
    """Have batches work in this process; return the tasks of each."""
    made = []

    class Pool(missions.Inline):
        def __init__(self, *args):
            super().__init__(*args)
            made.append(self)

    monkeypatch.setattr(batch_run, "LocalPool", Pool)
    return made


@pytest.fixture
def source(tmp_path, monkeypatch):
    """Work beside a folder `in` of inputs."""
    monkeypatch.chdir(tmp_path)
    missions.mission(tmp_path / "in")
    return Path("in")


@pytest.fixture
def batch(source, pools):
    """Return a function that runs a batch over the inputs, and returns what it did for which of them."""

    def batch(*names, output="out", **order):
        pools.clear()
        tally = missions.batch(names or ("in", "in/day1", "in/day2"), output, rover="in/rover.toml", **order)
        tasks = [task for pool in pools for task in pool.tasks]
        did = sorted((type(task).__name__, task.item.path) for task in tasks if hasattr(task, "item"))
        return tally, [(kind, path) for kind, path in did if kind != "Identify"]

    return batch
