"""The verdict is a function of what was found, and nothing else: as a table."""

from dataclasses import replace

import numpy as np
import pytest
from hidden_drives import Kind, windows_of

from terrain_cli.diagnosis import diagnose
from terrain_cli.diagnosis.verdict import decide
from terrain_cli.mechanics.wheel_model import Model
from terrain_cli.models import ModelFile

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


def test_a_name_that_leaves_much_of_the_error_is_probable():
    """A motor that warms and cools, of which nothing was recorded: an efficiency is its mean."""
    (windows,) = windows_of(84, Kind(seconds=64.0, rate=10.0))
    samples = windows.samples
    torque = samples.channels["torque"] * (1.25 + 0.2 * np.sin(2.0 * np.pi * samples.time / 43.0))
    channels = {**samples.channels, "torque": torque}
    found = diagnose(
        [replace(windows, samples=replace(samples, channels=channels))], ModelFile(model=Model())
    )
    assert (found.verdict, found.effect, found.family) == ("family", None, ("gear-efficiency",))
    assert "Probable cause: gear-efficiency" in found.sentence
