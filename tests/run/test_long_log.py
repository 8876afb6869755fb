"""Long logs worked through in reaches: the same as whole."""

from __future__ import annotations

import csv
import subprocess
import sys
import time

import numpy as np
import pandas as pd
import pytest
from child_processes import peak
from click.testing import CliRunner

from terrain_cli import rover
from terrain_cli.app import cli
from terrain_cli.errors import InputError
from terrain_cli.mechanics import linear
from terrain_cli.run import long_log, one_log
from terrain_cli.run.settings import Settings
from terrain_cli.telemetry import long_logs
from terrain_cli.windows import cut_windows

GEOMETRY = {"radius": 0.125, "width": 0.1, "shear_modulus": 0.018}
ROVER = "[wheel]\nradius = 0.125\nwidth = 0.1\n[soil]\nshear_modulus = 0.018\n"
#: c in Pa and tan φ.
SOILS = ((1.0e3, 0.50), (3.3e3, 0.66), (0.4e3, 0.70))


def drive(lengths, seed=0, first=0.0, rate=20.0):
    """Telemetry of soils on which the linearised model is right, with 2 % of noise."""
    rng = np.random.default_rng(seed)
    n = sum(lengths)
    time = np.arange(n) / rate
    soil = np.repeat(np.arange(len(lengths)) % len(SOILS), lengths)
    cohesion, tan_phi = np.array(SOILS)[soil].T
    load = 80.0 * (1.0 + 0.25 * np.sin(time / 0.8))
    slip = 0.35 + 0.2 * np.sin(time / 1.3)
    sinkage = 0.012 * (load / 80.0) ** 0.8 * (1.0 + 0.5 * slip)
    torque = linear.torque(load, sinkage, slip, cohesion, tan_phi, **GEOMETRY)
    table = pd.DataFrame(
        {"time": first + time, "load": load, "torque": torque, "sinkage": sinkage, "slip": slip}
    )
    for name in table.columns[1:]:
        table[name] *= 1.0 + 0.02 * rng.standard_normal(n)
    table["angular_velocity"] = 0.1 / (0.125 * (1.0 - slip))
    table["x"], table["y"] = 0.1 * time, 0.0
    return table


def dirty(table, seed=1):
    """Add what is set aside, gaps, and labels of runs."""
    rng = np.random.default_rng(seed)
    table, n = table.copy(), len(table)
    for begin in rng.integers(500, n - 500, 12):
        table.loc[begin : begin + int(rng.integers(0, 40)), "torque"] = np.nan
    for begin in rng.integers(500, n - 500, 5):
        table.loc[begin : begin + 120, "angular_velocity"] = 0.0
        table.loc[begin : begin + 120, "slip"] = np.nan
    table.loc[:30, "load"] = -1.0
    table.loc[n // 3 :, "time"] += 20.0
    table["run"] = np.where(np.arange(n) < n // 2, "out", "back")
    table["terrain"] = np.where(np.arange(n) // 1700 % 2, "dune", "plain")
    return table


LENGTHS = (3000, 2500, 400, 4100, 1500, 2500)


@pytest.fixture
def small(monkeypatch):
    """Make a table of some thousand rows a long one."""
    monkeypatch.setattr(long_log, "REACH", 3000)
    monkeypatch.setattr(long_log, "SETTLED", 900)
    monkeypatch.setattr(long_log, "LONGEST", 8000)
    monkeypatch.setattr(long_logs, "ROWS", 700)
    monkeypatch.setattr(long_logs, "BESIDE", 300)


@pytest.fixture
def both(small, monkeypatch, tmp_path):
    """Return a function that estimates a table in reaches and whole."""
    (tmp_path / "rover.toml").write_text(ROVER)

    def run(table, ending="parquet", **settings):
        path = tmp_path / f"run.{ending}"
        table.to_parquet(path, index=False) if ending == "parquet" else table.to_csv(path, index=False)
        settings = {"method": "least-squares", **settings}
        found = []
        for rows in (1000, 10**9):
            monkeypatch.setattr(long_log, "MOST_ROWS", rows)
            found.append(one_log.run(str(path), rover.load(tmp_path / "rover.toml"), Settings(**settings)))
        return found

    return run


def assert_same(found, whole):
    assert found.table.keys() == whole.table.keys()
    for name, column in whole.table.items():
        if isinstance(column, list):
            assert [str(value) for value in found.table[name]] == [str(value) for value in column], name
        else:
            np.testing.assert_allclose(found.table[name], column, rtol=1e-6, atol=1e-9, err_msg=name)
    assert len(found.estimates[0]) == len(whole.estimates[0])
    for one, other in zip(found.account["wheels"], whole.account["wheels"], strict=True):
        assert {**one, "set_aside": dict(one["set_aside"])} == other


@pytest.mark.parametrize("ending", ["parquet", "csv"])
@pytest.mark.parametrize("settings", [{}, {"method": "ridge"}, {"segments": "terrain"}, {"at_stress": 7.0}])
def test_reaches_make_the_table_of_the_whole_log(both, ending, settings):
    found, whole = both(dirty(drive(LENGTHS)), ending, **settings)
    assert_same(found, whole)
    assert len(found.table["segment"]) >= len(LENGTHS)
    assert sum(found.table["n_samples"]) + sum(found.table["n_rejected"]) == sum(LENGTHS)


def test_fixed_windows_and_conditions(both):
    table = dirty(drive(LENGTHS))
    for settings in (
        {"segments": "fixed", "window_samples": 250},
        {"where": "load > 60", "min_samples": 30},
        {"method": "recursive", "folds": 5},
    ):
        assert_same(*both(table, **settings))


def test_short_windows_share_what_is_the_same(both):
    """A text of its own for each of a million windows takes more than its numbers."""
    for outcome in both(drive(LENGTHS), segments="fixed", window_samples=3):
        assert len(outcome.table["status"]) > 4_000
        for name in ("source", "wheel", "method", "status"):
            assert len(set(map(id, outcome.table[name]))) == len(set(outcome.table[name]))


@pytest.mark.parametrize("rows", [1000, 10**9])
def test_more_windows_than_can_be_held(small, monkeypatch, tmp_path, rows):
    """In reaches and whole, of all wheels together."""
    (tmp_path / "rover.toml").write_text(ROVER)
    table = pd.concat([drive(LENGTHS[:3], seed).assign(wheel=name) for seed, name in enumerate("ab")])
    table.sort_index(kind="stable").to_csv(path := tmp_path / "run.csv", index=False)
    monkeypatch.setattr(long_log, "MOST_ROWS", rows)
    given = Settings(segments="fixed", window_samples=10, method="least-squares")
    found = one_log.run(str(path), rover.load(tmp_path / "rover.toml"), given)
    monkeypatch.setattr(cut_windows, "MOST", len(found.table["wheel"]))
    assert (
        one_log.run(str(path), rover.load(tmp_path / "rover.toml"), given).table.keys() == found.table.keys()
    )
    monkeypatch.setattr(cut_windows, "MOST", len(found.table["wheel"]) * 3 // 4)
    with pytest.raises(InputError, match=r"more than [\d,]+ segments") as caught:
        one_log.run(str(path), rover.load(tmp_path / "rover.toml"), given)
    assert "--window-samples" in caught.value.hint


def test_wheels_are_worked_through_side_by_side(both):
    table = pd.concat(
        [dirty(drive(LENGTHS, seed), seed).assign(wheel=name) for seed, name in enumerate("ab")]
    ).sort_index(kind="stable")
    found, whole = both(table)
    assert_same(found, whole)
    assert set(found.table["wheel"]) == {"a", "b"}


def test_a_soil_that_goes_on_is_cut(both):
    found, whole = both(drive((45_000,)))
    assert len(whole.table["segment"]) == 1
    assert len(found.table["segment"]) > 2
    assert max(found.table["n_samples"]) <= 2 * long_log.LONGEST + long_log.REACH
    assert sum(found.table["n_samples"]) == 45_000
    (remark,) = found.account["wheels"][0]["remarks"]
    assert remark.startswith("the wheel: a soil that goes on is cut every 8,000 samples")
    np.testing.assert_allclose(found.table["phi_deg"], whole.table["phi_deg"][0], atol=1.0)


@pytest.mark.parametrize(
    ("settings", "because"),
    [
        ({"segments": "none"}, "--segments none"),
        ({"segments": "fixed", "window_distance": 2.0}, "--segments fixed"),
        ({"whole": True}, "rejects, trace, samples, posterior"),
    ],
)
def test_what_needs_the_whole_log_gets_it_with_a_word(both, settings, because):
    found, whole = both(drive((2000, 2000)), **settings)
    first, second = (
        {name: list(map(str, column)) for name, column in one.table.items()} for one in (found, whole)
    )
    assert first == second
    assert f"a long log, read whole: {because}" in found.account["wheels"][0]["remarks"][0]
    assert whole.account["wheels"][0]["remarks"] == []


def test_the_line_stands_in_for_the_full_model_with_a_word(both):
    found, whole = both(drive((2000, 2000)), method="auto")
    assert set(whole.table["method"]) == {"wong-reece"}
    assert set(found.table["method"]) <= {"least-squares", "ridge"}
    remark = found.account["wheels"][0]["remarks"][0]
    assert remark.startswith("a log of more than 1,000 rows: c and φ are from the line")


def test_steady_test_points_are_read_whole(both):
    table = drive((500, 500, 500)).drop(columns=["time", "x", "y"])
    table["terrain"] = np.where(np.arange(len(table)) // 100 % 2, "dune", "plain")
    found, whole = both(table)
    assert_same(found, whole)
    assert list(found.table["terrain"]) == ["plain", "dune"]


def test_condition_that_nothing_meets(both):
    with pytest.raises(InputError, match="there are no samples where load > 1000"):
        both(drive((2000,)), where="load > 1000")


def test_nothing_usable_is_told_as_of_a_short_log(both):
    table = drive((3000,))
    table["load"] *= -1.0
    found, whole = both(table)
    assert str(found.error) == str(whole.error)
    assert "none of 3000 samples can be used (load not positive: 3000)" in str(found.error)


def test_rejects_of_a_long_log(small, monkeypatch, tmp_path):
    monkeypatch.setattr(long_log, "MOST_ROWS", 1000)
    (tmp_path / "rover.toml").write_text(ROVER)
    dirty(drive((2000, 2000))).to_csv(tmp_path / "run.csv", index=False)
    run = ["estimate", str(tmp_path / "run.csv"), "-o", str(tmp_path / "soil.csv")]
    done = CliRunner().invoke(cli, [*run, "--rejects", str(tmp_path / "rejects.csv")])
    assert done.exit_code == 0, done.output
    assert "a long log, read whole" in done.output
    with (tmp_path / "rejects.csv").open() as stream:
        assert len(list(csv.DictReader(stream))) > 31


#: Runs the command with reaches so short that logs of some hundred thousand samples are long.
SHORT = """
import sys
from terrain_cli.app import main
from terrain_cli.run import long_log
from terrain_cli.telemetry import long_logs
long_log.MOST_ROWS, long_log.REACH, long_log.SETTLED, long_logs.ROWS = 20_000, 20_000, 2_000, 10_000
if __name__ == "__main__":
    main(sys.argv[1:])
"""


@pytest.mark.skipif(sys.platform != "linux", reason="the system does not tell the peak")
def test_memory_does_not_grow_with_the_log(tmp_path):
    (tmp_path / "rover.toml").write_text(ROVER)
    (tmp_path / "short.py").write_text(SHORT)
    peaks = []
    table = drive((15_000,) * 8)
    for rounds in (2, 12):
        path = tmp_path / f"{rounds}.parquet"
        long = pd.concat([table.assign(time=table["time"] + 6000.0 * k) for k in range(rounds)])
        long.to_parquet(path, index=False, row_group_size=20_000)
        command = [sys.executable, tmp_path / "short.py", "estimate", path, "-q", "-o", tmp_path / "soil.csv"]
        most = 0
        with subprocess.Popen(command) as process:
            while process.poll() is None:
                # The last, as a process holds all of its parent for the moment before it begins.
                most = peak(process.pid) or most
                time.sleep(0.01)
        assert process.returncode == 0
        peaks.append(most / 1024.0)
        assert sum(pd.read_csv(tmp_path / "soil.csv")["n_samples"]) == len(long)
    # Held whole, 1,200,000 more samples are some 450 MB.
    assert peaks[1] < peaks[0] + 44.0
