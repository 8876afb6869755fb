"""What is written as TOML reads back as it was."""

from __future__ import annotations

import tomllib
from datetime import UTC, date, datetime

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from terrain_cli.errors import ConfigurationError
from terrain_cli.vocabulary import toml_files

texts = st.text(st.characters(exclude_categories=["Cs"]))
numbers = st.integers(-(2**63), 2**63 - 1) | st.floats(allow_nan=False)
values = st.recursive(
    st.booleans() | numbers | texts, lambda inner: st.lists(inner) | st.dictionaries(texts, inner)
)


@given(st.text(st.characters(exclude_categories=["Cs"]), min_size=1))
def test_any_name_can_be_a_key(name):
    text = f"[wheels.{toml_files.key(name)}.channels]"
    assert tomllib.loads(text) == {"wheels": {name: {"channels": {}}}}


def test_a_plain_name_is_a_bare_key():
    assert toml_files.key("front-left_2") == "front-left_2"
    assert toml_files.key("slip-sinkage.n1") == '"slip-sinkage.n1"'


@given(values)
def test_any_value_reads_back(value):
    assert tomllib.loads(f"x = {toml_files.value(value)}") == {"x": value}


def test_dates_numpy_and_nothing():
    moment = datetime(2026, 11, 21, 8, 0, tzinfo=UTC)
    content = {
        "day": date(2026, 11, 21),
        "at": moment,
        "error": np.float64(0.25),
        "n": np.int64(3),
        "no": None,
    }
    read = tomllib.loads(f"x = {toml_files.value(content)}")["x"]
    assert read == {"day": date(2026, 11, 21), "at": moment, "error": 0.25, "n": 3}
    with pytest.raises(TypeError, match="TOML has no complex"):
        toml_files.value(1j)


KEYS = """
name = "text"
kind = { choice = ["rigid", "rocker"] }
count = { what = "a whole number from 1 to 3", low = 1, high = 3, whole = true }
place = { axes = "[x, z]", reach = 5.0 }
length = "length"
[inner]
steady = "flag"
"""


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"name": 1}, "name: must be text, not 1"),
        ({"kind": "rocket"}, "kind: must be one of rigid, rocker, not 'rocket'; did you mean rocker?"),
        ({"count": 4}, "count: must be a whole number from 1 to 3, not 4"),
        ({"place": [1.0, 2.0, 3.0]}, "place: must be [x, z] in m, not [1.0, 2.0, 3.0]"),
        ({"length": -1.0}, "length: must be a length, not -1.0"),
        ({"inner": {"steady": 1}}, "inner.steady: must be true or false, not 1"),
        ({"nam": "x"}, "nam: unknown key; did you mean name?"),
    ],
)
def test_rules_are_read_from_a_file_of_keys(given, said):
    rule = toml_files.rules(tomllib.loads(KEYS), {"length": toml_files.number("a length", 0.0)})
    right = {"name": "a", "count": 2, "place": [1.0, 5.0], "inner": {"steady": True}}
    assert rule(right, "file: ") == {**right, "place": (1.0, 5.0)}
    with pytest.raises(ConfigurationError) as error:
        rule(given, "file: ")
    assert str(error.value) == f"file: {said}"
