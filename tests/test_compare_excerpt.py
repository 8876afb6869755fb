"""`terrain-est compare` of a log of which only pieces are read: the same errors, the same findings."""

from __future__ import annotations

import json

import numpy as np
import pandas as pd
import pytest
from click.testing import CliRunner
from simulator import CHANNELS, DRY_SAND, Drive, Track, simulate, steps, undulation, wave
from simulator.effects import base_contact
from simulator.logs import write_csv

from terrain_cli.app import cli
from terrain_cli.telemetry import long_logs

ROVER = "[wheel]\nradius = 0.125\nwidth = 0.1\n[soil]\nshear_modulus = 0.018\n"
ROUNDS = 12


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Write one drive many times over, with slip-sinkage, and noise that is new each time."""
    path = tmp_path_factory.mktemp("long")
    (path / "rover.toml").write_text(ROVER)
    track = Track(
        "wheel", [(base_contact(DRY_SAND), 60.0)], load=undulation(80.0, 0.2, 5.0), slip=wave(0.3, 0.6, 9.0)
    )
    write_csv(
        simulate(
            Drive(
                [track],
                rate=10.0,
                channels=(*CHANNELS, "slip", "drawbar_pull"),
                effects={"slip-sinkage": {"n1": 0.4}},
                speed=steps([(0.1, 30.0), (0.15, 30.0)]),
            )
        ),
        path / "once.csv",
    )
    once = pd.read_csv(path / "once.csv")
    rng = np.random.default_rng(2)
    again = []
    for k in range(ROUNDS):
        table = once.copy()
        table["time"] += 60.0 * k
        for name in ("load", "torque", "sinkage", "slip", "drawbar_pull"):
            table[name] *= 1.0 + 0.02 * rng.standard_normal(len(table))
        again.append(table)
    pd.concat(again).to_parquet(path / "run.parquet", row_group_size=500, index=False)
    return path


def compared(folder):
    done = CliRunner().invoke(cli, ["compare", str(folder / "run.parquet"), "--json", "-q"])
    assert done.exit_code == 0, done.output
    return json.loads(done.stdout)


def test_pieces_tell_what_the_whole_log_tells(folder, monkeypatch):
    whole = compared(folder)
    total = whole["data"]["samples"]
    assert total == 600 * ROUNDS
    assert not any("are read" in warning for warning in whole["warnings"])
    monkeypatch.setattr(long_logs, "MOST_ROWS", total // 2)
    monkeypatch.setattr(long_logs, "PIECE", 200)
    monkeypatch.setattr(long_logs, "ROWS", 1000)
    found = compared(folder)
    kept = found["data"]["samples"]
    assert total / 8 <= kept <= total / 4
    said = f"{kept} of {total} samples are read, in unbroken pieces of 200 spread over each input"
    assert found["warnings"][0] == said
    # No soil changes where a piece ends.
    assert found["data"]["segments"] == whole["data"]["segments"]
    for name, errors in whole["channels"].items():
        low, high = errors["heldout_interval"]
        first, last = found["channels"][name]["heldout_interval"]
        assert max(first, low) < min(last, high)
        assert found["channels"][name]["heldout_rmse"] == pytest.approx(errors["heldout_rmse"], rel=0.1)
        assert found["channels"][name]["noise"] == pytest.approx(errors["noise"], rel=0.15)
    strongest, again = whole["failures"][0], found["failures"][0]
    assert (again["channel"], again["driver"], again["shape"]) == (
        strongest["channel"],
        "slip",
        strongest["shape"],
    )
    assert again["amplitude"] == pytest.approx(strongest["amplitude"], rel=0.2)
    # Neither is sure of a soil that the model misses: they agree as far as both errors say.
    one, other = whole["segments"][0], found["segments"][0]
    assert {one["status"], other["status"]} <= {"model-misses", "prior-bound"}
    given = [name for name in ("c_kPa", "phi_deg") if one[name] is not None and other[name] is not None]
    assert "c_kPa" in given
    for name, unit in (column.split("_") for column in given):
        error = np.hypot(one[f"{name}_se_{unit}"], other[f"{name}_se_{unit}"])
        assert abs(one[f"{name}_{unit}"] - other[f"{name}_{unit}"]) < 3.0 * error
