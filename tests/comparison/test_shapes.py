import math
from dataclasses import replace

import numpy as np
import pytest

from terrain_cli.comparison import shapes


def test_a_driver_that_does_not_vary_has_no_shapes():
    assert shapes.of_number("slip", np.full(100, 0.3)) == []
    assert shapes.of_number("slip", np.full(100, np.nan)) == []
    assert shapes.of_label("terrain", np.zeros(10)) == []


def test_few_levels_are_steps_between_them():
    found = shapes.of_number("pass_number", np.repeat([0.0, 1.0], 50))
    assert [(shape.name, shape.at) for shape in found] == [("step", 0.5)]


def test_shapes_are_of_a_size_of_1():
    values = np.linspace(0.1, 0.6, 500)
    for shape in shapes.of_number("slip", values):
        assert np.ptp(shape(values)) == pytest.approx(shape.span, abs=0.05)


def test_periods_are_those_of_a_turn_and_not_faster_than_the_samples():
    angle = np.arange(0.0, 40.0, 0.1)
    found = shapes.of_turning("wheel_angle", [angle], (1, 12, 60))
    assert [round(2.0 * math.pi / shape.at) for shape in found] == [1, 1, 12, 12]
    assert found[0](angle) ** 2 + found[1](angle) ** 2 == pytest.approx(1.0)
    assert replace(found[0], partner=1) == found[1]


def test_a_wheel_that_hardly_turns_has_no_periods():
    assert shapes.of_turning("wheel_angle", [np.linspace(0.0, 6.0, 100)]) == []
