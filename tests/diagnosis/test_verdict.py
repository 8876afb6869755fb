"""The verdict is a function of what was found, and nothing else: as a table."""

import pytest

from terrain_cli.diagnosis.verdict import decide

STRESSES = "linearised-stresses"
AB = ("a", "b")


@pytest.mark.parametrize(
    ("found", "verdict", "effect", "family", "together", "tells_law", "rivals"),
    [
        pytest.param({}, "family", None, (), (), True, "family", id="nothing told apart"),
        pytest.param({"family": AB}, "family", None, AB, (), True, "family", id="a family"),
        pytest.param(
            {"family": ("a",), "clear": True}, "family", None, ("a",), (), True, "family", id="not earned"
        ),
        pytest.param(
            {"family": ("a",), "clear": True, "earned": True},
            "effect", "a", ("a",), (), True, "family", id="one name",
        ),
        pytest.param(
            {"family": AB, "law_alone": True}, "unknown", None, (), (), True, "", id="a law alone"
        ),
        pytest.param(
            {"pair": ("p", "q")}, "family", None, ("p", "q"), ("p", "q"), False, "family",
            id="a pair and no family",
        ),
        pytest.param(
            {"family": AB, "pair": ("p", "q"), "law_alone": True},
            "family", None, AB, ("p", "q"), False, "family", id="a pair before a law",
        ),
        pytest.param(
            {"family": ("a",), "clear": True, "earned": True, "pair": ("p", "q"), "pair_is_best": True},
            "family", None, ("p", "q"), ("p", "q"), False, "", id="a name gives way to a pair",
        ),
        pytest.param(
            {"family": ("a", "p"), "clear": True, "earned": True, "pair": ("p", "q")},
            "family", None, ("p", "q", "a"), ("p", "q"), False, "family", id="a name stays beside a pair",
        ),
        pytest.param(
            {"family": ("a",), "clear": True, "earned": True, "pair": ("p", "q"), "on_full_stresses": AB},
            "family", None, (STRESSES, "a", "b"), (STRESSES, "a"), False, "on_full_stresses",
            id="the stresses of the base before all",
        ),
    ],
)  # fmt: skip
def test_the_strongest_statement_wins(found, verdict, effect, family, together, tells_law, rivals):
    told = decide(**found)
    assert (told.verdict, told.effect, told.family) == (verdict, effect, family)
    assert (told.together, told.tells_law, told.rivals) == (together, tells_law, rivals)
