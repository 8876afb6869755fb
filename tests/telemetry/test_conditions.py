from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from formats import Labels
from terrain_cli.errors import UsageError
from terrain_cli.telemetry import Condition

NAN = float("nan")
TABLE = {
    "slip": np.array([0.1, 0.5, NAN, 0.9]),
    "slip_angle_deg": np.array([0.0, 15.0, 0.0, 0.0]),
    "terrain": Labels(np.array([0, 1, 0, -1], dtype=np.int32), ("sand", "rock")),
    "trial": Labels(np.array([0, 1, 1, 0], dtype=np.int32), ("1", "2")),
    "load [kN]": np.array([0.1, 0.2, 0.3, 0.4]),
    "when": np.array(["2026-11-21T08:00", "2026-11-21T09:00", "NaT", "2026-11-22"], "datetime64[ns]"),
}


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
