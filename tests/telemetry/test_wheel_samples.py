from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from terrain_cli.telemetry.wheel_samples import match_name, words


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("front-left", {"front", "left"}),
        ("FrontLeftWheelJoint", {"front", "left"}),
        ("wheel_fl", {"fl"}),
        ("wheelfl", {"fl"}),
        ("wheel10", {"10"}),
        ("Wheel2Left", {"2", "left"}),
        ("rover1", {"rover1"}),
        ("wheel", {"wheel"}),
        ("--", set()),
    ],
)
def test_words(name, expected):
    assert words(name) == expected


@pytest.mark.parametrize(
    ("wanted", "names", "expected"),
    [
        ("front-left", ["front_left_wheel_joint", "front_right_wheel_joint"], "front_left_wheel_joint"),
        ("front-left", ["LeftFrontWheel", "LeftRearWheel"], "LeftFrontWheel"),
        ("front-left", ["frontleft", "rearleft"], "frontleft"),
        ("front-left", ["wheel_fl", "wheel_fr", "wheel_rl"], "wheel_fl"),
        ("fr", ["front_left", "front_right"], "front_right"),
        ("wheel1", ["wheel10", "wheel1", "wheel2"], "wheel1"),
        ("1", ["wheel_10", "wheel_1"], "wheel_1"),
        ("1", ["wheel_10"], None),
        ("1", ["rover1"], None),
        ("fl", ["flipper"], None),
        # The drive of the wheel, not what steers it.
        ("fl", ["fl_steer_joint", "fl_drive_joint"], "fl_drive_joint"),
        ("left", ["front_left", "rear_left"], None),
        ("wheel", ["wheel_fl", "wheel_fr"], None),
        ("", ["a"], None),
        ("a", [], None),
    ],
)
def test_the_one_that_means_the_same(wanted, names, expected):
    assert match_name(wanted, names) == expected


names = st.lists(st.text("abcFL_-1 ", max_size=8), max_size=5)


@given(st.text("abcFL_-1 ", max_size=8), names)
def test_the_answer_is_one_of_the_names_and_does_not_hang_on_their_order(wanted, others):
    found = match_name(wanted, others)
    assert found is None or found in others
    if len(set(others)) == len(others):
        assert match_name(wanted, others[::-1]) == found


@given(st.text("abcFL-1", min_size=1, max_size=8).filter(lambda text: text.strip("-")), names)
def test_an_equal_name_is_found(wanted, others):
    plain = wanted.replace("-", "").casefold()
    rest = [name for name in others if name.casefold().translate({ord(c): None for c in "_- "}) != plain]
    assert match_name(wanted, [*rest, wanted.replace("-", "_")]) == wanted.replace("-", "_")
