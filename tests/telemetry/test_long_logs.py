"""A table read part by part is the table read whole; what is kept of a long one is honest pieces of it."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

import formats
from terrain_cli import telemetry
from terrain_cli.effects import find
from terrain_cli.errors import InputError
from terrain_cli.telemetry import assembly, long_logs, mapping, raw_channels, raw_columns
from terrain_cli.telemetry.long_logs import excerpt, excerpted, joined
from terrain_cli.vocabulary.channels import CHANNELS

GEOMETRY = "[wheel]\nradius = 0.125\nwidth = 0.1\ngrouser_count = 12\ngrouser_height = 0.01\n"
ROVER = GEOMETRY + "[soil]\nshear_modulus = 0.018\n"
N = 2500


@pytest.fixture
def rover(rover_of):
    return rover_of(ROVER)


@pytest.fixture
def small(monkeypatch):
    """Make parts so small that a table of some thousand rows has many."""
    monkeypatch.setattr(long_logs, "ROWS", 170)
    monkeypatch.setattr(long_logs, "BESIDE", 64)


def log(seed=0, n=N, rate=20.0):
    rng = np.random.default_rng(seed)
    omega = 1.0 + 0.2 * np.sin(np.arange(n) / 40.0)
    slip = 0.2 + 0.3 * np.sin(np.arange(n) / 30.0)
    velocity = np.where(slip < 0.0, 1.0 / (1.0 + np.minimum(slip, 0.0)), 1.0 - slip) * 0.125 * omega
    return pd.DataFrame(
        {
            "time": np.arange(n) / rate,
            "load": rng.uniform(60.0, 100.0, n),
            "torque": rng.uniform(2.0, 4.0, n),
            "sinkage": rng.uniform(0.005, 0.02, n),
            "angular_velocity": omega,
            "velocity": velocity,
        }
    )


def dirty(table, rng, standing=(20, 150, 300)):
    """Spoil a log in all the ways that depend on neighbours."""
    n = len(table)
    table = table.copy()
    for begin, length in zip(rng.integers(350, n - 400, 6), (1, 5, 30, 100, 200, 390), strict=True):
        table.loc[begin : begin + length, str(rng.choice(["torque", "load"]))] = np.nan
    for begin, length in zip(rng.integers(0, n - 400, len(standing)), standing, strict=True):
        table.loc[begin : begin + length, ["angular_velocity", "velocity"]] = 0.0
    for begin in rng.integers(0, n, 4):
        table.loc[begin:, "time"] += rng.choice([0.3, 2.0, 60.0])
    for begin in rng.integers(20, n - 20, 3):
        table.loc[begin : begin + rng.integers(1, 4), "time"] -= 5.0
    restart = int(rng.integers(200, n - 200))
    table.loc[restart:, "time"] -= table.loc[restart, "time"]
    table["run"] = np.where(np.arange(n) < rng.integers(0, n), "out", "back")
    table["terrain"] = np.where(np.arange(n) // 333 % 2, "sand", "loam")
    return table


def in_parts(path, rover, *, wheels=(), effects=(), rows=None):
    source = formats.open_source(path)
    layout = mapping.plan(source, rover)
    request = assembly.Request(
        layout=layout,
        rover=rover,
        channels=frozenset(CHANNELS),
        extras=layout.extras,
        wheels=wheels,
        where=None,
        effects=effects,
    )
    batches = list(source.read("", raw_channels.fields(request)[""], 50))
    begin = batches[:3] if rows is None else [raw_columns.whole(batches[:rows])]
    return list(long_logs.in_parts(request, [*begin, *batches[rows or 3 :]]))


def by_wheel(found):
    wheels = {}
    for part in found:
        wheels.setdefault(part.wheel, []).append(part)
    return {name: joined(wheels[name]) for name in sorted(wheels)}


def reasons(samples):
    names = np.array([*samples.set_aside.names, ""], dtype=object)
    return names[samples.set_aside.codes]


def assert_same(found, whole):
    assert (found.wheel, len(found), found.origin) == (whole.wheel, len(whole), whole.origin)
    np.testing.assert_array_equal(found.time, whole.time)
    assert found.channels.keys() == whole.channels.keys()
    for name, column in whole.channels.items():
        np.testing.assert_array_equal(found.channels[name], column, err_msg=name)
    np.testing.assert_array_equal(reasons(found), reasons(whole))
    # Which number a stretch has says nothing.
    np.testing.assert_array_equal(np.diff(found.stretch) > 0, np.diff(whole.stretch) > 0)
    np.testing.assert_allclose(found.distance, whole.distance, atol=1e-9)
    for name, labels in whole.labels.items():
        assert [labels.names[c] for c in labels.codes] == [
            found.labels[name].names[c] for c in found.labels[name].codes
        ]
    assert found.drivers.keys() == whole.drivers.keys()
    for name, column in whole.drivers.items():
        np.testing.assert_allclose(found.drivers[name], column, atol=1e-9, err_msg=name)


@pytest.mark.parametrize("seed", range(16))
def test_parts_make_the_whole(small, tmp_path, rover, seed):
    rng = np.random.default_rng(seed)
    path = tmp_path / "run.parquet"
    # Where the wheel stood the whole log has it turn on, which parts cannot see for long.
    effects, standing = ((find("grouser-ripple"),), (20, 40)) if seed % 2 else ((), (20, 150, 300))
    dirty(log(seed), rng, standing).to_parquet(path, row_group_size=90)
    # Whether batches are short or long.
    found = in_parts(str(path), rover, effects=effects, rows=20 if seed % 3 else None)
    assert len(found) > 8
    (whole,) = telemetry.read(str(path), rover, effects=effects, compared=True)
    assert_same(joined(found), whole)


@pytest.mark.parametrize("together", [True, False])
def test_wheels_of_one_table(small, tmp_path, rover, together):
    wheels = [dirty(log(k), np.random.default_rng(k)).assign(wheel=name) for k, name in enumerate("ba")]
    table = pd.concat(wheels)
    if together:
        table = table.iloc[np.argsort(np.tile(np.arange(N), 2), kind="stable")]
    table.iloc[[3, 900, 4000], table.columns.get_loc("wheel")] = None
    table.to_csv(tmp_path / "run.csv", index=False)
    path = str(tmp_path / "run.csv")
    every = {samples.wheel: samples for samples in telemetry.read(path, rover, effects=(), compared=True)}
    found = by_wheel(in_parts(path, rover))
    assert list(found) == list(every) == ["a", "b"]
    for name, whole in every.items():
        assert_same(found[name], whole)
        assert found[name].remarks == whole.remarks
        assert "3 rows name no wheel in wheel and are passed over" in found[name].remarks
    assert list(by_wheel(in_parts(path, rover, wheels=("b",)))) == ["b"]
    with pytest.raises(InputError, match="there is no wheel c"):
        in_parts(path, rover, wheels=("c",))


def test_clock_counts_from_the_first_part(small, tmp_path, rover):
    for name, offset in (("iso", None), ("unix", 1.7e9)):
        table = log()
        table["time"] = (
            pd.Timestamp("2026-11-21T08:00:00") + pd.to_timedelta(table["time"], unit="s")
            if offset is None
            else table["time"] + offset
        )
        table.to_csv(tmp_path / f"{name}.csv", index=False)
        (whole,) = telemetry.read(str(tmp_path / f"{name}.csv"), rover, effects=(), compared=True)
        assert_same(joined(in_parts(str(tmp_path / f"{name}.csv"), rover)), whole)


def test_short_tables_are_read_whole(tmp_path, rover):
    path = tmp_path / "run.parquet"
    log().to_parquet(path)
    (whole,) = telemetry.read(str(path), rover, effects=(), compared=True)
    (found,) = telemetry.read(str(path), rover, effects=(), compared=True, most=N)
    assert_same(found, whole)
    assert (found.drive, found.total) == (None, None)
    assert excerpted([found]) == []


@pytest.mark.parametrize("ending", ["parquet", "csv"])
def test_long_tables_are_read_in_unbroken_pieces(small, monkeypatch, tmp_path, rover, ending):
    monkeypatch.setattr(long_logs, "PIECE", 50)
    table = log(n=6000)
    table.loc[3000:, "time"] += 30.0
    table.loc[700:720, "torque"] = np.nan
    path = str(tmp_path / f"run.{ending}")
    table.to_parquet(path) if ending == "parquet" else table.to_csv(path, index=False)
    (whole,) = telemetry.read(path, rover, effects=(), compared=True)
    (found,) = telemetry.read(path, rover, effects=(), compared=True, most=2000)
    assert 500 <= len(found) <= 1000
    assert (found.total, len(found.usable)) == (len(whole.usable), len(found))
    (said,) = excerpted([found])
    assert said.startswith(f"{len(found)} of {len(whole.usable)} samples are read, in unbroken pieces")
    # Each sample is one of the log, with the distance it has there.
    usable = whole.usable
    place = np.searchsorted(whole.time[usable], found.time)
    rows = usable[place]
    np.testing.assert_array_equal(found.time, whole.time[rows])
    np.testing.assert_array_equal(found.channels["torque"], whole.channels["torque"][rows])
    np.testing.assert_allclose(found.distance, whole.distance[rows], atol=1e-9)
    # Pieces are unbroken, of the drive they are of, and spread over all of it.
    np.testing.assert_array_equal(
        np.diff(found.stretch) > 0, (np.diff(place) > 1) | (np.diff(found.drive) > 0)
    )
    np.testing.assert_array_equal(np.diff(found.drive) > 0, np.diff(whole.stretch[rows]) > 0)
    assert found.drive[-1] >= 1
    share = np.histogram(place, bins=6, range=(0, len(usable)))[0] / len(found)
    assert share.min() > 0.1


def test_of_many_wheels_each_keeps_its_share(small, monkeypatch, tmp_path, rover):
    monkeypatch.setattr(long_logs, "PIECE", 50)
    table = pd.concat([log(k, n=3000).assign(wheel=f"w{k}") for k in range(3)]).sort_index(kind="stable")
    table.to_csv(tmp_path / "run.csv", index=False)
    found = telemetry.read(str(tmp_path / "run.csv"), rover, effects=(), compared=True, most=3000)
    assert [samples.wheel for samples in found] == ["w0", "w1", "w2"]
    assert 750 <= sum(map(len, found)) <= 1500
    assert np.ptp([len(samples) for samples in found]) <= 50


def test_what_was_kept_whole_is_no_excerpt(tmp_path, rover):
    path = tmp_path / "run.parquet"
    log().to_parquet(path)
    whole = telemetry.read(str(path), rover, effects=(), compared=True)
    (found,) = excerpt(10 * N, whole)
    assert excerpted([found]) == []
    assert len(found) == len(whole[0].usable)


@pytest.mark.parametrize("lost", [0.0, 0.1])
def test_columns_on_clocks_of_their_own_in_parts(small, tmp_path, rover, lost):
    table, rng = log(), np.random.default_rng(0)
    fast = table[["time", "load", "torque", "angular_velocity", "velocity"]]
    slow = table.loc[table.index % 5 == 0, ["time", "sinkage"]].copy()
    slow["time"] += 0.011
    slow.loc[rng.random(len(slow)) < lost, "sinkage"] = np.nan
    merged = pd.concat([fast, slow]).sort_values("time", kind="stable")
    path = tmp_path / "run.parquet"
    merged.to_parquet(path, row_group_size=90)
    found = in_parts(str(path), rover)
    (whole,) = telemetry.read(str(path), rover, effects=(), compared=True)
    assert_same(joined(found), whole)
    assert len(whole) == len(slow)
    assert len(whole.usable) == slow["sinkage"].notna().sum()
    # Counted over all parts, once.
    assert found[0].remarks == whole.remarks
    assert f"its {len(slow)} rows are the samples; in {slow['sinkage'].notna().sum()} of" in whole.remarks[-1]
