"""Findings in words."""

import math

import pytest

from terrain_cli.comparison import shapes
from terrain_cli.comparison.findings import sentence_of
from terrain_cli.comparison.shapes import Shape

STRETCH = Shape(driver="time", name="stretch", at=40.0, until=59.95)
STEP = Shape(driver="slip", name="step", at=0.4, low=0.1, high=0.6, span=1.0)


@pytest.mark.parametrize(
    ("channel", "shape", "amplitude", "unit", "sentence"),
    [
        ("torque", STEP, 0.9, "1", "the model predicts 0.9 N m too little torque above slip 0.4"),
        ("torque", STRETCH, 1.6, "s", "the model predicts 1.6 N m too little torque from 40 s to 60 s"),
        (
            "sinkage",
            shapes.Shape(name="constant"),
            -0.0021,
            "",
            "the model predicts 2.1 mm too much sinkage throughout",
        ),
        (
            "drawbar_pull",
            Shape(driver="load", name="linear", at=None, low=60.0, high=100.0, span=1.0),
            4.0,
            "N",
            "the model predicts 4 N too little drawbar pull at load 100 N, compared with 60 N",
        ),
        (
            "torque",
            Shape(driver="wheel_angle", name="periodic", at=math.pi / 6.0, low=0.0, high=6.3, span=1.0),
            0.5,
            "rad",
            "the model misses an oscillation of ± 0.5 N m in torque, 12 times in a turn of the wheel",
        ),
        (
            "torque",
            Shape(driver="pitch", name="step", at=0.1, low=-0.2, high=0.2, span=1.0),
            0.9,
            "rad",
            "the model predicts 0.9 N m too little torque above pitch 5.7°",
        ),
        (
            "torque",
            Shape(driver="motor_temperature", name="saturating", at=5.0, low=20.0, high=60.0, span=1.0),
            -0.2,
            "°C",
            (
                "the model predicts 0.2 N m too much torque at motor temperature 60 °C, compared with 20 °C, "
                "most of it below 25 °C"
            ),
        ),
    ],
)
def test_sentences(channel, shape, amplitude, unit, sentence):
    assert sentence_of(channel, shape, amplitude, "", (), unit) == sentence


def test_what_varied_alike_is_said():
    text = sentence_of("torque", STEP, 0.9, "", ("time", "motor_temperature"), "1")
    assert text.endswith("(or time or motor temperature, which varied together with slip)")
    text = sentence_of("torque", STEP, 0.9, "", ("time", "speed", "motor_temperature", "load"), "1")
    assert text.endswith("(or time, speed or 2 further channels, which varied together with slip)")


LINE = Shape(driver="slip", name="linear", at=None, low=0.1, high=0.6, span=1.0)
TURN = Shape(driver="wheel_angle", name="periodic", at=math.pi, low=0.0, high=6.3, span=1.0)


@pytest.mark.parametrize(
    ("shape", "amplitude", "begins"),
    [
        (shapes.Shape(name="constant"), 0.9, "should predict 0.9 N m more torque throughout"),
        (STEP, -0.9, "should predict 0.9 N m less torque above slip 0.4"),
        (LINE, 0.9, "should predict 0.9 N m more torque at slip 0.6, compared with 0.1"),
        (TURN, 0.9, "misses an oscillation of ± 0.9 N m in torque, 2 times in a turn of the wheel"),
    ],
)
def test_of_what_the_soil_hides_no_error_is_claimed_that_the_table_does_not_show(shape, amplitude, begins):
    text = sentence_of("torque", shape, amplitude, "", (), "1", 0.1)
    assert text == f"the model {begins}; the fitted soil hides most of this error"
    assert "hides" not in sentence_of("torque", shape, amplitude, "", (), "1", 0.5)


def test_a_label_is_named():
    shape = Shape(driver="terrain", name="label", at=1.0, low=0.0, high=1.0, span=1.0)
    assert sentence_of("torque", shape, 0.3, "gravel", (), "") == (
        "the model predicts 0.3 N m too little torque where terrain is gravel, compared with the others"
    )
