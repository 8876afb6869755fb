"""Cells that were lost, and cells between the ticks of a slower clock: neither makes a sample."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from formats.recovery import Notice
from terrain_cli import api, rover

ROVER = "[wheel]\nradius = 0.125\nwidth = 0.1\n[soil]\nshear_modulus = 0.018\n"
RATE = 20.0
MADE_OF = ("load", "torque", "sinkage", "slip")


@pytest.fixture(scope="module")
def rover_of_tables(tmp_path_factory):
    path = tmp_path_factory.mktemp("rover") / "rover.toml"
    path.write_text(ROVER)
    return rover.load(path)


def log(n):
    """Return a drive whose channels all change steadily, so that an interpolated value can be told."""
    time = np.arange(n) / RATE
    return pd.DataFrame(
        {
            "time": time,
            "load": 80 + time,
            "torque": 3 + 0.1 * time,
            "sinkage": 0.01 + 1e-4 * time,
            "slip": 0.2,
        }
    )


def read(table, rover):
    (samples,) = api.from_frame(table, rover)
    return samples


def own_clock_remark(samples):
    return next((r for r in samples.remarks if "clocks of their own" in r), "")


shares = st.fixed_dictionaries(
    {name: st.sampled_from([0.0, 0.1, 0.3, 0.5, 0.6, 0.75, 0.9]) for name in MADE_OF}
)


@settings(max_examples=40, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(lost=shares, seed=st.integers(0, 1000))
def test_cells_lost_at_random_never_make_a_sample(rover_of_tables, lost, seed):
    table, rng = log(600), np.random.default_rng(seed)
    for name, share in lost.items():
        table.loc[rng.random(len(table)) < share, name] = np.nan
    whole = int(table.notna().all(axis=1).sum())
    samples = read(table, rover_of_tables)
    assert len(samples) == len(table)
    assert len(samples.usable) == whole
    assert sum(samples.reasons().values()) == len(table) - whole
    assert not own_clock_remark(samples)


@settings(max_examples=25, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    every=st.integers(2, 12),
    phase=st.integers(0, 11),
    column=st.sampled_from(MADE_OF),
    seed=st.integers(0, 99),
)
def test_a_slower_column_gives_as_many_samples_as_it_has_values(rover_of_tables, every, phase, column, seed):
    table = log(400)
    table.loc[np.arange(len(table)) % every != phase % every, column] = np.nan
    values = table[column].dropna()
    samples = read(table, rover_of_tables)
    assert len(samples.usable) == len(values)
    np.testing.assert_array_equal(samples.channels[column][samples.usable], values)
    # Nothing had to be interpolated, for the others are there in its rows.
    assert own_clock_remark(samples).endswith(f"its {len(samples)} rows are the samples")
    # Of a tenth that it lost itself, each one is missing and counted.
    lost = values.index[np.random.default_rng(seed).random(len(values)) < 0.1]
    table.loc[lost, column] = np.nan
    samples = read(table, rover_of_tables)
    assert len(samples.usable) == len(values) - len(lost)
    assert samples.reasons().get(f"no {column}", 0) == len(lost)


def merged(rates, seconds=20.0, jitter=None):
    """Return a table with a row for each time at which a topic had a message, and its other cells empty."""
    parts = []
    for k, (names, rate) in enumerate(rates):
        time = np.arange(0.0, seconds, 1.0 / rate) + 0.0011 * k
        if jitter and jitter[0] in names:
            time = np.sort(time + np.random.default_rng(0).uniform(0.0, jitter[1], len(time)))
        time = np.round(time, 6)
        truth = (
            log(1)
            .iloc[[0] * len(time)]
            .assign(time=time, load=80 + time, torque=3 + 0.1 * time, sinkage=0.01 + 1e-4 * time)
        )
        parts.append(truth[["time", *names]])
    return pd.concat(parts).sort_values("time").reset_index(drop=True)


def test_a_merged_table_has_the_samples_of_its_slowest_topic(rover_of_tables):
    table = merged([(["torque", "slip"], 50.0), (["sinkage"], 10.0), (["load"], 25.0)])
    samples = read(table, rover_of_tables)
    time = samples.time[samples.usable]
    assert len(samples) == table["sinkage"].notna().sum() == 200
    assert len(time) >= 199
    # Between two neighbours a straight line is the truth.
    for name, truth in (("torque", 3 + 0.1 * time), ("load", 80 + time), ("sinkage", 0.01 + 1e-4 * time)):
        np.testing.assert_allclose(samples.channels[name][samples.usable], truth, rtol=1e-9)
    remark = own_clock_remark(samples)
    assert isinstance(remark, Notice)
    assert "sinkage has a value every 0.1 s, and its 200 rows are the samples; in 200 of them" in remark


def test_no_gap_is_bridged_in_which_a_value_was_lost(rover_of_tables):
    table = merged([(["torque", "slip", "load"], 50.0), (["sinkage"], 10.0)])
    whole = read(table, rover_of_tables)
    # One message of the fast topic: less than the half second that a gap between topics may have.
    fast = table.index[table["torque"].notna()]
    table.loc[fast[500], ["torque", "slip", "load"]] = np.nan
    samples = read(table, rover_of_tables)
    assert len(whole.usable) - len(samples.usable) == 1
    # Two of the slow one are two rows without it.
    slow = table.index[table["sinkage"].notna()]
    table.loc[slow[50:52], "sinkage"] = np.nan
    samples = read(table, rover_of_tables)
    assert samples.reasons()["no sinkage"] == 2
    assert len(samples) == len(whole)


def test_max_gap_may_only_narrow_what_is_bridged(rover_of_tables, tmp_path):
    table = merged([(["torque", "slip", "load"], 50.0), (["sinkage"], 10.0)])
    for max_gap, usable in ((0.01, 0), (5.0, len(read(table, rover_of_tables).usable))):
        (tmp_path / "rover.toml").write_text(ROVER + f"[sampling]\nmax_gap = {max_gap}\n")
        assert len(read(table, rover.load(tmp_path / "rover.toml")).usable) == usable


def test_a_slow_topic_without_a_beat_has_its_own_rows(rover_of_tables):
    table = merged([(["torque", "slip", "load"], 50.0), (["sinkage"], 5.0)], jitter=("sinkage", 0.15))
    samples = read(table, rover_of_tables)
    assert len(samples) == table["sinkage"].notna().sum()
    assert len(samples.usable) >= len(samples) - 2


def test_a_column_that_was_out_for_most_of_the_drive_is_missing_there(rover_of_tables):
    table = log(400)
    table.loc[100:, "sinkage"] = np.nan
    samples = read(table, rover_of_tables)
    assert (len(samples), samples.reasons()) == (400, {"no sinkage": 300})
    # Also one on a slower clock: each value that was due, and no more.
    table = log(400)
    table.loc[(table.index % 5 != 0) | (table.index >= 100), "sinkage"] = np.nan
    samples = read(table, rover_of_tables)
    assert (len(samples), samples.reasons()) == (80, {"no sinkage": 60})


def test_places_and_attitude_make_no_clock(rover_of_tables):
    table = log(400).assign(x=np.arange(400) * 0.01, y=0.0)
    table.loc[table.index % 10 != 0, ["x", "y"]] = np.nan
    samples = read(table, rover_of_tables)
    assert len(samples.usable) == 400
    assert not own_clock_remark(samples)


def test_runs_are_not_mixed(rover_of_tables):
    half = merged([(["torque", "slip", "load"], 50.0), (["sinkage"], 10.0)], seconds=4.0)
    deep = half.assign(sinkage=half["sinkage"] + 0.01, run=2)
    samples = read(pd.concat([half.assign(run=1), deep]), rover_of_tables)
    known = samples.channels["sinkage"][np.isfinite(samples.channels["sinkage"])]
    assert np.all((known < 0.011) | (known > 0.0199))
    assert samples.stretch[samples.usable].tolist() == sorted(samples.stretch[samples.usable])
    # At its start each run has a sinkage, but no torque before it to interpolate from.
    assert samples.stretch.max() == 1


def test_the_angle_of_a_derived_slip_counts_as_well(rover_of_tables):
    table = log(400).drop(columns="slip").assign(angular_velocity=1.0, velocity=0.1)
    table.loc[table.index % 4 != 0, "velocity"] = np.nan
    assert len(read(table, rover_of_tables).usable) == 100
    # Where the slip itself is there, the velocity makes no sample.
    assert len(read(table.assign(slip=0.2), rover_of_tables).usable) == 400
