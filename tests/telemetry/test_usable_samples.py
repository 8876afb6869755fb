from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from formats import Labels
from terrain_cli.errors import UsageError
from terrain_cli.telemetry import Condition, usable_samples

NAN = float("nan")
TABLE = {
    "slip": np.array([0.1, 0.5, NAN, 0.9]),
    "slip_angle_deg": np.array([0.0, 15.0, 0.0, 0.0]),
    "terrain": Labels(np.array([0, 1, 0, -1], dtype=np.int32), ("sand", "rock")),
    "trial": Labels(np.array([0, 1, 1, 0], dtype=np.int32), ("1", "2")),
    "load [kN]": np.array([0.1, 0.2, 0.3, 0.4]),
    "when": np.array(["2026-11-21T08:00", "2026-11-21T09:00", "NaT", "2026-11-22"], "datetime64[ns]"),
}
NAN_OF_USABLE_SAMPLES, INF = float("nan"), float("inf")
RADIUS, WIDTH = 0.125, 0.1
GOOD = {"load": 80.0, "torque": 3.0, "sinkage": 0.01, "slip": 0.3, "angular_velocity": 1.0, "velocity": 0.1}
GOOD["drawbar_pull"] = 5.0


def holds(text):
    condition = Condition(text)
    return condition.holds({name: TABLE[name] for name in condition.names}).astype(int).tolist()


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("slip_angle_deg == 0", [1, 0, 1, 1]),
        ("slip > 0.1", [0, 1, 0, 1]),
        ("0.1 < slip <= 0.5", [0, 1, 0, 0]),
        ("slip != 0.5", [1, 0, 0, 1]),
        ("slip < slip_angle_deg", [0, 1, 0, 0]),
        ("-1 < slip", [1, 1, 0, 1]),
        ("not slip > 0.1", [1, 0, 0, 0]),
        ("not (slip > 0.1 and terrain == 'rock')", [1, 0, 1, 1]),
        ("slip > 0.4 or slip_angle_deg == 0", [1, 1, 1, 1]),
        ("slip > 0.4 or terrain == 'sand'", [1, 1, 1, 1]),
        ("1 < 2 and slip > 0.4", [0, 1, 0, 1]),
        ("terrain == 'sand'", [1, 0, 1, 0]),
        ("terrain != 'rock'", [1, 0, 1, 1]),
        ('terrain == ""', [0, 0, 0, 1]),
        ("trial == 2", [0, 1, 1, 0]),
        ("trial == '2'", [0, 1, 1, 0]),
        ("2.0 == trial", [0, 1, 1, 0]),
        ("`load [kN]` > 0.15 and `load [kN]` < 0.35", [0, 1, 1, 0]),
        ("when >= '2026-11-21T09:00:00Z'", [0, 1, 0, 1]),
        ("when < '2026-11-21T10:00:00+02:00'", [0, 0, 0, 0]),
        ("not when < '2026-11-22'", [0, 0, 0, 1]),
    ],
)
def test_what_holds(text, expected):
    assert holds(text) == expected


@pytest.mark.parametrize(
    "text",
    [
        "",
        "slip",
        "slip = 0",
        "slip ==",
        "1 < 2",
        "'a' == 'a'",
        "slip > 0; slip < 1",
        "slip + 1 > 0",
        "abs(slip) > 0",
        "slip.real > 0",
        "slip[0] > 0",
        "slip in (1, 2)",
        "slip is None",
        "slip == None",
        "[x for x in slip]",
        "(lambda: 1)() == slip",
        "__import__('os').system('true') == slip",
        "`` == 1",
        "slip > 0 and " * 200 + "slip > 0",
        "(" * 300 + "slip > 0" + ")" * 300,
        "slip > \0",
    ],
)
def test_anything_else_is_refused(text):
    with pytest.raises(UsageError, match="--where: cannot read") as error:
        Condition(text)
    assert "slip_angle_deg == 0" in error.value.hint


@pytest.mark.parametrize(
    "text",
    [
        "slip == 'sand'",
        "terrain == slip",
        "terrain < 'sand'",
        "trial < 2",
        "when > 3",
        "when > 'noon'",
        "1 == 'a' == slip",
    ],
)
def test_what_cannot_be_compared_is_refused(text):
    condition = Condition(text)
    with pytest.raises(UsageError, match="--where"):
        condition.holds({name: TABLE[name] for name in condition.names})


def test_the_names_a_condition_reads():
    assert Condition("not (slip > 0 and `load [kN]` == trial)").names == {"slip", "load [kN]", "trial"}


terms = st.sampled_from(["slip", "slip_angle_deg", "0.5", "-3", "0"])
comparisons = st.tuples(st.just("slip"), st.sampled_from(["==", "!=", "<", "<=", ">", ">="]), terms).map(
    " ".join
)
conditions = st.recursive(
    comparisons,
    lambda inner: st.one_of(
        st.tuples(inner, st.sampled_from(["and", "or"]), inner).map(lambda t: f"({' '.join(t)})"),
        inner.map(lambda text: f"not ({text})"),
    ),
    max_leaves=6,
)
numbers = st.sampled_from([-3.0, 0.0, 0.5, 1.0])


@given(conditions, st.lists(st.tuples(numbers, numbers), min_size=1, max_size=8))
def test_where_nothing_is_missing_it_is_what_python_makes_of_it(text, rows):
    columns = {name: np.array([row[j] for row in rows]) for j, name in enumerate(["slip", "slip_angle_deg"])}
    expected = [bool(eval(text, {}, {"slip": a, "slip_angle_deg": b})) for a, b in rows]  # noqa: S307 - made above
    assert Condition(text).holds(columns).tolist() == expected


@given(conditions)
def test_a_missing_number_satisfies_neither_a_condition_nor_its_opposite(text):
    columns = {"slip": np.array([NAN]), "slip_angle_deg": np.array([NAN])}
    assert not Condition(text).holds(columns).any()
    assert not Condition(f"not ({text})").holds(columns).any()


def channels(n=3, **changes):
    """Channels of good samples; of a change the middle one has the value."""
    columns = {name: np.full(n, value) for name, value in GOOD.items()}
    for name, value in changes.items():
        columns[name][n // 2] = value
    return columns


def reasons(columns, time=None):
    found, _ = usable_samples.set_aside(columns, time, RADIUS, WIDTH)
    return [None if code < 0 else found.names[code] for code in found.codes]


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"load": NAN_OF_USABLE_SAMPLES}, "no load"),
        ({"torque": NAN_OF_USABLE_SAMPLES}, "no torque"),
        ({"sinkage": NAN_OF_USABLE_SAMPLES}, "no sinkage"),
        ({"slip": NAN_OF_USABLE_SAMPLES}, "no slip"),
        ({"load": INF}, "load is infinite"),
        ({"torque": -INF}, "torque is infinite"),
        ({"slip": INF}, "slip is infinite"),
        # ω infinite makes a slip of 1, which would look like a wheel that spins.
        ({"angular_velocity": INF, "slip": 1.0}, "angular_velocity is infinite"),
        ({"velocity": INF, "slip": -1.0}, "velocity is infinite"),
        ({"angular_velocity": 0.0, "slip": NAN_OF_USABLE_SAMPLES}, "wheel stands (ω = 0, slip undefined)"),
        ({"angular_velocity": 1e-3, "slip": NAN_OF_USABLE_SAMPLES}, "wheel stands (ω = 0, slip undefined)"),
        ({"slip": -0.01}, "wheel skids (slip < 0)"),
        ({"slip": -1.01}, "wheel turns against its course (slip < -1)"),
        # The ground goes on under a wheel that skids, if nothing else is wrong.
        ({"slip": -0.01, "load": 0.0}, "load not positive"),
        ({"slip": 1.01}, "wheel rolls against its drive (slip > 1)"),
        ({"sinkage": 0.0}, "sinkage not positive"),
        ({"sinkage": -0.002}, "sinkage not positive"),
        ({"sinkage": RADIUS}, "sinkage beyond the wheel radius"),
        ({"load": 0.0}, "load not positive"),
        ({"load": -80.0}, "load not positive"),
        # An overflow of 16 bits, and a number that stands for a missing value.
        ({"load": 65_535.0}, "load beyond what soil bears"),
        ({"load": 1e4, "sinkage": 0.1}, None),
        ({"torque": -9999.0}, "torque beyond what soil takes"),
        ({"torque": -999.0}, "torque beyond what soil takes"),
        ({"torque": 100.0}, None),
        ({"drawbar_pull": 32_767.0}, "drawbar_pull beyond what soil takes"),
        ({"drawbar_pull": -800.0}, None),
        ({"sinkage": 1e-9}, None),
        ({"torque": -0.1}, None),
        ({"slip": 0.0}, None),
        ({"slip": 1.0}, None),
    ],
)
def test_each_reason(changes, reason):
    assert reasons(channels(**changes)) == [None, reason, None]


@pytest.mark.parametrize(
    ("slip", "reason"),
    [(-0.01, None), (-0.99, None), (-1.0, None), (-1.01, "wheel turns against its course (slip < -1)")],
)
def test_the_whole_model_covers_a_wheel_that_skids(slip, reason):
    found, _ = usable_samples.set_aside(channels(slip=slip), None, RADIUS, WIDTH, skids=True)
    assert [None if code < 0 else found.names[code] for code in found.codes] == [None, reason, None]


def test_the_first_reason_counts():
    assert (
        reasons(channels(load=NAN_OF_USABLE_SAMPLES, torque=NAN_OF_USABLE_SAMPLES, sinkage=-1.0))[1]
        == "no load"
    )


def test_times():
    time = np.array([0.0, NAN_OF_USABLE_SAMPLES, 0.1, 0.1, 0.05, 0.2])
    expected = [None, "no time", None, "time repeated", "time runs backwards", None]
    assert reasons(channels(6), time) == expected


def test_without_wheel_speed_a_missing_slip_is_just_missing():
    columns = channels(slip=NAN_OF_USABLE_SAMPLES)
    del columns["angular_velocity"]
    assert reasons(columns)[1] == "no slip"


values = st.sampled_from([NAN_OF_USABLE_SAMPLES, INF, -INF, -1.0, 0.0, 1e-4, 0.01, 0.5, 1.0, 2.0, 80.0])


@given(st.lists(st.fixed_dictionaries(dict.fromkeys(GOOD, values)), min_size=1, max_size=12))
def test_what_is_used_can_be_used(rows):
    columns = {name: np.array([row[name] for row in rows]) for name in GOOD}
    found, _ = usable_samples.set_aside(columns, None, RADIUS, WIDTH)
    used = {name: column[found.codes < 0] for name, column in columns.items()}
    assert all(np.isfinite(used[name]).all() for name in GOOD if name not in {"angular_velocity", "velocity"})
    assert np.all((used["load"] > 0) & (used["sinkage"] > 0) & (used["sinkage"] < RADIUS))
    assert np.all((used["slip"] >= 0) & (used["slip"] <= 1))
    # A reason is there because it occurs.
    assert set(found.codes.tolist()) >= set(range(len(found.names)))


def judged(n, **where):
    """Reasons of n samples: reason → rows."""
    names = tuple(where)
    codes = np.full(n, -1, dtype=np.int32)
    for code, rows in enumerate(where.values()):
        codes[list(rows)] = code
    texts = {
        "stands": usable_samples.STANDS,
        "skids": usable_samples.SKIDS,
        "astray": usable_samples.BACKWARDS,
    }
    return Labels(codes, tuple(texts.get(name, name) for name in names))


@given(st.lists(st.floats(0.01, 3.0), min_size=1, max_size=40), st.floats(0.05, 2.0))
def test_stretches_never_join_across_a_gap_and_are_never_cut_without(steps, max_gap):
    time = np.concatenate([[0.0], np.cumsum(steps)])
    stretch = usable_samples.stretches(time, judged(len(time)), max_gap=max_gap)
    gaps = np.diff(time) > max_gap + 1e-6
    np.testing.assert_array_equal(np.diff(stretch), gaps.astype(int))


@given(st.integers(2, 60), st.data())
def test_unusable_samples_break_a_stretch_when_they_last_too_long(n, data):
    time = np.arange(n) * 0.1
    lost = data.draw(st.sets(st.integers(0, n - 1), max_size=n))
    stretch = usable_samples.stretches(time, judged(n, lost=lost), max_gap=0.5)
    usable = [j for j in range(n) if j not in lost]
    for a, b in pairwise(usable):
        assert (stretch[b] > stretch[a]) == (time[b] - time[a] > 0.5 + 1e-6)


def test_standing_does_not_interrupt_the_ground():
    time = np.arange(100) * 0.1
    standing = judged(100, stands=range(20, 80))
    assert usable_samples.stretches(time, standing, max_gap=0.5).max() == 0
    # But what is not recorded while it stands may be anything.
    time[50:] += 2.0
    stretch = usable_samples.stretches(time, standing, max_gap=0.5)
    assert (stretch[19], stretch[80]) == (0, 1)


def test_a_time_that_is_wrong_is_no_gap():
    time = np.arange(60) * 0.1 + 1e9
    time[30] = 0.0
    stretch = usable_samples.stretches(time, judged(60, astray=[30]), max_gap=0.5)
    assert stretch.max() == 0
    time[30] = NAN_OF_USABLE_SAMPLES
    assert usable_samples.stretches(time, judged(60, lost=[30]), max_gap=0.5).max() == 0


def test_runs_and_restarts():
    time = np.concatenate([np.arange(10), np.arange(10)]) * 0.1
    runs = Labels(np.repeat([0, 1, 0, 0], 5).astype(np.int32), ("a", "b"))
    stretch = usable_samples.stretches(time, judged(20), runs=runs, restarts=np.array([15]), max_gap=0.5)
    np.testing.assert_array_equal(stretch, np.repeat([0, 1, 2, 3], 5))


def test_without_a_clock_there_are_no_gaps():
    stretch = usable_samples.stretches(None, judged(4, lost=[1]), max_gap=0.0)
    np.testing.assert_array_equal(stretch, [0, 0, 0, 0])
    assert len(usable_samples.stretches(np.empty(0), judged(0), max_gap=1.0)) == 0


def test_skidding_does_not_interrupt_the_ground_either():
    time, reasons = np.arange(100) * 0.1, judged(100, skids=range(20, 80))
    assert not usable_samples.stretches(time, reasons, max_gap=0.5).any()
    np.testing.assert_array_equal(usable_samples.on_ground(judged(5, skids=[1], lost=[3])), [0, 1, 2, 4])


@pytest.mark.parametrize("lost", [0.0, 0.1, 0.2, 0.3, 0.4])
@pytest.mark.parametrize("empty", [False, True], ids=["rows", "cells"])
def test_samples_lost_at_random_do_not_cut_a_drive(lost, empty):
    rng = np.random.default_rng(3)
    time = np.arange(3000.0)
    there = rng.random(3000) >= lost
    # A pause of a minute does, whatever is lost besides.
    there[1000:1060] = False
    load = np.where(there, 80.0, np.nan)
    if not empty:
        time, load = time[there], load[there]
    n = len(time)
    channels = {"load": load, "torque": np.ones(n), "sinkage": np.full(n, 0.02), "slip": np.full(n, 0.2)}
    reasons, _ = usable_samples.set_aside(channels, time, 0.125, 0.1)
    gap = usable_samples.longest_gap(time, reasons, None)
    cut = usable_samples.stretches(time, reasons, max_gap=gap)
    assert cut[-1] == 1
    # What was asked for holds.
    assert usable_samples.longest_gap(time, reasons, 2.5) == 2.5
