import math

import numpy as np
import pytest

from terrain_cli.comparison import finding_sentences, shapes
from terrain_cli.comparison.shapes import Shape


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
    assert found[0].partnered() == found[1]


def test_a_wheel_that_hardly_turns_has_no_periods():
    assert shapes.of_turning("wheel_angle", [np.linspace(0.0, 6.0, 100)]) == []


STEP = Shape(driver="slip", name="step", at=0.4, low=0.1, high=0.6, span=1.0)


@pytest.mark.parametrize(
    ("channel", "shape", "amplitude", "unit", "sentence"),
    [
        ("torque", STEP, 0.9, "1", "torque is under-predicted by 0.9 N m above slip 0.4"),
        ("sinkage", shapes.constant(), -0.0021, "", "sinkage is over-predicted by 2.1 mm throughout"),
        (
            "drawbar_pull",
            Shape(driver="load", name="linear", at=None, low=60.0, high=100.0, span=1.0),
            4.0,
            "N",
            "drawbar pull is more and more under-predicted as load rises: by 4 N from 60 N to 100 N",
        ),
        (
            "torque",
            Shape(driver="wheel_angle", name="periodic", at=math.pi / 6.0, low=0.0, high=6.3, span=1.0),
            0.5,
            "rad",
            "torque swings by ± 0.5 N m about its prediction, 12 times in a turn of the wheel",
        ),
        (
            "torque",
            Shape(driver="pitch", name="step", at=0.1, low=-0.2, high=0.2, span=1.0),
            0.9,
            "rad",
            "torque is under-predicted by 0.9 N m above pitch 5.7°",
        ),
        (
            "torque",
            Shape(driver="motor_temperature", name="saturating", at=5.0, low=20.0, high=60.0, span=1.0),
            -0.2,
            "°C",
            (
                "torque is more and more over-predicted as motor temperature rises: "
                "by 0.2 N m from 20 °C to 60 °C, most of it in the first 5 °C"
            ),
        ),
    ],
)
def test_sentences(channel, shape, amplitude, unit, sentence):
    assert finding_sentences.of(channel, shape, amplitude, "", (), unit) == sentence


def test_what_varied_alike_is_said():
    text = finding_sentences.of("torque", STEP, 0.9, "", ("time", "motor_temperature"), "1")
    assert text.endswith("(or with time or motor temperature, which varied alike)")


def test_what_the_soil_hides_of_it_is_said():
    text = finding_sentences.of("torque", STEP, 0.9, "", ("time",), "1", 0.1)
    assert "by 0.9 N m" in text
    assert "; the fitted soil takes up all but 0.09 N m of that (or with time" in text
    assert "takes up" not in finding_sentences.of("torque", STEP, 0.9, "", (), "1", 0.5)


def test_a_label_is_named():
    shape = Shape(driver="terrain", name="label", at=1.0, low=0.0, high=1.0, span=1.0)
    assert finding_sentences.of("torque", shape, 0.3, "gravel", (), "") == (
        "torque is under-predicted by 0.3 N m where terrain is gravel, against the others"
    )
