"""One log: how far the work has come is told on the way, and what became of its labels."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from terrain_cli import rover
from terrain_cli.run import long_log, one_log
from terrain_cli.run.settings import Settings
from terrain_cli.telemetry import long_logs

SAMPLE = Path(__file__).resolve().parents[2] / "sample_data"


def told(path, method="least-squares"):
    """Return the steps and the shares that are told while a log is estimated."""
    steps = []
    settings = Settings(method=method)
    one_log.run(
        str(path), rover.load(SAMPLE / "rover.toml"), settings, progress=lambda _, *step: steps.append(step)
    )
    return [step for step, _ in steps], [share for _, share in steps]


def test_each_step_of_each_wheel_moves_on():
    steps, shares = told(SAMPLE / "run.csv")
    assert steps[0] == "reading"
    assert [step.partition(":")[0] for step in steps[1:]] == 2 * ["wheel front-left"] + 2 * [
        "wheel front-right"
    ]
    assert shares == [0.0, 0.2, 0.4, 0.6, 0.8]


def test_a_long_log_moves_on_with_its_rows(monkeypatch):
    monkeypatch.setattr(long_log, "MOST_ROWS", 1000)
    monkeypatch.setattr(long_logs, "ROWS", 400)
    monkeypatch.setattr(long_logs, "BESIDE", 100)
    rows = len(pd.read_parquet(SAMPLE / "run.parquet"))
    steps, shares = told(SAMPLE / "run.parquet")
    assert len(steps) > 5
    assert shares == sorted(shares)
    assert shares[-1] == 1.0
    assert steps[-1] == f"{rows:,} samples"


@pytest.mark.parametrize("most", [1_000, 10_000_000])
def test_labels_that_share_a_segment_are_both_named_and_told_of(tmp_path, monkeypatch, most):
    monkeypatch.setattr(long_log, "MOST_ROWS", most)
    monkeypatch.setattr(long_logs, "ROWS", 400)
    table = pd.read_csv(SAMPLE / "run.csv")
    table["terrain"] = np.where(np.arange(len(table)) // 10 % 2, "sand", "loam")
    table.to_csv(tmp_path / "run.csv", index=False)
    settings = Settings(method="least-squares")
    outcome = one_log.run(str(tmp_path / "run.csv"), rover.load(SAMPLE / "rover.toml"), settings)
    assert {*outcome.table["terrain"]} == {"loam+sand"}
    for wheel in outcome.account["wheels"]:
        told = [remark for remark in wheel["remarks"] if "more than one terrain (loam+sand)" in remark]
        assert [remark.partition(":")[0] for remark in told] == [f"wheel {wheel['wheel']}"]


@pytest.mark.parametrize("heated", [True, False])
def test_what_only_a_rival_of_the_models_effects_uses_is_read_where_it_is_there(tmp_path, heated):
    table = pd.read_csv(SAMPLE / "run.csv")
    if heated:
        table["motor_temperature"] = 20.0 + 30.0 * np.linspace(0.0, 1.0, len(table)) ** 2
    table.to_csv(tmp_path / "run.csv", index=False)
    (tmp_path / "model.toml").write_text(
        'format = "terrain-est/model/1"\nbase = "wong-reece"\neffects = ["gear-efficiency"]\n'
        '[[history]]\naction = "add"\nchanged = ["gear-efficiency"]\nrivals = ["motor-temperature"]\n'
    )
    settings = Settings(model=str(tmp_path / "model.toml"), wheels=("front-left",))
    outcome = one_log.run(str(tmp_path / "run.csv"), rover.load(SAMPLE / "rover.toml"), settings)
    (told,) = outcome.account["wheels"]
    assert told["model"]["rivals"] == ["motor-temperature"] * heated
    assert ("motor-temperature.alpha" in told["model"]["parameters"]) is heated
