"""The notebook interface gives what the command line gives."""

from __future__ import annotations

import subprocess
import sys
from io import StringIO
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import terrain_cli as terrain
from terrain_cli.errors import ConfigurationError, UsageError

SAMPLE = Path(__file__).parent.parent / "sample_data"


@pytest.fixture(scope="module")
def wheels():
    return terrain.read(SAMPLE / "run.csv", SAMPLE / "rover.toml")


def test_the_steps_give_the_table_of_the_command(wheels):
    frame = terrain.estimate([terrain.segment(wheel) for wheel in wheels])
    command = [sys.executable, "-m", "terrain_cli", "estimate", str(SAMPLE / "run.csv"), "--quiet"]
    printed = subprocess.run(command, check=True, capture_output=True, text=True).stdout
    expected = pd.read_csv(StringIO(printed))
    assert list(frame) == list(expected)
    for name in expected:
        if pd.api.types.is_float_dtype(frame[name]):
            np.testing.assert_allclose(frame[name], expected[name], rtol=1e-12, err_msg=name)
    assert frame["status"].tolist() == expected["status"].tolist()


def test_a_frame_is_as_good_as_a_file(wheels):
    frame = pd.read_csv(SAMPLE / "run.csv")
    again = terrain.from_frame(frame, SAMPLE / "rover.toml")
    assert [one.wheel for one in again] == [one.wheel for one in wheels]
    for one, other in zip(again, wheels, strict=True):
        np.testing.assert_allclose(one.channels["torque"], other.channels["torque"], rtol=1e-12)
        assert one.reasons() == other.reasons()


def test_times_of_a_frame_may_be_timestamps(wheels):
    frame = pd.read_csv(SAMPLE / "run.csv")
    frame["time"] = pd.to_datetime(frame["time"], unit="s", utc=True)
    again = terrain.from_frame(frame, SAMPLE / "rover.toml")
    np.testing.assert_allclose(again[0].time, wheels[0].time, atol=1e-6)


def test_where_keeps_only_what_satisfies_it(wheels):
    few = terrain.read(SAMPLE / "run.csv", SAMPLE / "rover.toml", where="load > 80")
    assert 0 < len(few[0]) < len(wheels[0])
    assert few[0].channels["load"].min() > 80
    with pytest.raises(UsageError, match="cannot read"):
        terrain.read(SAMPLE / "run.csv", SAMPLE / "rover.toml", where="__import__('os')")


def test_the_trace_ends_at_the_estimate(wheels):
    cut = terrain.segment(wheels[0], "none")
    trace = terrain.trace(cut)
    last = trace.groupby("segment").last()
    estimate = terrain.estimate(cut, "least-squares").set_index("segment")
    np.testing.assert_allclose(last["c_kPa"], estimate["c_ls_kPa"], rtol=1e-9)
    np.testing.assert_allclose(last["phi_deg"], estimate["phi_ls_deg"], rtol=1e-9)


def test_the_summary_groups_by_terrain_and_wheel(wheels):
    cut = [terrain.segment(wheel) for wheel in wheels]
    groups = terrain.summarise(cut)
    assert [(g["terrain"], g["wheel"]) for g in groups] == [("", "front-left"), ("", "front-right")]
    assert sum(g["samples"] for g in groups) == terrain.estimate(cut)["n_samples"].sum()


def test_without_a_rover_the_missing_geometry_is_asked_for(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    frame = pd.DataFrame({"load": [80.0] * 5, "torque": [3.0] * 5, "sinkage": [0.01] * 5, "slip": [0.3] * 5})
    with pytest.raises(ConfigurationError, match="radius") as error:
        terrain.from_frame(frame)
    assert "[wheel]" in error.value.hint
